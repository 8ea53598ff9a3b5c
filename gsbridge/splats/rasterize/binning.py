"""Kernels that list, for every block of pixels, the splats that may touch it, nearest first."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import numpy as np

from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import at, lowest_bit, put

RECORD = layout.RECORD
_DIGIT = 12
_KEY = 2 * _DIGIT


@njit(error_model="numpy")
def sort_by_depth(records, bits, visible, counts, pairs, more_pairs, order):
    """Order the records by camera z; equal depths keep the order of the splats.

    Two passes of a radix sort over the float's own bits, less those of the nearest splat. 24 bits of key hold the exact order as
    long as the farthest splat is at most four times as far as the nearest, and 2**-20 of the depth over twelve octaves.

    Args:
        records: Records. [N * RECORD].
        bits: The same memory as int32.
        visible: Records in use.
        counts: Work space. [2 * 4096] int32.
        pairs, more_pairs: Work space. [N] int64.
        order: Filled with record numbers, nearest first. [N] int32.
    """
    if visible == 0:
        return
    low = bits[layout.DEPTH]
    high = low
    for i in range(visible):
        key = at(bits, i * RECORD + layout.DEPTH)
        low, high = min(low, key), max(high, key)
    shift = 0
    while ((high - low) >> shift) >= (1 << _KEY):
        shift += 1
    size = 1 << _DIGIT
    counts[:] = 0
    for i in range(visible):
        key = np.int64((at(bits, i * RECORD + layout.DEPTH) - low) >> shift)
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
def reserve(capacity, rows, columns, starts, running):
    """Turn the second difference of the blocks' capacities into the start of each block's list.

    Args:
        capacity: As left by `project`; set to zero again. [(rows + 1) * (columns + 1)].
        rows, columns: Blocks.
        starts: Filled, row by row. [rows * columns + 1].
        running: Work space. [columns + 1].

    Returns:
        Entries in all.
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
                total += level
    for column in range(columns + 1):
        capacity[rows * (columns + 1) + column] = 0
    starts[rows * columns] = total
    return total


@njit(error_model="numpy")
def _append_large(records, number, columns, ends, entries):
    """Append a record to the lists of the blocks that its ellipse meets; `project` does the same for small boxes."""
    base = np.int64(number) * RECORD
    half = np.float32(0.5)
    top, bottom = int(records[base + layout.TOP]), int(records[base + layout.BOTTOM])
    left, right = int(records[base + layout.LEFT]), int(records[base + layout.RIGHT])
    x, y = records[base + layout.X], records[base + layout.Y]
    xx, xy, yy = records[base + layout.XX], records[base + layout.XY], records[base + layout.YY]
    reach = records[base + layout.REACH] * np.float32(1.001)
    curve, level, scale = np.float32(4.0) * xx * yy - xy * xy, np.float32(4.0) * xx * reach, half / xx
    tilt = -half * xy / yy * np.sqrt(np.float32(4.0) * yy * reach / curve)
    for row in range(top, bottom):
        # The rows' pixel centres span near..far; the ellipse's right edge there is furthest right at its tip or at an end.
        near = row * np.float32(layout.BLOCK) + half - y
        far = near + np.float32(layout.BLOCK - 1)
        dy = min(max(tilt, near), far)
        edge = x - half + (np.sqrt(max(level - curve * dy * dy, np.float32(0.0))) - xy * dy) * scale
        end = min(right, (int(np.floor(max(edge, np.float32(-1.0)))) >> 2) + 1)
        dy = min(max(-tilt, near), far)
        edge = x - half - (np.sqrt(max(level - curve * dy * dy, np.float32(0.0))) + xy * dy) * scale
        begin = max(left, int(np.ceil(max(edge, np.float32(0.0)))) >> 2)
        for block in range(row * columns + begin, row * columns + end):
            entries[ends[block]] = number
            ends[block] += 1


@njit(error_model="numpy")
def fill(records, boxes, order, visible, columns, ends, entries):
    """Append each record, nearest first, to the lists of the blocks that its ellipse meets.

    Args:
        records, boxes: What `project` filled.
        order, visible: Records, nearest first.
        columns: Blocks in a row.
        ends: The start of each list; moved to its end. [rows * columns].
        entries: Filled with record numbers.
    """
    steps = np.empty(layout.SQUARE * layout.SQUARE, np.int64)
    for bit in range(len(steps)):
        steps[bit] = bit // layout.SQUARE * columns + bit % layout.SQUARE
    for i in range(visible):
        number = at(order, i)
        box = at(boxes, number)
        mask, first = box & 0xFFFFFFFF, box >> 32
        if mask == 0xFFFFFFFF:
            _append_large(records, number, columns, ends, entries)
            continue
        while mask:
            block = first + at(steps, lowest_bit(mask))
            mask &= mask - 1
            end = at(ends, block)
            put(entries, end, number)
            put(ends, block, end + 1)
