"""Replays that are pulled back to the measured motion, for models under logged torques that run away from their record.

A model that lacks the friction of a gear, or the rotor behind it, soon moves so differently under the logged torques that its
motion says nothing any more about what it lacks. A spring and a damper between each joint and its measured motion keep the
replay near the record. Their torque is in proportion to the torque that the model lacks, and so is the deviation that is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.case import JointCase
from gsbridge.gap.joints.first_states import HIGHEST, state_at
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import ControllerModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import spans_of
from gsbridge.geometry import Array

_RUNAWAY = 5.0
"""How many times as far as it moved a joint must be from its record for the model to run away."""

_REACH = 0.05
"""Deviation that the root mean square of a joint's torque causes against the spring, rad or m."""

_MEMORY = 0.1
"""Time after which the observer has forgotten a deviation, s: damping over stiffness."""

_STIFF = 6.0
"""Largest damping, in multiples of inertia per time step: beyond it, the implicit step rings at its own rate."""

_LEAST = 0.05
"""Smallest torque that a joint's spring is made for, as a share of that of the joint with the largest torque."""

_WINDOW, _ORDER = 0.06, 2
"""Length of the window, s, and order of the polynomial that smooths the measured motion."""

_POSTURES = 50
"""Number of postures of each record at which the inertia is computed."""

_HOOKS, _BESIDE = ("transmission", "body"), ("armature", "ripple", "effort_offset")
"""Where effects act that show beside an observer, and further effects that do. Errors of sensors and clocks, and late torques,
would act on the observer as well."""

_TORQUES = ("load_friction", "warming")
"""Effects in proportion to all torque or all friction of a joint, which would take the observer's for the mechanism's."""


def observed(case: JointCase) -> JointCase:
    """Give a case an observer if its model runs away from the record `fit` under the logged torques.

    Args:
        case: A checked case.

    Returns:
        The case as it is replayed, with a controller whose targets are the measured motion and whose feedforward is the logged
        torque; the case itself where it needs none. The damper is part of the model's viscous friction, which is stepped
        implicitly, and its target speed part of the feedforward: a light joint could not be damped explicitly.

    Source: Luenberger, IEEE Transactions on Automatic Control 16, 1971, for observers.
    """
    if not runaway_told(case):
        return case
    system, mechanism = case.system, Mechanism(case.system)
    torque = np.max([_rms(record.commands["command"]) for record in case.records.values()], axis=0)
    torque = np.maximum(torque, _LEAST * torque.max())
    inertia = np.min([_inertia(mechanism, record) for record in case.records.values()], axis=0)
    damping = np.minimum(torque / _REACH * _MEMORY, _STIFF * inertia / system.time_step)
    follower = ControllerModel(
        mode="pd",
        rate=system.physics_rate,
        stiffness=damping / _MEMORY,
        damping=np.zeros(len(damping)),
        bandwidth=system.controller.bandwidth,
        gravity_compensation=0.0,
        velocity_reference="zero",
        torque_limit=np.full(len(damping), np.inf),
        between="line",
    )
    pulled = replace(system, controller=follower, viscous=system.viscous + damping)
    records = {role: _following(record, damping) for role, record in case.records.items()}
    return replace(case, system=pulled, records=records, names=_names(case))


def runaway_told(case: JointCase) -> str:
    """Say in a sentence that the model of a case runs away under the logged torques; empty where it does not."""
    if case.system.controller.mode != "torque" or not _names(case):
        return ""
    times = _times_as_far(Mechanism(case.system), case.records["fit"])
    worst = int(np.argmax(times))
    if not times[worst] > _RUNAWAY:
        return ""
    joint = f"joint '{case.system.joints[worst]}' is {plain(float(times[worst]))} times as far from it as it moved"
    far = joint if np.isfinite(times[worst]) else "it is beyond all bounds"
    return (
        f"under the logged torques the model runs away from the record: within a second, {far}. Replays were therefore pulled "
        "back to the measured motion by a spring and a damper at each joint; late torques, the motors' constants, and errors "
        "of sensors and clocks cannot be told then"
    )


def _names(case: JointCase) -> tuple[str, ...]:
    """List the effects that may be the cause and show beside an observer."""
    acts = (name for name, effect in JOINT_EFFECTS.items() if "torque" in effect.modes and effect.hook in _HOOKS)
    shown = {*acts, *_BESIDE}.difference(_TORQUES)
    return tuple(name for name in JOINT_EFFECTS if name in shown and (case.names is None or name in case.names))


def _times_as_far(mechanism: Mechanism, record: Record) -> Array:
    """Compute how far each joint of the plain replay is from its record, in multiples of how far it moved meanwhile. [N].

    A joint that hardly moves is compared with the mean motion of all joints; infinite where the replay diverges.
    """
    spans, measured = spans_of(record, mechanism.system), record.measured["position"]
    states = [state_at(record, first, HIGHEST) for first, _ in spans]
    replayed = mechanism.run(record, apply_effects(mechanism, ()), spans, states)["position"]
    moved = _rms(np.concatenate([measured[first:end] - measured[first] for first, end in spans]))
    strayed = _rms(replayed - measured)
    return np.where(np.isfinite(strayed), strayed / np.maximum(moved, max(float(moved.mean()), 1e-12)), np.inf)


def _rms(values: Array) -> Array:
    """Compute the root mean square of each column. [T, N] -> [N]."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _inertia(mechanism: Mechanism, record: Record) -> Array:
    """Compute the least inertia that each joint feels where no other joint is held, over a record's postures. [N]."""
    rows = np.linspace(0, len(record.time) - 1, _POSTURES).astype(int)
    return np.min([1.0 / np.diag(np.linalg.inv(mechanism.inertia(q))) for q in record.measured["position"][rows]], axis=0)


def _following(record: Record, damping: Array) -> Record:
    """Make the record whose commands are the measured motion, with the logged torques and the damper's as feedforward."""
    positions, speeds = _smoothed(record)
    torque = record.commands["command"] + record.commands.get("feedforward", 0.0) + damping * speeds
    measured = {kind: values for kind, values in record.measured.items() if kind != "effort"}
    return replace(record, commands={"command": positions, "feedforward": torque}, measured=measured, torque_commands=False)


def _smoothed(record: Record) -> tuple[Array, Array]:
    """Smooth the measured positions by local polynomials, and compute their speeds. [T, N], [T, N].

    Noise of the positions would otherwise act as torque, through the damper.

    Source: Savitzky and Golay, Analytical Chemistry 36, 1964.
    """
    grid = np.arange(0.0, record.duration + 0.5 * record.period, record.period)
    window = max(2 * round(0.5 * _WINDOW / record.period) + 1, _ORDER + 3)
    even = np.stack([np.interp(grid, record.time, column) for column in record.measured["position"].T], axis=1)
    found = [savgol_filter(even, window, _ORDER, deriv=k, delta=record.period, axis=0) for k in (0, 1)]
    positions, speeds = (np.stack([np.interp(record.time, grid, column) for column in one.T], axis=1) for one in found)
    return positions, speeds
