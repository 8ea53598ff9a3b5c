"""Shadows in a drawn picture: splats carry the light of their film, and bodies that were not there take some of it away.

The picture's own depth tells where each pixel's surface lies. On a coarse grid of pixels the share of the light that bodies,
as spheres, leave is summed over the sky's parts; every pixel is then dimmed by the grid points round it that lie at its height.
Surfaces count as level, which the wrist camera, looking down, mostly sees; the robot itself is left as it is.
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import math
from collections.abc import Mapping

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.scene.light import WIDTH, SkyLight, directions

GRID = 16
"""Points along each edge of the picture at which the light is summed."""

LEAST = 0.003
"""Share below which a part of the sky is added to the floor instead of being traced."""

TABLE_HEIGHT = 0.006
"""m: what lies lower is the table; what lies higher may be the object, which carries its own shade."""

ROBOT_MARGIN = 0.003
"""m round the robot's spheres within which a surface is the robot's."""

OBJECT_MARGIN = 0.010
"""Likewise for the object: what stands up farther from it, such as a plate, is shaded by it."""

_NOWHERE = -1e3
"""Height of a point where nothing is drawn: NaN means nothing to kernels that compute fast."""

_SAME_HEIGHT = 0.012
_GAMMA, _OFFSET = 2.4, 0.055
"""Of sRGB's encoding of all but the darkest light: `1.055 light^(1 / 2.4) - 0.055`."""


@njit(error_model="numpy")
def _place(poses, owners, rest, out):  # type: ignore[no-untyped-def]
    """Spheres where their bodies are. [B, 4, 4], [S], [S, 4] -> out [S, 4]."""
    for s in range(rest.shape[0]):
        pose = poses[owners[s]]
        for k in range(3):
            out[s, k] = pose[k, 0] * rest[s, 0] + pose[k, 1] * rest[s, 1] + pose[k, 2] * rest[s, 2] + pose[k, 3]
        out[s, 3] = rest[s, 3]


@njit(error_model="numpy", fastmath=True)
def _points(depths, alphas, lens, table_from_cam, step, out):  # type: ignore[no-untyped-def]
    """Surface points of the grid's pixels, table frame, far below where nothing is drawn."""
    rows, columns = out.shape[0], out.shape[1]
    for i in range(rows):
        for j in range(columns):
            v, u = i * step + step // 2, j * step + step // 2
            if alphas[v, u] < 0.5:
                out[i, j, 2] = _NOWHERE
                continue
            z = depths[v, u] / alphas[v, u]
            x, y = z * (u + np.float32(0.5) - lens[2]) / lens[0], z * (v + np.float32(0.5) - lens[3]) / lens[1]
            for k in range(3):
                out[i, j, k] = (
                    table_from_cam[k, 0] * x + table_from_cam[k, 1] * y + table_from_cam[k, 2] * z + table_from_cam[k, 3]
                )


@njit(error_model="numpy", fastmath=True)
def _frame(dx, dy, dz):  # type: ignore[no-untyped-def]
    """Two unit vectors across a direction that does not lie level along x."""
    length = math.sqrt(dy * dy + dz * dz)
    ax, ay, az = np.float32(0.0), dz / length, -dy / length
    return ax, ay, az, dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax


@njit(error_model="numpy", fastmath=True)
def _shade(along, side, up, s_along, s_side, s_up, radius, left):  # type: ignore[no-untyped-def]
    """What a sphere leaves of a direction's light at some points, in coordinates along and across the direction.

    The same as `gsbridge.scene.occlusion.left_by`, without branches, so that many points are computed at a time.
    """
    width, tiny, one, zero = np.float32(WIDTH), np.float32(1e-4), np.float32(1.0), np.float32(0.0)
    square = radius * radius
    for i in range(along.shape[0]):
        a, b, c = s_along - along[i], s_side - side[i], s_up - up[i]
        across = b * b + c * c
        half = max(width * a, zero) + tiny
        narrow = min(half, radius)
        blocked = min(max((radius + half - math.sqrt(across)) / (narrow + narrow), zero), one)
        blocked *= min(square / (half * half), one)
        outside = one if a > zero and across + a * a > square else zero
        left[i] = min(left[i], one - blocked * outside)


@njit(error_model="numpy", fastmath=True)
def _within(x, y, z, spheres, first, last, margin):  # type: ignore[no-untyped-def]
    """Whether a point lies in one of some spheres, or within a margin of it."""
    for s in range(first, last):
        a, b, c, edge = spheres[s, 0] - x, spheres[s, 1] - y, spheres[s, 2] - z, spheres[s, 3] + margin
        if a * a + b * b + c * c < edge * edge:
            return True
    return False


@njit(error_model="numpy", fastmath=True)
def _bounds(along, side, up, heights, out):  # type: ignore[no-untyped-def]
    """Least `along`, least and largest `side`, and of `up`, of those points at which something is drawn. -> out [5]."""
    huge = np.float32(1e9)
    out[0] = out[1] = out[3] = huge
    out[2] = out[4] = -huge
    for i in range(along.shape[0]):
        if heights[i] != _NOWHERE:
            out[0] = min(out[0], along[i])
            out[1], out[2] = min(out[1], side[i]), max(out[2], side[i])
            out[3], out[4] = min(out[3], up[i]), max(out[4], up[i])


@njit(error_model="numpy", fastmath=True)
def _shades(bounds, s_along, s_side, s_up, radius):  # type: ignore[no-untyped-def]
    """Whether a sphere may take light from points within some bounds."""
    ahead = s_along - bounds[0]
    if ahead <= 0.0:
        return False
    across = max(bounds[1] - s_side, s_side - bounds[2], np.float32(0.0))
    over = max(bounds[3] - s_up, s_up - bounds[4], np.float32(0.0))
    edge = radius + np.float32(WIDTH) * ahead + np.float32(1e-4)
    return across * across + over * over < edge * edge


@njit(error_model="numpy", fastmath=True)
def _light(points, spheres, robot, sources, shares, floor, work, tones, own):  # type: ignore[no-untyped-def]
    """Share of the light at each point, to the power that colours are encoded with.

    Args:
        points: [N, 3].
        spheres: Robot's first, then the object's. [S, 4].
        robot: How many are the robot's.
        sources, shares, floor: The light. [M, 3], [M].
        work: Work space. [4, N].
        tones: Output: what the robot leaves, and what robot and object leave. [2, N].
        own: Output: points on the object. [N].
    """
    along, side, up, left = work[0], work[1], work[2], work[3]
    count, heights, bounds = points.shape[0], points[:, 2], np.empty(5, np.float32)
    tones[:] = floor
    for m in range(sources.shape[0]):
        dx, dy, dz = sources[m, 0], sources[m, 1], sources[m, 2]
        ax, ay, az, bx, by, bz = _frame(dx, dy, dz)
        for i in range(count):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            along[i], side[i], up[i] = x * dx + y * dy + z * dz, x * ax + y * ay + z * az, x * bx + y * by + z * bz
            left[i] = 1.0
        _bounds(along, side, up, heights, bounds)
        for group in range(2):
            first, last = (0, robot) if group == 0 else (robot, spheres.shape[0])
            for s in range(first, last):
                x, y, z, radius = spheres[s, 0], spheres[s, 1], spheres[s, 2], spheres[s, 3]
                s_along, s_side, s_up = x * dx + y * dy + z * dz, x * ax + y * ay + z * az, x * bx + y * by + z * bz
                if _shades(bounds, s_along, s_side, s_up, radius):
                    _shade(along, side, up, s_along, s_side, s_up, radius, left)
            for i in range(count):
                tones[group, i] += shares[m] * left[i]
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        high = pz >= TABLE_HEIGHT
        bare = pz == _NOWHERE or (high and _within(px, py, pz, spheres, 0, robot, np.float32(ROBOT_MARGIN)))
        own[i] = high and _within(px, py, pz, spheres, robot, spheres.shape[0], np.float32(OBJECT_MARGIN))
        for group in range(2):
            tones[group, i] = np.float32(1.0) if bare else np.float32(tones[group, i] ** (1.0 / _GAMMA))


@njit(error_model="numpy", fastmath=True)
def _dim(image, depths, alphas, lens, table_from_cam, step, points, tones, own):  # type: ignore[no-untyped-def]
    """Dim every pixel by the tone of the four grid points round it, those at its height foremost."""
    rows, columns = own.shape
    offset = np.float32(_OFFSET)
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            if alphas[v, u] < 0.5:
                continue
            z = depths[v, u] / alphas[v, u]
            x, y = z * (u + np.float32(0.5) - lens[2]) / lens[0], z * (v + np.float32(0.5) - lens[3]) / lens[1]
            height = table_from_cam[2, 0] * x + table_from_cam[2, 1] * y + table_from_cam[2, 2] * z + table_from_cam[2, 3]
            # Whole numbers fall on the grid's pixels.
            a, b = (v - step // 2) / step, (u - step // 2) / step
            i, j = int(math.floor(a)), int(math.floor(b))
            total, weight = np.float32(0.0), np.float32(0.0)
            for p in range(2):
                for q in range(2):
                    r, c = min(max(i + p, 0), rows - 1), min(max(j + q, 0), columns - 1)
                    if points[r, c, 2] == _NOWHERE:
                        continue
                    share = abs(1 - p - (a - i)) * abs(1 - q - (b - j)) + np.float32(1e-3)
                    if abs(points[r, c, 2] - height) > _SAME_HEIGHT:
                        share *= np.float32(1e-3)
                    # What stands up beside the table is the object: it carries its own shade, the table below it does not.
                    itself = height >= TABLE_HEIGHT and (own[r, c] or points[r, c, 2] < TABLE_HEIGHT)
                    total += share * tones[0 if itself else 1, r, c]
                    weight += share
            if weight > 0:
                factor = total / weight
                for k in range(3):
                    image[v, u, k] = max((image[v, u, k] + offset) * factor - offset, np.float32(0.0))


class Shadows:
    """Dims pictures where bodies stand in the light.

    Args:
        light: The light.
        robot: Spheres of the links, link frames. [S, 4] each.
        item: Name of the object among the poses, and its spheres, body frame. [S, 4].
    """

    def __init__(self, light: SkyLight, robot: Mapping[str, Array], item: tuple[str, Array]) -> None:
        traced = light.shares >= LEAST
        self._sources = np.ascontiguousarray(directions()[traced], np.float32)
        self._shares = light.shares[traced].astype(np.float32)
        # A part too small to trace is there all the same.
        self._floor = np.float32(light.floor + light.shares[~traced].sum())
        bodies = {**robot, item[0]: item[1]}
        self._names, self._robot = tuple(bodies), sum(len(spheres) for spheres in robot.values())
        self._owners = np.repeat(np.arange(len(bodies)), [len(spheres) for spheres in bodies.values()])
        self._rest = np.concatenate([np.zeros((0, 4)), *bodies.values()]).astype(np.float32)

    def dim(
        self, image: Array, depths: Array, alphas: Array, camera: Camera, cam_from_table: Array, poses: Mapping[str, Array]
    ) -> None:
        """Dim a picture where it lies in shadow.

        Args:
            image: Encoded, changed in place. [H, W, 3] float32.
            depths, alphas: Alpha-weighted sum of camera z, m, and alpha, as the rasteriser gives them. [H, W] float32.
            camera: Pinhole.
            cam_from_table: [4, 4].
            poses: `table_from_body` of the links and the object. [4, 4] each.

        Raises:
            InputError: A body has no pose: the light was calibrated with another robot.
        """
        missing = [name for name in self._names if name not in poses]
        if missing:
            raise InputError("light", f"{', '.join(missing)} is no body of this world", "Calibrate the light with this robot")
        step = max(1, min(image.shape[:2]) // GRID)
        shape = (image.shape[0] // step, image.shape[1] // step)
        lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
        table_from_cam = np.linalg.inv(cam_from_table).astype(np.float32)
        spheres = np.empty_like(self._rest)
        _place(np.array([poses[name] for name in self._names], np.float32), self._owners, self._rest, spheres)
        points, count = np.zeros((*shape, 3), np.float32), shape[0] * shape[1]
        _points(depths, alphas, lens, table_from_cam, step, points)
        work, tones, own = np.empty((4, count), np.float32), np.empty((2, count), np.float32), np.empty(count, np.bool_)
        light = self._sources, self._shares, self._floor
        flat = points.reshape(count, 3), spheres, self._robot
        _light(*flat, *light, work, tones, own)
        grid = points, tones.reshape(2, *shape), own.reshape(shape)
        _dim(image, depths, alphas, lens, table_from_cam, step, *grid)
