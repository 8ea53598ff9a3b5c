"""A floor under a background's splats: what shows through their gaps then has the table's colour instead of black.

Trained splats let a little of the light through, more near the camera, where the gaps between them grow on the image. A coarse,
opaque layer some way below the surface catches it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from gsbridge.meshes import Mesh
from gsbridge.scene.link_splats import splats_on_mesh
from gsbridge.splats.cloud import Cloud, concatenate

COUNT = 1500
DEPTH = 0.05
"""Below the surface, m. Splats blend by the depth of their centres, so a layer close below would come out in front of its
neighbours in slanting views."""

_OVERLAP = 3.2
"""More than on closed meshes: there is no second layer behind, and blurred edges do not matter here."""

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
    # A splat counts by the light it sends: opacity times area, the two larger of its axes.
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
