"""Cases of thrown bodies: the body, the hidden effects and their sizes, and the files that a user would provide."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gsbridge.errors import InputError
from gsbridge.gap.benchmark.body_truth import STEP, RunawayError, ThrowScene, throw_box
from gsbridge.gap.benchmark.body_visibility import BodyVisibility
from gsbridge.gap.benchmark.generate import NotShownError
from gsbridge.gap.contact.throws import Throws, write_throws
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

THROWS = 30
"""Number of throws of each role."""

DURATION = 0.6
"""Length of a throw, s."""

ROLES = ("fit", "select", "verify")

MODEL = "model.yaml"

URDF = "body.urdf"

BODY = "body"
"""Name of the plant of these cases in truths."""

_TRIES, _CLOSE = 9, 0.12
"""Largest number of steps in the search for a size, and the log ratio of shown to wanted units at which it stops."""

_FAR = 1.4
"""Largest factor between shown and wanted units; an effect that shows by less or by more is not hidden in that scene."""

_TOGETHER = 0.5
"""Share of the wanted units that several effects must show together, which excludes effects that cancel."""

_SCENES, _REDRAWS = 4, 8
"""Number of scenes tried for a set of effects, and largest number of times that an effect is replaced if it shows in none."""

Parameters = dict[str, float]
Hide = Callable[[ThrowScene, float, Array], tuple[ThrowScene, Parameters]]
"""Scene, size and random direction [3] -> scene with the effect, and the parameters that a perfect diagnosis would give."""


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that may be hidden.

    Args:
        low: Smallest size, SI.
        high: Largest size that is plausible for a careless model, SI.
        hide: Function that puts the effect into a scene.
        signed: Whether the size may be negative, too.
        shapes: Shapes of the bodies in which the effect can be hidden.
    """

    low: float
    high: float
    hide: Hide
    signed: bool = False
    shapes: tuple[str, ...] = ("box", "ball")


def _figure(field: str, parameter: str, *, share: bool = False, least: float = -np.inf) -> Hide:
    """Make a function that adds the size, or a share of the value, to a field of a scene; the result is at least `least`."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        now = float(getattr(scene, field))
        size = max(size, least - now)
        content: dict[str, Any] = {field: now * (1.0 + size) if share else now + size}
        return replace(scene, **content), {parameter: size}

    return hide


def _unlike(field: str) -> Hide:
    """Make a function that sets a field outside the catalogue's laws, so that no parameter can be compared."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        content: dict[str, Any] = {field: size}
        return replace(scene, **content), {}

    return hide


def _vector(field: str, names: tuple[str, ...]) -> Hide:
    """Make a function that adds a vector of the given size, in a random direction, to a field of a scene."""

    def hide(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
        along = way[: len(names)] / np.linalg.norm(way[: len(names)])
        content: dict[str, Any] = {field: tuple(np.asarray(getattr(scene, field)) + size * along)}
        return replace(scene, **content), dict(zip(names, (size * along).tolist(), strict=True))

    return hide


def _resize(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Scale all lengths of the body but keep its mass properties."""
    grown = tuple(edge * (1.0 + size) for edge in scene.edges)
    return replace(scene, edges=grown, inertia=scene.inertia / (1.0 + size) ** 2), {"share": size}


def _soften(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Make the contact a spring and damper with a period of `size` seconds and a damping ratio of 0.5."""
    pulse = 2 * np.pi / size
    return replace(scene, compliance=1.0 / (scene.mass * pulse**2), softened=scene.mass * pulse), {}


def _push(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Add a horizontal force that accelerates the body by `size` m/s2."""
    along = scene.mass * size * way[:2] / np.linalg.norm(way[:2])
    return replace(scene, force=tuple(np.asarray(scene.force) + along)), {"x": float(along[0]), "y": float(along[1])}


def _late(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Log start speeds of an earlier time; the lag is a whole number of engine steps, as speeds exist only at steps."""
    lag = STEP * round(size / STEP)
    return replace(scene, lag=lag), {"time": lag}


def _heavier(scene: ThrowScene, size: float, way: Array) -> tuple[ThrowScene, Parameters]:
    """Scale the mass, but not the force that acts on the body."""
    return replace(scene, mass=scene.mass * (1.0 + size)), {"share": size}


KNOWN: Mapping[str, HiddenEffect] = {
    "angular_damping": HiddenEffect(0.2, 8.0, _figure("angular", "coefficient")),
    "contact_friction": HiddenEffect(0.03, 0.5, _figure("friction", "friction", least=0.0), signed=True),
    "contact_softness": HiddenEffect(0.02, 0.15, _soften),
    "gravity_scale": HiddenEffect(0.005, 0.15, _figure("gravity", "share", share=True), signed=True),
    "inertia_scale": HiddenEffect(0.05, 1.5, _figure("inertia", "share", share=True)),
    "linear_damping": HiddenEffect(0.05, 4.0, _figure("linear", "coefficient")),
    "object_com": HiddenEffect(0.001, 0.02, _vector("com", ("x", "y", "z"))),
    "object_mass": HiddenEffect(0.1, 2.0, _heavier),
    "object_size": HiddenEffect(0.01, 0.2, _resize, signed=True),
    "restitution": HiddenEffect(0.1, 0.8, _figure("restitution", "restitution")),
    "rolling_friction": HiddenEffect(3e-4, 0.01, _figure("rolling", "arm")),
    "spinning_friction": HiddenEffect(1e-3, 0.03, _figure("spinning", "arm")),
    "steady_force": HiddenEffect(0.02, 3.0, _push),
    "table_height": HiddenEffect(5e-4, 0.02, _figure("height", "height"), signed=True),
    "table_tilt": HiddenEffect(0.005, 0.15, _vector("tilt", ("about_x", "about_y"))),
    "tracking_lag": HiddenEffect(1e-3, 0.02, _late),
    "tracking_offset": HiddenEffect(0.001, 0.02, _vector("offset", ("x", "y", "z"))),
    "tracking_rate": HiddenEffect(0.005, 0.15, _figure("clock", "share", share=True), signed=True),
    "tracking_scale": HiddenEffect(0.005, 0.15, _figure("stretched", "share", share=True), signed=True),
}
"""All effects of bodies in the catalogue; their ranges were fixed before any diagnosis."""

STRANGE: Mapping[str, HiddenEffect] = {
    "magnus": HiddenEffect(0.005, 0.4, _unlike("magnus")),
    "patchy": HiddenEffect(0.05, 0.4, _unlike("patchy")),
    "gust": HiddenEffect(0.05, 3.0, _unlike("gust")),
    "bent": HiddenEffect(0.02, 0.6, _unlike("bent")),
    "slosh": HiddenEffect(0.05, 0.6, _unlike("slosh")),
    "bump": HiddenEffect(5e-4, 0.015, _unlike("bump")),
}
"""Effects outside the catalogue: a force sideways to a spinning body, friction that depends on the place, wind that comes and
goes, a nonlinear scale of the tracker, a mass that swings inside the body, a wavy surface."""

UNKNOWN_OF = {"development": ("magnus", "patchy"), "scored": ("gust", "bent", "slosh", "bump")}
"""Names of the effects outside the catalogue by split; none is in both."""

_TWINS = (("object_mass", "steady_force"), ("gravity_scale", "tracking_rate"))
"""Pairs of effects with the same equation of motion. Half the mass doubles the acceleration by a steady force, as twice the
force does. If contacts are hard and nothing else sets a time scale, a slow clock is equivalent to a weak gravity."""

_APART = (("contact_softness", "restitution"),)
"""Pairs of effects that a contact has only one of: a soft contact gives back what its spring and damper do."""


def body_twins(names: tuple[str, ...]) -> list[list[str]]:
    """Return the other sets of effects with the same equation of motion as the hidden ones."""
    sets: set[frozenset[str]] = {frozenset()}
    for name in names:
        alike = {name}.union(*(group for group in _TWINS if name in group))
        sets = {done | {option} for done in sets for option in alike}
    return [sorted(found) for found in sorted(sets - {frozenset(names)}, key=sorted) if len(found) == len(names)]


@dataclass(frozen=True)
class BodyCase:
    """A sealed truth and its throws.

    Args:
        hidden: Sizes of the hidden effects, by name.
        parameters: Parameters that a perfect diagnosis would give, by name; empty for laws outside the catalogue.
        units: Visibility of the most visible effect; see `gsbridge.gap.benchmark.body_visibility`.
        model: Content of the model file.
        files: Contents of the files that the model names, by name.
        throws: Throws by role.
        settings: Main settings of the scene, for the truth's file.
    """

    hidden: Mapping[str, float]
    parameters: Mapping[str, Parameters]
    units: float
    model: Mapping[str, Any]
    files: Mapping[str, str]
    throws: Mapping[str, Throws]
    settings: Mapping[str, Any]


def draw_shown_case(names: tuple[str, ...], units: float, seed: int, pool: Sequence[str]) -> BodyCase:
    """Draw a case whose hidden effects show as wanted; replace effects that show in no scene.

    Args:
        names: Effects to hide first, of `KNOWN` or `STRANGE`.
        units: Visibility of each; see `gsbridge.gap.benchmark.body_visibility`.
        seed: Seed of everything.
        pool: Effects that may be hidden instead.

    Raises:
        InputError: No effect shows as wanted.
    """
    rng, failed = np.random.default_rng([seed, 1]), set[str]()
    for _ in range(_REDRAWS):
        lost = ""
        for scene_seed in (seed, *(int(value) for value in rng.integers(2**31, size=_SCENES - 1))):
            try:
                return draw_body_case(names, units, scene_seed)
            except NotShownError as error:
                logger.info("%s", error)
                lost = error.name
        failed.add(lost)
        left = [name for name in pool if name not in failed and name not in names]
        if not left:
            break
        names = tuple(sorted([*(name for name in names if name != lost), str(rng.choice(left))]))
    raise InputError("benchmark", f"nothing could be hidden; {', '.join(sorted(failed))} do not show", "Take another seed")


def draw_body_case(names: tuple[str, ...], units: float, seed: int, count: int = THROWS) -> BodyCase:
    """Draw a body and hide something in it.

    Args:
        names: Effects to hide, of `KNOWN` or `STRANGE`.
        units: Visibility of each by itself; see `gsbridge.gap.benchmark.body_visibility`.
        seed: Seed of everything.
        count: Number of throws of each role.

    Raises:
        NotShownError: An effect shows as wanted at no size, all together show much less, two have the same equation, or a
            contact cannot have both.
    """
    if any(len({*names}.intersection(group)) > 1 for group in _TWINS):
        raise NotShownError(names[-1], f"{' and '.join(names)} are one equation, and would hide as one of them")
    if any({*group} <= {*names} for group in _APART):
        raise NotShownError(names[-1], f"a contact has either of {' and '.join(names)}, not both")
    rng = np.random.default_rng(seed)
    entries = {name: KNOWN.get(name) or STRANGE[name] for name in names}
    shapes = [shape for shape in ("box", "ball") if all(shape in entry.shapes for entry in entries.values())]
    bare = _drawn_scene(str(rng.choice(shapes)), names, rng)
    ways = {name: rng.normal(size=3) for name in names}
    signs = {name: float(rng.choice((-1.0, 1.0))) if entry.signed else 1.0 for name, entry in entries.items()}
    seeds = [int(value) for value in rng.integers(2**31, size=4)]
    model, scene, hidden, parameters, found = _model(bare), bare, {}, {}, 0.0
    files = {} if "urdf" not in model else {URDF: _ball(bare.edges[0], bare.mass)}
    seen = BodyVisibility(model, files, bare, THROWS, seeds[3])
    for name, entry in entries.items():

        def put(on: ThrowScene, size: float, name: str = name, entry: HiddenEffect = entry) -> tuple[ThrowScene, Parameters]:
            return entry.hide(on, signs[name] * size, ways[name])

        size, shown = _sized(entry, lambda at, put=put: seen.units(put(bare, at)[0]), units)  # type: ignore[misc]
        if not 1.0 / _FAR < shown / units < _FAR:
            raise NotShownError(name, f"{name} shows {shown:.2g} units in a {bare.shape} where {units:.2g} are wanted")
        scene, parameters[name] = put(scene, size)
        hidden[name] = signs[name] * size
        found = max(found, shown)
    parameters |= _beside_others(scene, names)
    if len(names) > 1 and seen.units(scene) < _TOGETHER * units:
        raise NotShownError(names[-1], f"{' and '.join(names)} hardly show together in a {bare.shape}")
    try:
        throws = {role: throw_box(scene, count, number) for role, number in zip(ROLES, seeds[:3], strict=True)}
    except RunawayError as error:
        if not names:
            raise InputError("benchmark", f"with nothing hidden, {error}", "Take another seed") from error
        raise NotShownError(names[-1], f"with {' and '.join(names)}, {error}") from error
    settings = {"shape": bare.shape, "edges": list(bare.edges), "mass": bare.mass, "slowness": bare.slowness}
    return BodyCase(hidden, parameters, found, model, files, throws, settings)


def _beside_others(scene: ThrowScene, names: Sequence[str]) -> dict[str, Parameters]:
    """Return the true parameters that another hidden effect changes.

    Args:
        scene: The scene with all hidden effects.
        names: Names of the hidden effects.
    """
    out: dict[str, Parameters] = {}
    if "object_com" in names and "linear_damping" in names:
        # This damping acts beside the shifted centre of mass, unlike the catalogue's law, so it has no true parameter.
        out["linear_damping"] = {}
    if "tracking_lag" in names and scene.lag is not None:
        # The catalogue counts the lag in seconds of the log's clock.
        out["tracking_lag"] = {"time": scene.lag * scene.clock}
    return out


def _drawn_scene(shape: str, names: tuple[str, ...], rng: np.random.Generator) -> ThrowScene:
    """Draw a scene without any hidden effect."""
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
        # In free flight and sliding the mass has no influence, so that a force is needed.
        scene = replace(scene, force=tuple(scene.mass * rng.uniform(0.5, 1.5) * np.array([1.0, 0.5])))
    return scene


def _sized(entry: HiddenEffect, shown: Callable[[float], float], units: float) -> tuple[float, float]:
    """Return the size in an effect's range whose visibility is nearest to the wanted one, and that visibility, in units."""
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
    """Return the content of the model file: the scene without the hidden effects."""
    model: dict[str, Any] = {"controller": {"mode": "body"}, "contact": {"friction": scene.friction}}
    if scene.shape == "box":
        model |= {"box": list(scene.edges), "mass": scene.mass}
    else:
        model |= {"urdf": URDF}
    if any(scene.force):
        values = {axis: float(value) for axis, value in zip("xy", scene.force, strict=True)}
        model["effects"] = [{"name": "steady_force", "parameters": values}]
    return model


def write_body_case(folder: Path, case: BodyCase) -> dict[str, str]:
    """Write the files that a user would provide.

    Args:
        folder: Folder for the case file, the model and the throws.
        case: The case.

    Returns:
        SHA-256 of the throws' files by role.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in case.files.items():
        (folder / name).write_text(text, encoding="utf-8")
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
