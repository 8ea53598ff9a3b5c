"""Cases of thrown bodies: which body, what is hidden in it and how large, and the files that a user would bring."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gsbridge.gap.benchmark.body_truth import ThrowScene, throw_box
from gsbridge.gap.contact.throws import Throws, write_throws
from gsbridge.geometry import Array

THROWS = 30
"""Throws of each role."""

DURATION = 0.6
"""Length of a throw, s."""

ROLES = ("fit", "select", "verify")

MODEL = "model.yaml"

BODY = "body"
"""What truths call the plant of these cases."""

_SHARE = 0.2
"""A unit is this share of the distance to which noise of the starts and chaos alone drive the truth apart from itself."""

_TRIES, _CLOSE = 9, 0.12
"""Tries to find a size, and how near its displacement has to come to the wanted one."""

_PROBES = 10
"""Throws by which sizes are found."""

Parameters = dict[str, float]
Hide = Callable[[ThrowScene, float, Array], tuple[ThrowScene, Parameters]]
"""Scene, size and a random direction [3] -> scene with it, and the parameters of the effect that a perfect diagnosis gives."""


@dataclass(frozen=True)
class HiddenEffect:
    """One thing that may be hidden.

    Args:
        low: Smallest size, SI.
        high: Largest size that a careless model may have, SI.
        hide: Puts it into a scene.
        signed: Whether its size may be negative, too.
        shapes: Bodies in which it can be hidden.
    """

    low: float
    high: float
    hide: Hide
    signed: bool = False
    shapes: tuple[str, ...] = ("box", "ball")


def _figure(field: str, parameter: str, *, share: bool = False) -> Hide:
    """A scene's figure that is changed by the size, or by a share of itself."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        now = float(getattr(scene, field))
        content: dict[str, Any] = {field: now * (1.0 + size) if share else now + size}
        return replace(scene, **content), {parameter: size}

    return hide


def _unlike(field: str) -> Hide:
    """A figure for which the catalogue has another law, so that no parameter can be compared."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        content: dict[str, Any] = {field: size}
        return replace(scene, **content), {}

    return hide


def _vector(field: str, names: tuple[str, ...]) -> Hide:
    """A direction, drawn at random."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        along = way[: len(names)] / np.linalg.norm(way[: len(names)])
        content: dict[str, Any] = {field: tuple(np.asarray(getattr(scene, field)) + size * along)}
        return replace(scene, **content), dict(zip(names, (size * along).tolist(), strict=True))

    return hide


def _resize(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Larger in all lengths with the mass properties of before."""
    grown = tuple(edge * (1.0 + size) for edge in scene.edges)
    return replace(scene, edges=grown, inertia=scene.inertia / (1.0 + size) ** 2), {"share": size}


def _soften(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """A contact that swings with a period of `size` seconds, half damped."""
    pulse = 2 * np.pi / size
    return replace(scene, compliance=1.0 / (scene.mass * pulse**2), softened=scene.mass * pulse), {}


def _push(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """A force that accelerates the body by `size` m/s2."""
    along = scene.mass * size * way[:2] / np.linalg.norm(way[:2])
    return replace(scene, force=tuple(np.asarray(scene.force) + along)), {"x": float(along[0]), "y": float(along[1])}


def _heavier(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Heavier, with a force that does not grow with the mass."""
    return replace(scene, mass=scene.mass * (1.0 + size)), {"share": size}


KNOWN: Mapping[str, HiddenEffect] = {
    "angular_damping": HiddenEffect(0.2, 8.0, _unlike("angular")),
    "contact_friction": HiddenEffect(0.03, 0.5, _figure("friction", "friction"), signed=True),
    "contact_softness": HiddenEffect(0.02, 0.15, _soften),
    "gravity_scale": HiddenEffect(0.005, 0.15, _figure("gravity", "share", share=True), signed=True),
    "inertia_scale": HiddenEffect(0.05, 1.5, _figure("inertia", "share", share=True)),
    "linear_damping": HiddenEffect(0.05, 4.0, _unlike("linear")),
    "object_com": HiddenEffect(0.001, 0.02, _vector("com", ("x", "y", "z"))),
    "object_mass": HiddenEffect(0.1, 2.0, _heavier),
    "object_size": HiddenEffect(0.01, 0.2, _resize, signed=True),
    "restitution": HiddenEffect(0.1, 0.8, _figure("restitution", "restitution")),
    "rolling_friction": HiddenEffect(3e-4, 0.01, _figure("rolling", "arm")),
    "spinning_friction": HiddenEffect(1e-3, 0.03, _figure("spinning", "arm")),
    "steady_force": HiddenEffect(0.02, 3.0, _push),
    "table_height": HiddenEffect(5e-4, 0.02, _figure("height", "height"), signed=True),
    "table_tilt": HiddenEffect(0.005, 0.15, _vector("tilt", ("about_x", "about_y"))),
    "tracking_lag": HiddenEffect(1e-3, 0.02, _figure("lag", "time")),
    "tracking_offset": HiddenEffect(0.001, 0.02, _vector("offset", ("x", "y", "z"))),
    "tracking_rate": HiddenEffect(0.005, 0.15, _figure("clock", "share", share=True), signed=True),
    "tracking_scale": HiddenEffect(0.005, 0.15, _figure("stretched", "share", share=True), signed=True),
}
"""All effects of bodies; ranges were stated before anything was diagnosed."""

STRANGE: Mapping[str, HiddenEffect] = {
    "magnus": HiddenEffect(0.005, 0.4, _unlike("magnus")),
    "patchy": HiddenEffect(0.05, 0.4, _unlike("patchy")),
    "gust": HiddenEffect(0.05, 3.0, _unlike("gust")),
    "bent": HiddenEffect(0.02, 0.6, _unlike("bent")),
    "slosh": HiddenEffect(0.05, 0.6, _unlike("slosh")),
    "bump": HiddenEffect(5e-4, 0.015, _unlike("bump")),
}
"""What no catalogue holds: a spin that carries the body aside, friction that depends on the place, wind that comes and goes, a
tracker whose lengths are bent, something that swings inside, a wavy surface."""

UNKNOWN_OF = {"development": ("magnus", "patchy"), "scored": ("gust", "bent", "slosh", "bump")}
"""Families of what is unknown, by split: none is in both."""

_TWINS = (("object_mass", "steady_force"), ("gravity_scale", "tracking_rate"))
"""The same equation: a force that is steady accelerates a body of half the mass as twice the force does; and where contacts are
hard and nothing else has a time of its own, a slow clock is a weak gravity."""


def body_twins(names: tuple[str, ...]) -> list[list[str]]:
    """Sets of effects that are the same equation as what is hidden, itself not among them."""
    sets: set[frozenset[str]] = {frozenset()}
    for name in names:
        alike = {name}.union(*(group for group in _TWINS if name in group))
        sets = {done | {option} for done in sets for option in alike}
    return [sorted(found) for found in sorted(sets - {frozenset(names)}, key=sorted) if len(found) == len(names)]


@dataclass(frozen=True)
class BodyCase:
    """A sealed truth and its throws.

    Args:
        hidden: Sizes of what is hidden, by name.
        parameters: Parameters that a perfect diagnosis gives, by name; none where the law is another than the catalogue's.
        units: Size, in units of what the noise of the starts hides; see `_SHARE`.
        model: Content of the model's file.
        throws: Throws by role.
        settings: The scene in words, for the truth's file.
    """

    hidden: Mapping[str, float]
    parameters: Mapping[str, Parameters]
    units: float
    model: Mapping[str, Any]
    throws: Mapping[str, Throws]
    settings: Mapping[str, Any]


def draw_body_case(names: tuple[str, ...], units: float, seed: int, count: int = THROWS) -> BodyCase:
    """Draw a body and hide something in it.

    Args:
        names: What is hidden, of `KNOWN` or `STRANGE`; each of `units` by itself, or as much as its range allows.
        units: Size of each, in units of what the noise of the starts hides; see `_SHARE`.
        seed: Seed of everything.
        count: Throws of each role.
    """
    rng = np.random.default_rng(seed)
    entries = {name: KNOWN.get(name) or STRANGE[name] for name in names}
    shapes = [shape for shape in ("box", "ball") if all(shape in entry.shapes for entry in entries.values())]
    bare = _drawn_scene(str(rng.choice(shapes)), names, rng)
    ways = {name: rng.normal(size=3) for name in names}
    signs = {name: float(rng.choice((-1.0, 1.0))) if entry.signed else 1.0 for name, entry in entries.items()}
    seeds = [int(value) for value in rng.integers(2**31, size=4)]
    unit = _SHARE * _apart(bare, seeds[3])
    scene, hidden, parameters, found = bare, {}, {}, 0.0
    for name, entry in entries.items():

        def put(on: ThrowScene, size: float, name: str = name, entry: HiddenEffect = entry) -> tuple[ThrowScene, Parameters]:
            return entry.hide(on, signs[name] * size, ways[name])

        size, shown = _sized(entry, lambda at, put=put: _moved(bare, put(bare, at)[0], seeds[3]) / unit, units)  # type: ignore[misc]
        scene, parameters[name] = put(scene, size)
        hidden[name] = signs[name] * size
        found = max(found, shown)
    throws = {role: throw_box(scene, count, number) for role, number in zip(ROLES, seeds[:3], strict=True)}
    settings = {"shape": bare.shape, "edges": list(bare.edges), "mass": bare.mass, "slowness": bare.slowness}
    settings["unit_mm"] = 1e3 * unit
    return BodyCase(hidden, parameters, found, _model(bare), throws, settings)


def _drawn_scene(shape: str, names: tuple[str, ...], rng: np.random.Generator) -> ThrowScene:
    """A body without anything hidden."""
    edge = float(rng.uniform(0.05, 0.12))
    edges = tuple(float(value) for value in edge * rng.uniform(0.7, 1.3, 3)) if shape == "box" else (edge,) * 3
    scene = ThrowScene(
        shape, edges,
        mass=float(rng.uniform(0.1, 0.6)),
        friction=float(rng.uniform(0.2, 0.6)),
        slowness=float(rng.uniform(0.002, 0.006)),
        rate=float(rng.choice([120.0, 150.0, 240.0])),
        duration=DURATION,
        noise=(float(rng.uniform(5e-5, 3e-4)), float(rng.uniform(3e-4, 2e-3))),
    )  # fmt: skip
    if "tracking_lag" in names or rng.random() < 0.2:
        scene = replace(scene, lag=0.0)
    if "object_mass" in names:
        # In free flight and sliding a mass shows nowhere: something must pull.
        scene = replace(scene, force=tuple(scene.mass * rng.uniform(0.5, 1.5) * np.array([1.0, 0.5])))
    return scene


def _apart(scene: ThrowScene, seed: int) -> float:
    """Mean distance between throws and the same throws with starts that are known as well as the tracker tells them, m."""
    samples = 0.06 * scene.rate
    # Slope of a parabola over the first 60 ms, by which a diagnosis learns how a throw starts.
    gain = 13.9 / (0.06 * np.sqrt(samples))
    return _distance(scene, scene, seed, (scene.noise[0] * gain, scene.noise[1] * gain))


def _moved(bare: ThrowScene, scene: ThrowScene, seed: int) -> float:
    """Mean distance to which what is hidden drives throws, m."""
    return _distance(bare, scene, seed, (0.0, 0.0))


def _distance(one: ThrowScene, other: ThrowScene, seed: int, noise: tuple[float, float]) -> float:
    """Mean distance of throws of two scenes, the other's with noise on its start speeds (m/s, rad/s)."""
    quiet = [replace(scene, noise=(0.0, 0.0)) for scene in (one, other)]
    first, second = throw_box(quiet[0], _PROBES, seed), throw_box(quiet[1], _PROBES, seed, shaken=noise)
    pairs = zip(first.items, second.items, strict=True)
    return float(np.mean([np.linalg.norm(a.position - b.position, axis=1).mean() for a, b in pairs]))


def _sized(entry: HiddenEffect, shown: Callable[[float], float], units: float) -> tuple[float, float]:
    """A size within its range that shows as wanted, or the nearest, and how it shows."""
    low, high = entry.low, entry.high
    best = (high, shown(high))
    if best[1] <= units:
        return best
    for _ in range(_TRIES):
        size = float(np.sqrt(low * high))
        now = (size, shown(size))
        best = min(best, now, key=lambda pair: abs(np.log(max(pair[1], 1e-9) / units)))
        if abs(np.log(max(best[1], 1e-9) / units)) < _CLOSE:
            break
        low, high = (size, high) if now[1] < units else (low, size)
    return best


def _model(scene: ThrowScene) -> dict[str, Any]:
    """What the simulation believes: all but what is hidden."""
    model: dict[str, Any] = {"controller": {"mode": "body"}, "contact": {"friction": scene.friction}}
    if scene.shape == "box":
        model |= {"box": list(scene.edges), "mass": scene.mass}
    else:
        model |= {"urdf": "body.urdf"}
    if any(scene.force):
        values = {axis: float(value) for axis, value in zip("xy", scene.force, strict=True)}
        model["effects"] = [{"name": "steady_force", "parameters": values}]
    return model


def write_body_case(folder: Path, case: BodyCase) -> dict[str, str]:
    """Write what a user would bring.

    Args:
        folder: Gets the case, its model and its throws.
        case: The case.

    Returns:
        SHA-256 of the throws' files by role.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if "urdf" in case.model:
        (folder / "body.urdf").write_text(_ball(case.settings["edges"][0], case.settings["mass"]), encoding="utf-8")
    (folder / MODEL).write_text(yaml.safe_dump(dict(case.model), sort_keys=False), encoding="utf-8")
    digests = {}
    for role, throws in case.throws.items():
        write_throws(folder / f"{role}.csv", throws)
        digests[role] = hashlib.sha256((folder / f"{role}.csv").read_bytes()).hexdigest()
    content = {"model": MODEL, "records": {role: f"{role}.csv" for role in case.throws}, "horizon": DURATION}
    (folder / "case.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return digests


def _ball(diameter: float, mass: float) -> str:
    moment = 0.1 * mass * diameter**2
    return (
        f'<robot name="ball"><link name="ball"><inertial><mass value="{mass!r}"/><inertia ixx="{moment!r}" iyy="{moment!r}" '
        f'izz="{moment!r}" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><sphere radius="{0.5 * diameter!r}"/>'
        "</geometry></collision></link></robot>"
    )
