"""The mirror's hollow objects: empty vessels with thin walls, made as solids of revolution.

As in `objects`, each function works in the object's own frame, and signed distances are in millimetres.
"""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array
from gsbridge.reality.mirror.solids import merge, mesh_of, turned
from gsbridge.reality.mirror.textures import blend, cells, octaves, pick, step, value_noise

Made = tuple[Array, Array, Array, Array]
"""A made object: vertices, m [V, 3], normals [V, 3], faces [F, 3] and linear reflectances [V, 3]."""

_MUG_WALL = [(0.0, 1.5), (37.0, 1.5), (38.5, 4.0), (38.5, 90.5), (37.5, 90.5), (36.0, 8.5), (34.0, 6.0), (0.0, 6.0)]
_MUG_ROUNDING = 1.5
_HANDLE_MIDDLE, _HANDLE_RADIUS, _HANDLE_THICKNESS = (42.0, 0.0, 47.0), 25.0, 5.5

_BOWL_WALL = [
    *((0.0, 1.0), (26.0, 1.0), (28.0, 4.0), (44.0, 13.0), (58.0, 30.0), (67.5, 53.5)),
    *((66.5, 53.5), (55.0, 31.5), (41.5, 16.5), (26.0, 8.0), (0.0, 6.5)),
]
_BOWL_ROUNDING = 1.5

_POT_WALL = [
    *((0.0, 1.5), (30.0, 1.5), (42.0, 57.5), (46.5, 58.0), (49.5, 74.5)),
    *((48.5, 74.5), (43.5, 60.0), (39.5, 55.0), (28.0, 7.5), (0.0, 6.5)),
]
_POT_ROUNDING = 1.5


def _speckled(points: Array, seed: int, ground: list[float], specks: list[list[float]], reach: float = 0.36) -> Array:
    """Paint a stoneware glaze: soft variation of tone, and specks of two sizes. Points, m [N, 3] -> colours [N, 3]."""
    colours = np.array(ground) * np.clip(1 + 0.16 * octaves(points, 18e-3, 3, seed), 0.4, 1.5)[:, None]
    for size, share, shift in ((9e-3, reach, 3), (5.5e-3, 0.9 * reach, 7)):
        near, _, name = cells(points, size, seed + shift)
        wavy = near + 0.06 * octaves(points, size / 1.5, 2, seed + shift + 1)
        colours = blend(colours, pick(specks, name), 1 - step(wavy, share * (0.5 + 0.6 * name), 1.5e-3 / size))
    return colours


def make_mug(seed: int, detail: float) -> Made:
    """Make a stoneware mug of 80 mm with walls of 4 mm, 92 mm tall, 85 mm deep, with its handle to the right."""

    def handle(p: Array) -> Array:
        q = p - _HANDLE_MIDDLE
        return np.hypot(np.hypot(q[:, 0], q[:, 2]) - _HANDLE_RADIUS, q[:, 1]) - _HANDLE_THICKNESS

    def distance(p: Array) -> Array:
        wall = turned(p, _MUG_WALL, _MUG_ROUNDING)
        outside = 38.0 - np.hypot(p[:, 0], p[:, 1])  # the handle ends in the wall, not inside the mug
        return merge(wall, np.maximum(handle(p), outside), soft=3.0)

    v, n, f = mesh_of(distance, (-41, -41, 0), (73, 41, 93), 0.6 * detail)
    mm = v * 1e3
    glaze = _speckled(v, seed, [0.58, 0.54, 0.44], [[0.20, 0.11, 0.05], [0.10, 0.07, 0.05], [0.36, 0.22, 0.10]])
    rho, angle = np.hypot(mm[:, 0], mm[:, 1]), np.arctan2(mm[:, 1], mm[:, 0])
    out = step(rho, 38.0, 0.6)
    # Hand-painted leaves and dots of cobalt between two lines.
    round_wall = np.stack([0.040 * np.cos(angle), 0.040 * np.sin(angle), v[:, 2]], axis=-1)
    near, _, name = cells(round_wall, 17e-3, seed + 11)
    flower = near + 0.10 * octaves(v, 8e-3, 2, seed + 12)
    cobalt = np.array([0.035, 0.075, 0.28]) * np.clip(1 + 0.35 * octaves(v, 9e-3, 2, seed + 13), 0.3, 2.2)[:, None]
    between = step(mm[:, 2], 20.0, 1.2) * (1 - step(mm[:, 2], 76.0, 1.2))
    colours = blend(glaze, cobalt, (1 - step(flower, 0.42, 0.10)) * (name < 0.75) * between * out)
    berry, _, which = cells(round_wall, 10e-3, seed + 14)
    rust = pick([[0.42, 0.10, 0.04], [0.10, 0.24, 0.08], [0.55, 0.33, 0.05]], which)
    colours = blend(colours, rust, (1 - step(berry, 0.26, 0.14)) * (which < 0.6) * between * out)
    wave = 1.2 * value_noise(v, 14e-3, seed + 15)
    for height in (17.0, 79.0):
        line = np.abs(mm[:, 2] + wave - height)
        colours = blend(colours, cobalt, (1 - step(line, 1.6, 0.8)) * out)
    bare = np.array([0.40, 0.25, 0.14]) * np.clip(1 + 0.3 * octaves(v, 7e-3, 2, seed + 16), 0.4, 1.8)[:, None]
    return v, n, f, blend(colours, bare, 1 - step(mm[:, 2] + wave, 7.0, 1.0))


def make_bowl(seed: int, detail: float) -> Made:
    """Make a glazed bowl of 138 mm with walls of about 5 mm, 55 mm tall, 47 mm deep."""
    v, n, f = mesh_of(lambda p: turned(p, _BOWL_WALL, _BOWL_ROUNDING), (-70, -70, 0), (70, 70, 56), 0.6 * detail)
    mm = v * 1e3
    glaze = _speckled(v, seed, [0.12, 0.33, 0.34], [[0.55, 0.58, 0.50], [0.04, 0.12, 0.14], [0.42, 0.30, 0.12]], 0.40)
    rho, angle = np.hypot(mm[:, 0], mm[:, 1]), np.arctan2(mm[:, 1], mm[:, 0])
    inside = step(n[:, 2], 0.05, 0.1)
    # A star of brush strokes on the inside, runs of a second glaze from the rim on the outside.
    rays = np.cos(7 * angle + 0.05 * rho + 0.5 * value_noise(v, 25e-3, seed + 21))
    cream = np.array([0.62, 0.55, 0.40]) * np.clip(1 + 0.18 * octaves(v, 10e-3, 2, seed + 22), 0.4, 1.4)[:, None]
    colours = blend(glaze, cream, step(rays, 0.55, 0.35) * (rho < 58) * (rho > 10) * inside)
    runs = 38.0 + 7.0 * value_noise(v * [1, 1, 0.15], 13e-3, seed + 23) + 4.0 * np.cos(11 * angle)
    brown = np.array([0.22, 0.09, 0.035]) * np.clip(1 + 0.4 * octaves(v, 9e-3, 3, seed + 24), 0.3, 2.2)[:, None]
    colours = blend(colours, brown, step(mm[:, 2], runs, 2.0) * (1 - inside))
    clay = np.array([0.45, 0.30, 0.18]) * np.clip(1 + 0.3 * octaves(v, 7e-3, 2, seed + 25), 0.4, 1.6)[:, None]
    return v, n, f, blend(colours, clay, 1 - step(mm[:, 2], 5.0, 1.0))


def make_pot(seed: int, detail: float) -> Made:
    """Make a terracotta flower pot with a collar, 102 mm wide at the top and 62 mm at the bottom, 76 mm tall, 68 mm deep."""
    v, n, f = mesh_of(lambda p: turned(p, _POT_WALL, _POT_ROUNDING), (-52, -52, 0), (52, 52, 77), 0.6 * detail)
    mm = v * 1e3
    clay = np.array([0.46, 0.17, 0.075]) * np.clip(1 + 0.22 * octaves(v, 22e-3, 4, seed + 31), 0.35, 1.7)[:, None]
    grain, _, name = cells(v, 6e-3, seed + 32)
    colours = blend(clay, pick([[0.24, 0.08, 0.04], [0.58, 0.30, 0.17], [0.62, 0.50, 0.38]], name), 1 - step(grain, 0.33, 0.22))
    # Lime and moss, as where water seeps through.
    lime = octaves(v, 26e-3, 3, seed + 33) + 0.02 * (40 - mm[:, 2])
    colours = blend(colours, [0.62, 0.56, 0.47], 0.75 * step(lime, 1.0, 0.8))
    moss = octaves(v, 15e-3, 3, seed + 34)
    green = np.array([0.10, 0.15, 0.035]) * np.clip(1 + 0.4 * octaves(v, 6e-3, 2, seed + 35), 0.3, 2)[:, None]
    colours = blend(colours, green, step(moss, 1.2, 0.6) * (1 - step(mm[:, 2], 50.0, 20.0)))
    soil = np.array([0.07, 0.045, 0.03]) * np.clip(1 + 0.5 * octaves(v, 7e-3, 2, seed + 36), 0.3, 2.5)[:, None]
    within = (np.hypot(mm[:, 0], mm[:, 1]) < 44) * step(n[:, 2], 0.02, 0.1)
    stain = mm[:, 2] + 5.0 * value_noise(v, 12e-3, seed + 37)
    return v, n, f, blend(colours, soil, 0.8 * within * (1 - step(stain, 40.0, 4.0)))
