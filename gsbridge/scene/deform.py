"""Non-rigid editing: deform the mesh that splats are bound to, and they follow.

A deformation maps vertices to vertices. The binding then places every splat anew in its deformed face, with the face's new
normal, axes and size (Wu et al., RL-GSBridge, equation 2). The examples act on the whole height of the object, so that they
leave its foot on the table.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.splats.binding import Binding
from gsbridge.splats.cloud import Cloud

Deformation = Callable[[Array], Array]
"""Positions of all vertices, m, to their deformed positions. [V, 3] -> [V, 3]."""


def deform(binding: Binding, deformation: Deformation) -> Cloud:
    """Splats on a deformed mesh, in the frame of the binding.

    Args:
        binding: Splats bound to a mesh: `games`, `soft` or `refined`.
        deformation: See `Deformation`; gets a copy of the rest positions.

    Raises:
        InputError: The splats are unbound.
        ValueError: The deformation changes the number of vertices, or gives a position that is no number.
    """
    if binding.kind == "unbound":
        raise InputError("splats: binding", "unbound splats do not follow a mesh", "Train them as games, soft or refined")
    vertices = np.asarray(deformation(binding.vertices.copy()), dtype=np.float64)
    if vertices.shape != binding.vertices.shape or not np.isfinite(vertices).all():
        raise ValueError("a deformation must give one finite position for each vertex")
    return binding.evaluate(vertices)


def _span(vertices: Array) -> tuple[Array, float, Array]:
    """Middle of the footprint's bounds [3], height, and the relative height of each vertex, 0..1 [V]."""
    low, high = vertices.min(0), vertices.max(0)
    height = max(float(high[2] - low[2]), 1e-12)
    return np.array([*(0.5 * (low + high))[:2], low[2]]), height, (vertices[:, 2] - low[2]) / height


def bend(angle: float, heading: float = 0.0) -> Deformation:
    """Bend the upright axis into an arc, whose top leans by `angle`.

    Args:
        angle: Turn of the top, rad.
        heading: Direction it leans to, about z from +x, rad.

    Source: Barr, "Global and local deformations of solid primitives", 1984.
    """

    def apply(vertices: Array) -> Array:
        if abs(angle) < 1e-12:
            return vertices
        middle, height, share = _span(vertices)
        towards = np.array([np.cos(heading), np.sin(heading), 0.0])
        offset = vertices - middle
        along = offset @ towards
        turn = angle * share
        radius = height / angle
        # A slice at height h moves to the end of an arc of length h and leans by its angle.
        out = offset - np.outer(along, towards)
        out[:, 2] = (radius - along) * np.sin(turn)
        return middle + out + np.outer(radius - (radius - along) * np.cos(turn), towards)

    return apply


def twist(angle: float) -> Deformation:
    """Turn each slice about the upright axis in proportion to its height; the top by `angle`, rad. Source: Barr, 1984."""

    def apply(vertices: Array) -> Array:
        middle, _, share = _span(vertices)
        offset = vertices - middle
        c, s = np.cos(angle * share), np.sin(angle * share)
        turned = np.stack([c * offset[:, 0] - s * offset[:, 1], s * offset[:, 0] + c * offset[:, 1], offset[:, 2]], axis=1)
        return middle + turned

    return apply


def bulge(amount: float) -> Deformation:
    """Widen the slices by up to `1 + amount` at half height, keeping foot and top; negative amounts pinch."""

    def apply(vertices: Array) -> Array:
        middle, _, share = _span(vertices)
        factor = 1.0 + amount * np.sin(np.pi * share)
        return middle + (vertices - middle) * np.stack([factor, factor, np.ones_like(factor)], axis=1)

    return apply
