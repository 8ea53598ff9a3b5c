"""Other content of the room: a window, clutter, cables and decoys on the table, and a person who passes between lamp and table.

None of these takes part in the physics. Clutter and cables lie where no object starts, and decoys are crumpled paper, which
anything presses flat. An open hand may still pass through the edge of a piece of clutter when it grasps an object at the rim
of the area.
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
"""Width and height of the window, its distance from the working area, and the height of its middle over the table, m."""

_DAYLIGHT = (0.92, 1.0, 1.12)
_EDGE = (0.222, 0.25)
"""Smallest and largest distance from the working area's middle to the near edge of a piece of clutter, m, by the larger of its
x and y distances. Objects start within 0.165 m and extend by 0.055 m, so clutter is as near as they allow and is often seen."""

_FOOT = 0.18
"""Distance from the axis of the robot's foot that clutter keeps, m."""

_CABLE, _LINKS = 0.0035, 24
_RINGS, _SECTORS, _PATCHES = 5, 28, 6
"""Number of rings, sectors and colour patches of a decoy's mesh."""

_CREASE = 0.006
"""Height of a decoy's highest crease, m."""

PASSING_SPEED, _PASSING_WAY = 0.8, 1.2
"""Speed of the passer, m/s, and distance from the line of light at which they appear and disappear, m."""


def window(mi: Any, hidden: Hidden, lamp: float) -> dict[str, Any]:
    """Describe the shape and light of the window for Mitsuba; empty if there is no window.

    Args:
        mi: The Mitsuba module.
        hidden: Hidden parameters, of which the window's radiance and heading are used.
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
    """Return the middle of the window and the point that it lights, table frame, m. [3], [3]."""
    toward = np.array([np.cos(hidden.window_heading), np.sin(hidden.window_heading), 0.0])
    return np.array([*WORK_CENTRE_M, WINDOW_HEIGHT]) + WINDOW_AWAY * toward, np.array([*WORK_CENTRE_M, 0.0])


def lying_about(mi: Any, hidden: Hidden, colours: Array | None) -> dict[str, Any]:
    """Describe clutter, cables and decoys for Mitsuba. A larger count keeps the pieces of a smaller one and adds others.

    Args:
        mi: The Mitsuba module.
        hidden: Hidden parameters, of which the counts and `clutter_seed` are used.
        colours: Linear colours of the object, from which decoys take theirs; None for no decoys. [N, 3].
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
    """Draw a position beside the working area, clear of the robot's foot, for a piece of this radius, m. [2]."""
    foot = np.linalg.inv(base_from_table())[:2, 3]
    while True:
        side, along = rng.integers(4), rng.uniform(-1.0, 1.0)
        away = rng.uniform(_EDGE[0] + radius, _EDGE[1] + radius)
        corner = np.array([away, along * away]) if side % 2 else np.array([along * away, away])
        place = np.array(WORK_CENTRE_M) + (corner if side < 2 else -corner)
        if np.linalg.norm(place - foot) > _FOOT:
            return place


def _thing(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Describe a piece of clutter: a box, a can or a ball."""
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
    # The can lies on its side: a standing can would need a lid.
    along = high * np.array([np.cos(turn), np.sin(turn), 0.0])
    middle = np.array([x, y, deep])
    ends = {"p0": (middle - 1.5 * along).tolist(), "p1": (middle + 1.5 * along).tolist()}
    return {"type": "cylinder", **ends, "radius": deep, "bsdf": {"type": "twosided", "bsdf": surface}}


def _cable(mi: Any, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Describe a cable that bends past the working area."""
    start = rng.uniform(-np.pi, np.pi)
    angles = start + np.linspace(0.0, rng.uniform(0.8, 1.6), _LINKS + 1)
    # The cable follows a rounded square as far out as the clutter, because objects start in the area's corners, too.
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
    """Describe a crumpled wrapper in patches of the object's colours, on the table inside the working area."""
    middle, half = np.array([*WORK_CENTRE_M, 0.0]), rng.uniform(0.025, 0.042)
    middle[:2] += rng.uniform(-0.14, 0.14, 2)
    across, around = np.meshgrid(np.linspace(0.0, 1.0, _RINGS), np.arange(_SECTORS) / _SECTORS * 2 * np.pi, indexing="ij")
    edge = half * rng.uniform(0.6, 1.0, _SECTORS)
    out = np.stack([np.cos(around), np.sin(around)], axis=-1) * (across * edge)[..., None]
    # The edge lies on the table, the middle is a single vertex, and creases rise between them.
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
    # Give each triangle its own vertices and normal, so that creases are sharp.
    corners, paint = points[faces].reshape(-1, 3), np.clip(colours[inks[nearest]], 0.0, 0.95)[faces].reshape(-1, 3)
    mesh = Mesh(corners + middle, np.arange(len(corners)).reshape(-1, 3), paint)
    return painted(mi, name, mesh, np.repeat(mesh.normals(), 3, axis=0), float(rng.choice([0.0, 0.5, 0.8])))


def passer_pose(hidden: Hidden, lamp: Array, aim: Array, seed: int, seconds: float, episode: float = 4.0) -> Array:
    """Return the pose of a person who passes between lamp or window and table once in an episode. [4, 4].

    Args:
        hidden: Hidden parameters of the world; nobody passes if `passer` is 0.
        lamp: Position of the lamp, or of the window's middle, table frame, m. [3].
        aim: Point that it lights, table frame, m. [3].
        seed: Seed of the episode; it decides when the person passes and from which side.
        seconds: Time since the episode began, s.
        episode: Approximate length of an episode, s.
    """
    rng = np.random.default_rng([seed, zlib.crc32(b"passer")])
    crossing, side = rng.uniform(0.15, 0.7) * episode, rng.choice([-1.0, 1.0])
    toward = lamp - aim
    across = np.array([-toward[1], toward[0], 0.0]) / np.hypot(*toward[:2])
    way = np.clip(PASSING_SPEED * (seconds - crossing), -_PASSING_WAY, _PASSING_WAY)
    out = np.eye(4)
    # The screen that represents the person is upright, with its face towards the lamp.
    out[:3, 0], out[:3, 1] = across, [0.0, 0.0, 1.0]
    out[:3, 2] = np.cross(out[:3, 0], out[:3, 1])
    out[:3, 3] = aim + 0.55 * toward + side * way * across
    return out
