"""Densities: what a body weighs per volume it fills."""

from __future__ import annotations

from typing import Final

from gsbridge.errors import InputError

DENSITIES: Final = {
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
"""Bulk densities by material, kg/m3: handbook values for solids, typical ones for what holds air; weighing beats both."""

LIGHTEST, HEAVIEST = 5.0, 25_000.0
"""Foam of the lightest kind and a little more than gold, kg/m3: anything beyond is a slip of the unit."""


def density_of(value: str | float, source: str = "asset: density") -> float:
    """Density of a material's name, or the number itself, kg/m3.

    Args:
        value: A key of `DENSITIES`, or kg/m3.
        source: Where the value was written, for the error.

    Raises:
        InputError: The material is unknown, or the number is no density.
    """
    if isinstance(value, str):
        if value not in DENSITIES:
            raise InputError(source, f"the material '{value}' is unknown", f"Use kg/m3 or one of {', '.join(DENSITIES)}")
        return DENSITIES[value]
    if isinstance(value, bool) or not LIGHTEST <= value <= HEAVIEST:
        raise InputError(
            source,
            f"{value} is no density in kg/m3",
            f"Give {LIGHTEST:g} to {HEAVIEST:g}, or a material: {', '.join(DENSITIES)}",
        )
    return float(value)
