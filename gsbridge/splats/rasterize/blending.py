"""Kernels that blend the records of each block front to back.

A first pass over a block's list keeps the transmittances of its pixels in registers and writes the weights to a scratch array.
A second pass, over the records that changed a pixel, sums colour and depth. A single pass for both needs more registers than
most processors have. Processors with AVX-512 have enough and get their own kernel, whose results differ only by rounding (so
that, rarely, a splat close to the alpha cut is kept by one kernel only).
"""

from __future__ import annotations

from gsbridge.kernels import njit, options, prange  # isort: skip  (first: it sets numba's cache folder)

from typing import Any

import numba
import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.falloff import TILE, exponents, pixels_of, power, read_table
from gsbridge.splats.rasterize.lanes import HAS_WIDE, mask_bits, select, smaller, spread, spread_wide
from gsbridge.splats.rasterize.memory import (
    at,
    load,
    load_spread,
    load_wide,
    prefetch,
    put,
    store,
    store_halves,
    store_pixels,
)

RECORD, BLOCK, PIXELS, STATE = layout.RECORD, layout.BLOCK, layout.PIXELS, layout.STATE

AHEAD = 32
"""Number of entries between a record's prefetch and its use: processing one entry is much faster than a memory access."""


def use_threads(count: int) -> None:
    """Set the number of threads of the parallel kernels, at most the number with which numba was started."""
    numba.set_num_threads(min(count, options.NUMBA_NUM_THREADS))


@njit(error_model="numpy")
def _blend_block(
    table: Array,
    records: Array,
    entries: Array,
    first: int,
    last: int,
    row: int,
    column: int,
    width: int,
    height: int,
    background: Array,
    states: Array,
    state: int,
    weights: Array,
) -> int:
    """Blend a block into `states`, from index `state` on, and keep only the entries of its list that changed a pixel.

    Returns:
        The end of the shortened list.
    """
    x_lanes, y_lanes, light0, light1 = pixels_of(row, column, width, height)
    constants = read_table(table)
    cut, alpha_max, light_min = constants[6], constants[7], constants[8]
    kept, place = first, 0
    for entry in range(first, last):
        open0, open1 = light0 >= light_min, light1 >= light_min
        # Test only every fourth entry whether all pixels are finished: finished pixels take no more weight anyway.
        if (entry & 3) == 0 and mask_bits(open0 | open1) == 0:
            break
        number = at(entries, entry)
        prefetch(records, np.int64(at(entries, min(entry + AHEAD, last - 1))) * RECORD)
        _, _, p0, p1 = exponents(records, np.int64(number) * RECORD, x_lanes, y_lanes)
        hit0, hit1 = (p0 >= cut) & open0, (p1 >= cut) & open1
        weight0 = select(hit0, smaller(power(p0, constants), alpha_max), 0.0) * light0
        weight1 = select(hit1, smaller(power(p1, constants), alpha_max), 0.0) * light1
        light0, light1 = light0 - weight0, light1 - weight1
        store(weights, place, weight0)
        store(weights, place + 8, weight1)
        put(entries, kept, number)
        hit = mask_bits(hit0 | hit1) != 0
        kept += hit
        place += hit * PIXELS
    red0, red1, green0, green1 = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    blue0, blue1, depth0, depth1 = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    place = 0
    for entry in range(first, kept):
        base = np.int64(at(entries, entry)) * RECORD
        weight0, weight1 = load(weights, place), load(weights, place + 8)
        place += PIXELS
        value = load_spread(records, base + layout.RED)
        red0, red1 = red0 + weight0 * value, red1 + weight1 * value
        value = load_spread(records, base + layout.GREEN)
        green0, green1 = green0 + weight0 * value, green1 + weight1 * value
        value = load_spread(records, base + layout.BLUE)
        blue0, blue1 = blue0 + weight0 * value, blue1 + weight1 * value
        value = load_spread(records, base + layout.DEPTH)
        depth0, depth1 = depth0 + weight0 * value, depth1 + weight1 * value
    store(states, state, red0 + light0 * background[0])
    store(states, state + 8, red1 + light1 * background[0])
    store(states, state + 16, green0 + light0 * background[1])
    store(states, state + 24, green1 + light1 * background[1])
    store(states, state + 32, blue0 + light0 * background[2])
    store(states, state + 40, blue1 + light1 * background[2])
    store(states, state + 48, 1.0 - light0)
    store(states, state + 56, 1.0 - light1)
    store(states, state + 64, depth0)
    store(states, state + 72, depth1)
    return kept


@njit(error_model="numpy")
def _blend_block_wide(
    table: Array,
    records: Array,
    entries: Array,
    first: int,
    last: int,
    row: int,
    column: int,
    width: int,
    height: int,
    background: Array,
    states: Array,
    state: int,
    weights: Array,
) -> int:
    """Do the work of `_blend_block` in one pass, with all sixteen pixels in one register; `weights` is not used."""
    x, y = load_wide(layout.PIXEL_X, 0) + (column * BLOCK + 0.5), load_wide(layout.PIXEL_Y, 0) + (row * BLOCK + 0.5)
    light = select((x < width) & (y < height), 1.0, 0.0)
    c0, c1, c2, c3, c4, c5 = at(table, 0), at(table, 1), at(table, 2), at(table, 3), at(table, 4), at(table, 5)
    cut, alpha_max, light_min = at(table, 6), at(table, 7), at(table, 8)
    red, green, blue, depth = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
    kept = first
    for entry in range(first, last):
        is_open = light >= light_min
        if (entry & 3) == 0 and mask_bits(is_open) == 0:
            break
        number = at(entries, entry)
        prefetch(records, np.int64(at(entries, min(entry + AHEAD, last - 1))) * RECORD)
        base = np.int64(number) * RECORD
        dx, dy = x - at(records, base + layout.X), y - at(records, base + layout.Y)
        along = at(records, base + layout.XX) * dx + at(records, base + layout.XY) * dy
        p = at(records, base + layout.LOG) - dx * along - (at(records, base + layout.YY) * dy) * dy
        near = p >= cut
        power = c0 + p * (c1 + p * (c2 + p * (c3 + p * (c4 + p * c5))))
        power = power * power
        power = power * power
        # Each entry depends on the light of the one before. Test last whether a pixel is finished, to keep that chain short.
        wanted = select(near, smaller(power * power, alpha_max), 0.0) * light
        weight = select(is_open, wanted, 0.0)
        light = select(is_open, light - wanted, light)
        red, green = red + weight * at(records, base + layout.RED), green + weight * at(records, base + layout.GREEN)
        blue, depth = blue + weight * at(records, base + layout.BLUE), depth + weight * at(records, base + layout.DEPTH)
        put(entries, kept, number)
        kept += mask_bits(near & is_open) != 0
    store(states, state, red + light * background[0])
    store(states, state + PIXELS, green + light * background[1])
    store(states, state + 2 * PIXELS, blue + light * background[2])
    store(states, state + 3 * PIXELS, 1.0 - light)
    store(states, state + 4 * PIXELS, depth)
    return kept


_blend_best = _blend_block_wide if HAS_WIDE else _blend_block


@njit(error_model="numpy")
def _write_block(states: Array, state: int, row: int, column: int, width: int, height: int, images: tuple[Array, ...]) -> None:
    """Copy a block into the images."""
    colours, alphas, depths = images
    if (row + 1) * BLOCK <= height and (column + 1) * BLOCK <= width:
        for half in range(2):
            source, pixel = state + 8 * half, (row * BLOCK + 2 * half) * width + column * BLOCK
            red, green, blue = load(states, source), load(states, source + PIXELS), load(states, source + 2 * PIXELS)
            store_pixels(colours, 3 * pixel, 3 * width, red, green, blue)
            store_halves(alphas, pixel, width, load(states, source + 3 * PIXELS))
            store_halves(depths, pixel, width, load(states, source + 4 * PIXELS))
        return
    for j in range(min(BLOCK, height - row * BLOCK)):
        for i in range(min(BLOCK, width - column * BLOCK)):
            source, pixel = state + j * BLOCK + i, (row * BLOCK + j) * width + column * BLOCK + i
            for k in range(3):
                colours[3 * pixel + k] = states[source + k * PIXELS]
            alphas[pixel] = states[source + 3 * PIXELS]
            depths[pixel] = states[source + 4 * PIXELS]


@njit(error_model="numpy")
def _blend_band(blocks: tuple[Any, ...], images: tuple[Array, ...], band: int) -> None:
    """Blend one row of tiles."""
    table, records, entries, starts, ends, rows, columns, width, height, background, states = blocks
    last_row = min((band + 1) * TILE, rows)
    longest = 0
    for block in range(band * TILE * columns, last_row * columns):
        longest = max(longest, ends[block] - starts[block])
    weights = np.empty((longest + 1) * PIXELS, np.float32)
    for tile in range(0, columns, TILE):
        for row in range(band * TILE, last_row):
            for column in range(tile, min(tile + TILE, columns)):
                block = row * columns + column
                first, last, state = starts[block], ends[block], block * STATE
                ends[block] = _blend_best(
                    table, records, entries, first, last, row, column, width, height, background, states, state, weights
                )
                _write_block(states, state, row, column, width, height, images)


@njit(error_model="numpy")
def blend(blocks: tuple[Any, ...], images: tuple[Array, ...]) -> None:
    """Blend all blocks.

    Args:
        blocks: `layout.TABLE`; records [N * RECORD]; the lists' entries, starts and ends, shortened here to the entries that
            changed a pixel; rows and columns of blocks; width and height of the image, px; background [3]; states, filled with
            the blocks' pixels [rows * columns * STATE].
        images: Colours [H * W * 3], alphas [H * W], depths [H * W], filled.
    """
    for band in range((blocks[5] + TILE - 1) // TILE):
        _blend_band(blocks, images, band)


@njit(error_model="numpy", parallel=True)
def blend_parallel(blocks: tuple[Any, ...], images: tuple[Array, ...]) -> None:
    """Do the work of `blend` on several threads; blocks are independent, so the image is bitwise the same.

    Args:
        blocks, images: As in `blend`. [H * W * 3], [H * W], [H * W].
    """
    for band in prange((blocks[5] + TILE - 1) // TILE):
        _blend_band(blocks, images, band)
