"""Shadows in a drawn picture: splats show the light of their own film, and bodies that were not in it block some of that light.

The picture's own depth tells where each pixel's surface lies. At a coarse grid of pixels, the share of the light that the
bodies (as spheres) leave is summed over the sky's parts. Every pixel is then dimmed by the grid points round it that lie at its
height. Surfaces are taken as level, as are most that the wrist camera sees when it looks down. The robot's own pixels are not
dimmed.
"""

from __future__ import annotations

from gsbridge.kernels import Real, njit  # isort: skip  (first: it sets numba's cache folder)

import math
from collections.abc import Mapping

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.scene.light import SkyLight, directions
from gsbridge.scene.shading import NOWHERE, OWN, TABLE_HEIGHT, shade_points, tile_order

GRID = 16
"""Points along each edge of the picture at which the light is summed."""

LEAST = 0.003
"""Share below which a part of the sky is added to the floor instead of being traced."""

_SAME_HEIGHT = 0.012  # m: greatest difference in height between a pixel and a grid point of the same surface
_OFFSET = 0.055
"""Offset in sRGB's encoding of all but the darkest light: `1.055 light^(1 / GAMMA) - 0.055`."""


@njit(error_model="numpy")
def _place(poses: Array, owners: Array, rest: Array, out: Array) -> None:
    """Move spheres to the poses of their bodies. [4 B, 4], [S], [S, 4] -> out [S, 4]."""
    for s in range(rest.shape[0]):
        first = 4 * owners[s]
        for k in range(3):
            row = poses[first + k]
            out[s, k] = row[0] * rest[s, 0] + row[1] * rest[s, 1] + row[2] * rest[s, 2] + row[3]
        out[s, 3] = rest[s, 3]


@njit(error_model="numpy")
def _table_from_cam(cam_from_table: Array) -> Array:
    """Inverse of a rigid pose. [4, 4] -> [3, 4] float32."""
    out = np.empty((3, 4), np.float32)
    for i in range(3):
        shift = 0.0
        for j in range(3):
            out[i, j] = cam_from_table[j, i]
            shift -= cam_from_table[j, i] * cam_from_table[j, 3]
        out[i, 3] = shift
    return out


@njit(error_model="numpy", fastmath=True)
def _points(depths: Array, alphas: Array, lens: Array, table_from_cam: Array, step: int, out: Array) -> None:
    """Surface points of the grid's pixels, table frame, m; of height `NOWHERE` where nothing is drawn."""
    rows, columns = out.shape[0], out.shape[1]
    for i in range(rows):
        for j in range(columns):
            v, u = i * step + step // 2, j * step + step // 2
            if alphas[v, u] < 0.5:
                out[i, j, 2] = NOWHERE
                continue
            z = depths[v, u] / alphas[v, u]
            x, y = z * (u + np.float32(0.5) - lens[2]) / lens[0], z * (v + np.float32(0.5) - lens[3]) / lens[1]
            for k in range(3):
                out[i, j, k] = (
                    table_from_cam[k, 0] * x + table_from_cam[k, 1] * y + table_from_cam[k, 2] * z + table_from_cam[k, 3]
                )


@njit(error_model="numpy", fastmath=True)
def _widen(points: Array, tones: Array, kinds: Array, step: int, out: Array) -> None:
    """Copy to every column of pixels the values of the grid points to its left and to its right, for each row of the grid.

    Output: out [rows, 2, 4, W]; the four values are height, the tone as the robot leaves it, the tone as robot and object leave
    it, and 1 on the object.
    """
    rows, columns = kinds.shape
    for u in range(out.shape[3]):
        left = int(math.floor((u - step // 2) / step))
        for q in range(2):
            c = min(max(left + q, 0), columns - 1)
            for r in range(rows):
                out[r, q, 0, u], out[r, q, 3, u] = points[r, c, 2], kinds[r, c] == OWN
                out[r, q, 1, u], out[r, q, 2, u] = tones[0, r, c], tones[1, r, c]


@njit(error_model="numpy", fastmath=True)
def _dim(
    image: Array,
    depths: Array,
    alphas: Array,
    lens: Array,
    table_from_cam: Array,
    step: int,
    points: Array,
    tones: Array,
    kinds: Array,
) -> None:
    """Dim every pixel by the mean tone of the four grid points round it, in which points at its height weigh most.

    The loops run along rows without branches, so that the compiler computes many pixels at once.
    """
    rows, width = kinds.shape[0], image.shape[1]
    offset, one, zero, small = np.float32(_OFFSET), np.float32(1.0), np.float32(0.0), np.float32(1e-3)
    half = np.float32(0.5)
    work = np.empty((rows, 2, 4, width), np.float32)
    _widen(points, tones, kinds, step, work)
    factors, shares = np.empty(width, np.float32), np.empty((2, width), np.float32)
    for u in range(width):
        # `b` is the pixel's place in units of the grid; whole numbers are grid points.
        b = (u - step // 2) / step
        shares[1, u] = b - math.floor(b)
        shares[0, u] = one - shares[1, u]
    for v in range(image.shape[0]):
        a = (v - step // 2) / step
        i = int(math.floor(a))
        y = (v + half - lens[3]) / lens[1]
        for u in range(width):
            z = depths[v, u] / max(alphas[v, u], half)
            x = (u + half - lens[2]) / lens[0]
            height = (table_from_cam[2, 0] * x + table_from_cam[2, 1] * y + table_from_cam[2, 2]) * z + table_from_cam[2, 3]
            total, weight = zero, zero
            for p in range(2):
                r, above = min(max(i + p, 0), rows - 1), np.float32(abs(1 - p - (a - i)))
                for q in range(2):
                    level = work[r, q, 0, u]
                    share = above * shares[q, u] + small
                    share *= small if abs(level - height) > _SAME_HEIGHT else one
                    share = zero if level == NOWHERE else share
                    # A pixel above the table near the object is the object's own: its splats hold the object's shade already,
                    # so only the robot dims it.
                    itself = height >= TABLE_HEIGHT and (work[r, q, 3, u] > half or level < TABLE_HEIGHT)
                    total += share * (work[r, q, 1, u] if itself else work[r, q, 2, u])
                    weight += share
            drawn = alphas[v, u] >= half and weight > zero
            factors[u] = total / weight if drawn else one
        for u in range(width):
            if factors[u] != one:
                for k in range(3):
                    image[v, u, k] = max((image[v, u, k] + offset) * factors[u] - offset, zero)


@njit(error_model="numpy")
def _dim_picture(
    image: Array,
    depths: Array,
    alphas: Array,
    lens: tuple[float, ...],
    cam_from_table: Array,
    poses: Array,
    owners: Array,
    rest: Array,
    robot: int,
    sources: Array,
    shares: Array,
    floor: Real,
    step: int,
    order: Array,
) -> None:
    """Dim a picture; see `Shadows.dim`.

    Args:
        image, depths, alphas: See `Shadows.dim`.
        lens: fx, fy, cx, cy.
        cam_from_table: [4, 4].
        poses: `table_from_body`, one below the other. [4 B, 4].
        owners, rest: Body of each sphere, and the sphere in its frame, the robot's first. [S], [S, 4].
        robot, sources, shares, floor, order: As in `gsbridge.scene.shading.shade_points`.
        step: Pixels from one point of the grid to the next.
    """
    rows, columns = image.shape[0] // step, image.shape[1] // step
    camera = np.empty(4, np.float32)
    for i in range(4):
        camera[i] = lens[i]
    table_from_cam, spheres = _table_from_cam(cam_from_table), np.empty(rest.shape, np.float32)
    _place(poses, owners, rest, spheres)
    points, kinds = np.zeros((rows, columns, 3), np.float32), np.empty(rows * columns, np.int8)
    _points(depths, alphas, camera, table_from_cam, step, points)
    tones = np.empty((2, rows * columns), np.float32)
    shade_points(points.reshape(rows * columns, 3), order, spheres, robot, sources, shares, floor, kinds, tones)
    grid = points, tones.reshape(2, rows, columns), kinds.reshape(rows, columns)
    _dim(image, depths, alphas, camera, table_from_cam, step, *grid)


class Shadows:
    """Shadows of bodies, by which pictures are dimmed.

    Args:
        light: The light.
        robot: Spheres of the links, link frames. [S, 4] each.
        item: Name of the object among the poses, and its spheres, body frame. [S, 4].
    """

    def __init__(self, light: SkyLight, robot: Mapping[str, Array], item: tuple[str, Array]) -> None:
        traced = light.shares >= LEAST
        self._sources = np.ascontiguousarray(directions()[traced], np.float32)
        self._shares = light.shares[traced].astype(np.float32)
        # The light of parts too small to trace is kept, as light that no body blocks.
        self._floor = np.float32(light.floor + light.shares[~traced].sum())
        bodies = {**robot, item[0]: item[1]}
        self._names, self._robot = tuple(bodies), sum(len(spheres) for spheres in robot.values())
        self._owners = np.repeat(np.arange(len(bodies)), [len(spheres) for spheres in bodies.values()])
        self._poses = np.empty((4 * len(bodies), 4))
        self._rest = np.concatenate([np.zeros((0, 4)), *bodies.values()]).astype(np.float32)

    def dim(
        self, image: Array, depths: Array, alphas: Array, camera: Camera, cam_from_table: Array, poses: Mapping[str, Array]
    ) -> None:
        """Dim a picture where it lies in shadow.

        Args:
            image: Encoded, changed in place. [H, W, 3] float32.
            depths, alphas: Alpha-weighted sum of camera z, m, and alpha, as the rasteriser gives them. [H, W] float32.
            camera: Pinhole.
            cam_from_table: Pose of the camera. [4, 4].
            poses: `table_from_body` of the links and the object. [4, 4] each.

        Raises:
            InputError: A body has no pose: the light was calibrated with another robot.
        """
        missing = [name for name in self._names if name not in poses]
        if missing:
            raise InputError("light", f"{', '.join(missing)} is no body of this world", "Calibrate the light with this robot")
        # One kernel does all the work: numpy calls on a few numbers each cost several times as much here, between physics and
        # pictures.
        step = max(1, min(image.shape[:2]) // GRID)
        order = tile_order(image.shape[0] // step, image.shape[1] // step)
        np.concatenate([poses[name] for name in self._names], out=self._poses)
        bodies = self._poses, self._owners, self._rest, self._robot
        lens, pose = camera.pinhole_numbers, np.ascontiguousarray(cam_from_table, dtype=np.float64)
        _dim_picture(image, depths, alphas, lens, pose, *bodies, self._sources, self._shares, self._floor, step, order)
