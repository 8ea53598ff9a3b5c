"""Tag corners in space, triangulated from several posed views."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares

from gsbridge.cameras import Camera
from gsbridge.geometry import Array, align_similarity

Tags = dict[str, dict[int, Array]]
"""Corners, px [4, 2], by image name and tag id."""


def triangulate(rays: list[tuple[Array, Array]]) -> Array | None:
    """Point nearest to rays, in the least-squares sense.

    Args:
        rays: Origin and unit direction of each ray. [3], [3].

    Returns:
        The point [3]; None when the rays are too few or too nearly parallel.
    """
    if len(rays) < 2:
        return None
    lhs, rhs = np.zeros((3, 3)), np.zeros(3)
    for origin, direction in rays:
        across = np.eye(3) - np.outer(direction, direction)
        lhs += across
        rhs += across @ origin
    values = np.linalg.eigvalsh(lhs)
    # The smallest eigenvalue is the sum of squared sines of the rays' angles to their mean direction.
    if values[0] < len(rays) * np.sin(np.deg2rad(1.0)) ** 2:
        return None
    return np.linalg.solve(lhs, rhs)


def corner_points(tags: Tags, poses: Mapping[str, tuple[Camera, Array]]) -> dict[int, Array]:
    """Triangulate tag corners and refine them by their reprojection error, robustly.

    Args:
        tags: Corners in the pixels of the cameras in `poses`, which must be pinholes. [4, 2] each.
        poses: Pinhole and `cam_from_world` [4, 4] by image name.

    Returns:
        Corners in the world frame by tag id, for tags whose four corners could be found. [4, 3] each.
    """
    seen: dict[int, list[str]] = {}
    for name, found in tags.items():
        if name in poses:
            for tag in found:
                seen.setdefault(tag, []).append(name)
    out = {}
    for tag, names in sorted(seen.items()):
        corners = [_corner([tags[name][tag][k] for name in names], [poses[name] for name in names]) for k in range(4)]
        if all(corner is not None for corner in corners):
            out[tag] = np.array(corners)
    return out


def _corner(pixels: list[Array], cameras: list[tuple[Camera, Array]]) -> Array | None:
    """Triangulate one corner from its pixels in several views."""
    rays = []
    for pixel, (camera, pose) in zip(pixels, cameras, strict=True):
        direction = pose[:3, :3].T @ np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])
        rays.append((-pose[:3, :3].T @ pose[:3, 3], direction / np.linalg.norm(direction)))
    start = triangulate(rays)
    if start is None:
        return None
    rotations = np.array([pose[:3, :3] for _, pose in cameras])
    translations = np.array([pose[:3, 3] for _, pose in cameras])
    focal = np.array([[camera.fx, camera.fy] for camera, _ in cameras])
    centre = np.array([[camera.cx, camera.cy] for camera, _ in cameras])
    target = np.array(pixels)

    def residual(point: Array) -> Array:
        local = rotations @ point + translations
        return (focal * local[:, :2] / np.maximum(local[:, 2:], 1e-9) + centre - target).ravel()

    return least_squares(residual, start, loss="soft_l1", f_scale=0.5).x


def scale_standard_error(source: Array, target: Array, seed: int, rounds: int = 200) -> float:
    """Standard error of the scale between triangulated tags and their layout, as a share of the scale.

    Whole tags are resampled, because the errors within one tag (a blurred edge, a bent corner) are correlated.

    Args:
        source: Triangulated corners, any unit. [T, 4, 3].
        target: Printed corners, m. [T, 4, 3].
        seed: Random seed.
        rounds: Resamplings.

    Returns:
        The relative standard error; NaN with fewer than four tags, too few for resampling.
    """
    if len(source) < 4:
        return float("nan")
    rng = np.random.default_rng(seed)
    scales: list[float] = []
    while len(scales) < rounds:
        pick = rng.integers(0, len(source), len(source))
        # Two tags would determine a scale, but with three no single tag decides it alone.
        if len(np.unique(pick)) >= 3:
            scales.append(align_similarity(source[pick].reshape(-1, 3), target[pick].reshape(-1, 3)).scale)
    return float(np.std(scales, ddof=1) / np.mean(scales))
