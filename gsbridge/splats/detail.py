"""Local triangle sizes of a background: small where many pixels show much detail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import camera_centre
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.splats.targets import Target

SMALLEST, LARGEST = 0.25, 2.83
"""Bounds of the edge length, relative to its median."""

SAMPLES = 40_000
"""Number of points on the surface at which pixel density and detail are measured."""

VIEWS = 24
"""Approximate number of photos that are used, spread evenly over the film."""

WINDOW = 0.006
"""Width of the window in which the variance of colours is measured, m: about the edge of a splat's triangle."""

NOISE = 0.01
"""Standard deviation of colours, sRGB, that is mere noise of photos; its square is a floor for the detail of plain surfaces."""


@dataclass(frozen=True)
class Focus:
    """A square of the table that gets more weight than the photos give it: there the robot works, and its camera is near.

    Args:
        centre: Centre of the square, table frame, m. [2].
        side: Edge of the square, m.
        gain: Factor on the density of pixels in the square.
    """

    centre: tuple[float, float]
    side: float
    gain: float

    def gains(self, points: Array) -> Array:
        """Return the factor at each point. [N, 3] -> [N]."""
        away = np.abs(np.asarray(points)[:, :2] - self.centre).max(1)
        return np.where(away <= 0.5 * self.side, self.gain, 1.0)


def edge_sizes(mesh: Mesh, targets: Sequence[Target], focus: Focus | None = None, seed: int = 0) -> Callable[[Mesh], Array]:
    """Compute relative edge lengths that make the sum of the splats' errors least.

    A splat of width h leaves an error of about s^2 (h / L)^2 per pixel in texture of variance s^2 and a length scale L, which
    is taken as the same everywhere. If r pixels per area see the texture, the sum of errors over the surface for a given number
    of splats is least where h is proportional to (r s^2)^(-1/4).

    Args:
        mesh: Surface, table frame, m.
        targets: Photos; held-out photos are not used.
        focus: Square in which pixels count more; None for none.
        seed: Seed of the sampled points.

    Returns:
        Function from a mesh of this surface to the relative edge length at each of its faces. [F].
    """
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    areas = mesh.areas()
    corners = mesh.corners()[rng.choice(len(areas), SAMPLES, p=areas / areas.sum())]
    shares = rng.dirichlet([1.0, 1.0, 1.0], SAMPLES)
    points = (shares[:, :, None] * corners).sum(1)
    training = [target for target in targets if target.split == "train"]
    density, detail, count = np.zeros(SAMPLES), np.zeros(SAMPLES), np.zeros(SAMPLES)
    for target in training[:: max(1, len(training) // VIEWS)]:
        camera, pose = target.camera, target.cam_from_table
        local = points @ pose[:3, :3].T + pose[:3, 3]
        pixels = camera.project(local)
        inside = (local[:, 2] > 0) & (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        chosen = np.flatnonzero(inside)
        column, row = pixels[chosen].astype(int).T
        chosen, column, row = (item[target.weight[row, column] > 127] for item in (chosen, column, row))
        eye = camera_centre(pose)
        slant = np.abs(points[chosen, 2] - eye[2]) / np.linalg.norm(points[chosen] - eye, axis=1)
        depth = local[chosen, 2]
        density[chosen] += camera.fx * camera.fy * slant / depth**2
        width = max(3, 2 * round(0.5 * WINDOW * camera.fx / float(np.median(depth))) + 1) if len(chosen) else 3
        detail[chosen] += _variance(target.photo, width)[row, column]
        count[chosen] += 1
    seen = count > 0
    weight = (density[seen] / len(training)) * (detail[seen] / count[seen] + NOISE**2)
    if focus is not None:
        weight = weight * focus.gains(points[seen])
    # Average over neighbours before taking the power: single points would give a speckled pattern of triangle sizes.
    tree = cKDTree(points[seen])
    smooth = weight[tree.query(points[seen], k=24)[1]].mean(1)
    sizes = smooth**-0.25
    sizes = np.clip(sizes / np.median(sizes), SMALLEST, LARGEST)
    return lambda other: sizes[tree.query(other.corners().mean(1))[1]]


def _variance(photo: Array, width: int) -> Array:
    """Return the local variance of the colour in a square window, sRGB^2, mean of the channels. [H, W]."""
    image = photo.astype(np.float32) / 255.0
    mean = cv2.blur(image, (width, width))
    return np.maximum(cv2.blur(image * image, (width, width)) - mean * mean, 0.0).mean(-1)
