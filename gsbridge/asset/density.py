"""Bulk densities of materials."""

from __future__ import annotations

from typing import Final

from gsbridge.configuration.asset import Material

DENSITIES: Final[dict[Material, float]] = {
    "foam": 30.0,
    "plush": 120.0,  # fabric with its stuffing
    "cardboard": 150.0,  # a box with air in it
    "cork": 200.0,
    "sponge_cake": 350.0,
    "wood": 600.0,
    "fruit": 950.0,
    "water": 1000.0,
    "plastic": 1050.0,  # solid ABS or polystyrene
    "rubber": 1200.0,
    "ceramic": 2300.0,
    "stone": 2600.0,
    "aluminium": 2700.0,
    "steel": 7850.0,
}
"""Bulk densities by material, kg/m3: handbook values for solids, typical values for materials that hold air. Weighing the
object is more accurate than either."""
