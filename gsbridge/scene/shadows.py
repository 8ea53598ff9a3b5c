"""Shadows in a drawn picture: splats carry the light of their film, and bodies that were not there take some of it away.

The picture's own depth tells where each pixel's surface lies. On a coarse grid of pixels the share of the light that bodies,
as spheres, leave is summed over the sky's parts; every pixel is then dimmed by the grid points round it that lie at its height.
Surfaces count as level, which the wrist camera, looking down, mostly sees; the robot itself is left as it is.
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import math
from collections.abc import Mapping
from functools import cache

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.scene.light import WIDTH, SkyLight, directions
from gsbridge.splats.rasterize.lanes import WIDTH as LANES
from gsbridge.splats.rasterize.lanes import larger, lowest_bit, mask_bits, select, smaller, spread, square_root
from gsbridge.splats.rasterize.memory import at, load, store

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

TILE = 16
"""Grid points, in squares, for which spheres are looked up together: each shades a few of them only."""

_BARE, _OWN, _LIT = 0, 1, 2
"""What a point belongs to: the robot or nothing, the object, anything else."""

_SAME_HEIGHT = 0.012
_TINY = 1e-4
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
def _within(x, y, z, spheres, first, last, margin):  # type: ignore[no-untyped-def]
    """Whether a point lies in one of some spheres, or within a margin of it."""
    for s in range(first, last):
        a, b, c, edge = spheres[s, 0] - x, spheres[s, 1] - y, spheres[s, 2] - z, spheres[s, 3] + margin
        if a * a + b * b + c * c < edge * edge:
            return True
    return False


@njit(error_model="numpy", forceinline=True)
def _shade(along, side, up, s_along, s_side, s_up, radius, left):  # type: ignore[no-untyped-def]
    """What a sphere leaves of a direction's light at some points (`Lanes`), in coordinates along and across the direction.

    The same as `gsbridge.scene.occlusion.left_by`, without branches.
    """
    a, b, c = s_along - along, s_side - side, s_up - up
    across = b * b + c * c
    half = larger(a * WIDTH, 0.0) + _TINY
    # One division for all that are divided by `half`, or by the smaller of it and the radius.
    inverse = 1.0 / half
    blocked = smaller(larger((half + radius - square_root(across)) * larger(inverse, 1.0 / radius) * 0.5, 0.0), 1.0)
    blocked = blocked * smaller(inverse * inverse * (radius * radius), 1.0)
    outside = (a > 0.0) & (across + a * a > radius * radius)
    return smaller(left, 1.0 - select(outside, blocked, 0.0))


@njit(error_model="numpy", fastmath=True)
def _sort_out(points, spheres, robot, kinds):  # type: ignore[no-untyped-def]
    """What each point belongs to: `_BARE`, `_OWN` or `_LIT`. [N, 3], [S, 4] (the robot's first) -> kinds [N] int8."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        high = z >= TABLE_HEIGHT
        kinds[i] = _LIT
        if z == _NOWHERE or (high and _within(x, y, z, spheres, 0, robot, np.float32(ROBOT_MARGIN))):
            kinds[i] = _BARE
        elif high and _within(x, y, z, spheres, robot, spheres.shape[0], np.float32(OBJECT_MARGIN)):
            kinds[i] = _OWN


@njit(error_model="numpy")
def _gather(points, kinds, order, robot, spheres, tiled, balls, stops):  # type: ignore[no-untyped-def]
    """Points in the order of their tiles, and a ball round those of each tile that are to be lit.

    Args:
        points, kinds: [N, 3], [N].
        order: Point in each place of the tiles. [T * TILE].
        robot, spheres: How many spheres are the robot's, and in all.
        tiled: Output: x, y, z. [3 * T * TILE] float32.
        balls: Output: centre and radius. [T, 4].
        stops: Output: how many spheres to look up for a tile: the robot's, or all; -1 where nothing is to be lit. [T] int64.
    """
    size = order.shape[0]
    for t in range(balls.shape[0]):
        low, high, square = np.full(3, np.inf), np.full(3, -np.inf), 0.0
        stops[t] = -1
        for k in range(t * TILE, (t + 1) * TILE):
            kind = kinds[order[k]]
            # The object carries its own shade already.
            stops[t] = max(stops[t], -1 if kind == _BARE else robot if kind == _OWN else spheres)
            for i in range(3):
                value = points[order[k], i]
                tiled[i * size + k] = value
                if kind != _BARE:
                    low[i], high[i] = min(low[i], value), max(high[i], value)
        for i in range(3):
            balls[t, i] = 0.5 * (low[i] + high[i])
        for k in range(t * TILE, (t + 1) * TILE):
            if kinds[order[k]] != _BARE:
                away = 0.0
                for i in range(3):
                    away += (points[order[k], i] - balls[t, i]) ** 2
                square = max(square, away)
        balls[t, 3] = math.sqrt(square)


@njit(error_model="numpy")
def _light(tiled, balls, stops, spheres, robot, sources, shares, work, sums):  # type: ignore[no-untyped-def]
    """Add up the light of all directions at each point.

    Args:
        tiled, balls, stops: What `_gather` filled.
        spheres: Robot's first, then the object's. [S, 4] float32.
        robot: How many are the robot's.
        sources, shares: Direction and strength of the light's parts. [M, 3], [M] float32.
        work: Work space. [4 * (S + 8)] float32.
        sums: Added to: what the robot leaves, and what robot and object leave. [2 * T * TILE] float32.
    """
    size, count = balls.shape[0] * TILE, spheres.shape[0]
    # Along the direction, to two sides of it, radius: each with room for eight more, which are read but never counted.
    side, up, radii = count + LANES, 2 * (count + LANES), 3 * (count + LANES)
    for s in range(count):
        work[radii + s] = spheres[s, 3]
    for m in range(sources.shape[0]):
        dx, dy, dz, share = sources[m, 0], sources[m, 1], sources[m, 2], shares[m]
        ax, ay, az, bx, by, bz = _frame(dx, dy, dz)
        for s in range(count):
            x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
            work[s] = x * dx + y * dy + z * dz
            work[side + s], work[up + s] = x * ax + y * ay + z * az, x * bx + y * by + z * bz
        for t in range(balls.shape[0]):
            if stops[t] < 0:
                continue
            x, y, z, reach = balls[t, 0], balls[t, 1], balls[t, 2], balls[t, 3]
            ball_along = x * dx + y * dy + z * dz - reach
            ball_side, ball_up, reach = x * ax + y * ay + z * az, x * bx + y * by + z * bz, reach + _TINY
            first, second = t * TILE, t * TILE + LANES
            x0, y0, z0 = load(tiled, first), load(tiled, size + first), load(tiled, 2 * size + first)
            x1, y1, z1 = load(tiled, second), load(tiled, size + second), load(tiled, 2 * size + second)
            along0, side0, up0 = x0 * dx + y0 * dy + z0 * dz, x0 * ax + y0 * ay + z0 * az, x0 * bx + y0 * by + z0 * bz
            along1, side1, up1 = x1 * dx + y1 * dy + z1 * dz, x1 * ax + y1 * ay + z1 * az, x1 * bx + y1 * by + z1 * bz
            left0, left1 = spread(1.0), spread(1.0)
            for group in range(2):
                start, stop = (0, robot) if group == 0 else (robot, stops[t])
                for eight in range(start, stop, LANES):
                    ahead = load(work, eight) - ball_along
                    across, over = load(work, side + eight) - ball_side, load(work, up + eight) - ball_up
                    edge = load(work, radii + eight) + ahead * WIDTH + reach
                    bits = mask_bits((ahead > 0.0) & (across * across + over * over < edge * edge))
                    if stop - eight < LANES:
                        bits &= (1 << (stop - eight)) - 1
                    while bits:
                        s = eight + lowest_bit(bits)
                        bits &= bits - 1
                        a, b, c, radius = at(work, s), at(work, side + s), at(work, up + s), at(work, radii + s)
                        left0 = _shade(along0, side0, up0, a, b, c, radius, left0)
                        left1 = _shade(along1, side1, up1, a, b, c, radius, left1)
                place = group * size + first
                store(sums, place, load(sums, place) + left0 * share)
                store(sums, place + LANES, load(sums, place + LANES) + left1 * share)


@njit(error_model="numpy", fastmath=True)
def _tones(kinds, order, sums, tones):  # type: ignore[no-untyped-def]
    """Share of the light at each point, to the power that colours are encoded with.

    Args:
        kinds, order: As in `_gather`.
        sums: What `_light` added up. [2 * T * TILE].
        tones: Output: what the robot leaves, and what robot and object leave. [2, N].
    """
    size = order.shape[0]
    for k in range(size):
        i = order[k]
        for group in range(2):
            light = sums[group * size + k]
            tones[group, i] = np.float32(1.0) if kinds[i] == _BARE else np.float32(light ** (1.0 / _GAMMA))


@njit(error_model="numpy", fastmath=True)
def _widen(points, tones, kinds, step, out):  # type: ignore[no-untyped-def]
    """For each row of grid points, what the point to the left of every pixel of a row, and the one to the right, know.

    -> out [rows, 2, 4, W]: height, what the robot leaves, what robot and object leave, 1 on the object.
    """
    rows, columns = kinds.shape
    for u in range(out.shape[3]):
        left = int(math.floor((u - step // 2) / step))
        for q in range(2):
            c = min(max(left + q, 0), columns - 1)
            for r in range(rows):
                out[r, q, 0, u], out[r, q, 3, u] = points[r, c, 2], kinds[r, c] == _OWN
                out[r, q, 1, u], out[r, q, 2, u] = tones[0, r, c], tones[1, r, c]


@njit(error_model="numpy", fastmath=True)
def _dim(image, depths, alphas, lens, table_from_cam, step, points, tones, kinds, work):  # type: ignore[no-untyped-def]
    """Dim every pixel by the tone of the four grid points round it, those at its height foremost.

    Without branches, a row at a time, so that many pixels are computed at once. `work` has room for [rows, 2, 4, W].
    """
    rows, width = kinds.shape[0], image.shape[1]
    offset, one, zero, small = np.float32(_OFFSET), np.float32(1.0), np.float32(0.0), np.float32(1e-3)
    half = np.float32(0.5)
    _widen(points, tones, kinds, step, work)
    factors, shares = np.empty(width, np.float32), np.empty((2, width), np.float32)
    for u in range(width):
        # Whole numbers fall on the grid's pixels.
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
                    share = zero if level == _NOWHERE else share
                    # What stands up beside the table is the object: it carries its own shade, the table below it does not.
                    itself = height >= TABLE_HEIGHT and (work[r, q, 3, u] > half or level < TABLE_HEIGHT)
                    total += share * (work[r, q, 1, u] if itself else work[r, q, 2, u])
                    weight += share
            drawn = alphas[v, u] >= half and weight > zero
            factors[u] = total / weight if drawn else one
        for u in range(width):
            if factors[u] != one:
                for k in range(3):
                    image[v, u, k] = max((image[v, u, k] + offset) * factors[u] - offset, zero)


@cache
def _tile_order(rows: int, columns: int) -> Array:
    """Grid points in squares of `TILE`; at the edges of the grid some are there twice. [T * TILE] int64."""
    edge = math.isqrt(TILE)
    i, j = np.arange(-(-rows // edge) * edge), np.arange(-(-columns // edge) * edge)
    number = np.minimum(i, rows - 1)[:, None] * columns + np.minimum(j, columns - 1)
    return number.reshape(-1, edge, len(j) // edge, edge).swapaxes(1, 2).reshape(-1).copy()


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
        flat, kinds, order = points.reshape(count, 3), np.empty(count, np.int8), _tile_order(*shape)
        _sort_out(flat, spheres, self._robot, kinds)
        tiled, tiles = np.empty(3 * len(order), np.float32), len(order) // TILE
        balls, stops = np.empty((tiles, 4), np.float32), np.empty(tiles, np.int64)
        _gather(flat, kinds, order, self._robot, len(spheres), tiled, balls, stops)
        sums, work = np.full(2 * len(order), self._floor), np.zeros(4 * (len(spheres) + LANES), np.float32)
        _light(tiled, balls, stops, spheres, self._robot, self._sources, self._shares, work, sums)
        tones = np.empty((2, count), np.float32)
        _tones(kinds, order, sums, tones)
        grid = points, tones.reshape(2, *shape), kinds.reshape(shape)
        _dim(image, depths, alphas, lens, table_from_cam, step, *grid, np.empty((shape[0], 2, 4, image.shape[1]), np.float32))
