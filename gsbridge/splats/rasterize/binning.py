"""Kernels that list, for every block of pixels, the splats that may touch it, nearest first."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import WIDTH, larger, lowest_bit, smaller, square_root
from gsbridge.splats.rasterize.memory import at, load, load_spread, put, store_whole
from gsbridge.splats.rasterize.projection import row_span

RECORD = layout.RECORD
EIGHT = layout.EIGHT
_DIGIT = 12
_KEY = 2 * _DIGIT
_CORNER = 0b11 | 0b11 << layout.SQUARE
"""Bits of a `MASK` for the first two blocks of its first two rows."""


@njit(error_model="numpy")
def sort_by_depth(depths: Array, visible: int, counts: Array, pairs: Array, more_pairs: Array, order: Array) -> None:
    """Order the records by camera z; equal depths keep the order of the splats.

    The method is a radix sort in two passes over the bits of the floats, minus those of the nearest splat. The 24-bit key gives
    the exact order if the farthest splat is at most four times as far as the nearest. Over eight octaves of depth, it resolves
    relative differences of 2**-21.

    Args:
        depths: Camera z of the records, positive, as the int32 with the same bits. [N].
        visible: Number of records in use.
        counts: Work space. [2 * 4096] int32.
        pairs, more_pairs: Work space. [N] int64.
        order: Filled with record indices, nearest first. [N] int32.
    """
    if visible == 0:
        return
    low = high = depths[0]
    for i in range(visible):
        key = at(depths, i)
        low, high = min(low, key), max(high, key)
    shift = 0
    while ((high - low) >> shift) >= (1 << _KEY):
        shift += 1
    size = 1 << _DIGIT
    counts[:] = 0
    for i in range(visible):
        key = np.int64((at(depths, i) - low) >> shift)
        put(pairs, i, (key << 32) | i)
        digit = key & (size - 1)
        put(counts, digit, at(counts, digit) + 1)
        digit = size + (key >> _DIGIT)
        put(counts, digit, at(counts, digit) + 1)
    first, second = 0, 0
    for k in range(size):
        a, b = counts[k], counts[size + k]
        counts[k], counts[size + k] = first, second
        first, second = first + a, second + b
    for i in range(visible):
        pair = at(pairs, i)
        digit = (pair >> 32) & (size - 1)
        place = at(counts, digit)
        put(more_pairs, place, pair)
        put(counts, digit, place + 1)
    for i in range(visible):
        pair = at(more_pairs, i)
        digit = size + (pair >> (32 + _DIGIT))
        place = at(counts, digit)
        put(order, place, pair & 0x7FFFFFFF)
        put(counts, digit, place + 1)


@njit(error_model="numpy")
def reserve(capacity: Array, rows: int, columns: int, starts: Array, running: Array) -> int:
    """Turn the second difference of the blocks' capacities into the start of each block's list.

    Args:
        capacity: As left by `project`; reset to zero. [(rows + 1) * (columns + 1)].
        rows, columns: Numbers of rows and columns of blocks.
        starts: Filled row by row; each list has room for one extra entry (see `fill`). All elements after the start of the last
            list are the total number of entries. [rows * columns + columns + 1].
        running: Work space. [columns + 1].

    Returns:
        Total number of entries.
    """
    running[:] = 0
    total = 0
    for row in range(rows):
        level = 0
        for column in range(columns + 1):
            cell = row * (columns + 1) + column
            running[column] += capacity[cell]
            capacity[cell] = 0
            if column < columns:
                level += running[column]
                starts[row * columns + column] = total
                total += level + 1
    for column in range(columns + 1):
        capacity[rows * (columns + 1) + column] = 0
    starts[rows * columns :] = total
    return total


@njit(error_model="numpy")
def _append_large(records: Array, number: int, columns: int, edges: Array, ends: Array, entries: Array) -> None:
    """Append a record to the lists of the blocks that its ellipse meets, eight rows of blocks at a time."""
    base = np.int64(number) * RECORD
    top, bottom = int(at(records, base + layout.TOP)), int(at(records, base + layout.BOTTOM))
    xx, xy = load_spread(records, base + layout.XX), load_spread(records, base + layout.XY)
    yy, reach = load_spread(records, base + layout.YY), load_spread(records, base + layout.REACH) * 1.001
    left, right = load_spread(records, base + layout.LEFT), load_spread(records, base + layout.RIGHT)
    curve, level, scale = 4.0 * xx * yy - xy * xy, 4.0 * xx * reach, 0.125 / xx
    tilt = -(0.5 * xy / yy) * square_root(4.0 * yy * reach / curve)
    origin = (load_spread(records, base + layout.X) - 0.5) * 0.25
    rows_below = load(EIGHT, 0) * 4.0 + 0.5 - load_spread(records, base + layout.Y)
    for first in range(top, bottom, WIDTH):
        begin, end = row_span(rows_below + float(first * layout.BLOCK), tilt, level, curve, xy, scale, origin)
        store_whole(edges, 0, smaller(larger(begin, left), right))
        store_whole(edges, WIDTH, smaller(larger(end, left), right))
        for row in range(first, min(first + WIDTH, bottom)):
            start = row * columns
            for block in range(start + at(edges, row - first), start + at(edges, WIDTH + row - first)):
                last = at(ends, block)
                put(entries, last, number)
                put(ends, block, last + 1)


@njit(error_model="numpy")
def fill(
    records: Array, boxes: Array, order: Array, visible: int, columns: int, ends: Array, entries: Array, ordered: Array
) -> None:
    """Append each record, nearest first, to the lists of the blocks that its ellipse meets.

    Args:
        records, boxes: What `project` filled. [N * RECORD], [N] int64.
        order: Indices of the records, nearest first. [N] int32.
        visible: Number of records in use.
        columns: Number of blocks in a row.
        ends: On entry, the start of each list as `reserve` gives it; changed to its end. [rows * columns + columns + 1].
        entries: Filled with record indices; one longer than `reserve` returned. [entries + 1] int32.
        ordered: Work space. [N] int64.
    """
    steps, edges = np.empty(layout.SQUARE * layout.SQUARE, np.int64), np.empty(2 * WIDTH, np.int32)
    for bit in range(len(steps)):
        steps[bit] = bit // layout.SQUARE * columns + bit % layout.SQUARE
    # Gather the boxes in a loop of their own, where many reads from memory overlap; in the loop below, each read would wait for
    # the branches before it.
    for i in range(visible):
        put(ordered, i, at(boxes, at(order, i)))
    for i in range(visible):
        number, box = at(order, i), at(ordered, i)
        mask, first = box & 0xFFFFFFFF, box >> 32
        if not mask & ~_CORNER:
            # Most splats touch at most two by two blocks. Write to all four lists, but lengthen only those whose block meets
            # the ellipse: branches on this would often be mispredicted.
            below = first + columns
            end0, end1, end2, end3 = at(ends, first), at(ends, first + 1), at(ends, below), at(ends, below + 1)
            put(entries, end0, number)
            put(ends, first, end0 + np.int32(mask & 1))
            put(entries, end1, number)
            put(ends, first + 1, end1 + np.int32(mask >> 1 & 1))
            put(entries, end2, number)
            put(ends, below, end2 + np.int32(mask >> layout.SQUARE & 1))
            put(entries, end3, number)
            put(ends, below + 1, end3 + np.int32(mask >> (layout.SQUARE + 1) & 1))
        elif mask == 0xFFFFFFFF:
            _append_large(records, number, columns, edges, ends, entries)
        else:
            while mask:
                block = first + at(steps, lowest_bit(mask))
                mask &= mask - 1
                end = at(ends, block)
                put(entries, end, number)
                put(ends, block, end + 1)
