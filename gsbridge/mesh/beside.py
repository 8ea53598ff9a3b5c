"""A check for parts of an object that all masks lost: stereo depth right beside the masks, above the table.

Masks made by the table's colour lose, say, a chimney of that colour in every photo. They then agree with each other, with their
hull and with the mesh. Stereo does not depend on colour models and finds such a part. But a stereo patch that contains the
object's outline gives the object's depth to pixels beside the object, as far as the patch reaches, and in small photos that is
farther than a lost part may be. So only depth beyond a patch's reach counts: beside a plain cube 65 px wide, 161 points lay
farther off than 5 % of its size without this rule, 43 of them in one place; with it 3 do.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gsbridge.cameras import Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.geometry import Array
from gsbridge.mesh.depth import depth_cloud
from gsbridge.mesh.hull import build_hull
from gsbridge.mesh.repair import depth_inside
from gsbridge.meshes import Mesh

_AROUND = 0.12
"""Width of the band beyond the patches on a mask's outline in which depth is searched, as a share of the root of its area."""
_VOXELS = 96
"""Samples of the hull of the widened masks."""
_ACROSS = 32
"""Depths wanted along the root of a mask's area: enough to notice a lost part, too few to reconstruct it."""
_OFF = 0.05
"""Points farther than this from the mesh, as a share of its size, do not belong to it."""
_LOW = 0.06
"""Points lower than this, as a share of the mesh's size, may be the table's and do not count."""
_PART = 0.003
"""A cluster with at least this share of all points is a part of the object: chance clusters are smaller, a chimney larger."""
_FEWEST = 20
"""Fewest points of such a cluster."""


def points_beside(views: Views, masks: Sequence[Array], settings: MeshSettings, seed: int = 0, threads: int = 1) -> Array:
    """Measure points on the object and on its surroundings that depth maps agree on. [N, 3].

    Args:
        views, masks: Photos and masks. [H, W] each.
        settings: See `MeshSettings`; depth is measured at half their density, more sparsely in large photos.
        seed: Random seed.
        threads: Threads to use.
    """
    wide, across = [], []
    for view, mask in zip(views, masks, strict=True):
        # Square brushes are cheap at any size.
        root = float(np.sqrt((mask > 0.5).sum()))
        shrink = min(1.0, settings.image_width / view.camera.width)
        reach = 1 + round(_AROUND * root + settings.window / shrink)
        across.append(root * shrink)
        wide.append(cv2.dilate((mask > 0.5).astype(np.float32), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)))
    hull = build_hull(views, wide, vote=settings.hull_vote, voxels=_VOXELS, width=settings.image_width, threads=threads)
    rough = settings.model_copy(update={"stride": max(2 * settings.stride, int(np.median(across) / _ACROSS))})
    return depth_cloud(views, wide, hull, rough, seed, threads, own=masks).points


def beside_doubts(mesh: Mesh, points: Array) -> list[str]:
    """Report a cluster of measured points beside a mesh, which may be a part that the mesh lacks.

    Args:
        mesh: Mesh of the object, standing on z = 0.
        points: Measured points, m; see `points_beside`. [N, 3].
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if len(points) == 0:
        return []
    off = points[(depth_inside(mesh, points) < -_OFF * size) & (points[:, 2] > _LOW * size)]
    if len(off) < _FEWEST:
        return []
    pairs = cKDTree(off).query_pairs(_OFF * size, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(off), len(off)))
    heaps = connected_components(graph, directed=False)[1]
    most = int(np.argmax(np.bincount(heaps)))
    heap = off[heaps == most]
    if len(heap) < max(_FEWEST, _PART * len(points)):
        return []
    height = 100 * float(heap[:, 2].mean()) / float(mesh.vertices[:, 2].max())
    return [
        f"{len(heap)} points are measured in one place beside the mesh, at {height:.0f} % of its height: a part of the object "
        "that the masks leave out (mark it with `masks: {points: ...}`), or something that stands too near"
    ]
