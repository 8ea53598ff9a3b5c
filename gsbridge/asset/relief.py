"""The raised part of a background's table, such as a plate on which objects are placed and which they bump against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh

RAISED = 0.003
"""Smallest height over the table, m, of a raised part; lower ones may be unevenness of the reconstruction."""

SMALLEST = 0.03
"""Smallest radius, m, of a raised part on which objects can be placed."""

RELIEF_URDF = "relief.urdf"
"""Name of the relief's description in the folder of the asset's hulls."""

COLLISION_FACES = 800
"""Largest number of triangles of the body. With the several thousand of a reconstruction, the physics of an object on a plate
takes longer than the control step that it simulates. This number changes the surface by less than a millimetre."""

_DISC = np.array([[r * np.cos(a), r * np.sin(a)] for r in (0.2, 0.6, 1.0) for a in np.arange(8) * np.pi / 4])
_INNER = 0.5
"""Share of the radius within which the height of the middle is measured."""


@dataclass(frozen=True)
class Relief:
    """The largest raised part of a background, table frame.

    Args:
        x, y: Middle of the plate, m.
        radius: Radius of a disc with the same area, m.
        height: Height of the surface in its middle over the table, m.
        highest: Height of its rim, m.
    """

    x: float
    y: float
    radius: float
    height: float
    highest: float

    @classmethod
    def from_json(cls, content: Mapping[str, Any] | None) -> Relief | None:
        """Relief of a record's entry; None for a flat background. Damage raises KeyError, TypeError or ValueError."""
        return None if content is None else cls(**{key: float(value) for key, value in content.items()})


def find_relief(mesh: Mesh) -> tuple[Relief, Mesh] | None:
    """Find the largest raised part of a background.

    Args:
        mesh: Surface of the background, table frame, m.

    Returns:
        The relief, and the part of the mesh that belongs to it, down to where it meets the table; None for a flat background.
    """
    raised = mesh.vertices[:, 2] > RAISED
    faces = mesh.faces[raised[mesh.faces].all(1)]
    if len(faces) == 0:
        return None
    count = len(mesh.vertices)
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    labels = connected_components(coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count)), directed=False)[1]
    areas = np.bincount(labels[faces[:, 0]], weights=Mesh(mesh.vertices, faces).areas(), minlength=labels.max() + 1)
    own = np.unique(faces[labels[faces[:, 0]] == np.argmax(areas)])
    # Middle and radius come from areas, since single vertices of the outline may lie far off. The surface is flattened first,
    # because a steep rim would weigh more otherwise.
    flat = Mesh(mesh.vertices * (1.0, 1.0, 0.0), faces[labels[faces[:, 0]] == labels[own[0]]])
    weights = flat.areas()
    middle = np.average(flat.corners()[..., :2].mean(1), axis=0, weights=weights)
    radius = float(np.sqrt(weights.sum() / np.pi))
    if radius < SMALLEST:
        return None
    # Add the neighbouring triangles: the foot of the raised part, where it meets the table.
    member = np.zeros(count, bool)
    member[own] = True
    for _ in range(2):
        member[mesh.faces[member[mesh.faces].any(1)]] = True
    kept = mesh.faces[member[mesh.faces].all(1)]
    used, renumbered = np.unique(kept, return_inverse=True)
    inner = middle + _INNER * radius * _DISC
    height = float(np.nanmedian([_height(mesh, point) for point in inner]))
    relief = Relief(float(middle[0]), float(middle[1]), radius, height, float(mesh.vertices[own, 2].max()))
    return relief, Mesh(mesh.vertices[used], renumbered.reshape(-1, 3))


def simplified(surface: Mesh, faces: int = COLLISION_FACES) -> Mesh:
    """Reduce a surface to few triangles, for collisions; a surface that has few already stays as it is.

    Args:
        surface: Part of a mesh, m.
        faces: Largest number of triangles.
    """
    if len(surface.faces) <= faces:
        return surface
    o3d = import_open3d()
    fine = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), o3d.utility.Vector3iVector(surface.faces.astype(np.int32))
    )
    coarse = fine.simplify_quadric_decimation(faces)
    return Mesh(np.asarray(coarse.vertices), np.asarray(coarse.triangles, dtype=surface.faces.dtype))


def _height(mesh: Mesh, point: Array) -> float:
    """Height of the surface's top at x, y [2], m; NaN beside the mesh."""
    a, b, c = np.moveaxis(mesh.corners(), 1, 0)
    first, second, to_point = (b - a)[:, :2], (c - a)[:, :2], point - a[:, :2]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(np.abs(area) < 1e-15, np.nan, area)
    u = (to_point[:, 0] * second[:, 1] - to_point[:, 1] * second[:, 0]) / area
    v = (first[:, 0] * to_point[:, 1] - first[:, 1] * to_point[:, 0]) / area
    hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    heights = (a[:, 2] + u * (b - a)[:, 2] + v * (c - a)[:, 2])[hit]
    return float(heights.max()) if len(heights) else float("nan")
