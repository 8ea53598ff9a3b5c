"""Functions that the blending kernels share: the pixels of a block, and a splat's alpha at them."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import LaneValues, select
from gsbridge.splats.rasterize.memory import load, load_spread

BLOCK, PIXELS = layout.BLOCK, layout.PIXELS
LANE_X, LANE_Y = layout.LANE_X, layout.LANE_Y
TILE = 4
"""Edge, in blocks, of the tiles in which blocks are processed, so that a tile's records stay in the first-level cache."""


@njit(error_model="numpy", forceinline=True)
def read_table(table: Array) -> tuple[LaneValues, ...]:
    """Load `layout.TABLE` [9] as lanes; the compiler would set up literal constants again in every iteration of a loop."""
    return (
        load_spread(table, 0),
        load_spread(table, 1),
        load_spread(table, 2),
        load_spread(table, 3),
        load_spread(table, 4),
        load_spread(table, 5),
        load_spread(table, 6),
        load_spread(table, 7),
        load_spread(table, 8),
    )


@njit(error_model="numpy", forceinline=True)
def power(p: LaneValues, constants: tuple[LaneValues, ...]) -> LaneValues:
    """Return `2**(8 p)` for lanes in -1..0; the result is undefined for other values."""
    c0, c1, c2, c3, c4, c5, _, _, _ = constants
    e = c0 + p * (c1 + p * (c2 + p * (c3 + p * (c4 + p * c5))))
    e = e * e
    e = e * e
    return e * e


@njit(error_model="numpy", forceinline=True)
def exponents(
    records: Array, base: int | np.int64, x_lanes: LaneValues, y_lanes: LaneValues
) -> tuple[LaneValues, LaneValues, LaneValues, LaneValues]:
    """Return the offsets dx and dy (upper half of the block), and an eighth of alpha's binary logarithm in both halves.

    Args:
        records: Projected splats. [N * RECORD] float32.
        base: Index in `records` at which the splat's record begins.
        x_lanes, y_lanes: Pixel centres of the block's upper half, from `pixels_of`, px.

    Returns:
        dx and dy, px, then the exponents of the upper and the lower half.
    """
    dx = x_lanes - load_spread(records, base + layout.X)
    dy0 = y_lanes - load_spread(records, base + layout.Y)
    dy1 = dy0 + 2.0
    xy, yy = load_spread(records, base + layout.XY), load_spread(records, base + layout.YY)
    log = load_spread(records, base + layout.LOG)
    along = load_spread(records, base + layout.XX) * dx
    p0 = log - dx * (along + xy * dy0) - (yy * dy0) * dy0
    p1 = log - dx * (along + xy * dy1) - (yy * dy1) * dy1
    return dx, dy0, p0, p1


@njit(error_model="numpy", forceinline=True)
def falloff(
    records: Array, base: int | np.int64, x_lanes: LaneValues, y_lanes: LaneValues, constants: tuple[LaneValues, ...]
) -> tuple[LaneValues, LaneValues, LaneValues, LaneValues]:
    """Return the offsets dx and dy (upper half of the block), and alpha in both halves, unclipped and zero below the cut.

    Args:
        records: Projected splats. [N * RECORD] float32.
        base: Index in `records` at which the splat's record begins.
        x_lanes, y_lanes: Pixel centres of the block's upper half, from `pixels_of`, px.
        constants: Output of `read_table`.

    Returns:
        dx and dy, px, then alpha in the upper and in the lower half.
    """
    dx, dy0, p0, p1 = exponents(records, base, x_lanes, y_lanes)
    cut = constants[6]
    return dx, dy0, select(p0 >= cut, power(p0, constants), 0.0), select(p1 >= cut, power(p1, constants), 0.0)


@njit(error_model="numpy", forceinline=True)
def pixels_of(row: int, column: int, width: int, height: int) -> tuple[LaneValues, LaneValues, LaneValues, LaneValues]:
    """Return the pixel centres of a block's upper half (the lower half is 2 px further down) and marks of pixels in the image.

    Args:
        row, column: Row and column of the block in the image.
        width, height: Size of the image, px.

    Returns:
        x and y of the upper half's pixel centres, px, then the marks of upper and lower half (1 inside the image, 0 outside).
    """
    x = load(LANE_X, 0) + (column * BLOCK + 0.5)
    y = load(LANE_Y, 0) + (row * BLOCK + 0.5)
    return x, y, select((x < width) & (y < height), 1.0, 0.0), select((x < width) & (y + 2.0 < height), 1.0, 0.0)
