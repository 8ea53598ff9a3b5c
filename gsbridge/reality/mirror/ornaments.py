"""Objects of the mirror that are hard to reconstruct: with a foot wider than the body, with openings, or without texture.

As in `objects`, each function works in the object's own frame, and signed distances are in millimetres.
"""

from __future__ import annotations

import itertools

import numpy as np

from gsbridge.geometry import Array
from gsbridge.reality.mirror.solids import box, ellipsoid, merge, mesh_of, rod, turned
from gsbridge.reality.mirror.textures import blend, cells, octaves, paint_strokes, pick, step
from gsbridge.reality.mirror.vessels import Made

_PLINTH = 15.0  # height, mm


def make_statue(seed: int, detail: float) -> Made:
    """Make a marble bust on a thin neck over a granite plinth of 90 mm; 120 mm tall."""

    def bust(p: Array) -> Array:
        shoulders = ellipsoid(p, (0, 0, 62), (31, 17, 20))
        head = ellipsoid(p, (0, -3, 98), (17, 19, 22))
        nose = ellipsoid(p, (0, -22, 96), (4, 5, 6))
        hair = ellipsoid(p, (0, 6, 104), (19, 18, 16))
        return merge(shoulders, rod(p, (0, 0, 66), (0, -1, 90), 9.0), head, nose, hair, soft=4.0)

    def distance(p: Array) -> Array:
        foot = box(p, (0, 0, _PLINTH / 2 - 2), (45, 45, _PLINTH / 2 + 2), 2.0)
        neck = turned(p, [(0, 10), (19, 10), (19, 17), (12, 22), (10, 34), (13, 46), (0, 46)], 1.0)
        return merge(foot, merge(neck, bust(p), soft=3.0), soft=1.0)

    v, n, f = mesh_of(distance, (-46, -46, 0), (46, 46, 121), 0.65 * detail)
    mm = v * 1e3
    vein = np.abs(octaves(v + 4e-3 * octaves(v, 20e-3, 2, seed + 1)[:, None], 30e-3, 3, seed + 2))
    marble = np.array([0.62, 0.59, 0.54]) * np.clip(1 + 0.12 * octaves(v, 20e-3, 3, seed + 3), 0.5, 1.25)[:, None]
    marble = blend(marble, [0.20, 0.17, 0.16], 0.85 * (1 - step(vein, 0.22, 0.30)))
    fleck, _, shade = cells(v, 8e-3, seed + 4)
    marble = blend(marble, [0.36, 0.27, 0.20], 0.7 * (1 - step(fleck, 0.30, 0.24)) * (shade < 0.5))
    granite = np.array([0.16, 0.13, 0.13]) * np.clip(1 + 0.3 * octaves(v, 14e-3, 3, seed + 5), 0.3, 2)[:, None]
    for size, reach, shift in ((8e-3, 0.40, 6), (5e-3, 0.36, 9)):
        grain, _, name = cells(v, size, seed + shift)
        palette = [[0.48, 0.42, 0.40], [0.05, 0.05, 0.05], [0.40, 0.22, 0.17]]
        granite = blend(granite, pick(palette, name), 1 - step(grain, reach, 1.5e-3 / size))
    return v, n, f, blend(granite, marble, step(mm[:, 2], _PLINTH + 0.5, 0.8))


_CAB = (-22.0, 0.0)  # middle of the cab, x and y, mm
_CAB_HALF = 24.0
_AXLES = (-36.0, 34.0)  # x, mm
_POSTS = (33.0, 74.0)  # heights that the posts span, mm


def make_toy(seed: int, detail: float) -> Made:
    """Make a toy loader of 130 mm: an open cab of four posts and a roof, a frame of thin rods, four wheels; 80 mm tall."""
    x, y = _CAB

    def parts(p: Array) -> dict[str, Array]:
        wheels = [rod(p, (place, -24, 14), (place, 24, 14), 3.0) for place in _AXLES]
        for place, side in itertools.product(_AXLES, (-1, 1)):
            q = np.stack([np.hypot(p[:, 0] - place, p[:, 2] - 14) - 13.0, np.abs(p[:, 1] - side * 26) - 4.0], axis=-1)
            wheels.append(np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0) - 2.0)
        posts = [
            box(
                p,
                (x + dx * (_CAB_HALF - 3), y + dy * (_CAB_HALF - 3), sum(_POSTS) / 2),
                (3, 3, (_POSTS[1] - _POSTS[0]) / 2 + 2),
            )
            for dx in (-1, 1)
            for dy in (-1, 1)
        ]
        arms = [
            np.minimum(
                rod(p, (10, side * 20, 36), (58, side * 20, 52), 3.0), rod(p, (58, side * 20, 52), (60, side * 20, 24), 3.0)
            )
            for side in (-1, 1)
        ]
        return {
            "chassis": box(p, (0, 0, 20), (54, 20, 9), 2.0),
            "deck": box(p, (x, y, 31), (_CAB_HALF, _CAB_HALF, 3), 1.0),
            "hood": box(p, (26, 0, 36), (22, 15, 10), 4.0),
            "wheels": np.minimum.reduce(wheels),
            "posts": np.minimum.reduce(posts),
            "roof": box(p, (x, y, 77), (_CAB_HALF + 2, _CAB_HALF + 2, 3.5), 1.5),
            "seat": box(p, (x - 6, y, 38), (8, 9, 6), 2.0),
            "arms": np.minimum.reduce(
                [*arms, rod(p, (60, -20, 24), (60, 20, 24), 3.0), rod(p, (10, -20, 36), (10, 20, 36), 3.0)]
            ),
            "pipe": rod(p, (34, 8, 40), (34, 8, 74), 3.0),
        }

    def distance(p: Array) -> Array:
        return merge(*parts(p).values(), soft=1.2)

    v, n, f = mesh_of(distance, (-56, -33, 0), (65, 33, 82), 0.55 * detail)
    d = parts(v * 1e3)
    near = np.argmin(np.stack(list(d.values())), axis=0)
    paint = np.array(
        [
            *([0.10, 0.10, 0.11], [0.16, 0.15, 0.14], [0.62, 0.36, 0.02], [0.035, 0.035, 0.04], [0.60, 0.34, 0.02]),
            *([0.58, 0.10, 0.05], [0.10, 0.08, 0.06], [0.08, 0.20, 0.42], [0.40, 0.40, 0.40]),
        ]
    )
    colours = paint[near] * np.clip(1 + 0.25 * octaves(v, 14e-3, 3, seed + 1), 0.3, 1.7)[:, None]
    chip, _, name = cells(v, 9e-3, seed + 2)
    wavy = chip + 0.08 * octaves(v, 6e-3, 2, seed + 3)
    worn = pick([[0.45, 0.44, 0.42], [0.20, 0.10, 0.06], [0.66, 0.60, 0.46]], name)
    colours = blend(colours, worn, (1 - step(wavy, 0.34, 0.2)) * (0.3 + 0.7 * (name < 0.7)))
    rng = np.random.default_rng(seed)
    lines = [[0.05, 0.05, 0.05], [0.70, 0.66, 0.58], [0.30, 0.05, 0.03]]
    return (
        v,
        n,
        f,
        paint_strokes(colours, v, n, count=150, length=(5e-3, 12e-3), width=(1.8e-3, 2.6e-3), palette=lines, rng=rng),
    )


def make_white_box(seed: int, detail: float) -> Made:
    """Make a plain white box of 84 x 56 x 66 mm, of paper whose tone hardly varies."""
    v, n, f = mesh_of(lambda p: box(p, (0, 0, 31), (42, 28, 35), 1.5), (-42, -28, 0), (42, 28, 66), 0.7 * detail)
    return v, n, f, np.array([0.70, 0.69, 0.66]) * (1 + 0.006 * octaves(v, 20e-3, 2, seed))[:, None]
