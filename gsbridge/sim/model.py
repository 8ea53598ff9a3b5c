"""The simulation model: every parameter of simulated physics and camera, read strictly from one YAML file.

Nothing has a default in code. A key that is missing, unknown or out of range is refused, so a model file always says in full
what was simulated. PyBullet's own defaults (link damping 0.04, joint damping 0.5) never act: each has a key here or
is set to zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied, checked_number, effect_of, read_effects
from gsbridge.errors import InputError
from gsbridge.reading import load_yaml, refusing

EFFECTS = (JOINT_EFFECTS, BODY_EFFECTS, IMAGE_EFFECTS)
"""Registries of effects. A model may hold all of them, except those that state a `reason` why it may not."""

ARM = 7
"""Joints of the arm."""

Seven = tuple[float, float, float, float, float, float, float]


class Range(NamedTuple):
    """Allowed content of a key of the model file: unit, smallest and largest value, and length of a list (0: no list)."""

    unit: str
    low: float
    high: float
    length: int = 0


@dataclass(frozen=True)
class Timing:
    """Clock of physics and control.

    Args:
        physics_hz: Steps of the engine, and of the joint controller, per second.
        control_hz: Commands per second.
    """

    physics_hz: Annotated[float, Range("Hz", 500, 10_000)]
    control_hz: Annotated[float, Range("Hz", 1, 200)]


@dataclass(frozen=True)
class Arm:
    """Joint controller and drives of the arm; lists run from the base to the hand.

    Args:
        stiffness: Torque per position error, N m/rad.
        damping: Torque per speed error, N m s/rad.
        armature: Inertia of rotor and gear about the joint, kg m2.
        viscous_friction: Torque lost per speed, N m s/rad. The engine's joint damping is zero, this takes its place.
        gravity_compensation: Share of the arm's own weight that the controller carries.
        delay: Time that a command takes to the joint controller, s; also to the gripper's.
    """

    stiffness: Annotated[Seven, Range("N m/rad", 0, 50_000, ARM)]
    damping: Annotated[Seven, Range("N m s/rad", 0, 2_000, ARM)]
    armature: Annotated[Seven, Range("kg m2", 0, 5, ARM)]
    viscous_friction: Annotated[Seven, Range("N m s/rad", 0, 50, ARM)]
    gravity_compensation: Annotated[float, Range("", 0, 2)]
    delay: Annotated[float, Range("s", 0, 0.5)]


@dataclass(frozen=True)
class Gripper:
    """Drive of the gripper, in terms of the distance of its pads.

    Args:
        force: Largest force of each pad, N.
        speed: Speed at which the pads approach each other, m/s.
        stiffness: Force per error of the opening, N/m.
        damping: Force per speed of the opening, N s/m.
    """

    force: Annotated[float, Range("N", 1, 500)]
    speed: Annotated[float, Range("m/s", 0.001, 2)]
    stiffness: Annotated[float, Range("N/m", 0, 20_000)]
    damping: Annotated[float, Range("N s/m", 0, 60)]


@dataclass(frozen=True)
class Surface:
    """Contact of the object with one partner, as a property of the pair.

    Args:
        friction: Lateral coefficient.
        rolling_friction: Rolling resistance: lever of the normal force, m.
        spinning_friction: Resistance to spinning about the normal: lever, m.
        restitution: Share of the impact's speed that the contact gives back; a soft contact, which takes longer than a
            step, gives back less.
    """

    friction: Annotated[float, Range("", 0, 5)]
    rolling_friction: Annotated[float, Range("m", 0, 0.1)]
    spinning_friction: Annotated[float, Range("m", 0, 0.1)]
    restitution: Annotated[float, Range("", 0, 1)]


@dataclass(frozen=True)
class Contact:
    """Contacts of the object.

    Args:
        table: Contact with the table.
        plate: Contact with the plate or other relief of the background.
        gripper: Contact with pads and other links of the robot.
        stiffness: Stiffness of each contact point, N/m.
        damping: Damping of each contact point, N s/m.
    """

    table: Surface
    plate: Surface
    gripper: Surface
    stiffness: Annotated[float, Range("N/m", 1_000, 1e8)]
    damping: Annotated[float, Range("N s/m", 0, 1e5)]


@dataclass(frozen=True)
class Object:
    """The body that is handled; its mass properties come from its asset.

    Args:
        mass: Factor on the asset's mass and inertia.
        linear_damping: d of the loss `v' = -d v`, 1/s. Bullet's default of 0.04 is wrong for a solid in air.
        angular_damping: d of the same loss for the spin, 1/s.
    """

    mass: Annotated[float, Range("", 0.01, 100)]
    linear_damping: Annotated[float, Range("1/s", 0, 10)]
    angular_damping: Annotated[float, Range("1/s", 0, 10)]


@dataclass(frozen=True)
class CameraModel:
    """Response of the wrist camera to the scene's light.

    Args:
        gain: Factor on linear light.
        red_gain: Further factor on red: white balance.
        blue_gain: Further factor on blue.
        gamma: Exponent on the encoded value, above 1 darker.
        black_level: Added to the encoded value, in shares of full scale.
        shot_noise: Variance of linear light per linear light.
        read_noise: Standard deviation of linear light in the dark.
    """

    gain: Annotated[float, Range("", 0.05, 20)]
    red_gain: Annotated[float, Range("", 0.2, 5)]
    blue_gain: Annotated[float, Range("", 0.2, 5)]
    gamma: Annotated[float, Range("", 0.3, 3)]
    black_level: Annotated[float, Range("", -0.3, 0.3)]
    shot_noise: Annotated[float, Range("", 0, 0.1)]
    read_noise: Annotated[float, Range("", 0, 0.3)]


@dataclass(frozen=True)
class Model:
    """The whole model.

    Args:
        gravity: m/s2, downwards.
        timing: Clock.
        arm: Controller and drives.
        gripper: Drive of the gripper.
        contact: Contacts of the object.
        object: The handled body.
        camera: The wrist camera.
        effects: Effects that are added to the nominal model.
    """

    gravity: Annotated[float, Range("m/s2", 0, 30)]
    timing: Timing
    arm: Arm
    gripper: Gripper
    contact: Contact
    object: Object
    camera: CameraModel
    effects: tuple[Applied, ...] = ()

    def effects_on(self, *scopes: str) -> tuple[Applied, ...]:
        """Effects that act on `joint`, `mechanism`, `body` or `camera`, in their order."""
        return tuple(applied for applied in self.effects if effect_of(applied, *EFFECTS).scope in scopes)

    @property
    def substeps(self) -> int:
        """Physics steps per control period."""
        return round(self.timing.physics_hz / self.timing.control_hz)

    @property
    def time_step(self) -> float:
        """Step of the physics, s."""
        return 1.0 / self.timing.physics_hz

    @property
    def period(self) -> float:
        """Time between two commands, s."""
        return self.substeps * self.time_step


def read_model(path: str | Path) -> Model:
    """Read a model file.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing or damaged, a key is unknown or missing, a value is no number or out of range.
    """
    with refusing(path, "the model cannot be used", "Correct it after models/nominal.yaml"):
        return parse_model(load_yaml(path, "model file", "Check the path; models/nominal.yaml is the nominal one"), str(path))


def parse_model(content: Any, source: str = "model") -> Model:
    """A model from the content of a model file.

    Args:
        content: Nested mappings as in `models/nominal.yaml`.
        source: Where it comes from, for messages.

    Raises:
        InputError: As `read_model`.
    """
    if not isinstance(content, Mapping) or "effects" not in content:
        raise InputError(source, "the model has no list 'effects'", "Write effects: [] for the nominal model")
    effects = read_effects(content["effects"], source, *EFFECTS)
    for applied in effects:
        effect = effect_of(applied, *EFFECTS)
        if not effect.amendable:
            where = f" of joint '{applied.joint}'" if applied.joint else ""
            raise InputError(source, f"the simulation cannot play '{effect.name}'{where}: {effect.reason}", effect.instead)
    model = _section(Model, {key: value for key, value in content.items() if key != "effects"}, "", source, effects=effects)
    ratio = model.timing.physics_hz / model.timing.control_hz
    if abs(ratio - round(ratio)) > 1e-9:
        raise InputError(
            source,
            "timing.physics_hz is no multiple of timing.control_hz",
            "Physics takes whole steps per command, e.g. 1000 / 20",
        )
    return model


def _section(kind: type, content: Any, prefix: str, source: str, **known: Any) -> Any:
    """Fill one dataclass from a mapping, key by key."""
    if not isinstance(content, Mapping):
        raise InputError(source, f"'{prefix.rstrip('.')}' is no section", "Correct it after models/nominal.yaml")
    hints = get_type_hints(kind, include_extras=True)
    wanted = [item for item in fields(kind) if item.name not in known]
    names = [item.name for item in wanted]
    for key in content:
        if key not in names:
            raise InputError(source, f"the key '{prefix}{key}' is unknown", f"Use only: {', '.join(names)}")
    values = dict(known)
    for item in wanted:
        key = prefix + item.name
        if item.name not in content:
            raise InputError(source, f"the key '{key}' is missing", "A model states every value; see models/nominal.yaml")
        value, kind_of = content[item.name], hints[item.name]
        if isinstance(kind_of, type) and is_dataclass(kind_of):
            values[item.name] = _section(kind_of, value, key + ".", source)
            continue
        unit, low, high, length = kind_of.__metadata__[0]
        if not length:
            values[item.name] = checked_number(value, low, high, key, unit, source)
            continue
        if not isinstance(value, list) or len(value) != length:
            raise InputError(source, f"'{key}' is no list of {length} numbers", "Give one number per joint, base first")
        values[item.name] = tuple(
            checked_number(number, low, high, f"{key}[{i}]", unit, source) for i, number in enumerate(value)
        )
    return kind(**values)
