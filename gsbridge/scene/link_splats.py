"""Splats on a known mesh: the robot's links, drawn in the same call as the rest so that occlusion is right below the pixel.

Nothing is trained: discs are spread evenly over the surface, overlap enough to be opaque, and take their colour from the
configuration, from photos or from the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from gsbridge.geometry import Array, quat_from_rotation
from gsbridge.meshes import Mesh
from gsbridge.splats.cloud import Cloud

OVERLAP = 2.3
"""Standard deviation of a disc divided by that of the patch it covers. A smaller ratio leaves gaps at the patches' corners, a
larger one blurs edges. At this one, front and back of a closed mesh together let hardly any light through, and edges blur by
the size of a patch (see `link_fit`)."""

OPACITY = 0.99
"""The rasteriser clips alpha here."""

FLATNESS = 1e-5
"""Standard deviation along the normal, m."""

_CANDIDATES = 12
"""Surface points per splat from which patches are formed."""
_ROUNDS = 12

Colours = Sequence[float] | Array | Callable[[Array, Array], Array]
"""One sRGB colour [3]; one for each vertex [V, 3]; or a function from points and normals, [N, 3] each, to colours [N, 3]."""


def splats_on_mesh(mesh: Mesh, count: int, colours: Colours | None = None, seed: int = 0, *, overlap: float = OVERLAP) -> Cloud:
    """Opaque discs over a whole surface, evenly by area.

    Random points are grouped into the cells of a centroidal Voronoi tessellation on the surface (Lloyd's algorithm). Its
    distance includes the angle between normals, so that no cell reaches through a thin wall or round an edge. Each disc takes
    the place and the second moments of its cell, so that discs at edges and on narrow strips are as narrow as their cells.

    Args:
        mesh: Surface, m, in whatever frame the splats shall have.
        count: Splats.
        colours: sRGB, 0..1: one for all [3], one for each vertex [V, 3], or a function; see `Colours`. The mesh's own vertex
            colours when None.
        seed: Random seed.
        overlap: See `OVERLAP`.

    Raises:
        ValueError: The mesh has no area, there are no colours, or they do not fit the mesh.
    """
    areas = mesh.areas()
    total = float(areas.sum())
    if count < 1 or not total > 0:
        raise ValueError(f"{count} splats cannot cover a surface of {total} m2")
    points, normals, faces, weights = _sample(mesh, areas, max(_CANDIDATES * count, 64), np.random.default_rng(seed))
    # Two points whose normals differ by 90 degrees count as two patch widths apart.
    width = np.sqrt(total / count)
    features = np.concatenate([points, 2.0 * width / np.sqrt(2.0) * normals], axis=1)
    owner = _cells(features, count)
    centres, quats, spreads, chosen = _discs(points, normals, features, owner, width)
    shown = _colours(mesh, colours, centres, normals[chosen], faces[chosen], weights[chosen])
    scales = np.concatenate([np.full((len(centres), 1), FLATNESS), overlap * spreads], axis=1)
    return Cloud(centres, quats, scales, np.full(len(centres), OPACITY), np.clip(shown, 0.0, 1.0))


def _sample(mesh: Mesh, areas: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Points spread by area, one in each of `count` equal shares of it; their normals, faces and barycentric weights."""
    shares = (np.arange(count) + rng.random(count)) / count * areas.sum()
    faces = np.minimum(np.searchsorted(np.cumsum(areas), shares, side="right"), len(areas) - 1)
    u, v = rng.random((2, count))
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    points = np.einsum("nk,nki->ni", weights, mesh.corners()[faces])
    return points, mesh.normals()[faces], faces, weights


def _cells(features: Array, count: int) -> Array:
    """Number of the cell that each point belongs to, after some rounds of Lloyd's algorithm. [N]."""
    # The points run along the faces in order, so that equal steps through them start near an even spread.
    centres = features[np.linspace(0, len(features) - 1, count).astype(int)]
    for _ in range(_ROUNDS):
        owner = np.asarray(cKDTree(centres).query(features)[1])
        sizes = np.bincount(owner, minlength=len(centres))
        sums = np.stack([np.bincount(owner, column, minlength=len(centres)) for column in features.T], axis=1)
        centres = sums[sizes > 0] / sizes[sizes > 0, None]
    return np.unique(cKDTree(centres).query(features)[1], return_inverse=True)[1]


def _discs(points: Array, normals: Array, features: Array, owner: Array, width: float) -> tuple[Array, Array, Array, Array]:
    """Centre, orientation and standard deviations in the surface of each cell, and the point that lies nearest its centre."""
    count = int(owner.max()) + 1
    sizes = np.bincount(owner)

    def mean(values: Array) -> Array:
        return np.stack([np.bincount(owner, column) for column in values.T], axis=1) / sizes[:, None]

    distance = np.linalg.norm(features - mean(features)[owner], axis=1)
    order = np.lexsort((distance, owner))
    chosen = order[np.searchsorted(owner[order], np.arange(count))]
    axis = normals[chosen]
    # The centroid of a curved cell lies off the surface; its foot in the nearest point's plane does not.
    centroid = mean(points)
    centres = centroid - ((centroid - points[chosen]) * axis).sum(1, keepdims=True) * axis
    offsets = points - centres[owner]
    second = mean((offsets[:, :, None] * offsets[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
    flat = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    # A variance added along the normal, larger than any in the surface, makes the normal the eigenvector of the largest value.
    values, vectors = np.linalg.eigh(flat @ second @ flat + (10.0 * width) ** 2 * axis[:, :, None] * axis[:, None, :])
    frame = np.stack([vectors[:, :, 2], vectors[:, :, 1], vectors[:, :, 0]], axis=-1)
    frame[:, :, 2] = np.cross(frame[:, :, 0], frame[:, :, 1])
    # A cell of one or two samples has no spread of its own, so spreads are bounded.
    spreads = np.sqrt(np.clip(values[:, 1::-1], (0.05 * width) ** 2, width**2))
    return centres, quat_from_rotation(frame), spreads, chosen


def _colours(mesh: Mesh, colours: Colours | None, points: Array, normals: Array, faces: Array, weights: Array) -> Array:
    """Colour of each splat. [N, 3]."""
    if callable(colours):
        return np.asarray(colours(points, normals), dtype=np.float64)
    given = mesh.colours if colours is None else np.asarray(colours, dtype=np.float64)
    if given is None:
        raise ValueError("the mesh has no colours; give some")
    if given.shape == (3,):
        return np.tile(given, (len(points), 1))
    if given.shape != mesh.vertices.shape:
        raise ValueError(f"colours must be [3] or {mesh.vertices.shape}, not {given.shape}")
    return np.einsum("nk,nki->ni", weights, given[mesh.faces[faces]])
