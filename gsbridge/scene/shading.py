"""Kernels that compute how much light reaches points near bodies made of spheres.

Points are processed in small tiles of neighbours; for each tile only the spheres that may shade it are computed.
"""

from __future__ import annotations

from gsbridge.kernels import Real, njit  # isort: skip  (first: it sets numba's cache folder)

import math
from functools import cache

import numpy as np

from gsbridge.geometry import Array
from gsbridge.scene.light import WIDTH
from gsbridge.splats.rasterize.lanes import WIDTH as LANES
from gsbridge.splats.rasterize.lanes import LaneValues, larger, lowest_bit, mask_bits, select, smaller, spread, square_root
from gsbridge.splats.rasterize.memory import at, load, store

TABLE_HEIGHT = 0.006
"""Points below this height, m, count as the table; higher ones may be the object's, whose splats hold its own shade already."""

ROBOT_MARGIN = 0.003
"""Distance from the robot's spheres within which a surface is the robot's, m."""

OBJECT_MARGIN = 0.010
"""Distance from the object's spheres within which a point is the object's, m. Points farther off, such as a plate's, are
shaded by the object."""

NOWHERE = -1e3
"""Height of a point where nothing is drawn, m; not NaN, which kernels compiled with `fastmath` do not recognise."""

TILE = 2 * LANES
"""Points in one tile, a square of the grid. Spheres are looked up once for a whole tile; each shades only a few tiles."""

BARE, OWN, LIT = 0, 1, 2
"""Kinds of points: those of the robot or of nothing, those of the object, and all others."""

GAMMA = 2.4
"""Exponent in sRGB's encoding of all but the darkest light."""

_TINY = 1e-4


@cache
def tile_order(rows: int, columns: int) -> Array:
    """Numbers of the grid points, tile by tile; some points at the grid's edges appear twice. [T * TILE] int64."""
    edge = math.isqrt(TILE)
    i, j = np.arange(-(-rows // edge) * edge), np.arange(-(-columns // edge) * edge)
    number = np.minimum(i, rows - 1)[:, None] * columns + np.minimum(j, columns - 1)
    return number.reshape(-1, edge, len(j) // edge, edge).swapaxes(1, 2).reshape(-1).copy()


@njit(error_model="numpy", fastmath=True)
def _frame(dx: float, dy: float, dz: float) -> tuple[Real, ...]:
    """Two unit vectors perpendicular to a direction and to each other; the direction must not be parallel to x."""
    length = math.sqrt(dy * dy + dz * dz)
    ax, ay, az = np.float32(0.0), dz / length, -dy / length
    return ax, ay, az, dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax


@njit(error_model="numpy", fastmath=True)
def _within(x: float, y: float, z: float, spheres: Array, first: int, last: int, margin: Real) -> bool:
    """Whether a point lies in one of some spheres, or within a margin of it."""
    for s in range(first, last):
        a, b, c, edge = spheres[s, 0] - x, spheres[s, 1] - y, spheres[s, 2] - z, spheres[s, 3] + margin
        if a * a + b * b + c * c < edge * edge:
            return True
    return False


@njit(error_model="numpy", forceinline=True)
def _shade(
    along: LaneValues,
    side: LaneValues,
    up: LaneValues,
    s_along: float,
    s_side: float,
    s_up: float,
    radius: float,
    left: LaneValues,
) -> LaneValues:
    """Share of a direction's light that remains at the points in the lanes after one more sphere.

    Coordinates run along and across the direction. This is `gsbridge.scene.occlusion.left_by` without branches.
    """
    a, b, c = s_along - along, s_side - side, s_up - up
    across = b * b + c * c
    half = larger(a * WIDTH, 0.0) + _TINY
    # One division serves all quotients by `half` and by the smaller of `half` and the radius.
    inverse = 1.0 / half
    blocked = smaller(larger((half + radius - square_root(across)) * larger(inverse, 1.0 / radius) * 0.5, 0.0), 1.0)
    blocked = blocked * smaller(inverse * inverse * (radius * radius), 1.0)
    outside = (a > 0.0) & (across + a * a > radius * radius)
    return smaller(left, 1.0 - select(outside, blocked, 0.0))


@njit(error_model="numpy", fastmath=True)
def _sort_out(points: Array, spheres: Array, robot: int, kinds: Array) -> None:
    """Find each point's kind: `BARE`, `OWN` or `LIT`. [N, 3], [S, 4] (the robot's first) -> kinds [N] int8."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        high = z >= TABLE_HEIGHT
        kinds[i] = LIT
        if z == NOWHERE or (high and _within(x, y, z, spheres, 0, robot, np.float32(ROBOT_MARGIN))):
            kinds[i] = BARE
        elif high and _within(x, y, z, spheres, robot, spheres.shape[0], np.float32(OBJECT_MARGIN)):
            kinds[i] = OWN


@njit(error_model="numpy")
def _gather(points: Array, kinds: Array, order: Array, tiled: Array, balls: Array, lit: Array) -> None:
    """Sort points into their tiles, and find a ball round those points of each tile that are not `BARE`.

    Args:
        points, kinds: [N, 3], [N].
        order: Point in each place of the tiles. [T * TILE].
        tiled: Output: x, y, z. [3 * T * TILE] float32.
        balls: Output: centre and radius. [T, 4].
        lit: Output: whether the tile has any such points. [T] bool.
    """
    size = order.shape[0]
    for t in range(balls.shape[0]):
        low, high, square = np.full(3, np.inf), np.full(3, -np.inf), 0.0
        lit[t] = False
        for k in range(t * TILE, (t + 1) * TILE):
            kind = kinds[order[k]]
            lit[t] |= kind != BARE
            for i in range(3):
                value = points[order[k], i]
                tiled[i * size + k] = value
                if kind != BARE:
                    low[i], high[i] = min(low[i], value), max(high[i], value)
        for i in range(3):
            balls[t, i] = 0.5 * (low[i] + high[i])
        for k in range(t * TILE, (t + 1) * TILE):
            if kinds[order[k]] != BARE:
                away = 0.0
                for i in range(3):
                    away += (points[order[k], i] - balls[t, i]) ** 2
                square = max(square, away)
        balls[t, 3] = math.sqrt(square)


@njit(error_model="numpy")
def _light(
    tiled: Array, balls: Array, lit: Array, spheres: Array, robot: int, sources: Array, shares: Array, work: Array, sums: Array
) -> None:
    """Add up the light of all directions at each point.

    Args:
        tiled, balls, lit: What `_gather` filled.
        spheres: Robot's first, then the object's. [S, 4] float32.
        robot: Number of spheres that are the robot's.
        sources, shares: Direction and strength of the light's parts. [M, 3], [M] float32.
        work: Work space. [4 * (S + 8)] float32.
        sums: Added to: the light left after the robot's spheres, and after robot's and object's. [2 * T * TILE] float32.
    """
    size, count = balls.shape[0] * TILE, spheres.shape[0]
    # `work` holds each sphere's coordinate along the direction, two across it, and its radius, in this order. Each of the four
    # parts has room for `LANES` more values, which are read but never used.
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
            if not lit[t]:
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
                start, stop = (0, robot) if group == 0 else (robot, count)
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
def _tones(kinds: Array, order: Array, sums: Array, tones: Array) -> None:
    """Encode the share of the light at each point with the exponent that colours are encoded with.

    Args:
        kinds, order: As in `_gather`.
        sums: What `_light` added up. [2 * T * TILE].
        tones: Output: encoded light left after the robot's spheres, and after robot's and object's. [2, N].
    """
    size = order.shape[0]
    for k in range(size):
        i = order[k]
        for group in range(2):
            light = sums[group * size + k]
            tones[group, i] = np.float32(1.0) if kinds[i] == BARE else np.float32(light ** (1.0 / GAMMA))


@njit(error_model="numpy")
def shade_points(
    points: Array,
    order: Array,
    spheres: Array,
    robot: int,
    sources: Array,
    shares: Array,
    floor: Real,
    kinds: Array,
    tones: Array,
) -> None:
    """Find the kind of each point, and the share of the light that reaches it.

    Args:
        points: Surface points, table frame; of height `NOWHERE` where there is none. [N, 3] float32.
        order: What `tile_order` gives for their grid. [T * TILE] int64.
        spheres: Robot's first, then the object's. [S, 4] float32.
        robot: Number of spheres that are the robot's.
        sources, shares, floor: Direction and share of the light's parts, and the share that no body blocks. [M, 3], [M].
        kinds: Output: `BARE`, `OWN` or `LIT`. [N] int8.
        tones: Output: share of the light, with the exponent that colours are encoded with: first as the robot leaves it, then
            as robot and object leave it. [2, N] float32.
    """
    tiles = order.shape[0] // TILE
    tiled, balls, lit = np.empty(3 * TILE * tiles, np.float32), np.empty((tiles, 4), np.float32), np.empty(tiles, np.bool_)
    sums, work = np.full(2 * TILE * tiles, floor), np.zeros(4 * (spheres.shape[0] + LANES), np.float32)
    _sort_out(points, spheres, robot, kinds)
    _gather(points, kinds, order, tiled, balls, lit)
    _light(tiled, balls, lit, spheres, robot, sources, shares, work, sums)
    _tones(kinds, order, sums, tones)
