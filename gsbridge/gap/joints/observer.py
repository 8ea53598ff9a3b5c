"""Replays that are pulled back to the measured motion, for models under logged torques that run away from their record.

A model that lacks the friction of a gear, or the rotor behind it, soon moves so differently under the logged torques that its
motion says nothing any more about what it lacks. A spring and a damper between each joint and its measured motion keep the
replay near the record. Their torque is in proportion to the torque that the model lacks, and so is the deviation that is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.case import JointCase
from gsbridge.gap.joints.first_states import HIGHEST, state_at
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import ControllerModel, MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import spans_of
from gsbridge.geometry import Array

_RUNAWAY, _NEAR = 1.0, 1.0
"""How many times as far as it moved a joint must be from its record for the model to run away, and how near an observer must
keep it."""

_REACH = 0.05
"""Deviation that the root mean square of a joint's torque causes against the spring, rad or m."""

_MEMORY = 0.1
"""Time after which the observer has forgotten a deviation, s: damping over stiffness."""

_STIFF = 6.0
"""Largest damping, in multiples of inertia per time step: beyond it, the implicit step rings at its own rate."""

_FINER = (1, 2, 4)
"""Multiples of the rate of the physics that are tried, since shorter steps allow of stronger springs."""

_LEAST = 0.05
"""Smallest torque that a joint's spring is made for, as a share of the largest one of its kind, turning or sliding."""

_SPARSE = 0.021
"""Longest period of a record, s, from which the speeds of the targets are known well enough."""

_WINDOW, _FEWEST, _ORDER = 0.06, 7, 4
"""Length of the window, s, smallest number of samples in it, and order of the polynomial that smooths the measured motion."""

_JOINTS = 3
"""Smallest number of joints whose equal figures are no chance."""

_POSTURES = 50
"""Number of postures of each record at which the inertia is computed."""

_HIDDEN = ("clock", "command")
"""Where effects act that do not show beside an observer: they would move the motion that it pulls to."""

_ACTED = ("saturation",)
"""Effects that logged torques have passed already. A limit near zero takes torque away as friction does: on logs of a UR10e, it
explained more at first than the friction, and hid it."""


def observed(case: JointCase) -> tuple[JointCase, str]:
    """Give a case an observer if its model runs away from the record `fit` under the logged torques.

    Args:
        case: A checked case.

    Returns:
        The case as it is replayed, and why its result is degraded. Where an observer is needed and possible, the case has a
        controller whose targets are the measured motion and whose feedforward is the logged torque; otherwise it is the case
        itself, and the reason is empty where none is needed.

    Source: Luenberger, IEEE Transactions on Automatic Control 16, 1971, for observers.
    """
    system, fit = case.system, case.records["fit"]
    if system.controller.mode != "torque":
        return case, ""
    times = _times_as_far(Mechanism(system), fit)
    worst = int(np.argmax(times))
    if not times[worst] > _RUNAWAY:
        return case, ""
    far = f"joint '{system.joints[worst]}'" if np.isfinite(times[worst]) else "it"
    told = f"under the logged torques the model runs away from the record: within a second, {far} is {_multiple(times[worst])}"
    shown, hidden = _effects(case.names)
    strange = sorted({applied.name for applied in system.effects}.difference(_effects(None)[0]))
    if strange:
        return case, f"{told}. Its effects {', '.join(strange)} do not allow of pulling it back"
    if not shown:
        return case, f"{told}. None of the effects that may be the cause can be told if it is pulled back"
    if max(record.period for record in case.records.values()) > _SPARSE:
        return case, f"{told}. Log 50 samples per second or more, so that it can be pulled back to the measured motion"
    for finer in _FINER:
        pulled = _pulled(case, replace(system, physics_rate=finer * system.physics_rate), shown)
        if (_times_as_far(Mechanism(pulled.system), pulled.records["fit"]) < _NEAR).all():
            unsought = f"; what cannot be told then was not sought: {', '.join(hidden)}" if hidden else ""
            return pulled, (
                f"{told}. All replays were therefore pulled back to the measured motion by a spring and a damper at each "
                f"joint, and every gap is that of such a replay{unsought}{_taken_as_true(system)}"
            )
    return case, f"{told}, and neither springs nor dampers hold it. State 'armature' of light joints"


def strays_told(case: JointCase, effects: Sequence[Applied]) -> str:
    """Tell in words how far plain replays of the held-out record are from it, before and after effects are added.

    Args:
        case: The case as it was read, without an observer.
        effects: The effects.
    """
    mechanism, record = Mechanism(case.system), case.records["verify"]
    before, after = (float(_times_as_far(mechanism, record, added).max()) for added in ((), effects))
    plainly = f"without being pulled back, the farthest joint of 'verify' is {_multiple(before)}"
    return f"{plainly} within a second" + (f", and {_multiple(after)} with what was found" if effects else "")


def _multiple(times: float) -> str:
    """Tell how far a joint is from its record."""
    return f"{plain(times)} times as far from it as it moved" if np.isfinite(times) else "beyond all bounds"


def _effects(names: tuple[str, ...] | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Divide the effects that may be the cause, None for all, into those that show beside an observer and the others."""
    asked = [n for n, effect in JOINT_EFFECTS.items() if "torque" in effect.modes and (names is None or n in names)]
    shown = tuple(n for n in asked if JOINT_EFFECTS[n].hook not in _HIDDEN and n not in _ACTED)
    return shown, tuple(name for name in asked if name not in shown)


def _taken_as_true(system: MechanismModel) -> str:
    """Tell, in words that follow others, of figures that are equal at all joints, as defaults of a file are."""
    figures = {"armature": system.armature, "viscous": system.viscous, "coulomb": system.coulomb}
    alike = [name for name, values in figures.items() if len(values) >= _JOINTS and values[0] > 0.0 and not np.ptp(values)]
    if not alike:
        return ""
    which = " and ".join(alike)
    return f". If {which}, the same at all joints, {'were' if alike[1:] else 'was'} never measured, state 0: effects add to it"


def _pulled(case: JointCase, system: MechanismModel, shown: tuple[str, ...]) -> JointCase:
    """Make the case with an observer, for the effects that show beside it.

    Args:
        case: The case.
        system: Its model, at the rate at which it is stepped.
        shown: Effects that may be the cause.
    """
    mechanism, records = Mechanism(system), case.records.values()
    torque = np.max([_rms(_torque(record, system)) for record in records], axis=0)
    sliding = np.array([joint in system.sliding for joint in system.joints])
    for kind in (sliding, ~sliding):
        torque[kind] = np.maximum(torque[kind], _LEAST * torque[kind].max(initial=0.0))
    inertia = np.min([_inertia(mechanism, record) for record in records], axis=0)
    damping = np.minimum(torque / _REACH * _MEMORY, _STIFF * inertia / system.time_step)
    follower = ControllerModel(
        mode="pd",
        rate=system.physics_rate,
        stiffness=damping / _MEMORY,
        damping=damping,
        bandwidth=system.controller.bandwidth,
        gravity_compensation=0.0,
        velocity_reference="zero",
        torque_limit=system.controller.torque_limit,
        between="line",
        observes=True,
    )
    follows = {role: _following(record, system) for role, record in case.records.items()}
    return replace(case, system=replace(system, controller=follower), records=follows, names=shown)


def _times_as_far(mechanism: Mechanism, record: Record, effects: Sequence[Applied] = ()) -> Array:
    """Compute how far each joint of the plain replay is from its record, in multiples of how far it moved in a second. [N].

    A joint that hardly moves is compared with the mean motion of all joints of its kind; infinite where the replay diverges.
    """
    system, measured = mechanism.system, record.measured["position"]
    spans = spans_of(record, system)
    states = [state_at(record, first, HIGHEST) for first, _ in spans]
    strayed = _rms(mechanism.run(record, apply_effects(mechanism, effects), spans, states)["position"] - measured)
    second = max(round(1.0 / record.period), 1)
    moved = _rms(np.concatenate([part - part[0] for part in np.split(measured, range(second, len(measured), second))]))
    sliding = np.array([joint in system.sliding for joint in system.joints])
    for kind in (sliding, ~sliding):
        moved[kind] = np.maximum(moved[kind], moved[kind].mean() if kind.any() else 0.0)
    return np.where(np.isfinite(strayed), strayed / np.maximum(moved, 1e-12), np.inf)


def _rms(values: Array) -> Array:
    """Compute the root mean square of each column. [T, N] -> [N]."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _inertia(mechanism: Mechanism, record: Record) -> Array:
    """Compute the least inertia that each joint feels where no other joint is held, over a record's postures. [N]."""
    rows = np.linspace(0, len(record.time) - 1, _POSTURES).astype(int)
    return np.min([1.0 / np.diag(np.linalg.inv(mechanism.inertia(q))) for q in record.measured["position"][rows]], axis=0)


def _torque(record: Record, system: MechanismModel) -> Array:
    """Compute the torque that the motors gave, N m or N, for commands that are joined by straight lines. [T, N].

    Where the model holds commands, each is there late by half the time between two samples, on average.
    """
    given = record.commands["command"] + record.commands.get("feedforward", 0.0)
    given = np.clip(given, -system.controller.torque_limit, system.controller.torque_limit)
    before = np.concatenate([given[:1], given[:-1]])
    return 0.5 * (given + before) if system.controller.between == "hold" else given


def _following(record: Record, system: MechanismModel) -> Record:
    """Make the record whose commands are the measured motion, with the logged torques as feedforward."""
    positions, speeds = _smoothed(record)
    commands = {"command": positions, "command_velocity": speeds, "feedforward": _torque(record, system)}
    measured = {kind: values for kind, values in record.measured.items() if kind != "effort"}
    return replace(record, commands=commands, measured=measured, torque_commands=False)


def _smoothed(record: Record) -> tuple[Array, Array]:
    """Smooth the measured positions by local polynomials, and compute their speeds. [T, N], [T, N].

    Noise of the positions would otherwise act as torque, through the damper.

    Source: Savitzky and Golay, Analytical Chemistry 36, 1964.
    """
    grid = np.arange(0.0, record.duration + 0.5 * record.period, record.period)
    window = max(2 * round(0.5 * _WINDOW / record.period) + 1, _FEWEST)
    even = CubicSpline(record.time, record.measured["position"])(grid)
    found = [savgol_filter(even, window, _ORDER, deriv=k, delta=record.period, axis=0) for k in (0, 1)]
    positions, speeds = (np.asarray(CubicSpline(grid, one)(record.time)) for one in found)
    return positions, speeds
