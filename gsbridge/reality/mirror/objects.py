"""The mirror's objects by name, and the makers of the solid ones: signed distances, meshed finely and painted per vertex.

Each maker works in the object's own frame: metres, z up, resting on z = 0, footprint centre at the origin, front towards -y.
Signed distances inside this module are in millimetres, because the shapes are defined in millimetres. No painted mark is finer
than about 2 mm: a frame of 640 px shows 1 mm per pixel at half a metre, so finer marks would only be noise that differs from
view to view.
"""

from __future__ import annotations

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.ornaments import make_statue, make_toy, make_white_box
from gsbridge.reality.mirror.solids import ellipsoid, merge, mesh_of
from gsbridge.reality.mirror.textures import blend, cells, octaves, paint_strokes, pick, step, value_noise
from gsbridge.reality.mirror.vessels import make_bowl, make_mug, make_pot


def _small_cube(seed: int, detail: float) -> tuple[Array, Array, Array, Array]:
    """Make a 58 mm cube of red terrazzo with rounded edges."""

    def distance(p: Array) -> Array:
        q = np.abs(p - [0, 0, 29.0]) - (29.0 - 2.0)
        return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0) - 2.0

    v, n, f = mesh_of(distance, (-29, -29, 0), (29, 29, 58), 0.6 * detail)
    red = np.array([0.55, 0.07, 0.06])
    colours = red * np.clip(1 + 0.28 * octaves(v, 16e-3, 3, seed), 0.2, 2)[:, None]
    chips = [
        [0.72, 0.66, 0.52],
        [0.06, 0.05, 0.06],
        [0.70, 0.42, 0.06],
        [0.08, 0.20, 0.42],
        [0.75, 0.74, 0.72],
        [0.30, 0.03, 0.05],
    ]
    for size, reach, shift in ((17e-3, 0.40, 11), (10e-3, 0.36, 23), (6.5e-3, 0.30, 37)):
        near, _, name = cells(v, size, seed + shift)
        wavy = near + 0.08 * octaves(v, size / 1.5, 2, seed + shift + 5)
        chip = pick(chips, name) * np.clip(1 + 0.15 * octaves(v, 7e-3, 2, seed + shift + 7), 0.4, 1.6)[:, None]
        colours = blend(colours, chip, 1 - step(wavy, reach, 1.6e-3 / size))
    return v, n, f, colours


def _cake(seed: int, detail: float) -> tuple[Array, Array, Array, Array]:
    """Make a layered cake of 110 mm with dripping frosting, sprinkles and berries, 60 mm tall."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, 6)
    berries = [(30 * np.cos(a), 30 * np.sin(a), 51.5) for a in np.arange(7) * 2 * np.pi / 7 + rng.uniform(-0.15, 0.15, 7)]

    def drip(p: Array) -> Array:
        angle = np.arctan2(p[:, 1], p[:, 0])
        waves = sum(
            a * np.cos(k * angle + phase)
            for a, k, phase in zip((3, 4, 3.5, 2.5, 2, 2), (3, 5, 7, 11, 13, 17), phases, strict=True)
        )
        return 37.0 + waves

    def distance(p: Array) -> Array:
        rho = np.hypot(p[:, 0], p[:, 1])
        frosted = 1.6 / (1 + np.exp(-(p[:, 2] - drip(p)) / 0.7))
        layers = 0.7 * np.cos(p[:, 2] * 2 * np.pi / 15.0)
        q = np.stack([rho - (52.6 + frosted + layers * (frosted < 0.8) - 4), np.abs(p[:, 2] - 26) - (26 - 4)], axis=-1)
        body = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0) - 4
        parts = [ellipsoid(p, berry, (7.2, 7.2, 7.6)) for berry in berries]
        swirl = ellipsoid(p, (0, 0, 52), (13, 13, 7.6)) + 0.8 * np.cos(5 * np.arctan2(p[:, 1], p[:, 0]) + 0.55 * rho)
        return merge(body, swirl, *parts, soft=1.5)

    v, n, f = mesh_of(distance, (-56, -56, 0), (56, 56, 61), 0.7 * detail)
    mm = v * 1e3
    rho = np.hypot(mm[:, 0], mm[:, 1])
    crumb = octaves(v, 12e-3, 3, seed + 1)
    sponge = np.array([0.50, 0.27, 0.09]) * np.clip(1 + 0.32 * crumb, 0.15, 2)[:, None]
    hole, _, _ = cells(v, 6.5e-3, seed + 2)
    sponge = blend(sponge, [0.16, 0.07, 0.02], 1 - step(hole + 0.06 * crumb, 0.30, 0.24))
    layer = np.cos((mm[:, 2] + 1.2 * value_noise(v, 12e-3, seed + 3)) * 2 * np.pi / 15.0)
    cream = np.array([0.72, 0.63, 0.47]) * (1 + 0.10 * octaves(v, 10e-3, 2, seed + 4))[:, None]
    colours = blend(sponge, cream, step(layer, 0.55, 0.5))
    frosting = np.array([0.66, 0.28, 0.33]) * np.clip(1 + 0.15 * octaves(v, 16e-3, 3, seed + 5), 0.5, 1.4)[:, None]
    frosting = blend(frosting, [0.75, 0.66, 0.62], 0.7 * step(octaves(v, 14e-3, 2, seed + 6), 1.0, 0.6))
    on_top = step(mm[:, 2] - drip(mm), 0.0, 0.8)
    colours = blend(colours, frosting, on_top)
    bright = [
        [0.75, 0.72, 0.66],
        [0.70, 0.50, 0.05],
        [0.06, 0.30, 0.45],
        [0.10, 0.40, 0.12],
        [0.35, 0.06, 0.30],
        [0.20, 0.07, 0.03],
    ]
    colours = paint_strokes(
        colours, v, n, count=130, length=(6e-3, 10e-3), width=(2.6e-3, 3.6e-3), palette=bright, rng=rng, where=on_top > 0.9
    )
    for berry in berries:
        inside = np.linalg.norm((mm - berry) / [7.2, 7.2, 7.6], axis=1)
        red = np.array([0.45, 0.02, 0.03]) * np.clip(1 + 0.25 * octaves(v, 7e-3, 2, seed + 8), 0.4, 1.6)[:, None]
        seeds, _, _ = cells(v, 5e-3, seed + 9)
        red = blend(red, [0.68, 0.52, 0.20], 1 - step(seeds, 0.24, 0.25))
        colours = blend(colours, red, 1 - step(inside, 1.06, 0.05))
    swirl = (1 - step(rho, 13.5, 1.0)) * step(mm[:, 2], 53.5, 1.0)
    colours = blend(colours, cream * (1 + 0.2 * np.cos(5 * np.arctan2(mm[:, 1], mm[:, 0]) + 0.55 * rho))[:, None], swirl)
    colours = paint_strokes(
        colours,
        v,
        n,
        count=22,
        length=(3e-3, 5e-3),
        width=(2e-3, 2.6e-3),
        palette=[[0.12, 0.05, 0.02]],
        rng=rng,
        where=swirl > 0.9,
    )
    return v, n, f, colours


_BANANA_BEND = 128.0  # radius of the centre line, mm
_BANANA_SPAN = 1.44  # angle of the centre line, rad


def _banana_frame(p: Array) -> tuple[Array, Array, Array]:
    """Return for points, mm: position along the banana (0 stem .. 1 tip), distance from the centre line (mm), angle around it.

    The results have the shape [N] each.
    """
    middle = np.array([0.0, -_BANANA_BEND * 0.86, 17.8])
    q = p - middle
    angle = np.clip(np.arctan2(q[:, 0], q[:, 1]), -_BANANA_SPAN / 2, _BANANA_SPAN / 2)
    # The stem rises a little from the table, as on a real banana that lies on its side.
    lift = 5.0 * np.maximum(-angle / (_BANANA_SPAN / 2) - 0.5, 0) ** 2
    nearest = np.stack([_BANANA_BEND * np.sin(angle), _BANANA_BEND * np.cos(angle), lift], axis=-1)
    away = q - nearest
    out = away[:, 0] * np.sin(angle) + away[:, 1] * np.cos(angle)
    return angle / _BANANA_SPAN + 0.5, np.linalg.norm(away, axis=-1), np.arctan2(away[:, 2], out)


def _banana(seed: int, detail: float) -> tuple[Array, Array, Array, Array]:
    """Make a banana of about 190 mm that lies on its side."""
    places = np.array([0.0, 0.06, 0.12, 0.20, 0.35, 0.55, 0.75, 0.88, 0.96, 1.0])
    radii = np.array([5.2, 4.8, 6.5, 12.5, 17.6, 19.0, 17.4, 12.0, 6.0, 4.2])
    from scipy.interpolate import PchipInterpolator

    profile = PchipInterpolator(places, radii)

    def distance(p: Array) -> Array:
        along, away, angle = _banana_frame(p)
        return away - profile(along) * (1 + 0.035 * np.cos(5 * angle + 0.4))

    v, n, f = mesh_of(distance, (-100, -50, 0), (100, 50, 40), 0.6 * detail)
    along, _, angle = _banana_frame(v * 1e3)
    yellow = np.array([0.66, 0.44, 0.035])
    colours = yellow * np.clip(1 + 0.13 * octaves(v, 24e-3, 3, seed), 0.5, 1.35)[:, None]
    stretched = np.stack([along * 0.19 * 0.18, 0.018 * np.cos(angle), 0.018 * np.sin(angle)], axis=-1)
    colours *= np.clip(1 + 0.13 * octaves(stretched, 6e-3, 2, seed + 1), 0.5, 1.4)[:, None]
    colours = blend(colours, [0.30, 0.36, 0.05], 0.7 * (1 - step(along, 0.17, 0.16)) + 0.4 * step(along, 0.93, 0.10))
    ridge = np.abs(np.sin(2.5 * angle + 0.2 + 0.10 * value_noise(v, 15e-3, seed + 2)))
    colours = blend(colours, [0.34, 0.21, 0.03], 0.55 * (1 - step(ridge, 0.10, 0.16)))
    for size, reach, share, shift in ((19e-3, 0.30, 0.55, 3), (10e-3, 0.28, 0.6, 7), (6e-3, 0.30, 0.6, 13)):
        near, _, name = cells(v, size, seed + shift)
        spot = near + 0.08 * octaves(v, size / 1.6, 2, seed + shift + 1)
        brown = np.array([0.15, 0.065, 0.018]) * (0.6 + 1.1 * name)[:, None]
        colours = blend(colours, brown, (1 - step(spot, reach * (0.5 + 0.8 * name), 1.6e-3 / size)) * (name < share))
    rng = np.random.default_rng(seed)
    colours = paint_strokes(
        colours,
        v,
        n,
        count=45,
        length=(8e-3, 24e-3),
        width=(1.8e-3, 2.6e-3),
        palette=[[0.20, 0.10, 0.03], [0.42, 0.25, 0.03]],
        rng=rng,
    )
    dark = np.array([0.055, 0.035, 0.02]) * np.clip(1 + 0.5 * octaves(v, 7e-3, 2, seed + 17), 0.3, 2.5)[:, None]
    ends = (1 - step(along + 0.006 * octaves(v, 5e-3, 2, seed + 18), 0.025, 0.02)) + step(along, 0.972, 0.02)
    return v, n, f, blend(colours, dark, ends)


_BEAR_EYES = ((-11.5, -27.5, 96.0), (11.5, -27.5, 96.0))


def _bear(seed: int, detail: float) -> tuple[Array, Array, Array, Array]:
    """Make a sitting toy bear with a scarf, 120 mm tall."""

    def parts(p: Array) -> dict[str, Array]:
        scarf = np.hypot(np.hypot(p[:, 0], p[:, 1] + 1) - 22.5, p[:, 2] - 67 - 0.12 * p[:, 1]) - 6.0
        return {
            "body": ellipsoid(p, (0, 2, 38), (34, 29, 42)),
            "head": ellipsoid(p, (0, -4, 90), (30, 27, 26)),
            "ears": np.minimum(ellipsoid(p, (-23, -1, 109), (11.5, 7, 11.5)), ellipsoid(p, (23, -1, 109), (11.5, 7, 11.5))),
            "muzzle": ellipsoid(p, (0, -27, 83), (14.5, 12, 11.5)),
            "nose": ellipsoid(p, (0, -38, 87.5), (5.5, 4, 4.0)),
            "eyes": np.minimum(*(ellipsoid(p, eye, (4.2, 3.4, 4.2)) for eye in _BEAR_EYES)),
            "arms": np.minimum(
                ellipsoid(p, (-35, -12, 48), (10.5, 12, 24), 0.45), ellipsoid(p, (35, -12, 48), (10.5, 12, 24), -0.45)
            ),
            "legs": np.minimum(ellipsoid(p, (-23, -30, 15), (15, 29, 16)), ellipsoid(p, (23, -30, 15), (15, 29, 16))),
            "scarf": np.minimum(scarf, ellipsoid(p, (9, -29, 52), (6.5, 4.5, 17), 0.25)),
        }

    def distance(p: Array) -> Array:
        d = parts(p)
        fur = merge(d["body"], d["head"], d["ears"], d["arms"], d["legs"], d["muzzle"], soft=5.0)
        return merge(fur, d["nose"], d["eyes"], d["scarf"], soft=1.2)

    v, n, f = mesh_of(distance, (-50, -62, 0), (50, 34, 122), 0.7 * detail)
    mm = v * 1e3
    d = parts(mm)
    # Hanging fur: noise stretched along z, on top of lighter and darker patches.
    hair = octaves(v * [1, 1, 0.4], 8e-3, 2, seed)
    tone = 1 + 0.24 * octaves(v, 22e-3, 3, seed + 1) + 0.26 * hair
    colours = np.array([0.30, 0.155, 0.06]) * np.clip(tone, 0.12, 2.4)[:, None]
    colours = blend(colours, [0.46, 0.30, 0.14], 0.8 * step(octaves(v, 7e-3, 2, seed + 2), 1.2, 0.8))
    pale = np.array([0.58, 0.43, 0.25]) * np.clip(1 + 0.22 * octaves(v, 8e-3, 2, seed + 3), 0.3, 1.6)[:, None]
    colours = blend(colours, pale, 1 - step(d["muzzle"], 0.4, 1.0))
    belly = np.hypot(mm[:, 0] / 20, (mm[:, 2] - 36) / 22) + 0.05 * octaves(v, 8e-3, 2, seed + 4)
    colours = blend(colours, pale, (1 - step(belly, 0.9, 0.12)) * (mm[:, 1] < -8) * (d["legs"] > 1.5))
    inner = np.minimum(*(np.hypot(mm[:, 0] - s * 23, mm[:, 2] - 109.5) for s in (-1, 1)))
    colours = blend(colours, pale * [0.95, 0.75, 0.70], (1 - step(inner, 7.0, 1.2)) * (mm[:, 1] < -3.5) * (d["head"] > 0.5))
    for side in (-1, 1):
        sole = np.hypot(mm[:, 0] - side * 23, mm[:, 2] - 14) + 0.5 * octaves(v, 4e-3, 2, seed + 5)
        colours = blend(colours, pale * 0.8, (1 - step(sole, 9.0, 1.5)) * (mm[:, 1] < -47))
        for toe in (-7.5, 0, 7.5):
            pad = np.hypot(mm[:, 0] - side * 23 - toe, mm[:, 2] - 25 + 0.08 * toe**2)
            colours = blend(colours, [0.10, 0.05, 0.03], (1 - step(pad, 2.6, 1.0)) * (mm[:, 1] < -45))
    mouth = np.hypot(np.abs(mm[:, 0]) - 4.5, mm[:, 2] - 80.5)
    colours = blend(
        colours, [0.05, 0.03, 0.02], (1 - step(np.abs(mouth - 4.5), 0.7, 0.7)) * (mm[:, 2] < 80.5) * (mm[:, 1] < -33)
    )
    wool = np.array([0.07, 0.16, 0.34]) * np.clip(1 + 0.22 * octaves(v, 7e-3, 2, seed + 6), 0.3, 1.8)[:, None]
    near, _, name = cells(v, 9e-3, seed + 7)
    wool = blend(wool, pick([[0.72, 0.68, 0.58], [0.62, 0.10, 0.07], [0.68, 0.48, 0.08]], name), 1 - step(near, 0.36, 0.20))
    colours = blend(colours, wool, 1 - step(d["scarf"], 0.35, 0.5))
    colours = blend(colours, [0.03, 0.025, 0.025], 1 - step(np.minimum(d["nose"], d["eyes"]), 0.4, 0.5))
    for x, y, z in _BEAR_EYES:
        glint = np.linalg.norm(mm - [x + 1.2, y - 3.0, z + 1.6], axis=1)
        colours = blend(colours, [0.75, 0.75, 0.75], 1 - step(glint, 1.2, 0.6))
    colours = paint_strokes(
        colours,
        v,
        n,
        count=160,
        length=(6e-3, 14e-3),
        width=(1.8e-3, 2.4e-3),
        palette=[[0.10, 0.045, 0.02], [0.52, 0.36, 0.18]],
        rng=np.random.default_rng(seed),
        where=(d["scarf"] > 2) & (d["eyes"] > 2) & (d["nose"] > 2),
    )
    return v, n, f, colours


_MAKERS = {
    "small_cube": _small_cube,
    "cake": _cake,
    "banana": _banana,
    "bear": _bear,
    "mug": make_mug,
    "bowl": make_bowl,
    "pot": make_pot,
    "statue": make_statue,
    "toy": make_toy,
    "white_box": make_white_box,
}

OBJECTS = tuple(_MAKERS)
"""Names of the objects."""


def make_object(name: str, seed: int, detail: float = 1.0) -> tuple[Mesh, Array]:
    """Make one object in its own frame.

    Args:
        name: One of `OBJECTS`.
        seed: Seed of the object's texture.
        detail: Vertex spacing of the mesh, 1 for 0.6 to 0.7 mm (toy: 0.55 mm); larger is coarser and faster.

    Returns:
        The mesh, m, with linear reflectances 0..0.8 (not sRGB) as colours, and the vertex normals. [V, 3].

    Raises:
        InputError: The name is unknown.
    """
    if name not in _MAKERS:
        raise InputError("mirror", f"the object '{name}' is unknown", f"Use one of {', '.join(OBJECTS)}")
    vertices, normals, faces, colours = _MAKERS[name](seed, detail)
    centre = (vertices[:, :2].min(0) + vertices[:, :2].max(0)) / 2
    vertices = vertices - [*centre, 0.0]
    return Mesh(vertices, faces, np.clip(colours, 0.01, 0.78).astype(np.float32)), normals
