"""Settings of the asset stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AssetSettings:
    """How an object becomes a rigid body. Lengths in metres.

    Args:
        binding: Binding of the splats that the bundle carries: `games`, `soft`, `refined` or `unbound`.
        density: kg/m3, or a material of `gsbridge.asset.density`; set per scene.
        concavity: Dents up to this depth are filled by the convex hulls.
        most_hulls: Hulls, at most.
        hull_vertices: Vertices of a hull, at most: contacts cost time with each.
        hull_tolerance: How far a hull may be cut back to save vertices.
        foot: Height up to which the lowest part of the surface counts as the foot that stood on the table.
        margin: Collision margin of the engine, by which the hulls it gets are made smaller all round.
        largest, smallest: Bounds of a body's longest side; beyond them the scale must be wrong.
        floating: Largest gap between table and lowest point that is mended by moving the body; more is an error.
    """

    binding: str = "refined"
    density: float | str = "wood"
    concavity: float = 0.005
    most_hulls: int = 12
    hull_vertices: int = 64
    hull_tolerance: float = 0.0003
    foot: float = 0.001
    margin: float = 0.001
    largest: float = 0.5
    smallest: float = 0.005
    floating: float = 0.005
