"""How well splats cover a surface and show its colours, measured before and after an edit.

No photo shows the deformed object, so nothing here is an error against reality. Two things can be measured all the same.
*Geometry*: the deformed mesh is known exactly. Splats that follow it must cover its silhouette (no holes) and stay within it
(no spikes). The splats on the faces turned to the camera must cover the silhouette by themselves, or else the inside of the far
side shows between them. Some of that happens at rest, where training darkened the front by letting the back shine through; an
edit must not add to it.
*Colour*: the rest mesh, finely divided, takes its colours from the photos without any splat and is deformed in the same way.
Its image is blurred and no ground truth, so the PSNR against it counts only as a change from rest to edit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage, sparse

from gsbridge.cameras import Camera, camera_centre
from gsbridge.geometry import Array
from gsbridge.images import psnr
from gsbridge.meshes import Mesh
from gsbridge.scene.meshes import MeshComposition
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.evaluate import render_cloud

OPAQUE = 0.5
"""Alpha from which a pixel counts as covered."""

RIM_PX = 1.5
"""Pixels nearer to the silhouette's outline than this are left out of holes and PSNR, because they are only partly inside."""

SPILL_MM = 2.0
"""Covered pixels farther outside the silhouette than this count as spill, mm."""


@dataclass(frozen=True)
class EditQuality:
    """Figures over some views; every pixel of every view has the same weight.

    Args:
        holes: Share of the silhouette's pixels with an alpha below `OPAQUE`, 0..1.
        see_through: The same share when only the splats of faces turned to the camera are drawn, 0..1.
        spill: Covered pixels more than `SPILL_MM` outside the silhouette, as a share of the silhouette's pixels, 0..1.
        overhang_mm: Largest distance of a covered pixel from the silhouette, mm at the depth of the object's middle.
        psnr: Splats against the coloured mesh inside the silhouette, dB.
    """

    holes: float
    see_through: float
    spill: float
    overhang_mm: float
    psnr: float


def measure_edit(
    cloud: Cloud, faces: Array, surface: Mesh, coloured: Mesh, views: Sequence[tuple[Camera, Array]]
) -> EditQuality:
    """Measure splats against the surface that they are to cover.

    Args:
        cloud: Splats, table frame.
        faces: Face of `surface` that each splat hangs on. [N].
        surface: The mesh, deformed like the splats; outward normals.
        coloured: The surface with colours.
        views: Pinholes and `cam_from_table` [4, 4] each.

    Raises:
        ValueError: No view shows the surface.
    """
    normals, anchors = surface.normals()[faces], surface.corners().mean(1)[faces]
    middle = np.append(0.5 * (surface.vertices.min(0) + surface.vertices.max(0)), 1.0)
    inside_px = holes = see_through = spilt = 0
    overhang = 0.0
    shown, wanted = [], []
    drawn = MeshComposition({"surface": coloured})
    for camera, pose in views:
        covered = drawn.coverage(camera, pose)
        inside = ndimage.distance_transform_edt(covered > 0.5) > RIM_PX
        colours, alphas = render_cloud(cloud, camera, pose)
        front = ((camera_centre(pose) - anchors) * normals).sum(1) > 0
        _, front_alphas = render_cloud(cloud.subset(front), camera, pose)
        mm_per_px = 1e3 * float((pose @ middle)[2]) / camera.fx
        outside = ndimage.distance_transform_edt(covered == 0) * mm_per_px
        inside_px += int(inside.sum())
        holes += int((inside & (alphas < OPAQUE)).sum())
        see_through += int((inside & (front_alphas < OPAQUE)).sum())
        spilt += int(((outside > SPILL_MM) & (alphas >= OPAQUE)).sum())
        overhang = max(overhang, float(outside[alphas >= OPAQUE].max(initial=0.0)))
        shown.append(np.clip(colours[inside], 0, 1))
        wanted.append(drawn.render(camera, pose)[inside].astype(np.float32) / 255)
    if inside_px == 0:
        raise ValueError("no view shows the surface")
    fit = psnr(np.concatenate(shown)[None], np.concatenate(wanted)[None])
    return EditQuality(holes / inside_px, see_through / inside_px, spilt / inside_px, overhang, fit)


@dataclass(frozen=True)
class Division:
    """A finer mesh on the same surface; `weights @ values` interpolates positions or colours given at the coarse vertices.

    Args:
        faces: Faces of the finer mesh. [G, 3].
        weights: Weight of each coarse vertex in each finer vertex. [W, V], sparse.
    """

    faces: Array
    weights: sparse.csr_array


def divide(faces: Array, vertices: int, times: int) -> Division:
    """Cut each face into four, `times` times over; the cuts depend on the faces alone, so that deformed meshes are cut alike.

    Args:
        faces: [F, 3].
        vertices: Number of vertices; they come first in the finer mesh.
        times: How often; each time halves the edges.
    """
    weights = sparse.eye_array(vertices, format="csr")
    for _ in range(times):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        # One number per edge sorts ten times as fast as pairs do.
        keys, index = np.unique(edges[:, 0] * np.int64(weights.shape[0]) + edges[:, 1], return_inverse=True)
        first, second = np.divmod(keys, weights.shape[0])
        ab, bc, ca = index.reshape(3, -1) + weights.shape[0]
        a, b, c = faces.T
        faces = np.concatenate([np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        weights = sparse.vstack([weights, 0.5 * (weights[first] + weights[second])], format="csr")
    return Division(faces, weights)


def framed(camera: Camera, cam_from_table: Array, points: Array, size: int, margin: float = 0.03) -> tuple[Camera, Array]:
    """Square window of a view round some points, at another resolution.

    Args:
        camera: Pinhole of the view.
        cam_from_table: Its pose. [4, 4].
        points: Points that the window shall hold, table frame, m. [N, 3].
        size: Edge of the window after scaling, px.
        margin: Free edge on each side, as a share of the window.

    Returns:
        The window's camera, and the affine map from pixels of the view to those of the window, for `window_of`. [2, 3].

    Raises:
        ValueError: A point lies behind the camera.
    """
    pixels = camera.project(points @ cam_from_table[:3, :3].T + cam_from_table[:3, 3])
    if not np.isfinite(pixels).all():
        raise ValueError("the window's points must lie before the camera")
    low, high = pixels.min(0), pixels.max(0)
    edge = float((high - low).max()) / (1 - 2 * margin)
    zoom = size / edge
    left, top = 0.5 * (low + high) - 0.5 * edge
    window = Camera(
        size, size, camera.fx * zoom, camera.fy * zoom, (camera.cx - left) * zoom, (camera.cy - top) * zoom, camera.distortion
    )
    return window, np.array([[zoom, 0.0, -left * zoom], [0.0, zoom, -top * zoom]])


def window_of(image: Array, window_from_view: Array, size: int) -> Array:
    """The window that `framed` chose, cut from the view's image; beyond its edges the edge is repeated. [size, size, 3].

    Args:
        image: The view's image. [H, W, 3].
        window_from_view: Affine map of pixels from `framed`. [2, 3].
        size: Edge of the window, px.
    """
    # Pixel centres lie at +0.5 here, at 0 in OpenCV.
    half = np.array([[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1.0]])
    full = np.linalg.inv(half) @ np.vstack([window_from_view, [0, 0, 1]]) @ half
    return cv2.warpAffine(image, full[:2], (size, size), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
