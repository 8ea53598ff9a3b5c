"""Number of splats that a scene needs, from the pixels and the texture in its photos.

Splats at a distance of h pixels show the mean colour of h by h pixels, and the variance within that square is their error. The
distance is chosen so that this error is small compared with other errors. The number of splats then follows from the area of
the surface in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gsbridge.configuration.splats import SplatSettings
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.splats.targets import Target, seen_faces

TEXTURE_PSNR = 30.0
"""PSNR if the distance of the splats were the only error, dB: about the PSNR of soft splats on their training photos."""

LEAST = 12_000
"""Smallest number of splats, which is the default number: scenes without texture need splats for their outline, too."""

_VIEWS = 24
"""Approximate number of photos that are used, spread evenly over the film."""
_WIDTHS = (1, 3, 5, 7, 9, 13, 17, 25, 33)
"""Widths of the windows in which variance is measured, px; within one pixel the variance is 0."""


def choose_splats(mesh: Mesh, targets: Sequence[Target], settings: SplatSettings, *, kind: str) -> int:
    """Choose the number of splats for `max_splats: auto`.

    Args:
        mesh: Surface to which the splats are bound, table frame, m.
        targets: Photos; held-out photos are not used.
        settings: Settings, of which `max_pixels` (the resolution of training), `splats_per_face` and `most_splats` are used.
        kind: `object` or `background`.

    Returns:
        Between `LEAST` and `most_splats`.
    """
    training = [target for target in targets if target.split == "train"]
    looked = [target.affordable(settings.max_pixels, kind=kind) for target in training[:: max(1, len(training) // _VIEWS)]]
    wanted = surface_pixels(mesh, looked, seen_faces(mesh, targets)) / texture_width(looked) ** 2
    return int(np.clip(round(wanted * settings.splats_per_face), min(LEAST, settings.most_splats), settings.most_splats))


def texture_width(targets: Sequence[Target]) -> float:
    """Return the width of a square, px, in which the variance of colours is the error of `TEXTURE_PSNR`.

    Pixels outside the mask do not count.
    """
    errors = [0.0]
    for width in _WIDTHS[1:]:
        total, count = 0.0, 0.0
        for target in targets:
            inside = (target.weight > 127).astype(np.float32)
            total += float((_variance(target.photo, inside, width) * inside).sum())
            count += float(inside.sum())
        errors.append(total / max(count, 1.0))
    # Variance should grow with the window; where noise breaks this, use the larger value of the smaller windows.
    return float(np.interp(10 ** (-TEXTURE_PSNR / 10), np.maximum.accumulate(errors), _WIDTHS))


def surface_pixels(mesh: Mesh, targets: Sequence[Target], seen: Array) -> float:
    """Return the number of pixels that the surface would have if the photos saw each face head-on from their mean distance.

    Args:
        mesh: Surface, table frame, m.
        targets: Photos.
        seen: Mask of the faces that count. [F] bool.
    """
    centroids, areas = mesh.corners().mean(1), mesh.areas()
    density, count = np.zeros(len(areas)), np.zeros(len(areas))
    for target in targets:
        camera, pose = target.camera, target.cam_from_table
        local = centroids @ pose[:3, :3].T + pose[:3, 3]
        pixels = camera.project(local)
        inside = (local[:, 2] > 0) & (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        density[inside] += camera.fx * camera.fy / local[inside, 2] ** 2
        count[inside] += 1
    chosen = seen & (count > 0)
    return float((areas[chosen] * density[chosen] / count[chosen]).sum())


def _variance(photo: Array, inside: Array, width: int) -> Array:
    """Return the variance of the colour (0..1) in a square window over the pixels inside, mean of the channels. [H, W]."""
    image = photo.astype(np.float32) / 255
    share = np.maximum(cv2.blur(inside, (width, width)), 1e-6)[..., None]
    mean = cv2.blur(image * inside[..., None], (width, width)) / share
    square = cv2.blur(image * image * inside[..., None], (width, width)) / share
    return np.maximum(square - mean * mean, 0.0).mean(-1)
