"""Hidden parameters of the mirror, drawn by seed from stated ranges; further worlds set some of them by name.

Code that learns or diagnoses must never read a `Hidden`; apart from the mirror itself, only scores do.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.errors import InputError

Value = float | tuple[float, ...]
Triple = tuple[float, float, float]

_ONE_DEGREE = math.radians(1.0)


@dataclass(frozen=True)
class Hidden:
    """Hidden parameters of one world; the defaults are those of the nominal world.

    Args:
        mass: Factor on the object's mass.
        friction_table: Sliding friction of the object on the table.
        friction_plate: Sliding friction of the object on the plate.
        friction_pad: Sliding friction of the rubber pads.
        friction_spin: Torsional friction of every contact of the object, m.
        contact_time: Time constant with which a contact pushes bodies apart, s.
        stiffness: Factor on the servo gain of each arm joint.
        damping: Factor on the servo damping of each arm joint.
        inertia: Factor on the rotor inertia of each arm joint.
        joint_friction: Coulomb friction as a share of the joint's largest torque.
        grip_force: Force with which each pad presses on a gripped object, N.
        latency: Time from a command to its effect, s.
        encoder_noise: Standard deviation of measured joint angles, rad.
        torque_noise: Standard deviation of measured joint torques, N m.
        camera_shift: Shift of the wrist camera from its nominal position, along the flange's axes, m.
        camera_turn: Turn of the camera from its nominal axes, rotation vector in the flange frame, rad.
        table_shift: Shift of the table from its nominal position, along the base's axes, m.
        table_turn: Turn of the table from its nominal axes, rotation vector in the base frame, rad.
        light_turn: Turn of the lamp about the vertical through the middle of the table, rad.
        light_rise: Change of the lamp's height angle, rad.
        light_power: Factor on all light.
        light_cast: Factors on red, green and blue light.
        robot_shade: Factors on the brightness of the arm's covers, its coloured covers, and the hand.
        robot_tint: Factors on red, green and blue of the robot.
        full_well: Number of electrons that saturates a pixel; the shot noise is the square root of the number of electrons.
        read_noise: Standard deviation of the readout noise in linear light, as a share of saturation.
        exposure: Factor of the camera on the light, before saturation.
        tint: Factors of the camera on the encoded red, green and blue. Never drawn; a world may set it.
        pedestal: Offset that the camera adds to the encoded value, 0..1. Never drawn; a world may set it.
        vignette: Share of the light that the lens loses at the picture's corners, below 1. Never drawn; a world may set it.

    The following parameters are drawn by severity alone (`gsbridge.reality.world.severity`); docs/mirror.md explains them:

        encoder_offset: Measured angle of each joint minus its true angle, rad.
        link_offset: Shift of each of the arm's seven joints from its nominal position, along the axes of the link before it:
            x, y, z of the first joint, then of the second, and so on, m.
        gravity_error: Share of the robot's weight by which gravity compensation is too strong.
        latency_jitter: Largest delay of a command beyond `latency`, s.
        lost_commands: Share of commands that never arrive.
        object_com: Offset of the centre of mass along the object's x and y, as a share of the object's width.
        exposure_time: Time for which each row of a picture is exposed, s.
        readout: Time between the first row of a picture and its last, s.
        auto_exposure, auto_balance: Share of a picture's difference from grey (in brightness, and in colour) that the camera
            corrects.
        distortion: Radial distortion k1 beyond what is calibrated.
        focal_error: Share by which the focal length is longer than calibrated.
        compression: 100 minus the JPEG quality of the pictures; 0 for no compression.
        dropped_frames: Share of pictures that are replaced by the one delivered before.
        late_frames: Share of pictures that show the state one step earlier.
        light_hue: Natural logarithm of the ratio of red to green light, and of that of green to blue.
        lamp_dim: Share of the lamp's light that is missing.
        window: Radiance of a window beside the table, as a share of the lamp's.
        window_heading: Direction of the window from the working area, about the vertical, rad.
        passer: Half the width of a person who passes between table and lamp (or window, if the lamp is out), m; 0 for nobody.
        gloss_object, gloss_plate, gloss_robot, gloss_table: Gloss from 0 (matt) to 1 (wet).
        clutter, cables, decoys: Number of pieces of each kind that lie about.
        clutter_seed: Seed of their shapes and positions.
    """

    mass: float = 1.0
    friction_table: float = 0.6
    friction_plate: float = 0.5
    friction_pad: float = 0.9
    friction_spin: float = 0.003
    contact_time: float = 0.004
    stiffness: tuple[float, ...] = (1.0,) * 7
    damping: tuple[float, ...] = (1.0,) * 7
    inertia: tuple[float, ...] = (1.0,) * 7
    joint_friction: float = 0.002
    grip_force: float = 40.0
    latency: float = 0.0
    encoder_noise: float = 0.0
    torque_noise: float = 0.0
    camera_shift: Triple = (0.0, 0.0, 0.0)
    camera_turn: Triple = (0.0, 0.0, 0.0)
    table_shift: Triple = (0.0, 0.0, 0.0)
    table_turn: Triple = (0.0, 0.0, 0.0)
    light_turn: float = 0.0
    light_rise: float = 0.0
    light_power: float = 1.0
    light_cast: Triple = (1.0, 1.0, 1.0)
    robot_shade: Triple = (1.0, 1.0, 1.0)
    robot_tint: Triple = (1.0, 1.0, 1.0)
    full_well: float = 1e9
    read_noise: float = 0.0
    exposure: float = 1.0
    tint: Triple = (1.0, 1.0, 1.0)
    pedestal: float = 0.0
    vignette: float = 0.0
    encoder_offset: tuple[float, ...] = (0.0,) * 7
    link_offset: tuple[float, ...] = (0.0,) * 21
    gravity_error: float = 0.0
    latency_jitter: float = 0.0
    lost_commands: float = 0.0
    object_com: tuple[float, float] = (0.0, 0.0)
    exposure_time: float = 0.0
    readout: float = 0.0
    auto_exposure: float = 0.0
    auto_balance: float = 0.0
    distortion: float = 0.0
    focal_error: float = 0.0
    compression: float = 0.0
    dropped_frames: float = 0.0
    late_frames: float = 0.0
    light_hue: float = 0.0
    lamp_dim: float = 0.0
    window: float = 0.0
    window_heading: float = 0.0
    passer: float = 0.0
    gloss_object: float = 0.0
    gloss_plate: float = 0.0
    gloss_robot: float = 0.0
    gloss_table: float = 0.0
    clutter: float = 0.0
    cables: float = 0.0
    decoys: float = 0.0
    clutter_seed: float = 0.0

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = _checked(item.name, getattr(self, item.name), item.default)
            object.__setattr__(self, item.name, value)
        if self.vignette >= 1.0:
            raise InputError("hidden parameters", f"'vignette' is {self.vignette!r}", "Give a share below 1")
        for name in _SHARES:
            if getattr(self, name) > 1.0:
                raise InputError("hidden parameters", f"'{name}' is {getattr(self, name)!r}", "Give a share of 1 at most")
        for name in _COUNTS:
            if getattr(self, name) > _MOST_THINGS or getattr(self, name) % 1.0:
                raise InputError(
                    "hidden parameters", f"'{name}' is {getattr(self, name)!r}", f"Give 0 to {_MOST_THINGS} things"
                )
        if self.latency > _LATEST:
            raise InputError("hidden parameters", f"'latency' is {self.latency!r}", f"Give {_LATEST:g} s at most")
        # A late command must still act in its own control period, and a picture must be exposed within one.
        if self.latency_jitter > 0.05 or self.exposure_time + self.readout > 0.05 or self.compression > 99:
            raise InputError(
                "hidden parameters",
                f"'latency_jitter' is {self.latency_jitter!r}, 'exposure_time' {self.exposure_time!r}, 'readout'"
                f" {self.readout!r}, 'compression' {self.compression!r}",
                "Give 0.05 s at most for the first, and for the next two together, and 99 at most for the last",
            )

    @classmethod
    def draw(cls, seed: int, ranges: Ranges | None = None) -> Hidden:
        """Draw the hidden parameters of a seed.

        Each parameter has its own random stream, so a new parameter does not change the values of the others.

        Args:
            seed: Seed of the world.
            ranges: Ranges to draw from; None for the defaults of `Ranges`.
        """
        limits = ranges or Ranges()
        values: dict[str, Value] = {}
        for item in dataclasses.fields(limits):
            low, high = getattr(limits, item.name)
            default = getattr(cls, item.name)
            count = len(default) if isinstance(default, tuple) else 1
            drawn = np.random.default_rng([seed, zlib.crc32(item.name.encode())]).uniform(low, high, count)
            values[item.name] = tuple(drawn.tolist()) if isinstance(default, tuple) else float(drawn[0])
        return cls(**values)  # type: ignore[arg-type]

    def changed(self, changes: Mapping[str, Any], source: str = "hidden parameters") -> Hidden:
        """Return this world with some parameters set to given values; further worlds are made this way.

        Args:
            changes: Values by name; a single number for a parameter of several values sets them all.
            source: Where the names were written, for the error message.

        Raises:
            InputError: A name is unknown, or a value is not possible.
        """
        names = [item.name for item in dataclasses.fields(self)]
        for name in changes:
            if name not in names:
                raise InputError(source, f"the parameter '{name}' is unknown", f"Use one of {', '.join(names)}")
        try:
            return dataclasses.replace(self, **changes)
        except InputError as error:
            raise InputError(source, error.problem, error.remedy) from error


@dataclass(frozen=True)
class Ranges:
    """Lowest and highest value of each drawn hidden parameter; each component is drawn uniformly and independently.

    Mass, latency and the kinds of surprise are those of the specification. The other ranges are as wide as the differences
    between two robots of one type, between rubber, foam and cloth, and between two times of day in one room. Camera and table
    deviate from their nominal poses as far as when a person places them with a ruler; registration measures them.
    """

    mass: tuple[float, float] = (0.8, 1.2)
    friction_table: tuple[float, float] = (0.40, 0.70)
    friction_plate: tuple[float, float] = (0.30, 0.60)
    friction_pad: tuple[float, float] = (0.7, 1.1)
    friction_spin: tuple[float, float] = (0.001, 0.005)
    contact_time: tuple[float, float] = (0.003, 0.006)
    stiffness: tuple[float, float] = (0.8, 1.2)
    damping: tuple[float, float] = (0.85, 1.15)
    inertia: tuple[float, float] = (0.8, 1.2)
    joint_friction: tuple[float, float] = (0.001, 0.006)
    grip_force: tuple[float, float] = (30.0, 50.0)
    latency: tuple[float, float] = (0.0, 0.060)
    encoder_noise: tuple[float, float] = (1e-5, 5e-5)
    torque_noise: tuple[float, float] = (0.05, 0.3)
    camera_shift: tuple[float, float] = (-0.003, 0.003)
    camera_turn: tuple[float, float] = (-_ONE_DEGREE, _ONE_DEGREE)
    table_shift: tuple[float, float] = (-0.010, 0.010)
    table_turn: tuple[float, float] = (-_ONE_DEGREE, _ONE_DEGREE)
    light_turn: tuple[float, float] = (-0.20, 0.20)
    light_rise: tuple[float, float] = (-0.12, 0.12)
    light_power: tuple[float, float] = (0.90, 1.10)
    light_cast: tuple[float, float] = (0.97, 1.03)
    robot_shade: tuple[float, float] = (0.75, 1.15)
    robot_tint: tuple[float, float] = (0.93, 1.07)
    full_well: tuple[float, float] = (6000.0, 15000.0)
    read_noise: tuple[float, float] = (0.0005, 0.0015)
    exposure: tuple[float, float] = (0.96, 1.04)


_MAY_BE_NEGATIVE = (
    "camera_shift", "camera_turn", "table_shift", "table_turn", "light_turn", "light_rise", "pedestal",
    "encoder_offset", "link_offset", "gravity_error", "object_com", "distortion", "focal_error", "light_hue", "window_heading",
)  # fmt: skip
_SHARES = (
    "lost_commands", "auto_exposure", "auto_balance", "dropped_frames", "late_frames", "lamp_dim", "gloss_object",
    "gloss_plate", "gloss_robot", "gloss_table",
)  # fmt: skip
_COUNTS = ("clutter", "cables", "decoys")
_MOST_THINGS = 100
"""Largest number of pieces of one kind that lie about; it is limited because each piece is rendered in every picture."""

_LATEST = 1.0
"""Longest latency of a command, s; it is limited because commands under way are stored for every physics step."""

_MUST_BE_POSITIVE = (
    "mass", "contact_time", "stiffness", "inertia", "grip_force", "light_power", "full_well", "exposure",
)  # fmt: skip


def _checked(name: str, value: Any, default: Any) -> Value:
    """Check one value and convert it to the type of its field.

    Raises:
        InputError: The value is not a number or not finite, or has the wrong count or a sign that is not possible.
    """
    wanted = len(default) if isinstance(default, tuple) else 0
    parts = list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value] * max(wanted, 1)
    numbers = all(isinstance(part, (int, float, np.number)) and not isinstance(part, bool) for part in parts)
    if not numbers or len(parts) != max(wanted, 1) or (not wanted and isinstance(value, (list, tuple, np.ndarray))):
        form = f"{wanted} numbers, or one for all" if wanted else "one number"
        raise InputError("hidden parameters", f"'{name}' is {value!r}", f"Give {form}")
    parts = [float(part) for part in parts]
    low = -math.inf if name in _MAY_BE_NEGATIVE else 0.0
    if not all(math.isfinite(part) and part >= low and (part > 0 or name not in _MUST_BE_POSITIVE) for part in parts):
        raise InputError("hidden parameters", f"'{name}' is {value!r}", "Give a finite value of the right sign")
    return tuple(parts) if wanted else parts[0]
