"""Model of a mechanism: a URDF or an MJCF, a controller that drives it, and effects that were added."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.sliding import SLIDING_EFFECTS
from gsbridge.effects.registry import Applied, read_effects, refuse_doubles
from gsbridge.errors import InputError
from gsbridge.gap.formats.yaml_file import plain_number, read_yaml
from gsbridge.gap.joints.mechanism.description import description_bytes, read_mechanism_description, stated_besides
from gsbridge.geometry import Array
from gsbridge.reading import refusing

MODES = ("torque", "pd", "position", "free")
"""How a mechanism is driven: by logged torques; by a controller of position and speed errors; by a servo of which only the
bandwidth is known; or not at all."""

FASTEST = 1e5
"""Highest rate of the control loop and of the physics, and highest bandwidth of a servo, Hz: more would take too many steps."""

_STRONGEST = 30.0
"""Largest gravity that is accepted, m/s2: more than on any planet with solid ground."""

_WHOLE = 1e-4
"""Largest error of the ratio of both rates, as a share, for a rate that was rounded when it was written down."""

_LARGEST = 1e12
"""Largest gain, friction, inertia and finite limit that is accepted, SI units: no real one comes near it."""


@dataclass(frozen=True)
class ControllerModel:
    """How the joints are driven.

    Args:
        mode: One of `MODES`.
        rate: Rate of the control loop, Hz; the physics take a whole number of steps per loop.
        stiffness: Torque per position error, N m/rad (mode `pd`). [N].
        damping: Torque per speed error, N m s/rad (mode `pd`). [N].
        bandwidth: Bandwidth of the servo, Hz (mode `position`).
        gravity_compensation: Share of the weight that the controller compensates.
        velocity_reference: Target speed of the controller if the record commands no speeds: `zero`, or the `derivative` of the
            commanded position.
        torque_limit: Largest torque of each joint, N m; infinite where there is none. [N].
        between: What reaches the controller between two logged commands: `hold` (the last one) or `line` (a straight line).
        observes: Whether this is no controller of the mechanism, but an observer that pulls replays to the measured motion.
    """

    mode: str
    rate: float
    stiffness: Array
    damping: Array
    bandwidth: float
    gravity_compensation: float
    velocity_reference: str
    torque_limit: Array
    between: str = "hold"
    observes: bool = False

    @property
    def closed_loop(self) -> bool:
        """Whether position errors are fed back, so that a replay stays near the record by itself."""
        return self.mode in ("pd", "position")

    @property
    def repeatable(self) -> bool:
        """Whether the mechanism's own controller leads two records of one command to one motion, so that repeats tell noise."""
        return self.closed_loop and not self.observes


@dataclass(frozen=True)
class MechanismModel:
    """A mechanism as it is simulated.

    Args:
        urdf: Description of the mechanism, a URDF or an MJCF.
        joints: Driven and logged joints, in the order of the records. All others are held.
        gravity: Acceleration in the base frame, m/s2. [3].
        controller: How the joints are driven.
        viscous: Known viscous friction of each joint, N m s/rad. [N].
        coulomb: Known Coulomb friction of each joint, N m. [N].
        armature: Known inertia of rotor and gear seen from the joint, kg m2. [N].
        limits: Lower and upper limits, rad; infinite where the description has none. [N, 2].
        physics_rate: Simulation steps per second.
        effects: Effects that were added to the model.
        centred: Whether positions move with the mean of a step's two speeds instead of the new speed.
        tool: Link whose place the `tool` columns log; empty for none.
        sliding: Joints that slide instead of turning; their units have m and N wherever others have rad and N m.
    """

    urdf: Path
    joints: tuple[str, ...]
    gravity: Array
    controller: ControllerModel
    viscous: Array
    coulomb: Array
    armature: Array
    limits: Array
    physics_rate: float
    effects: tuple[Applied, ...] = ()
    centred: bool = True
    tool: str = ""
    sliding: tuple[str, ...] = ()

    @property
    def time_step(self) -> float:
        """Step of the physics, s."""
        return 1.0 / self.physics_rate

    def digest(self) -> str:
        """Return the SHA-256 of everything that a simulation depends on."""
        c = self.controller
        figures = [self.joints, self.gravity, c.mode, c.rate, c.stiffness, c.damping, c.bandwidth, c.gravity_compensation]
        figures += [
            c.velocity_reference,
            c.torque_limit,
            c.between,
            self.viscous,
            self.coulomb,
            self.armature,
            self.physics_rate,
            self.centred,
        ]
        figures += [[effect.record() for effect in self.effects]]
        figures += [self.tool] if self.tool else []
        figures += ["observes"] if c.observes else []
        text = json.dumps([item.tolist() if isinstance(item, np.ndarray) else item for item in figures])
        return hashlib.sha256(description_bytes(self.urdf) + text.encode()).hexdigest()


def read_mechanism_model(path: str | Path) -> MechanismModel:
    """Read a model of a mechanism: YAML with `urdf`, `joints`, `controller` and so on; see docs/gap.md.

    Raises:
        InputError: The file or the URDF cannot be read, a key is unknown or missing, or joints do not match.
    """
    path = Path(path)
    with refusing(path, "the model cannot be used", "Correct it after docs/gap.md"):
        return parse_mechanism_model(read_yaml(path, "model", "docs/gap.md"), path.parent, path)


_KEYS = (
    "urdf",
    "mjcf",
    "joints",
    "gravity",
    "controller",
    "viscous",
    "coulomb",
    "armature",
    "physics_rate",
    "scheme",
    "tool",
    "effects",
    "evidence",
)
_CONTROL = (
    "mode",
    "rate",
    "stiffness",
    "damping",
    "bandwidth",
    "gravity_compensation",
    "velocity_reference",
    "torque_limit",
    "between",
)


def parse_mechanism_model(content: Any, folder: Path, source: str | Path = "model") -> MechanismModel:
    """Make a model of a mechanism from the content of its file.

    Args:
        content: Content of the file.
        folder: Folder to which the path of the URDF or MJCF is relative.
        source: File, for messages.

    Raises:
        InputError: As `read_mechanism_model`.
    """
    described = "mjcf" if isinstance(content, Mapping) and "mjcf" in content else "urdf"
    _check_keys(content, _KEYS, (described, "controller"), source, "")
    if "urdf" in content and "mjcf" in content:
        raise InputError(source, "it names both a URDF and an MJCF", "Keep one of them")
    # A key without a value counts as absent.
    content = {key: value for key, value in content.items() if value is not None or key == described}
    _check_keys(content.get("controller", {}), _CONTROL, ("mode",), source, "controller.")
    given = {key: value for key, value in content["controller"].items() if value is not None}
    mode = given["mode"]
    if mode not in MODES:
        raise InputError(source, f"controller.mode is '{mode}'", f"Use one of {', '.join(MODES)}")
    if not isinstance(content[described], str):
        raise InputError(source, f"'{described}' is {content[described]!r}", f"Write '{described}: FILE'")
    urdf = folder / content[described]
    description = read_mechanism_description(urdf, described, source)
    besides = stated_besides(description)
    # Keep the file's order, which is that of the records if the model names no joints.
    by_name = {joint.name: joint for joint in description.joints if joint.kind in ("revolute", "continuous", "prismatic")}
    moving = {name: by_name[name] for name in description.origins if name in by_name}
    named = content.get("joints") or [name for name, joint in moving.items() if joint.follows is None]
    if not isinstance(named, list):
        raise InputError(source, f"'joints' is {named!r}", f"Write a list, 'joints: [{', '.join(moving)}]'")
    # A description may well call its joints 1, 2, 3.
    joints = tuple(str(name) if isinstance(name, int) else name for name in named)
    unknown = [name for name in joints if name not in moving]
    if unknown:
        raise InputError(
            source, f"the {described.upper()} has no moving joint '{unknown[0]}'", f"It has: {', '.join(moving) or 'none'}"
        )
    if not joints:
        raise InputError(urdf, f"the {described.upper()} has no moving joint", "Give that of a mechanism")
    twice = next((name for name in joints if joints.count(name) > 1), None)
    if twice is not None:
        raise InputError(source, f"'joints' names '{twice}' twice", "Name each joint once, in the order of the records")
    count = len(joints)

    def row(values: Any, key: str, *, endless: bool = False) -> Array:
        if isinstance(values, Mapping):
            raise InputError(source, f"'{key}' is given by joint", f"Give a list in the order of {', '.join(joints)}")
        values = [values] * count if values is None or np.isscalar(values) else values
        if len(values) != count:
            raise InputError(
                source, f"'{key}' has {len(values)} numbers for {count} joints ({', '.join(joints)})",
                "Give one per joint, or one for all; name those that are driven under 'joints'",
            )  # fmt: skip
        # Only a limit may be infinite; null means the same.
        values = [np.inf if value is None and endless else value for value in values]
        out = np.array([_number(value, key, source, endless) for value in values])
        if endless and (out == 0).any():
            raise InputError(source, f"'{key}' is zero, so that the motor does nothing", "Leave it out where there is no limit")
        if (out < 0).any():
            raise InputError(source, f"'{key}' is below zero", "Give it without a sign; nothing real is so")
        if (out[np.isfinite(out)] > _LARGEST).any():
            raise InputError(source, f"'{key}' is {out[np.isfinite(out)].max():g}", f"Give at most {_LARGEST:g}, in SI units")
        return out

    def one(key: str, default: float, low: float, high: float) -> float:
        section = given if key in _CONTROL else content
        value = _number(section.get(key, default), key, source)
        if not low <= value <= high:
            span = f"above zero, {high:g} at most" if low > 0 else f"from {low:g} to {high:g}"
            raise InputError(source, f"'{key}' is {value:g}", f"Give a number {span}")
        return value

    rate, physics = one("rate", 1000.0, 1e-3, FASTEST), one("physics_rate", 1000.0, 1e-3, FASTEST)
    whole = round(physics / rate)
    if whole < 1 or abs(physics / rate - whole) > _WHOLE * whole:
        raise InputError(
            source, f"physics_rate {physics:g} is no multiple of controller.rate {rate:g}",
            f"Write 'physics_rate: {rate * np.ceil(1000.0 / rate):.9g}', for example",
        )  # fmt: skip
    # A loop of 15 ms is written as 66.667 Hz; the steps of the physics decide.
    rate = physics / whole
    for key in {"pd": ("stiffness", "damping"), "position": ("bandwidth",)}.get(mode, ()):
        if key not in given:
            raise InputError(source, f"controller.{key} is missing, which mode {mode} needs", "State it; see docs/gap.md")
    scheme = content.get("scheme", "centred")
    if scheme not in ("centred", "euler"):
        raise InputError(source, f"scheme is '{scheme}'", "Use centred, or euler for the engines' own")
    limits = np.array([(moving[name].lower, moving[name].upper) for name in joints]).reshape(count, 2)
    controller = ControllerModel(
        mode,
        rate,
        row(given.get("stiffness", 0.0), "controller.stiffness"),
        row(given.get("damping", 0.0), "controller.damping"),
        one("bandwidth", 1.0, 1e-3, FASTEST) if mode == "position" else 0.0,
        one("gravity_compensation", 0.0, 0.0, 2.0),
        given.get("velocity_reference", "zero"),
        row(given.get("torque_limit", np.inf), "controller.torque_limit", endless=True),
        given.get("between", "hold"),
    )
    if controller.between not in ("hold", "line"):
        raise InputError(source, f"controller.between is '{controller.between}'", "Use hold or line")
    if controller.velocity_reference not in ("zero", "derivative"):
        raise InputError(source, f"velocity_reference is '{controller.velocity_reference}'", "Use zero or derivative")
    tool = content.get("tool") or ""
    if tool and tool not in description.links:
        raise InputError(source, f"the {described.upper()} has no link '{tool}'", f"It has: {', '.join(description.links)}")
    sliding = tuple(name for name in joints if moving[name].kind == "prismatic")
    effects = _read_effects(content.get("effects") or [], source, joints, sliding)
    usual = [0.0, 0.0, -9.81] if besides.gravity is None else besides.gravity
    stated = content.get("gravity", usual)
    if np.shape(stated) != (3,):
        raise InputError(source, f"'gravity' is {stated!r}", "Give three numbers, m/s2: [0, 0, -9.81]")
    gravity = np.array([_number(value, "gravity", source) for value in stated])
    if np.linalg.norm(gravity) > _STRONGEST:
        raise InputError(source, f"'gravity' is {stated!r}", f"Give three numbers, m/s2, {_STRONGEST:g} at most: [0, 0, -9.81]")
    rotors = [besides.armature.get(name, 0.0) for name in joints]
    own = [moving[name].damping for name in joints], [moving[name].friction for name in joints]
    return MechanismModel(
        urdf, joints, gravity, controller,
        row(content.get("viscous", own[0]), "viscous"), row(content.get("coulomb", own[1]), "coulomb"),
        row(content.get("armature", rotors), "armature"), limits, physics, effects,
        scheme == "centred", tool, sliding,
    )  # fmt: skip


def _number(value: Any, key: str, source: str | Path, endless: bool = False) -> float:
    """Read a finite number of a model, or one that may be infinite if `endless`.

    Raises:
        InputError: The value is no such number.
    """
    out = plain_number(value)
    if out is None:
        raise InputError(source, f"'{key}' is {value!r}, which is no number", "Give a number in SI units, without its unit")
    if np.isnan(out) or not (endless or np.isfinite(out)):
        raise InputError(source, f"'{key}' is not finite", "Give a number")
    return out


def _read_effects(items: Any, source: str | Path, joints: tuple[str, ...], sliding: tuple[str, ...]) -> tuple[Applied, ...]:
    """Read and check the list of effects; figures at joints that slide are in metres and newtons.

    Raises:
        InputError: As `gsbridge.effects.registry.read_effects`.
    """
    if not isinstance(items, list):
        return read_effects(items, source, JOINT_EFFECTS, joints=joints)
    out: tuple[Applied, ...] = ()
    for item in items:
        slides = isinstance(item, Mapping) and item.get("joint") in sliding
        out += read_effects([item], source, SLIDING_EFFECTS if slides else JOINT_EFFECTS, joints=joints)
    refuse_doubles(out, source, JOINT_EFFECTS)
    return out


def _check_keys(content: Any, known: tuple[str, ...], needed: tuple[str, ...], source: str | Path, prefix: str) -> None:
    """Refuse a section that is no mapping, lacks a key or has an unknown one."""
    if not isinstance(content, Mapping):
        raise InputError(source, f"'{prefix.rstrip('.') or 'the model'}' is no section", "Correct it after docs/gap.md")
    for key in content:
        if key not in known:
            elsewhere = "It belongs to 'controller'. " if not prefix and key in _CONTROL else ""
            elsewhere = "It belongs beside 'controller'. " if prefix and key in _KEYS else elsewhere
            raise InputError(source, f"the key '{prefix}{key}' is unknown", f"{elsewhere}Use only: {', '.join(known)}")
    for key in needed:
        if key not in content:
            raise InputError(source, f"the key '{prefix}{key}' is missing", "See docs/gap.md")
