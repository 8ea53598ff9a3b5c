"""The mirror's table tops: a foam pad, a woven tablecloth, and the foam pad with a painted plate.

A table top is a picture in linear reflectance, 0.5 mm per pixel. Its first row is at the far (+y) edge of the table, so that it
is not mirrored when seen from above.
"""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.textures import blend, cells, octaves, paint_strokes, plane_noise, step

TABLE_SIZE_M = (1.2, 1.0)
"""Width (x) and depth (y) of the table top, m."""
TABLE_CENTRE_M = (0.0, 0.22)
"""Centre of the table top in the table frame (origin at the board's centre), m."""
WORK_CENTRE_M = (0.0, 0.265)
"""Centre of the 30 x 30 cm working area in the table frame, m."""
PLATE_CENTRE_M = (0.02, 0.285)
PLATE_WELL_M = 0.004
"""Height of the plate's well over the table, m: objects in the plate rest at this height."""

PIXELS_PER_M = 2000.0

BACKGROUNDS = ("foam_pad", "tablecloth", "plate")
"""Names of the backgrounds."""


def _dots(image: Array, count: int, radius: tuple[float, float], values: Array, rng: np.random.Generator) -> None:
    """Paint anti-aliased round dots in place. Radii in px; each dot takes a random row of `values` [K, 3]."""
    height, width = image.shape[:2]
    for x, y, r, colour in zip(
        rng.uniform(0, width, count),
        rng.uniform(0, height, count),
        rng.uniform(*radius, count),
        values[rng.integers(len(values), size=count)],
        strict=True,
    ):
        cv2.circle(image, (int(x * 16), int(y * 16)), int(r * 16), colour.tolist(), -1, cv2.LINE_AA, 4)


def _byte_paint(reflectance: Array) -> Array:
    """Convert reflectance to 8 bits on a square-root scale, because OpenCV draws anti-aliased only in 8 bits."""
    return np.rint(255 * np.sqrt(np.clip(reflectance, 0, 1))).astype(np.uint8)


def _foam_pad(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Paint light grey-blue foam with fine cells, speckle, smudges and scuffs, none of which repeats."""
    grain = 0.07 * plane_noise(shape, 0.9, rng) + 0.05 * plane_noise(shape, 2.0, rng) + 0.04 * plane_noise(shape, 5, rng)
    smudge = 0.06 * plane_noise(shape, 14, rng) + 0.06 * plane_noise(shape, 45, rng) + 0.05 * plane_noise(shape, 140, rng)
    tint = 0.03 * plane_noise(shape, 70, rng)
    base = np.array([0.225, 0.255, 0.285], np.float32) * np.clip(1 + grain + smudge, 0.4, 1.7)[..., None]
    base *= 1 + tint[..., None] * np.array([1, 0, -1], np.float32)
    paint = _byte_paint(base)
    tones = np.array([[95, 103, 110], [108, 116, 124], [140, 148, 155], [158, 164, 168]])
    area = shape[0] * shape[1]
    _dots(paint, area // 550, (0.8, 1.8), tones, rng)
    _dots(paint, area // 9000, (1.8, 3.5), tones, rng)
    for _ in range(area // 16000):  # scuffs
        start = rng.uniform(0, shape[::-1])
        way = np.cumsum(rng.normal(0, 7, (6, 2)) + rng.normal(0, 9, 2), axis=0)
        points = np.rint((start + way) * 16).astype(np.int32)
        cv2.polylines(paint, [points], False, tones[rng.integers(len(tones))].tolist(), 1, cv2.LINE_AA, 4)
    return (paint.astype(np.float32) / 255) ** 2


def _tablecloth(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Paint brown woven checks, which repeat, with a hand-printed floral pattern and stains, which do not."""
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float32)
    bend_x, bend_y = 5 * plane_noise(shape, 120, rng), 5 * plane_noise(shape, 120, rng)
    u, v = columns + bend_x, rows + bend_y
    period = 76.0  # px: checks of 38 mm

    def stripes(t: Array) -> Array:
        return (np.abs((t / period) % 1 - 0.5) < 0.25).astype(np.float32)

    checks = 0.5 * (stripes(u) + stripes(v))
    thin = np.maximum(np.abs((u / period) % 1 - 0.5) > 0.47, np.abs((v / period) % 1 - 0.5) > 0.47)
    weave = 0.11 * np.sin(2 * np.pi * u / 4.1) * np.sin(2 * np.pi * v / 4.1)
    light, dark = np.array([0.36, 0.225, 0.115], np.float32), np.array([0.13, 0.068, 0.03], np.float32)
    base = light + (dark - light) * checks[..., None]
    base = np.where(thin[..., None], np.array([0.42, 0.33, 0.20], np.float32), base)
    yarn = 0.10 * plane_noise(shape, 0.9, rng) + 0.07 * plane_noise(shape, 3, rng)
    stain = 0.07 * plane_noise(shape, 25, rng) + 0.08 * plane_noise(shape, 90, rng)
    base = base * np.clip(1 + weave + yarn + stain, 0.3, 1.8)[..., None]
    paint = _byte_paint(base)
    inks = np.array([[178, 158, 120], [70, 40, 24], [150, 84, 44], [120, 128, 84], [190, 172, 140], [96, 30, 22]])
    area = shape[0] * shape[1]
    for _ in range(area // 5200):  # sprigs: a bent stem with leaves
        ink = inks[rng.integers(len(inks))].tolist()
        at, heading = rng.uniform(0, shape[::-1]), rng.uniform(0, 2 * np.pi)
        stem = [at]
        for _ in range(int(rng.integers(3, 7))):
            heading += rng.normal(0, 0.35)
            stem.append(stem[-1] + rng.uniform(6, 11) * np.array([np.cos(heading), np.sin(heading)]))
            side = heading + rng.choice([-1, 1]) * rng.uniform(0.6, 1.2)
            axes = np.array([rng.uniform(4, 9), rng.uniform(1.6, 3.6)])
            leaf = stem[-1] + axes[0] * np.array([np.cos(side), np.sin(side)])
            cv2.ellipse(
                paint,
                tuple(int(c * 16) for c in leaf),
                tuple(int(a * 16) for a in axes),
                float(np.degrees(side)),
                0,
                360,
                ink,
                -1,
                cv2.LINE_AA,
                4,
            )
        cv2.polylines(paint, [np.rint(np.array(stem) * 16).astype(np.int32)], False, ink, 2, cv2.LINE_AA, 4)
    _dots(paint, area // 3500, (1.0, 3.0), inks, rng)
    return (paint.astype(np.float32) / 255) ** 2


def table_texture(background: str, seed: int) -> Array:
    """Return the linear reflectance of a table top, first row at the far (+y) edge. [H, W, 3] float32.

    Args:
        background: One of `BACKGROUNDS`.
        seed: Seed of the world; the same seed gives the same table in every film.

    Raises:
        InputError: The name is unknown.
    """
    if background not in BACKGROUNDS:
        raise InputError("mirror", f"the background '{background}' is unknown", f"Use one of {', '.join(BACKGROUNDS)}")
    shape = (round(TABLE_SIZE_M[1] * PIXELS_PER_M), round(TABLE_SIZE_M[0] * PIXELS_PER_M))
    maker = _tablecloth if background == "tablecloth" else _foam_pad
    return maker(shape, np.random.default_rng([seed, 1 if background == "tablecloth" else 0]))


def make_plate(seed: int, detail: float = 1.0) -> tuple[Mesh, Array]:
    """Make a ceramic plate of 200 mm, 20 mm tall, with a painted rim; own frame, standing on z = 0.

    Args:
        seed: Seed of the paint.
        detail: Vertex spacing of the mesh, 1 for 0.9 mm; larger is coarser and faster.

    Returns:
        Watertight mesh, m, with linear reflectances as colours, and vertex normals. [V, 3].
    """
    # Half section, mm: up the outside from the centre of the foot, over the rim, and back to the centre of the well.
    section = np.array(
        [[0, 0], [55, 0], [60, 1.5], [80, 11], [98, 18.5], [100, 20], [97.5, 20], [85, 15.5], [72, 9], [62, 5], [50, 4], [0, 4]]
    )
    lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(section, axis=0), axis=1))]
    rings = np.arange(0.9 * detail, lengths[-1] - 0.5, 0.9 * detail)
    radius, height = (np.interp(rings, lengths, section[:, axis]) for axis in (0, 1))
    around = round(720 / detail)
    angle = np.arange(around) * 2 * np.pi / around
    body = np.stack(
        [np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)), np.repeat(height[:, None], around, 1)], axis=-1
    ).reshape(-1, 3)
    vertices = np.vstack([body, [[0, 0, 0], [0, 0, 4]]]) * 1e-3
    ring, spoke = np.meshgrid(np.arange(len(rings) - 1), np.arange(around), indexing="ij")
    a, b = (ring * around + spoke).ravel(), (ring * around + (spoke + 1) % around).ravel()
    c, d = a + around, b + around
    spokes, following = np.arange(around), (np.arange(around) + 1) % around
    foot, well = len(body), len(body) + 1
    last = (len(rings) - 1) * around
    faces = np.concatenate(
        [
            np.c_[a, b, d],
            np.c_[a, d, c],
            np.c_[np.full(around, foot), following, spokes],
            np.c_[np.full(around, well), last + spokes, last + following],
        ]
    )
    mesh = Mesh(vertices, faces)
    if mesh.volume() < 0:
        mesh = Mesh(vertices, faces[:, ::-1])
    normals = np.asarray(mesh.trimesh().vertex_normals)
    return Mesh(mesh.vertices, mesh.faces, _plate_colours(mesh.vertices, normals, seed)), normals


def _plate_colours(vertices: Array, normals: Array, seed: int) -> Array:
    """Paint cream glaze with crazing, a blue rim, and brush strokes on rim and well. -> linear reflectances [V, 3]."""
    rng = np.random.default_rng([seed, 77])
    rho = 1e3 * np.hypot(vertices[:, 0], vertices[:, 1])
    upper = normals[:, 2] > 0
    colours = np.array([0.60, 0.57, 0.50]) * (1 + 0.05 * octaves(vertices, 20e-3, 5, seed))[:, None]
    near, second, _ = cells(vertices, 7e-3, seed + 1)
    colours = blend(colours, [0.40, 0.36, 0.30], 0.5 * (1 - step(second - near, 0.04, 0.05)))
    blue = [[0.05, 0.12, 0.38], [0.10, 0.22, 0.50], [0.03, 0.06, 0.20], [0.45, 0.20, 0.06]]
    edge = rho + 0.8 * octaves(vertices, 9e-3, 3, seed + 2)
    colours = blend(colours, blue[0], step(edge, 95.5, 1.5) * upper)
    colours = blend(colours, blue[1], (1 - step(np.abs(edge - 73), 1.2, 0.8)) * upper)
    for where, count in (((rho > 76) & (rho < 93) & upper, 420), ((rho < 62) & upper, 260)):
        colours = paint_strokes(
            colours,
            vertices,
            normals,
            count=count,
            length=(2e-3, 9e-3),
            width=(1e-3, 2.6e-3),
            palette=blue,
            rng=rng,
            where=where,
        )
    spot, _, pick_one = cells(vertices, 3.2e-3, seed + 4)
    colours = blend(colours, [0.20, 0.17, 0.14], (1 - step(spot, 0.24, 0.10)) * (pick_one < 0.35))
    return np.clip(colours, 0.01, 0.75).astype(np.float32)
