"""Non-rigid editing: deform the mesh that splats are bound to, and they follow.

A deformation maps vertices to vertices. The binding then places every splat anew in its deformed face, with the face's new
normal, axes and size (Wu et al., RL-GSBridge, equation 2). All deformations leave the object's foot on the table. `bend` and
`twist` act on a range of heights, which may be the whole object or a neck; `pull` acts on the neighbourhood of one point.
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
    return binding.evaluate(deformed_vertices(binding, deformation))


def deformed_vertices(binding: Binding, deformation: Deformation) -> Array:
    """Positions of the binding's vertices after a deformation, m. [V, 3].

    Raises:
        ValueError: The deformation changes the number of vertices, or gives a position that is no number.
    """
    vertices = np.asarray(deformation(binding.vertices.copy()), dtype=np.float64)
    if vertices.shape != binding.vertices.shape or not np.isfinite(vertices).all():
        raise ValueError("a deformation must give one finite position for each vertex")
    return vertices


def shift_only(binding: Binding, deformation: Deformation) -> Cloud:
    """Control for `deform`: centres follow the mesh, but orientations and sizes stay those of the rest mesh.

    This is what remains of the edit without recomputed normals and face axes; it opens gaps and spikes wherever faces turn
    or stretch. Arguments and errors as in `deform`.
    """
    rest, moved = binding.evaluate(), deform(binding, deformation)
    return Cloud(moved.means, rest.quats, rest.scales, rest.opacities, rest.colours, rest.harmonics)


def sequence(*deformations: Deformation) -> Deformation:
    """Return the deformation that applies several, the first one first."""

    def apply(vertices: Array) -> Array:
        for deformation in deformations:
            vertices = deformation(vertices)
        return vertices

    return apply


def _heights(vertices: Array, low: float, high: float) -> tuple[Array, float, Array]:
    """Foot of the axis, length of the range, and how far up the range each vertex stands.

    The axis is upright and goes through the middle of the bounds of the vertices in and above the range.

    Args:
        vertices: Vertices of the mesh, m. [V, 3].
        low, high: The range, as shares of the object's height.

    Returns:
        A point on the axis at the range's lower end [3]; the range's length, m; the share of the range below each vertex,
        0..1 [V].
    """
    bottom, top = vertices[:, 2].min(), vertices[:, 2].max()
    height = max(float(top - bottom), 1e-12)
    share = (vertices[:, 2] - bottom) / height
    part = vertices[share >= low - 1e-9, :2]
    middle = 0.5 * (part.min(0) + part.max(0))
    return np.array([*middle, bottom + low * height]), (high - low) * height, np.clip((share - low) / (high - low), 0, 1)


def _check_range(low: float, high: float) -> None:
    if not 0 <= low < high <= 1:
        raise ValueError(f"a range of heights goes up within 0..1, not from {low} to {high}")


def bend(angle: float, heading: float = 0.0, *, low: float = 0.0, high: float = 1.0) -> Deformation:
    """Bend the upright axis into an arc whose top leans by `angle`; the part above the range leans rigidly.

    Args:
        angle: Turn of the top, rad.
        heading: Direction that the top leans to, about z from +x, rad.
        low, high: Range of heights that bends, as shares of the object's height.

    Raises:
        ValueError: The range is empty or not within 0..1.

    Source: Barr, "Global and local deformations of solid primitives", 1984.
    """
    _check_range(low, high)

    def apply(vertices: Array) -> Array:
        if abs(angle) < 1e-12:
            return vertices
        foot, length, share = _heights(vertices, low, high)
        towards = np.array([np.cos(heading), np.sin(heading), 0.0])
        offset = vertices - foot
        along = offset @ towards
        turn = angle * share
        radius = length / angle
        # A slice at height h moves to the end of an arc of length h and leans by its angle; beyond it the axis is straight.
        beyond = offset[:, 2] - length * share
        out = offset - np.outer(along, towards)
        out[:, 2] = (radius - along) * np.sin(turn) + beyond * np.cos(turn)
        return foot + out + np.outer(radius - (radius - along) * np.cos(turn) + beyond * np.sin(turn), towards)

    return apply


def twist(angle: float, *, low: float = 0.0, high: float = 1.0) -> Deformation:
    """Turn each slice about the upright axis in proportion to its height; the part above the range turns rigidly.

    Args:
        angle: Turn of the top, rad.
        low, high: Range of heights that twists, as shares of the object's height.

    Raises:
        ValueError: The range is empty or not within 0..1.

    Source: Barr, 1984.
    """
    _check_range(low, high)

    def apply(vertices: Array) -> Array:
        foot, _, share = _heights(vertices, low, high)
        offset = vertices - foot
        c, s = np.cos(angle * share), np.sin(angle * share)
        turned = np.stack([c * offset[:, 0] - s * offset[:, 1], s * offset[:, 0] + c * offset[:, 1], offset[:, 2]], axis=1)
        return foot + turned

    return apply


def bulge(amount: float) -> Deformation:
    """Widen the slices by up to `1 + amount` at half height, keeping foot and top; negative amounts pinch."""

    def apply(vertices: Array) -> Array:
        foot, _, share = _heights(vertices, 0.0, 1.0)
        factor = 1.0 + amount * np.sin(np.pi * share)
        return foot + (vertices - foot) * np.stack([factor, factor, np.ones_like(factor)], axis=1)

    return apply


def pull(direction: Array, reach: float, radius: float) -> Deformation:
    """Pull out the point that lies farthest in a direction; its neighbours follow less the farther they are from it.

    Args:
        direction: Direction of the pull, which also chooses the point. [3].
        reach: How far the point moves, as a share of the object's height.
        radius: Distance from the point at which nothing moves any more, as a share of the object's height.

    Raises:
        ValueError: The direction has no length, or the radius is not positive.

    Source: Wendland, Advances in Computational Mathematics 4, 1995, for the falloff, which is twice differentiable.
    """
    length = float(np.linalg.norm(direction))
    if not (length > 0 and radius > 0):
        raise ValueError("a pull needs a direction and a radius above 0")
    towards = np.asarray(direction, dtype=np.float64) / length

    def apply(vertices: Array) -> Array:
        height = float(np.ptp(vertices[:, 2]))
        handle = vertices[int(np.argmax(vertices @ towards))]
        near = np.clip(np.linalg.norm(vertices - handle, axis=1) / max(radius * height, 1e-12), 0, 1)
        falloff = (1 - near) ** 4 * (4 * near + 1)
        return vertices + np.outer(reach * height * falloff, towards)

    return apply
