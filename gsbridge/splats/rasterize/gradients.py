"""Kernels that go through each block's list again, front to back, to compute the gradients of its records.

Only a pixel's final value is kept from the forward pass: the light that reaches a pixel from behind a splat is the final value
minus the sum up to that splat. The gradient with respect to a splat's weight is the sum over colour and depth of the image's
gradient times the splat's value, plus the gradient of alpha, minus that of the background, which the splat hides.
"""

from __future__ import annotations

from gsbridge.kernels import njit, prange  # isort: skip  (first: it sets numba's cache folder)

from typing import Any

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.falloff import TILE, falloff, pixels_of, read_table
from gsbridge.splats.rasterize.lanes import LaneValues, select, smaller, sums_of_eight
from gsbridge.splats.rasterize.memory import at, load, load_halves, load_pixels, load_spread, prefetch, store

RECORD, BLOCK, PIXELS, STATE = layout.RECORD, layout.BLOCK, layout.PIXELS, layout.STATE

AHEAD = 8
"""Number of entries between a prefetch and its use; lower than in blending, because an entry takes longer and needs two cache
lines."""


@njit(error_model="numpy")
def _gather(gradients: tuple[Array, ...], row: int, column: int, width: int, height: int, scratch: Array) -> None:
    """Copy a block's gradients from the images to `scratch`: red, green, blue, depth, alpha.

    Values of pixels outside the image are left as they are.
    """
    colours, alphas, depths = gradients
    if (row + 1) * BLOCK <= height and (column + 1) * BLOCK <= width:
        for half in range(2):
            pixel = (row * BLOCK + 2 * half) * width + column * BLOCK
            red, green, blue = load_pixels(colours, 3 * pixel, 3 * width)
            store(scratch, 8 * half, red)
            store(scratch, PIXELS + 8 * half, green)
            store(scratch, 2 * PIXELS + 8 * half, blue)
            store(scratch, 3 * PIXELS + 8 * half, load_halves(depths, pixel, width))
            store(scratch, 4 * PIXELS + 8 * half, load_halves(alphas, pixel, width))
        return
    for j in range(min(BLOCK, height - row * BLOCK)):
        for i in range(min(BLOCK, width - column * BLOCK)):
            lane, pixel = j * BLOCK + i, (row * BLOCK + j) * width + column * BLOCK + i
            for k in range(3):
                scratch[k * PIXELS + lane] = colours[3 * pixel + k]
            scratch[3 * PIXELS + lane] = depths[pixel]
            scratch[4 * PIXELS + lane] = alphas[pixel]


@njit(error_model="numpy", forceinline=True)
def _worth(scratch: Array, half: int, background: Array, states: Array, state: int) -> tuple[LaneValues, LaneValues]:
    """Return the parts of the gradient that do not depend on a splat, for one half of a block.

    Returns:
        The gradient per unit of weight apart from colour and depth (alpha minus background), and the sum of gradient times
        weight over all splats of a pixel.
    """
    red, green, blue = load(scratch, half), load(scratch, half + 16), load(scratch, half + 32)
    depth, alpha = load(scratch, half + 48), load(scratch, half + 64)
    behind = red * background[0] + green * background[1] + blue * background[2]
    total = red * load(states, state + half) + green * load(states, state + half + 16) + blue * load(states, state + half + 32)
    total = total + alpha * load(states, state + half + 48) + depth * load(states, state + half + 64) - behind
    return alpha - behind, total


@njit(error_model="numpy")
def _backward_block(
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
    scratch: Array,
    targets: Array,
    sums: Array,
) -> None:
    """Add a block's gradient sums to the rows of `sums` that `targets` names for its entries.

    `scratch` holds the gradients of the block's pixels.
    """
    x_lanes, y_lanes, light0, light1 = pixels_of(row, column, width, height)
    constants = read_table(table)
    alpha_max, light_min = constants[7], constants[8]
    plain0, rest0 = _worth(scratch, 0, background, states, state)
    plain1, rest1 = _worth(scratch, 8, background, states, state)
    store(scratch, 64, plain0)
    store(scratch, 72, plain1)
    after = np.int64(at(entries, first)) * RECORD
    next_dx, next_dy, next_raw0, next_raw1 = falloff(records, after, x_lanes, y_lanes, constants)
    for entry in range(first, last):
        # Compute the falloff of the next entry together with the sums of this one: two independent chains of instructions
        # overlap, where one long chain would not.
        base, dx, dy0, raw0, raw1 = after, next_dx, next_dy, next_raw0, next_raw1
        dy1 = dy0 + 2.0
        ahead = np.int64(at(entries, min(entry + AHEAD, last - 1))) * RECORD
        prefetch(records, ahead)
        prefetch(sums, np.int64(at(targets, min(entry + AHEAD, last - 1))) * RECORD)
        after = np.int64(at(entries, min(entry + 1, last - 1))) * RECORD
        next_dx, next_dy, next_raw0, next_raw1 = falloff(records, after, x_lanes, y_lanes, constants)
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
        # alpha dL/dalpha; zero where alpha is clipped.
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
        into = np.int64(at(targets, entry)) * RECORD
        store(sums, into, load(sums, into) + moments)
        store(sums, into + 8, load(sums, into + 8) + others)


@njit(error_model="numpy")
def _backward_rows(
    blocks: tuple[Any, ...], gradients: tuple[Array, ...], first_row: int, last_row: int, targets: Array, sums: Array
) -> None:
    """Add the gradient sums of rows of blocks to the rows of `sums` that `targets` names, tile by tile."""
    table, records, entries, starts, ends, _, columns, width, height, background, states = blocks
    scratch = np.zeros(STATE, np.float32)
    for top in range(first_row, last_row, TILE):
        for tile in range(0, columns, TILE):
            for row in range(top, min(top + TILE, last_row)):
                for column in range(tile, min(tile + TILE, columns)):
                    block = row * columns + column
                    first, last, state = starts[block], ends[block], block * STATE
                    if first < last:
                        _gather(gradients, row, column, width, height, scratch)
                        _backward_block(
                            table,
                            records,
                            entries,
                            first,
                            last,
                            row,
                            column,
                            width,
                            height,
                            background,
                            states,
                            state,
                            scratch,
                            targets,
                            sums,
                        )


@njit(error_model="numpy")
def sum_gradients(blocks: tuple[Any, ...], gradients: tuple[Array, ...], sums: Array) -> None:
    """Compute the gradient sums of all records, see `projection.project_backward`.

    Args:
        blocks: As in `blending.blend`, after it ran.
        gradients: Gradients of the loss with respect to colours, alphas and depths. [H * W * 3], [H * W], [H * W].
        sums: The result is added to this. [N * RECORD].
    """
    _backward_rows(blocks, gradients, 0, blocks[5], blocks[2], sums)


@njit(error_model="numpy")
def share_entries(blocks: tuple[Any, ...], bands: int, first_band: Array, targets: Array, owners: Array) -> int:
    """Assign a row of sums to each entry so that no two bands write to the same row.

    The first band that shows a record writes to the record's own row. In a later band, each entry of that record gets its own
    row, which is afterwards added to the record's row in the order of the blocks. A single thread adds in the same order; this
    matters because float sums depend on their order.

    Args:
        blocks: As in `sum_gradients`.
        bands: Number of bands.
        first_band: Filled with the first band of each record, -1 if no band shows it. [N] int32.
        targets: Filled with the row of sums of each entry; rows from N on belong to single entries. [entries] int32.
        owners: Filled with the records of the rows from N on, in order. [entries] int32.

    Returns:
        Number of rows from N on.
    """
    entries, starts, ends, rows, columns = blocks[2], blocks[3], blocks[4], blocks[5], blocks[6]
    first_band[:] = -1
    count = 0
    for band in range(bands):
        begin, end = _rows_of(band, bands, rows)
        for top in range(begin, end, TILE):
            for tile in range(0, columns, TILE):
                for row in range(top, min(top + TILE, end)):
                    for column in range(tile, min(tile + TILE, columns)):
                        block = row * columns + column
                        for entry in range(starts[block], ends[block]):
                            record = entries[entry]
                            if first_band[record] < 0:
                                first_band[record] = band
                            if first_band[record] == band:
                                targets[entry] = record
                            else:
                                targets[entry] = len(first_band) + count
                                owners[count] = record
                                count += 1
    return count


@njit(error_model="numpy")
def _rows_of(band: int, bands: int, rows: int) -> tuple[int, int]:
    """Return the rows of blocks of a band: whole tiles, so that consecutive bands have the order of a single thread."""
    tiles = (rows + TILE - 1) // TILE
    return TILE * (tiles * band // bands), min(rows, TILE * (tiles * (band + 1) // bands))


@njit(error_model="numpy", parallel=True)
def sum_gradients_parallel(
    blocks: tuple[Any, ...], gradients: tuple[Array, ...], bands: int, targets: Array, owners: Array, count: int, sums: Array
) -> None:
    """Do the work of `sum_gradients` in bands of rows; the result is bitwise the same.

    Args:
        blocks: As in `sum_gradients`.
        gradients: As in `sum_gradients`. [H * W * 3], [H * W], [H * W].
        bands: Number of bands that `share_entries` was called with.
        targets, owners: As filled by `share_entries`. [entries] int32.
        count: As returned by `share_entries`.
        sums: Zero on entry; the first N rows receive the result. [(N + count) * RECORD].
    """
    for band in prange(bands):
        begin, end = _rows_of(band, bands, blocks[5])
        _backward_rows(blocks, gradients, begin, end, targets, sums)
    first = len(sums) // RECORD - count
    for own in range(count):
        into, base = np.int64(owners[own]) * RECORD, (first + own) * RECORD
        for k in range(RECORD):
            sums[into + k] += sums[base + k]
