"""An opaque layer under a background's splats: their gaps then show the table's colour instead of black.

Trained splats let a little light through, and more of it near the camera, where the gaps between them are larger in the image.
A coarse, opaque layer some way below the surface fills these gaps.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from gsbridge.meshes import Mesh
from gsbridge.scene.link_splats import splats_on_mesh
from gsbridge.splats.cloud import Cloud, concatenate

COUNT = 1500
DEPTH = 0.05
"""Depth of the layer below the surface, m. Splats are sorted by the depth of their centres, so that in slanting views a layer
closer to the surface would be drawn in front of some splats above it."""

_OVERLAP = 3.2
"""Overlap of the layer's discs (see `link_splats.OVERLAP`), larger than on closed meshes: there is no second layer behind, and
blurred edges do not matter here."""

_NEIGHBOURS = 12


def with_underlay(cloud: Cloud, mesh: Mesh, *, count: int = COUNT, depth: float = DEPTH, seed: int = 0) -> Cloud:
    """A background with an opaque layer below it, coloured like the splats above.

    Args:
        cloud: Splats of the background, table frame.
        mesh: Surface of the background with upward normals, table frame.
        count: Splats of the layer.
        depth: How far the layer lies below the surface, against its normals, m.
        seed: Seed of the layer's places.

    Returns:
        The splats of the background, then those of the layer.
    """
    tree = cKDTree(cloud.means)
    # Each splat's weight is its opacity times the area that its two larger axes span.
    size = np.sort(cloud.scales.astype(np.float64), axis=1)[:, 1:].prod(1) * cloud.opacities

    def colour(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        nearest = tree.query(points, k=min(_NEIGHBOURS, len(cloud)))[1].reshape(len(points), -1)
        share = size[nearest] / np.maximum(size[nearest].sum(1, keepdims=True), 1e-30)
        return np.einsum("nk,nkc->nc", share, cloud.colours[nearest])

    vertex_normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(vertex_normals, mesh.faces[:, corner], mesh.normals() * mesh.areas()[:, None])
    vertex_normals /= np.maximum(np.linalg.norm(vertex_normals, axis=1, keepdims=True), 1e-30)
    lowered = Mesh(mesh.vertices - depth * vertex_normals, mesh.faces)
    return concatenate([cloud, splats_on_mesh(lowered, count, colour, seed, overlap=_OVERLAP)])
