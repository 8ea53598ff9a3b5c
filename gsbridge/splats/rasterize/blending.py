"""Kernels that blend the records of a block front to back, and walk the same way again for the gradients.

The state of a block's sixteen pixels stays in registers while its list runs. The backward pass needs no second state: what a pixel
still receives from behind is its final value less what it has got so far.
"""

from __future__ import annotations

from gsbridge.kernels import njit, prange  # isort: skip  (first: it sets numba's cache folder)

import numba
import numpy as np

from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import (
    larger,
    at,
    put,
    load,
    load_spread,
    mask_bits,
    prefetch,
    select,
    smaller,
    spread,
    store,
    sums_of_eight,
)

RECORD, BLOCK = layout.RECORD, layout.BLOCK
LANE_X, LANE_Y = layout.LANE_X, layout.LANE_Y
_AHEAD = 8
"""Entries between a record's prefetch and its use."""
TILE = 4
"""Edge, in blocks, of the tiles in which blocks are visited: a tile's records stay in the nearest cache."""
PIXELS = BLOCK * BLOCK
STATE = 5 * PIXELS
"""float32 per block: red, green, blue, alpha and depth of its pixels."""


def use_threads(count: int) -> None:
    """Let the parallel kernels use a number of threads, as far as numba was started with as many."""
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))


@njit(error_model="numpy", forceinline=True)
def _constants(table):
    """The constants of `layout.TABLE` as lanes. Read from memory, or the compiler would set each up again in every turn of a loop."""
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
def _power(p, constants):
    """`2**(8 p)` for lanes in -1..0; anything finite, infinite or NaN elsewhere."""
    c0, c1, c2, c3, c4, c5, _, _, _ = constants
    e = c0 + p * (c1 + p * (c2 + p * (c3 + p * (c4 + p * c5))))
    e = e * e
    e = e * e
    return e * e


@njit(error_model="numpy", forceinline=True)
def _exponents(records, base, x_lanes, y_lanes):
    """Offsets dx and dy (upper half of the block), and an eighth of the binary logarithm of alpha in both halves."""
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
def _falloff(records, base, x_lanes, y_lanes, constants):
    """Offsets dx and dy (upper half of the block), and alpha before its clip, zero below the cut, in both halves."""
    dx, dy0, p0, p1 = _exponents(records, base, x_lanes, y_lanes)
    cut = constants[6]
    return dx, dy0, select(p0 >= cut, _power(p0, constants), 0.0), select(p1 >= cut, _power(p1, constants), 0.0)


@njit(error_model="numpy", forceinline=True)
def _lanes_of(row, column, width, height):
    """Pixel centres of a block (the lower half lies 2 px further down), and 1 where its halves are inside the image."""
    x = load(LANE_X, 0) + (column * BLOCK + 0.5)
    y = load(LANE_Y, 0) + (row * BLOCK + 0.5)
    return x, y, select((x < width) & (y < height), 1.0, 0.0), select((x < width) & (y + 2.0 < height), 1.0, 0.0)


@njit(error_model="numpy", forceinline=True)
def _blend_block(table, records, entries, first, last, row, column, width, height, background, states, state, weights):
    """Blend a block into `states`, from `state` on; returns the end of its list, shortened to entries that changed a pixel."""
    x_lanes, y_lanes, light0, light1 = _lanes_of(row, column, width, height)
    constants = _constants(table)
    cut, alpha_max, light_min = constants[6], constants[7], constants[8]
    kept, place = first, 0
    for entry in range(first, last):
        open0, open1 = light0 >= light_min, light1 >= light_min
        if mask_bits(open0 | open1) == 0:
            break
        number = at(entries, entry)
        base = np.int64(number) * RECORD
        prefetch(records, np.int64(at(entries, min(entry + _AHEAD, last - 1))) * RECORD)
        _, _, p0, p1 = _exponents(records, base, x_lanes, y_lanes)
        hit0, hit1 = (p0 >= cut) & open0, (p1 >= cut) & open1
        weight0 = select(hit0, smaller(_power(p0, constants), alpha_max), 0.0) * light0
        weight1 = select(hit1, smaller(_power(p1, constants), alpha_max), 0.0) * light1
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
def _write_row(states, row, columns, width, height, colours, alphas, depths):
    """Copy one row of blocks into the images."""
    for j in range(min(BLOCK, height - row * BLOCK)):
        for column in range(columns):
            state, pixel = (row * columns + column) * STATE + j * BLOCK, (row * BLOCK + j) * width + column * BLOCK
            for i in range(min(BLOCK, width - column * BLOCK)):
                colours[3 * (pixel + i)] = states[state + i]
                colours[3 * (pixel + i) + 1] = states[state + PIXELS + i]
                colours[3 * (pixel + i) + 2] = states[state + 2 * PIXELS + i]
                alphas[pixel + i] = states[state + 3 * PIXELS + i]
                depths[pixel + i] = states[state + 4 * PIXELS + i]


@njit(error_model="numpy")
def _blend_band(table, records, entries, starts, ends, band, rows, columns, width, height, background, states, colours, alphas, depths):
    """Blend one row of tiles."""
    last_row = min((band + 1) * TILE, rows)
    longest = 0
    for block in range(band * TILE * columns, last_row * columns):
        longest = max(longest, ends[block] - starts[block])
    weights = np.empty(longest * PIXELS + PIXELS, np.float32)
    for tile in range(0, columns, TILE):
        for row in range(band * TILE, last_row):
            for column in range(tile, min(tile + TILE, columns)):
                block = row * columns + column
                ends[block] = _blend_block(
                    table, records, entries, starts[block], ends[block], row, column, width, height, background, states, block * STATE, weights
                )
    for row in range(band * TILE, last_row):
        _write_row(states, row, columns, width, height, colours, alphas, depths)


@njit(error_model="numpy")
def blend(table, records, entries, starts, ends, rows, columns, width, height, background, states, colours, alphas, depths):
    """Blend all blocks.

    Args:
        table: `layout.TABLE`.
        records: Records. [N * RECORD].
        entries, starts, ends: List of each block; shortened to the entries that changed a pixel.
        rows, columns: Blocks.
        width, height: Image, px.
        background: Colour behind the splats. [3].
        states: Filled with the blocks' pixels. [rows * columns * STATE].
        colours, alphas, depths: Filled. [H * W * 3], [H * W], [H * W].
    """
    for band in range((rows + TILE - 1) // TILE):
        _blend_band(table, records, entries, starts, ends, band, rows, columns, width, height, background, states, colours, alphas, depths)


@njit(error_model="numpy", parallel=True)
def blend_parallel(table, records, entries, starts, ends, rows, columns, width, height, background, states, colours, alphas, depths):
    """`blend` on several threads; the blocks do not touch each other, so the image is the same to the last bit."""
    for band in prange((rows + TILE - 1) // TILE):
        _blend_band(table, records, entries, starts, ends, band, rows, columns, width, height, background, states, colours, alphas, depths)


@njit(error_model="numpy")
def _gather_gradients(g_colours, g_alphas, g_depths, row, column, width, height, scratch):
    """Copy the images' gradients of a block: red, green, blue, depth, alpha. Pixels outside the image keep what was there."""
    for j in range(min(BLOCK, height - row * BLOCK)):
        pixel = (row * BLOCK + j) * width + column * BLOCK
        for i in range(min(BLOCK, width - column * BLOCK)):
            lane = j * BLOCK + i
            scratch[lane] = g_colours[3 * (pixel + i)]
            scratch[PIXELS + lane] = g_colours[3 * (pixel + i) + 1]
            scratch[2 * PIXELS + lane] = g_colours[3 * (pixel + i) + 2]
            scratch[3 * PIXELS + lane] = g_depths[pixel + i]
            scratch[4 * PIXELS + lane] = g_alphas[pixel + i]


@njit(error_model="numpy", forceinline=True)
def _worth(scratch, half, background, states, state):
    """Gradient of a unit of weight without colour and depth, and the sum over all weights of what they are worth."""
    red, green, blue = load(scratch, half), load(scratch, half + 16), load(scratch, half + 32)
    depth, alpha = load(scratch, half + 48), load(scratch, half + 64)
    behind = red * background[0] + green * background[1] + blue * background[2]
    # With the light left behind the splats equal to 1 - alpha, each weight replaces its share of the background.
    total = red * load(states, state + half) + green * load(states, state + half + 16) + blue * load(states, state + half + 32)
    total = total + alpha * load(states, state + half + 48) + depth * load(states, state + half + 64) - behind
    return alpha - behind, total


@njit(error_model="numpy")
def _backward_block(table, records, entries, first, last, row, column, width, height, background, states, state, scratch, sums):
    """Add a block's gradient sums to those of its records; `scratch` holds the gradients of its pixels."""
    x_lanes, y_lanes, light0, light1 = _lanes_of(row, column, width, height)
    plain0, rest0 = _worth(scratch, 0, background, states, state)
    plain1, rest1 = _worth(scratch, 8, background, states, state)
    store(scratch, 64, plain0)
    store(scratch, 72, plain1)
    constants = _constants(table)
    alpha_max, light_min = constants[7], constants[8]
    after = np.int64(entries[first]) * RECORD
    next_dx, next_dy, next_raw0, next_raw1 = _falloff(records, after, x_lanes, y_lanes, constants)
    for entry in range(first, last):
        # The falloff of the next entry is computed beside the sums of this one: two short chains instead of a long one.
        base, dx, dy0, raw0, raw1 = after, next_dx, next_dy, next_raw0, next_raw1
        dy1 = dy0 + 2.0
        ahead = np.int64(at(entries, min(entry + _AHEAD, last - 1))) * RECORD
        prefetch(records, ahead)
        prefetch(sums, ahead)
        after = np.int64(at(entries, min(entry + 1, last - 1))) * RECORD
        next_dx, next_dy, next_raw0, next_raw1 = _falloff(records, after, x_lanes, y_lanes, constants)
        alpha0 = select(light0 >= light_min, smaller(raw0, alpha_max), 0.0)
        alpha1 = select(light1 >= light_min, smaller(raw1, alpha_max), 0.0)
        weight0, weight1 = alpha0 * light0, alpha1 * light1
        light0, light1 = light0 - weight0, light1 - weight1

        red, green = load_spread(records, base + layout.RED), load_spread(records, base + layout.GREEN)
        blue, depth = load_spread(records, base + layout.BLUE), load_spread(records, base + layout.DEPTH)
        worth0 = red * load(scratch, 0) + green * load(scratch, 16) + blue * load(scratch, 32)
        worth1 = red * load(scratch, 8) + green * load(scratch, 24) + blue * load(scratch, 40)
        worth0 = worth0 + (depth * load(scratch, 48) + load(scratch, 64))
        worth1 = worth1 + (depth * load(scratch, 56) + load(scratch, 72))
        gain0, gain1 = weight0 * worth0, weight1 * worth1
        rest0, rest1 = rest0 - gain0, rest1 - gain1
        # alpha dL/dalpha; zero where the clip at ALPHA_MAX holds alpha.
        g0 = select(raw0 < alpha_max, gain0 - rest0 * (alpha0 / (1.0 - alpha0)), 0.0)
        g1 = select(raw1 < alpha_max, gain1 - rest1 * (alpha1 / (1.0 - alpha1)), 0.0)

        gy0, gy1 = g0 * dy0, g1 * dy1
        g, gy = g0 + g1, gy0 + gy1
        gx = g * dx
        moments = sums_of_eight(
            g,
            gx,
            gy,
            gx * dx,
            gy * dx,
            gy0 * dy0 + gy1 * dy1,
            weight0 * load(scratch, 0) + weight1 * load(scratch, 8),
            weight0 * load(scratch, 16) + weight1 * load(scratch, 24),
        )
        blue = weight0 * load(scratch, 32) + weight1 * load(scratch, 40)
        depth = weight0 * load(scratch, 48) + weight1 * load(scratch, 56)
        others = sums_of_eight(blue, depth, blue, depth, blue, depth, blue, depth)
        store(sums, base, load(sums, base) + moments)
        store(sums, base + 8, load(sums, base + 8) + others)


@njit(error_model="numpy")
def _backward_rows(
    table, records, entries, starts, ends, first_row, last_row, columns, width, height, background, states, g_colours, g_alphas, g_depths, sums
):
    """Add the gradient sums of rows of blocks to the sums of the records, tile by tile."""
    scratch = np.zeros(STATE, np.float32)
    for top in range(first_row, last_row, TILE):
        for tile in range(0, columns, TILE):
            for row in range(top, min(top + TILE, last_row)):
                for column in range(tile, min(tile + TILE, columns)):
                    block = row * columns + column
                    first, last = starts[block], ends[block]
                    if first == last:
                        continue
                    _gather_gradients(g_colours, g_alphas, g_depths, row, column, width, height, scratch)
                    _backward_block(
                        table, records, entries, first, last, row, column, width, height, background, states, block * STATE, scratch, sums
                    )


@njit(error_model="numpy")
def blend_backward(
    table, records, entries, starts, ends, rows, columns, width, height, background, states, g_colours, g_alphas, g_depths, sums
):
    """Gradient sums of all records, see `project_backward`.

    Args:
        table, records, entries, starts, ends, rows, columns, width, height, background, states: As in `blend`, after it ran.
        g_colours, g_alphas, g_depths: Gradients of the loss with respect to the images.
        sums: Added to. [N * RECORD].
    """
    _backward_rows(
        table, records, entries, starts, ends, 0, rows, columns, width, height, background, states, g_colours, g_alphas, g_depths, sums
    )


@njit(error_model="numpy", parallel=True)
def blend_backward_parallel(
    table, records, entries, starts, ends, rows, columns, width, height, background, states, g_colours, g_alphas, g_depths, parts
):
    """`blend_backward` in bands of rows, each with its own sums, added in the order of the bands: no race, no atomics.

    Args:
        parts: Sums of each band, zero on entry; the first holds the result. [bands, N * RECORD].
    """
    bands = len(parts)
    for band in prange(bands):
        first, last = rows * band // bands, rows * (band + 1) // bands
        _backward_rows(
            table,
            records,
            entries,
            starts,
            ends,
            first,
            last,
            columns,
            width,
            height,
            background,
            states,
            g_colours,
            g_alphas,
            g_depths,
            parts[band],
        )
    for band in range(1, bands):
        for k in range(parts.shape[1]):
            parts[0, k] += parts[band, k]
