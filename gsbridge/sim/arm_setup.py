"""Effects of a model on the simulated arm: parameters that they change beforehand, and kernels that simulate them.

The arm is a `gsbridge.effects.joints.base.MechanismSetup`, so that an effect means the same here as in the logs where it was
found. If no effect acts, no kernel of this module runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import effect_of
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.robot.friction import rub
from gsbridge.robot.links import Inertia, joined_inertia
from gsbridge.sim.model import Model

PLAIN = ("stiffness", "damping", "armature", "viscous", "torque_limit", "gravity_share")
"""Parameters of the torque law that every arm has, in the order in which the torque kernel takes them."""

(
    _DRY, _SKEW, _STRIBECK, _STRIBECK_SPEED, _LOAD, _QUADRATIC, _GAIN, _OFFSET, _LAG, _DELAY, _SINE, _COSINE, _WAVES,
    _ENC_OFFSET, _ENC_SCALE, _ECC_SINE, _ECC_COSINE, _SPRING, _SPRING_REST, _SLOWNESS,
) = range(20)  # fmt: skip
_FIGURES = MappingProxyType(
    {
        "coulomb": _DRY, "coulomb_skew": _SKEW, "stribeck": _STRIBECK, "stribeck_speed": _STRIBECK_SPEED,
        "load_friction": _LOAD, "quadratic": _QUADRATIC, "torque_gain": _GAIN, "torque_offset": _OFFSET,
        "torque_lag": _LAG, "torque_delay": _DELAY, "ripple_sine": _SINE, "ripple_cosine": _COSINE, "ripple_waves": _WAVES,
        "encoder_offset": _ENC_OFFSET, "encoder_scale": _ENC_SCALE, "eccentric_sine": _ECC_SINE,
        "eccentric_cosine": _ECC_COSINE, "spring": _SPRING, "spring_rest": _SPRING_REST,
    }
)  # fmt: skip
"""Rows of the parameters that only effects change. Without such an effect they are zero, but for `stribeck_speed` and
`ripple_waves`, which are one."""

ENCODER = ("encoder_offset", "encoder_scale", "eccentric_sine", "eccentric_cosine")
"""Rows that make the encoders report other angles than the true ones."""

_FILTERS = 4
"""Largest number of filters in series on the commands."""

_SLOTS = 256
"""Length of the buffer that delays torques, physics steps; the same for all models, since a kernel is compiled per size."""


class ArmSetup:
    """The simulated arm with the model's effects on joints.

    Args:
        model: The simulation model.
        joints: Names of the arm's joints.
        torque_limit: Largest torque of each joint, N m. [N].
        gravity: Gravitational acceleration in the base frame that the controller assumes, m/s2. [3].

    Attributes:
        law: Parameters of the joints, by name. [N] each.
        gravity: Gravity that really acts, base frame, m/s2. [3].
        delay: Dead time of commands, s.
        filters: Time constants of filters on commands, s.
        slowness: One over the largest speed of each joint's command, s/rad; zero where there is no limit. [N].
        loads: Changes of the mass properties of the link that each joint moves, by joint.

    Raises:
        InputError: An effect names a joint that the arm does not have, or exceeds what the kernels have room for.
    """

    def __init__(self, model: Model, joints: tuple[str, ...], torque_limit: Array, gravity: Array) -> None:
        arm, count = model.arm, len(joints)
        self.joints, self.gravity, self.delay = joints, np.array(gravity, dtype=np.float64), arm.delay
        self.law: dict[str, Array] = {name: np.zeros(count) for name in _FIGURES}
        self.law["stribeck_speed"], self.law["ripple_waves"] = np.ones(count), np.ones(count)
        plain = (arm.stiffness, arm.damping, arm.armature, arm.viscous_friction, torque_limit)
        self.law |= {name: np.array(values, dtype=np.float64) for name, values in zip(PLAIN, plain, strict=False)}
        self.law["gravity_share"] = np.full(count, arm.gravity_compensation)
        self.filters: list[float] = []
        self.slowness = np.zeros(count)
        self.loads: dict[str, list[Callable[[Inertia], Inertia]]] = {}
        for applied in model.effects_on("joint", "mechanism"):
            effect = effect_of(applied, JOINT_EFFECTS, joints=joints)
            effect.apply(self, joints.index(applied.joint) if applied.joint else -1, applied.parameters)
        if len(self.filters) > _FILTERS:
            raise InputError("model", f"commands pass {len(self.filters)} filters", f"Leave at most {_FILTERS} effects 'lag'")
        if (self.law["torque_delay"] > (_SLOTS - 2) * model.time_step).any():
            longest = (_SLOTS - 2) * model.time_step
            raise InputError("model", "the dead time of a drive is too long for the simulation", f"Give at most {longest:g} s")
        self._nominal_gravity = np.array(gravity, dtype=np.float64)

    def delay_commands(self, seconds: float) -> None:
        """Delay the commands to arm and gripper by some more seconds."""
        self.delay += seconds

    @property
    def latency(self) -> float:
        """Time by which a steadily moving command acts late, s: its dead time and the time constants of its filters.

        Dead time and lag of the drives' torque are not part of it: they lie inside the control loop, which feeds the command's
        speed forward, so that a steady motion is not later for them.
        """
        return self.delay + sum(self.filters)

    def smooth_commands(self, seconds: float) -> None:
        """Put a filter of first order before the controller; `seconds` is its time constant."""
        if seconds > 0.0:
            self.filters.append(seconds)

    def limit_commands(self, joint: int, slowness: float) -> None:
        """Limit how fast the command of one joint may change; `slowness` is one over the largest speed, s/rad."""
        self.slowness[joint] = max(self.slowness[joint], slowness)

    def scale_link(self, joint: int, factor: float) -> None:
        """Multiply mass and inertia of the link that a joint moves."""
        changes = self.loads.setdefault(self.joints[joint], [])
        changes.append(lambda body: Inertia(factor * body.mass, body.centre, factor * body.tensor))

    def add_payload(self, mass: float, place: Array) -> None:
        """Fix a point mass (kg) at a place (m) in the frame of the last link. [3]."""
        changes = self.loads.setdefault(self.joints[-1], [])
        changes.append(lambda body: joined_inertia([body, Inertia(mass, np.asarray(place), np.zeros((3, 3)))]))

    def lay_surface(self, height: float, stiffness: float) -> None:
        """Refuse: the simulation has its own table.

        Raises:
            InputError: Always.
        """
        raise InputError("model", "the simulated table stands where the registration has it", "Leave the effect out")

    def restamp_motion(self, taken: Callable[[Array], Array]) -> None:
        """Refuse: the simulated arm keeps no log with clocks of its own.

        Raises:
            InputError: Always.
        """
        raise InputError("model", "the simulated arm keeps no log whose time stamps could err", "Leave the effect out")

    def rows(self) -> Array:
        """Return the parameters of `PLAIN`, as the torque kernel takes them. [6, N]."""
        return np.stack([self.law[name] for name in PLAIN])

    def record(self) -> dict[str, Array]:
        """Fields of the torque kernel's record that effects need."""
        count = len(self.joints)
        figures = np.stack([*(self.law[name] for name in _FIGURES), self.slowness])
        filters = np.zeros(_FILTERS)
        filters[: len(self.filters)] = self.filters
        neutral = figures.copy()
        neutral[[_STRIBECK_SPEED, _WAVES]] = 0.0
        tilt = self.gravity - self._nominal_gravity
        return {
            "plays": np.array([bool(neutral.any() or filters.any() or tilt.any())], dtype=np.int64),
            "figures": figures,
            "filters": filters,
            "tilt": tilt,
            "seen": np.zeros((2, count + 1)),
            "shaped": np.zeros((2, count + 1)),
            "started": np.zeros(2, dtype=np.int64),
            "filtered": np.zeros((_FILTERS, 2, 2, count)),
            "followed": np.zeros(count),
            "asked": np.zeros((_SLOTS, count)),
            "lagged": np.zeros(count),
            "rubs": np.zeros(count),
            "impulse": np.zeros(count),
            "speed": np.zeros(count),
            "inverse": np.zeros((count, count)),
            "columns": np.zeros((count, count + 1)),
        }


@njit(nogil=True)
def sense(a: np.record, measured: Array) -> None:
    """Compute the angles and speeds that the encoders report from the true ones. measured [2, N + 1] -> a.seen [2, N + 1]."""
    figures, seen = a.figures, a.seen
    for i in range(figures.shape[1]):
        angle, rate = measured[0, i], measured[1, i]
        sine, cosine = figures[_ECC_SINE, i], figures[_ECC_COSINE, i]
        seen[0, i] = (1.0 + figures[_ENC_SCALE, i]) * angle + figures[_ENC_OFFSET, i]
        seen[1, i] = (1.0 + figures[_ENC_SCALE, i]) * rate
        seen[0, i] += sine * math.sin(angle) + cosine * math.cos(angle)
        seen[1, i] += (sine * math.cos(angle) - cosine * math.sin(angle)) * rate


@njit(nogil=True)
def shape_commands(a: np.record, step: float) -> None:
    """Pass the arm's set points, positions and speeds, through filters and limit how fast they move.

    Args:
        a: Record of the arm; `shaped` [2, N + 1] is changed.
        step: Step of time, s.
    """
    shaped, filters, filtered, followed = a.shaped, a.filters, a.filtered, a.followed
    count = a.figures.shape[1]
    first = a.started[0] == 0
    a.started[0] = 1
    for kind in range(2):
        for i in range(count):
            value = shaped[kind, i]
            for k in range(len(filters)):
                if filters[k] > 0.0:
                    if first:
                        filtered[k, 0, kind, i] = filtered[k, 1, kind, i] = value
                    # Exact if commands are linear between set points, as in `gsbridge.gap.joints.mechanism.setup.smoothed`.
                    keep = math.exp(-step / filters[k])
                    old = filters[k] / step * (1.0 - keep)
                    new = keep * filtered[k, 1, kind, i] + (1.0 - old) * value + (old - keep) * filtered[k, 0, kind, i]
                    filtered[k, 0, kind, i], filtered[k, 1, kind, i] = value, new
                    value = new
            slowness = a.figures[_SLOWNESS, i]
            if slowness > 0.0 and kind == 0:
                most = step / slowness
                if not first:
                    value = followed[i] + min(max(value - followed[i], -most), most)
                followed[i] = value
            elif slowness > 0.0:
                # The speed that is fed forward is itself no faster than the limit; how fast it changes is not limited.
                value = min(max(value, -1.0 / slowness), 1.0 / slowness)
            shaped[kind, i] = value


@njit(nogil=True)
def play_drives(a: np.record, measured: Array, step: float, out: Array) -> bool:
    """Turn the torques that the controller asks for into those that act on the joints, without dry friction and armature.

    Args:
        a: Record of the arm, as `gsbridge.sim.dynamics.joint_torques` has it; `rubs`, the largest dry friction, is filled.
        measured: True angles and speeds. [2, N + 1].
        step: Step of time, s.
        out: Row 1: torques asked; row 0: torques at the joints, overwritten. [2, N + 1].

    Returns:
        Whether a joint has dry friction.
    """
    figures, law, asked, lagged, grip = a.figures, a.law, a.asked, a.lagged, a.rubs
    number, slots, rough = a.started[1], len(asked), False
    a.started[1] = number + 1
    for i in range(figures.shape[1]):
        angle, rate = measured[0, i], measured[1, i]
        given = out[1, i]
        asked[number % slots, i] = given
        if figures[_DELAY, i] > 0.0:
            back = figures[_DELAY, i] / step
            whole = int(math.floor(back))
            near = asked[(number - whole) % slots, i] if number >= whole else asked[0, i]
            far = asked[(number - whole - 1) % slots, i] if number > whole else near
            given = near + (back - whole) * (far - near)
        if figures[_LAG, i] > 0.0:
            if number == 0:
                lagged[i] = given
            lagged[i] += (given - lagged[i]) * (1.0 - math.exp(-step / figures[_LAG, i]))
            given = lagged[i]
        given = (1.0 + figures[_GAIN, i]) * given + figures[_OFFSET, i]
        phase = figures[_WAVES, i] * angle
        given += figures[_SINE, i] * math.sin(phase) + figures[_COSINE, i] * math.cos(phase)
        share = rate / figures[_STRIBECK_SPEED, i]
        grip[i] = figures[_DRY, i] + figures[_STRIBECK, i] * math.exp(-share * share) + figures[_LOAD, i] * abs(given)
        rough = rough or grip[i] > 0.0 or figures[_SKEW, i] != 0.0
        out[0, i] = given - (law[3, i] + figures[_QUADRATIC, i] * abs(rate)) * rate
        out[0, i] -= figures[_SPRING, i] * (angle - figures[_SPRING_REST, i])
    turn, move, mass, moment, tilt = a.turn, a.move, a.mass, a.moment, a.tilt
    for j in range(figures.shape[1]):
        # Add the weight that a tilted base causes; the engine's gravity does not include the tilt.
        h = moment[j]
        out[0, j] += turn[j, 0] * (h[1] * tilt[2] - h[2] * tilt[1])
        out[0, j] += turn[j, 1] * (h[2] * tilt[0] - h[0] * tilt[2]) + turn[j, 2] * (h[0] * tilt[1] - h[1] * tilt[0])
        for m in range(3):
            out[0, j] += move[j, m] * mass[j] * tilt[m]
    return rough


@njit(nogil=True)
def rub_joints(a: np.record, measured: Array, step: float, out: Array) -> None:
    """Set the torques of one step by which the engine moves as if it had dry friction and armature.

    Args:
        a: Record of the arm; `columns` [N, N + 1] holds the joints' accelerations without dry friction and, after them, the
            inverse of the joint-space inertia with armature.
        measured: True angles and speeds. [2, N + 1].
        step: Step of time, s.
        out: Row 0: torques for the engine, updated. [2, N + 1].
    """
    columns, inverse, speed, impulse, law = a.columns, a.inverse, a.speed, a.impulse, a.law
    count = len(speed)
    for i in range(count):
        for j in range(count):
            inverse[i, j] = columns[i, 1 + j]
    for i in range(count):
        speed[i] = measured[1, i] + step * columns[i, 0]
        impulse[i] = 0.0
    rub(speed, inverse, a.rubs, a.figures[_SKEW], step, impulse)
    for i in range(count):
        out[0, i] += impulse[i] / step - law[2, i] * (speed[i] - measured[1, i]) / step
