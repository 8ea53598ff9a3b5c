"""What else is in the room: a window, things that lie about, and somebody who passes between lamp and table.

Nothing of it has a body: clutter and cables lie where no object starts, decoys are crumpled paper, which anything presses flat.
A hand that is open may still pass through the edge of a thing, where it takes an object from the rim of the area.
"""

from __future__ import annotations

import colorsys
import zlib
from typing import Any

import numpy as np

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.backgrounds import WORK_CENTRE_M
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.surfaces import coated, painted
from gsbridge.robot.nominal import base_from_table

WINDOW_SIZE, WINDOW_AWAY, WINDOW_HEIGHT = (1.2, 1.0), 1.4, 0.65
"""Width and height of a window, how far from the working area it is, and its middle over the table, m."""

_DAYLIGHT = (0.92, 1.0, 1.12)
_EDGE = (0.222, 0.25)
"""Nearest and farthest that a thing reaches towards the middle of the working area, along x or y, whichever is farther, m: as
near as objects leave room, which start within 0.165 and reach 0.055 further, so that many pictures show some."""

_FOOT = 0.18
"""Room for the foot of the robot, m."""

_CABLE, _LINKS = 0.0035, 24
_RINGS, _SECTORS, _PATCHES = 5, 28, 6
"""Rings and sectors of a decoy, and patches of colour."""

_CREASE = 0.006
"""Height of a decoy's highest crease, m."""

PASSING_SPEED, _PASSING_WAY = 0.8, 1.2
"""Speed of somebody who passes, m/s, and how far from the lamp's line they come and go, m."""


def window(mi: Any, hidden: Hidden, lamp: float) -> dict[str, Any]:
    """Shape and light of the window, where there is one.

    Args:
        mi: The Mitsuba module.
        hidden: Radiance and heading of the window.
        lamp: Radiance of the lamp.
    """
    if hidden.window == 0.0:
        return {}
    middle, aim = window_line(hidden)
    facing = mi.ScalarTransform4f().look_at(origin=middle.tolist(), target=[*aim[:2], WINDOW_HEIGHT], up=[0, 0, 1])
    radiance = (hidden.window * lamp * np.array(_DAYLIGHT)).tolist()
    return {
        "window": {
            "type": "rectangle",
            "to_world": facing.scale([WINDOW_SIZE[0] / 2, WINDOW_SIZE[1] / 2, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
        }
    }


def window_line(hidden: Hidden) -> tuple[Array, Array]:
    """Middle of the window and the point that it lights, table frame, m. [3], [3]."""
    toward = np.array([np.cos(hidden.window_heading), np.sin(hidden.window_heading), 0.0])
    return np.array([*WORK_CENTRE_M, WINDOW_HEIGHT]) + WINDOW_AWAY * toward, np.array([*WORK_CENTRE_M, 0.0])


def lying_about(mi: Any, hidden: Hidden, colours: Array | None) -> dict[str, Any]:
    """Clutter, cables and decoys. More of them are the same ones and others.

    Args:
        mi: The Mitsuba module.
        hidden: How many, and the seed of where they lie.
        colours: Colours of the object, linear, from which decoys take theirs; None for none. [N, 3].
    """
    content: dict[str, Any] = {}
    seed = int(hidden.clutter_seed)
    for kind, count in (("clutter", hidden.clutter), ("cable", hidden.cables), ("decoy", hidden.decoys)):
        for number in range(int(count)):
            rng = np.random.default_rng([seed, zlib.crc32(kind.encode()), number])
            if kind == "clutter":
                content[f"clutter_{number}"] = _thing(mi, rng)
            elif kind == "cable":
                content.update({f"cable_{number}_{k}": part for k, part in enumerate(_cable(mi, rng))})
            elif colours is not None:
                content[f"decoy_{number}"] = _decoy(mi, f"decoy_{number}", rng, colours)
    return content


def _beside(rng: np.random.Generator, radius: float) -> Array:
    """A place beside the working area, off the robot's foot, for a thing of that radius, m. [2]."""
    foot = np.linalg.inv(base_from_table())[:2, 3]
    while True:
        side, along = rng.integers(4), rng.uniform(-1.0, 1.0)
        away = rng.uniform(_EDGE[0] + radius, _EDGE[1] + radius)
        corner = np.array([away, along * away]) if side % 2 else np.array([along * away, away])
        place = np.array(WORK_CENTRE_M) + (corner if side < 2 else -corner)
        if np.linalg.norm(place - foot) > _FOOT:
            return place


def _thing(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """A box, a can or a ball."""
    wide, deep, high = rng.uniform(0.012, 0.032, 3)
    colour = colorsys.hsv_to_rgb(rng.uniform(), rng.uniform(0.2, 0.95), rng.uniform(0.15, 0.8))
    surface = coated({"type": "rgb", "value": list(colour)}, float(rng.choice([0.0, 0.5, 0.8])))
    turn = float(np.degrees(rng.uniform(0, np.pi)))
    kind = rng.choice(["cube", "cylinder", "sphere"])
    radius = {"cube": np.hypot(wide, deep), "cylinder": np.hypot(1.5 * high, deep), "sphere": wide}[str(kind)]
    x, y = _beside(rng, float(radius))
    if kind == "cube":
        place = mi.ScalarTransform4f().translate([x, y, high]).rotate([0, 0, 1], turn).scale([wide, deep, high])
        return {"type": "cube", "to_world": place, "bsdf": surface}
    if kind == "sphere":
        return {"type": "sphere", "center": [x, y, wide], "radius": wide, "bsdf": surface}
    # A can that lies on its side: a standing one would need a lid.
    along = high * np.array([np.cos(turn), np.sin(turn), 0.0])
    middle = np.array([x, y, deep])
    ends = {"p0": (middle - 1.5 * along).tolist(), "p1": (middle + 1.5 * along).tolist()}
    return {"type": "cylinder", **ends, "radius": deep, "bsdf": {"type": "twosided", "bsdf": surface}}


def _cable(mi: Any, rng: np.random.Generator) -> list[dict[str, Any]]:
    """A cable that bends past the working area."""
    start = rng.uniform(-np.pi, np.pi)
    angles = start + np.linspace(0.0, rng.uniform(0.8, 1.6), _LINKS + 1)
    # A rounded square, as far out as things: objects start in corners, too.
    around = (np.cos(angles) ** 8 + np.sin(angles) ** 8) ** (-1 / 8)
    away = (0.258 + 0.03 * np.sin(3.0 * angles + rng.uniform(0, 6))) * around + np.linspace(0.12, 0.0, _LINKS + 1)
    points = np.c_[
        WORK_CENTRE_M[0] + away * np.cos(angles), WORK_CENTRE_M[1] + away * np.sin(angles), np.full(_LINKS + 1, _CABLE)
    ]
    shade = float(rng.uniform(0.02, 0.3))
    surface = coated({"type": "rgb", "value": [shade] * 3}, 0.3)
    return [
        {"type": "cylinder", "p0": a.tolist(), "p1": b.tolist(), "radius": _CABLE, "bsdf": surface}
        for a, b in zip(points[:-1], points[1:], strict=True)
    ]


def _decoy(mi: Any, name: str, rng: np.random.Generator, colours: Array) -> Any:
    """A crumpled wrapper in patches of the object's colours, on the table inside the working area."""
    middle, half = np.array([*WORK_CENTRE_M, 0.0]), rng.uniform(0.025, 0.042)
    middle[:2] += rng.uniform(-0.14, 0.14, 2)
    across, around = np.meshgrid(np.linspace(0.0, 1.0, _RINGS), np.arange(_SECTORS) / _SECTORS * 2 * np.pi, indexing="ij")
    edge = half * rng.uniform(0.6, 1.0, _SECTORS)
    out = np.stack([np.cos(around), np.sin(around)], axis=-1) * (across * edge)[..., None]
    # Its edge lies on the table, its middle is one corner, and creases rise between.
    high = _CREASE * rng.uniform(0.2, 1.0, across.shape)
    high[0], high[-1] = high[0, 0], 5e-4
    points = np.c_[out.reshape(-1, 2), high.ravel()]
    spots, inks = rng.uniform(-half, half, (_PATCHES, 2)), rng.choice(len(colours), _PATCHES)
    nearest = np.linalg.norm(points[:, None, :2] - spots, axis=-1).argmin(axis=1)
    ring, sector = np.meshgrid(np.arange(_RINGS - 1), np.arange(_SECTORS), indexing="ij")
    a, b = ring * _SECTORS + sector, ring * _SECTORS + (sector + 1) % _SECTORS
    outer, inner = np.stack([a, a + _SECTORS, b + _SECTORS], -1), np.stack([a, b + _SECTORS, b], -1)
    # Sectors meet in the middle, where the inner triangles would have no area.
    faces = np.concatenate([outer, inner[1:]]).reshape(-1, 3)
    # Triangles of their own, each with its own normal: creases are sharp.
    corners, paint = points[faces].reshape(-1, 3), np.clip(colours[inks[nearest]], 0.0, 0.95)[faces].reshape(-1, 3)
    mesh = Mesh(corners + middle, np.arange(len(corners)).reshape(-1, 3), paint)
    return painted(mi, name, mesh, np.repeat(mesh.normals(), 3, axis=0), float(rng.choice([0.0, 0.5, 0.8])))


def passer_pose(hidden: Hidden, lamp: Array, aim: Array, seed: int, seconds: float, episode: float = 4.0) -> Array:
    """Pose of somebody who passes between lamp or window and table once in an episode. [4, 4].

    Args:
        hidden: Parameters of the world; nobody passes where `passer` is 0.
        lamp: Place of the lamp, or of the window's middle, table frame, m. [3].
        aim: Point that it lights, table frame, m. [3].
        seed: Seed of the episode; it decides when somebody passes and from which side.
        seconds: Time since the episode began, s.
        episode: How long episodes last, about, s.
    """
    rng = np.random.default_rng([seed, zlib.crc32(b"passer")])
    crossing, side = rng.uniform(0.15, 0.7) * episode, rng.choice([-1.0, 1.0])
    toward = lamp - aim
    across = np.array([-toward[1], toward[0], 0.0]) / np.hypot(*toward[:2])
    way = np.clip(PASSING_SPEED * (seconds - crossing), -_PASSING_WAY, _PASSING_WAY)
    out = np.eye(4)
    # The screen that stands for a person: upright, its face towards the lamp.
    out[:3, 0], out[:3, 1] = across, [0.0, 0.0, 1.0]
    out[:3, 2] = np.cross(out[:3, 0], out[:3, 1])
    out[:3, 3] = aim + 0.55 * toward + side * way * across
    return out
