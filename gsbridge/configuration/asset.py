"""Settings of the bodies for simulators."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gsbridge.configuration.base import Number, Positive, Settings, Whole

Material = Literal[
    "foam", "plush", "cardboard", "cork", "sponge_cake", "wood", "fruit", "water", "plastic", "rubber", "ceramic", "stone",
    "aluminium", "steel",
]  # fmt: skip
"""A material whose density is known, see `gsbridge.asset.density`."""
Density = Annotated[Number, Field(ge=5, le=25_000)] | Material
"""kg/m3, or a material. The lightest foam and a little more than gold: anything beyond is a slip of the unit."""


class AssetSection(Settings):
    """How an object becomes a rigid body, whatever it is made of."""

    binding: Literal["games", "soft", "refined", "unbound", "games_vertices"] = "refined"
    """Binding of the splats that the bundle carries."""
    concavity: Positive = Field(default=0.005, le=1)
    """Dents up to this depth are filled by the convex hulls, m."""
    most_hulls: Whole = Field(default=12, ge=1, le=200)
    """Largest number of convex hulls."""
    hull_vertices: Whole = Field(default=64, ge=4, le=1000)
    """Largest number of vertices of a hull; each costs time in every contact."""
    hull_tolerance: Number = Field(default=0.0003, ge=0, le=0.1)
    """How far a hull may be cut back to save vertices, m."""
    foot: Number = Field(default=0.001, ge=0, le=0.1)
    """Height up to which the lowest part of the surface counts as the foot that stood on the table, m."""
    margin: Number = Field(default=0.001, ge=0, le=0.01)
    """Collision margin of the engine, by which the hulls it gets are made smaller all round, m."""
    largest: Positive = Field(default=0.5, le=100)
    """Upper bound of a body's longest side; beyond it the scale must be wrong, m."""
    smallest: Positive = Field(default=0.005, le=100)
    """Lower bound of a body's longest side, m."""
    floating: Number = Field(default=0.005, ge=0, le=0.1)
    """Largest gap between table and lowest point that is mended by moving the body; more is an error, m."""


class AssetSettings(AssetSection):
    """How one object becomes a rigid body."""

    density: Density = "wood"
    """Density for the mass, kg/m3, or a material."""
