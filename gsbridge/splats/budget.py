"""How many splats a scene needs: as many as its photos show pixels and texture.

Splats that lie h pixels apart show the mean colour of h by h pixels, and leave the variance within as their error. The distance
is chosen so that the error is small beside what else goes wrong; the number of splats follows from the surface, in pixels.
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
"""PSNR that the distance of the splats alone would leave, dB: about that of soft splats on their training photos."""

LEAST = 12_000
"""Plain things get as many as by default: their outline needs splats, too."""

_VIEWS = 24
"""Photos that are looked at, evenly over the film."""
_WIDTHS = (1, 3, 5, 7, 9, 13, 17, 25, 33)
"""Windows in which variance is measured, px; within one pixel there is none."""


def choose_splats(mesh: Mesh, targets: Sequence[Target], settings: SplatSettings, *, kind: str) -> int:
    """Number of splats for `max_splats: auto`.

    Args:
        mesh: Surface that the splats hang on, table frame, m.
        targets: Photos; the held-out ones are not looked at.
        settings: `max_pixels`, at which texture is seen in training, and `most_splats`.
        kind: `object` or `background`.

    Returns:
        Between `LEAST` and `most_splats`.
    """
    training = [target for target in targets if target.split == "train"]
    looked = [target.affordable(settings.max_pixels, kind=kind) for target in training[:: max(1, len(training) // _VIEWS)]]
    wanted = surface_pixels(mesh, looked, seen_faces(mesh, targets)) / texture_width(looked) ** 2
    return int(np.clip(round(wanted * settings.splats_per_face), min(LEAST, settings.most_splats), settings.most_splats))


def texture_width(targets: Sequence[Target]) -> float:
    """Width of a square, px, within which colours vary by the error of `TEXTURE_PSNR`; pixels beside the mask do not count."""
    errors = [0.0]
    for width in _WIDTHS[1:]:
        total, count = 0.0, 0.0
        for target in targets:
            inside = (target.weight > 127).astype(np.float32)
            total += float((_variance(target.photo, inside, width) * inside).sum())
            count += float(inside.sum())
        errors.append(total / max(count, 1.0))
    # Variance grows with the window; where noise says otherwise the smaller window counts.
    return float(np.interp(10 ** (-TEXTURE_PSNR / 10), np.maximum.accumulate(errors), _WIDTHS))


def surface_pixels(mesh: Mesh, targets: Sequence[Target], seen: Array) -> float:
    """Pixels that the surface would have if each of its faces was looked at head-on from the distance of the photos.

    Args:
        mesh: Surface, table frame, m.
        targets: Photos.
        seen: Faces that count. [F] bool.
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
    """Variance of the colour in a square window over the pixels that count, 0..1 squared, mean of the channels. [H, W]."""
    image = photo.astype(np.float32) / 255
    share = np.maximum(cv2.blur(inside, (width, width)), 1e-6)[..., None]
    mean = cv2.blur(image * inside[..., None], (width, width)) / share
    square = cv2.blur(image * image * inside[..., None], (width, width)) / share
    return np.maximum(square - mean * mean, 0.0).mean(-1)
