"""Heights above the table from photos: every cell of a map is tried at many heights and keeps the one on which its views agree.

The map lies in the table plane, not in an image: one map serves all views, a flat table is the simplest answer, and plain
areas are filled by their neighbours (semi-global aggregation along eight directions).

Source: Hirschmueller, IEEE PAMI 30(2), 2008 for the aggregation, here with a penalty linear in the step up to a limit.
"""

from __future__ import annotations

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import Real, njit


@njit(nogil=True)
def agreement(
    images: Array,
    sizes: Array,
    projections: Array,
    chosen: Array,
    xs: Array,
    ys: Array,
    heights: Array,
    pitch: float,
    radius: int,
    texture: float,
    out: Array,
) -> None:
    """Mean correlation of the views of every cell at every height.

    Args:
        images: Grey photos, 0..1. [V, H, W] float32.
        sizes: Width and height of each photo, px. [V, 2].
        projections: Projections of the views, from the table frame to pixels. [V, 3, 4].
        chosen: Views of each cell, -1 for none. [ny, nx, K].
        xs, ys: Cell centres, m. [nx], [ny].
        heights: Heights to try, m. [L].
        pitch: Distance of the patch's sample points on the table, m.
        radius: Patch radius in sample points.
        texture: Least standard deviation of a patch.
        out: Mean pairwise correlation, -1..1; 0 where fewer than two views show texture. [ny, nx, L] float32, written.
    """
    side = 2 * radius + 1
    count = side * side
    patch = np.empty(count)
    total = np.empty(count)
    for i in range(ys.shape[0]):
        for j in range(xs.shape[0]):
            if chosen[i, j, 0] < 0:
                continue
            for level in range(heights.shape[0]):
                z = heights[level]
                used = 0
                total[:] = 0.0
                for k in range(chosen.shape[2]):
                    v = chosen[i, j, k]
                    if v < 0:
                        break
                    p = projections[v]
                    image = images[v]
                    mean = 0.0
                    squares = 0.0
                    n = 0
                    for a in range(-radius, radius + 1):
                        y = ys[i] + a * pitch
                        for b in range(-radius, radius + 1):
                            x = xs[j] + b * pitch
                            w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                            u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w - 0.5
                            q = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w - 0.5
                            if w <= 0 or u < 0 or q < 0 or u >= sizes[v, 0] - 1 or q >= sizes[v, 1] - 1:
                                break
                            c = int(u)
                            r = int(q)
                            fu = u - c
                            fq = q - r
                            value = (image[r, c] * (1 - fu) + image[r, c + 1] * fu) * (1 - fq) + (
                                image[r + 1, c] * (1 - fu) + image[r + 1, c + 1] * fu
                            ) * fq
                            patch[n] = value
                            n += 1
                            mean += value
                            squares += value * value
                    if n < count:
                        continue
                    mean /= count
                    spread = squares - count * mean * mean
                    if spread < count * texture * texture:
                        continue
                    scale = 1.0 / math.sqrt(spread)
                    for m in range(count):
                        total[m] += (patch[m] - mean) * scale
                    used += 1
                if used >= 2:
                    energy = 0.0
                    for m in range(count):
                        energy += total[m] * total[m]
                    out[i, j, level] = (energy - used) / (used * (used - 1))


@njit(nogil=True)
def _sweep(cost: Array, valid: Array, di: int, dj: int, slope: Real, limit: Real, total: Array) -> None:
    """Add the path costs of one direction to `total`. [ny, nx, L]."""
    rows, columns, levels = cost.shape
    path = np.zeros_like(cost)
    message = np.empty(levels, np.float32)
    for a in range(rows):
        i = a if di >= 0 else rows - 1 - a
        for b in range(columns):
            j = b if (dj > 0 or (dj == 0)) else columns - 1 - b
            if not valid[i, j]:
                continue
            pi = i - di
            pj = j - dj
            if pi < 0 or pj < 0 or pi >= rows or pj >= columns or not valid[pi, pj]:
                for level in range(levels):
                    path[i, j, level] = cost[i, j, level]
            else:
                least = path[pi, pj, 0]
                for level in range(levels):
                    message[level] = path[pi, pj, level]
                    least = min(least, message[level])
                for level in range(1, levels):
                    message[level] = min(message[level], message[level - 1] + slope)
                for level in range(levels - 2, -1, -1):
                    message[level] = min(message[level], message[level + 1] + slope)
                for level in range(levels):
                    path[i, j, level] = cost[i, j, level] + min(message[level], least + limit) - least
            for level in range(levels):
                total[i, j, level] += path[i, j, level]


def smooth_heights(cost: Array, valid: Array, heights: Array, slope: float, limit: float) -> tuple[Array, Array]:
    """Heights that fit the costs and change little between neighbours.

    Args:
        cost: Cost of each height, low is good. [ny, nx, L].
        valid: Cells that take part. [ny, nx] bool.
        heights: The heights, m, evenly spaced. [L].
        slope: Penalty per step of height between neighbours.
        limit: Largest penalty, which is that of an edge.

    Returns:
        Height of each cell, m, interpolated between the steps, and the index of the best step. [ny, nx], [ny, nx].
    """
    total = np.zeros(cost.shape, np.float32)
    data = np.ascontiguousarray(cost, dtype=np.float32)
    for di, dj in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
        _sweep(data, valid, di, dj, np.float32(slope), np.float32(limit), total)
    level = np.argmin(total, axis=2)
    inner = np.clip(level, 1, len(heights) - 2)
    low, middle, high = (np.take_along_axis(total, (inner + k)[..., None], axis=2)[..., 0] for k in (-1, 0, 1))
    bend = low - 2 * middle + high
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where((bend > 1e-9) & (inner == level), 0.5 * (low - high) / bend, 0.0)
    step = float(heights[1] - heights[0])
    return heights[level] + step * np.clip(shift, -0.5, 0.5), level
