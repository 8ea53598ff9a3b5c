"""Simulation loop of all truths of arms: a sampled joint controller with gravity compensation, and its log.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from gsbridge.gap.benchmark.hidden_parts import Commands, Drive, Loads, Rubs, Sensors, size_at
from gsbridge.gap.benchmark.trajectories import Course
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

PERIOD = 1e-3
"""Period of the controller, s."""

_PARTS = 4
"""Number of updates per control period of drive and loads outside the engine, if it divides the number of engine steps."""


_HANGING = 1.5
"""Settling time before the log begins, s, for links behind play or a spring, which would otherwise start out of balance."""


class ArmEngine(Protocol):
    """A simulated arm with those hidden effects for which its engine has a mechanism."""

    def begin(self, q: Array) -> None:
        """Start at rest at positions, rad or m. [N]."""

    def state(self) -> tuple[Array, Array]:
        """Return positions and speeds of the same time. [N] each."""

    def weight(self, q: Array) -> Array:
        """Return the torques that hold the nominal arm against gravity, N m. [N]."""

    def advance(self, asked: Array, extra: Array, dry: Array | None, steps: int) -> None:
        """Simulate some steps of the engine with constant torques.

        Args:
            asked: Torques commanded to the motors, N m. [N].
            extra: Additional torques on the joints, N m. [N].
            dry: Dry friction of the joints beyond that in the engine, N m; None leaves it unchanged. [N].
            steps: Number of engine steps.
        """

    def place(self) -> Array:
        """Return the origin of the last link's frame at the time of `state`, base frame, m. [3]."""

    def touch(self, force: Array) -> None:
        """Apply a force to the last link at its centre of mass from now on, world frame, N. [3]."""

    @property
    def steps(self) -> int:
        """Number of engine steps per period of the controller."""

    @property
    def loose(self) -> bool:
        """Whether links can move relative to their motors, because of play or elasticity."""


def run_arm(
    engine: ArmEngine, system: MechanismModel, course: Course, duration: float, times: Array, hidden: Mapping[str, float]
) -> dict[str, Array]:
    """Simulate an arm with hidden effects, and return its log; a `generate.Truth` except for the first two arguments.

    Args:
        engine: The simulated arm, with those hidden effects for which its engine has a mechanism.
        system: Model of the arm, whose controller is copied.
        course: Commands.
        duration: Length of the course, s.
        times: Times of the samples, s. [T].
        hidden: Sizes of the hidden effects, by name (`name:joint` for one joint).

    Returns:
        `position`, `velocity` and `effort`, each [T, N], and `tool`, the frame of the last link, m, [T, 3].
    """
    count, steps = len(system.joints), int(np.ceil(duration / PERIOD)) + 150

    def row(name: str) -> Array:
        return np.array([size_at(hidden, name, joint) for joint in system.joints])

    stiff, damp = system.controller.stiffness * (1 + row("gain_p")), system.controller.damping * (1 + row("gain_d"))
    share, weakness = system.controller.gravity_compensation + hidden.get("gravcomp", 0.0), row("saturation")
    limit = np.where(weakness > 0, 1.0 / np.where(weakness > 0, weakness, 1.0), np.inf)
    wanted = np.asarray(course(0.0), dtype=np.float64)
    parts = _PARTS if engine.steps % _PARTS == 0 else engine.steps
    commands, sensors = Commands(system, hidden, wanted, PERIOD), Sensors(system, hidden, duration)
    drive, loads, rubs = Drive(system, hidden, PERIOD / parts), Loads(system, hidden, duration), Rubs(system, hidden)
    engine.begin(sensors.place(wanted))
    out, places = np.empty((3, steps, count)), np.full((steps, 3), np.nan)
    grid = np.arange(steps) * PERIOD
    # Clock offset and drift: a sample is taken this much earlier than its time stamp says.
    late = hidden.get("clock_offset", 0.0) + hidden.get("clock_drift", 0.0) * times
    # The tool's position costs more than a step, so it is computed only next to the samples.
    beside = np.searchsorted(grid, times - late)[:, None] + np.arange(-1, 2)
    placed = set(np.clip(beside, 0, steps - 1).ravel().tolist())
    for number in range(-round(_HANGING / PERIOD) if engine.loose else 0, steps):
        time = max(number, 0) * PERIOD
        wanted = commands(np.asarray(course(max(time - commands.dead, 0.0)), dtype=np.float64))
        q, v = engine.state()
        seen, rate = sensors(q, v, time)
        asked = stiff * (wanted - seen) - damp * rate
        asked = np.clip(asked + share * engine.weight(seen) if share else asked, -limit, limit)
        if number >= 0:
            out[:, number] = seen, rate, asked
        if number in placed:
            places[number] = engine.place()
        dry = rubs(q, v, time, asked)
        if "touch_for" in hidden:
            engine.touch(_push(hidden, time))
        if not loads.acts and not drive.acts:
            engine.advance(asked, loads.steady, dry, engine.steps)
            continue
        for part in range(parts):
            q, v = engine.state()
            given = drive(asked) if drive.acts else asked
            engine.advance(given, loads(q, v, time + part * PERIOD / parts, given), dry, engine.steps // parts)
    shift = {"position": late, "velocity": late, "effort": 0.0, "tool": late}
    return {
        kind: np.stack([np.interp(times - shift[kind], grid, column) for column in values.T], axis=1)
        for kind, values in zip(shift, (*out, places), strict=True)
    }


def _push(hidden: Mapping[str, float], time: float) -> Array:
    """Return the force of a touch at a time, half a sine wave over its duration, world frame, N. [3]."""
    share = (time - hidden["touch_at"]) / hidden["touch_for"]
    if not 0.0 < share < 1.0:
        return np.zeros(3)
    return np.array([hidden["touch_x"], hidden["touch_y"], hidden["touch_z"]]) * np.sin(np.pi * share)
