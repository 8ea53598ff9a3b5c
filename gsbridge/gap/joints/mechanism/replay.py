"""Replay of a record through the simulated mechanism.

A compiled kernel steps the mechanism's equations, about ten times faster than an engine with Python between its steps; a
diagnosis needs thousands of runs. `tests/unit/bullet_replay.py` runs the same in PyBullet, and tests check that the two agree.
PyBullet's scheme (positions move with the new speed) shifts positions against speeds by half a step. At 1 kHz that looks like
half a millisecond of latency, so that a mechanism is stepped with the mean speed unless its file says `scheme: euler`. Runs of
the same input are equal to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import AXES, TOOL, Record
from gsbridge.gap.joints.mechanism.chain import Chain
from gsbridge.gap.joints.mechanism.dynamics import LOADS, inertia, place, spread
from gsbridge.gap.joints.mechanism.inertials import Inertial, Skeleton
from gsbridge.gap.joints.mechanism.joint_kernel import MODE, simulate
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.setup import JointSetup
from gsbridge.geometry import Array

_FILLED = 3
"""Largest number of lost commands in a row that are filled in."""

_REGULAR, _MOSTLY = 0.1, 0.98
"""Largest deviation of a step between time stamps from a whole number of periods, in periods, and share of the steps that must
keep within it, for gaps to count as lost commands."""

_LOST = 0.1
"""Share of a log's steps from which on gaps belong to the way of logging and are not lost commands."""

_FAR, _TIMES = 1e3, 10.0
"""Distance from zero, rad or m, and speed, rad/s or m/s, up to which no motion counts as diverged; and the multiple of what the
record commands or begins with, if that is more."""

Span = tuple[int, int]
"""First sample of a stretch of a record, and the one behind its last."""

State = tuple[Array, Array]
"""Positions and speeds of the joints. [N], [N]."""


class Mechanism:
    """A simulated mechanism with joints.

    Args:
        system: The mechanism.

    Raises:
        InputError: The URDF cannot be used, or a joint has nothing to move.

    Attributes:
        runs: Number of simulations so far.
        shared: Number of simulations among `runs` whose results are kept for all records of equal commands.
        tip: Joint of the chain that moves the tool; without a tool, the end of the mechanism.
        toe: Place of the tool or end in that joint's frame, m. [3].
    """

    def __init__(self, system: MechanismModel) -> None:
        self.system = system
        self.runs = self.shared = 0
        self.skeleton = Skeleton.read(system.urdf, system.joints)
        self.chain = Chain.of(self.skeleton, system.joints)
        self.tip, self.toe = self.chain.end(system.tool)
        self._brain = self.chain.bodies(self.skeleton.inertials)
        idle = self.chain.idle(self._brain)
        for k, joint in enumerate(system.joints):
            if idle[k] and system.armature[k] <= 0.0:
                raise InputError(
                    system.urdf, f"joint '{joint}' moves neither mass nor inertia",
                    "State mass and inertia of what it moves, above zero, or 'armature' in the model",
                )  # fmt: skip

    def setup(self) -> JointSetup:
        """Make a fresh setup without effects."""
        outermost = self.system.joints[self.chain.order[self.chain.outermost]]
        return JointSetup.nominal(self.system, self.skeleton.inertials, self.skeleton.child_of, outermost)

    def inertia(self, q: Array, inertials: Mapping[str, Inertial] | None = None) -> Array:
        """Compute the joint-space inertia of the model in a posture, rotors included.

        Args:
            q: Positions of the joints, rad or m. [N].
            inertials: Mass properties by link; None for those of the model.

        Returns:
            kg m2, kg m or kg. [N, N].
        """
        chain, count = self.chain, len(q)
        turn, (origin, axis) = np.empty((count, 3, 3)), np.empty((2, count, 3))
        screws, loads, matrix = np.empty((count, 6)), np.empty((count, LOADS)), np.empty((count, count))
        place(chain.parents, chain.fixed, chain.axes, chain.slides, q[chain.order], turn, origin, axis)
        bodies = self._brain if inertials is None else chain.bodies(inertials)
        spread(chain.slides, bodies, turn, origin, axis, screws, loads)
        inertia(chain.parents, screws, loads, matrix)
        out = np.empty_like(matrix)
        out[np.ix_(chain.order, chain.order)] = matrix
        return out + np.diag(self.system.armature)

    def run(self, record: Record, setup: JointSetup, spans: Sequence[Span], states: Sequence[State]) -> dict[str, Array]:
        """Simulate stretches of a record.

        Args:
            record: Commands and times.
            setup: The mechanism with its effects.
            spans: Stretches, each simulated from its own state.
            states: Positions, rad or m, and speeds of the joints at the start of each stretch, as measured. [N] each.

        Returns:
            `position`, `velocity` and `effort` (the torque that the controller asks of the motors) at the record's times, and
            `tool` if the record has it, SI units. Each [T, N]; `tool` [T, 3]. Not-a-number outside the stretches and after a
            divergence.
        """
        self.runs += 1
        system, chain, order = self.system, self.chain, self.chain.order
        step, count = system.time_step, len(record.joints)
        seen = setup.taken(record.time)
        # Under feedback the replay begins with the commands, otherwise with the first measured state.
        ran = record.time if system.controller.closed_loop else seen
        begins = [int(round(ran[first] / step)) for first, _ in spans]
        steps = int(np.ceil(max(record.duration, ran[-1]) / step)) + 2
        early = max(0, -min(begins))
        wanted = [np.ascontiguousarray(values[:, order]) for values in command_grid(record, system, setup, steps)]
        # The first command holds before it, too.
        wanted = [np.concatenate([np.repeat(values[:1], early, axis=0), values]) for values in wanted] if early else wanted
        bodies = chain.bodies(setup.inertials)
        law = np.ascontiguousarray(setup.rows()[:, order])
        out = {kind: np.full((len(record.time), count), np.nan) for kind in ("position", "velocity", "effort")}
        if TOOL in record.measured:
            out[TOOL] = np.full((len(record.time), len(AXES)), np.nan)
        up = up_of(system.gravity)
        surface = np.concatenate([up, setup.surface if up.any() else np.zeros(2)])
        every = round(system.physics_rate / system.controller.rate)
        farthest, fastest = _bounds(record, system, spans, states)
        for (first, end), (q, v), begin in zip(spans, states, begins, strict=True):
            length = min(int(np.ceil((ran[end - 1] - ran[first]) / step)) + 2, steps - begin)
            raw = np.full((4, length, count), np.nan)
            if setup.clocks and not system.controller.closed_loop:
                q, v = _at_step(setup, record, first, begin * step, (q, v))
            q, v = true_state(setup, q, v)
            simulate(
                chain.parents, chain.fixed, chain.axes, chain.slides, bodies, setup.gravity, self._brain, system.gravity,
                system.armature[order], law, self.tip, self.toe, surface, MODE[system.controller.mode],
                2 * np.pi * system.controller.bandwidth, wanted[0][begin + early :], wanted[1][begin + early :],
                wanted[2][begin + early :], q[order], v[order], float(ran[first]), step, every, system.centred,
                farthest, fastest, raw,
            )  # fmt: skip
            channels: dict[str, Array] = {}
            for kind, values in zip(("position", "velocity", "effort"), raw[:3], strict=True):
                channels[kind] = np.empty_like(values)
                channels[kind][:, order] = values
            if TOOL in out:
                # Take the true positions of the links: encoders may err, and measure the motor's side of a soft joint.
                channels[TOOL] = chain.place(system.tool, raw[3])
            grid = begin * step + step * np.arange(length)
            for kind, values in channels.items():
                times = (record.time if kind == "effort" else seen)[first:end]
                for k in range(values.shape[1]):
                    out[kind][first:end, k] = np.interp(times, grid, values[:, k])
        return out


def up_of(gravity: Array) -> Array:
    """Compute the upward unit vector from gravity; zero without gravity. [3] -> [3]."""
    length = float(np.linalg.norm(gravity))
    return -gravity / length if length > 0.0 else np.zeros(3)


def _at_step(setup: JointSetup, record: Record, first: int, begin: float, state: State) -> State:
    """Compute the state at the beginning of a stretch's first step from the one that was measured with a wrong clock.

    Args:
        setup: The mechanism, with its clocks.
        record: The record.
        first: First sample of the stretch.
        begin: Time of the first step, s.
        state: Positions and speeds as estimated from the samples around the first one.
    """
    around = record.time[first] + record.period * np.array([-0.5, 0.0, 0.5])
    before, then, after = setup.taken(around)
    # Speeds that were estimated from positions are in the clock's seconds.
    speed = state[1] if "velocity" in record.measured else state[1] * record.period / (after - before)
    return state[0] + speed * (begin - then), speed


def true_state(setup: JointSetup, q: Array, v: Array) -> State:
    """Compute the true state of the joints from a measured one by taking off the encoders' errors.

    Args:
        setup: The mechanism, with its encoders' errors.
        q: Measured positions, rad or m. [N].
        v: Measured speeds, rad/s or m/s. [N].

    Returns:
        True positions and speeds. [N], [N].
    """
    law = setup.law
    scale = 1.0 + law["encoder_scale"]
    q = (q - law["encoder_offset"]) / scale
    return q - law["eccentric_sine"] * np.sin(q) - law["eccentric_cosine"] * np.cos(q), v / scale


def _bounds(record: Record, system: MechanismModel, spans: Sequence[Span], states: Sequence[State]) -> tuple[float, float]:
    """Choose the distance from zero and the speed from which on a replay counts as diverged.

    A joint that turns on and on gets far, and a spindle is fast, so that both follow the commands and the states at the start.

    Args:
        record: Commands and times.
        system: Model of the mechanism.
        spans: Stretches that are replayed.
        states: State of the joints at the start of each stretch.

    Returns:
        Distance, rad or m, and speed, rad/s or m/s.
    """
    far, fast = (max(float(np.abs(values).max()) for values in kind) for kind in zip(*states, strict=True))
    if system.controller.closed_loop:
        command = record.commands["command"]
        far = max(far, float(np.abs(command).max()))
        fast = max(fast, float(np.abs(np.diff(command, axis=0) / np.diff(record.time)[:, None]).max(initial=0.0)))
    else:
        far += fast * max(float(record.time[end - 1] - record.time[first]) for first, end in spans)
    return max(_FAR, _TIMES * far), max(_FAR, _TIMES * fast)


def with_lost_commands(record: Record) -> tuple[Array, Mapping[str, Array]]:
    """Fill in commands that a log lost here and there, along a cubic spline through the others.

    The controller received these commands, although they were not logged. Longer gaps, and gaps of logs whose time stamps
    jitter, are left alone. Since a spline overshoots where a command jumps, it may bend no more than the command does around
    the gap.

    Args:
        record: Commands and times.

    Returns:
        Times, s. [T'], and commands by kind. [T', N] each.
    """
    time = record.time
    counts = np.diff(time) / record.period
    whole = np.rint(counts)
    lost = (whole >= 2) & (whole <= _FILLED + 1)
    if not 0.0 < lost.mean() < _LOST or np.mean(np.abs(counts - whole) < _REGULAR) < _MOSTLY or not record.commands:
        return time, record.commands
    inside = [time[k] + (time[k + 1] - time[k]) * np.arange(1, whole[k]) / whole[k] for k in np.flatnonzero(lost)]
    every = np.sort(np.concatenate([time, *inside]))
    return every, {kind: _smooth(time, values, every) for kind, values in record.commands.items()}


def _smooth(time: Array, values: Array, every: Array) -> Array:
    """Interpolate between samples by lines, plus the cubic spline's deviation from them as far as nearby curvature allows.

    Args:
        time: Times of the samples, s. [T].
        values: Values. [T, N].
        every: Times asked for, s. [T'].
    """
    gaps = np.diff(time)[:, None]
    slopes = np.diff(values, axis=0) / gaps
    # Second derivative at each sample; the ends take that of their neighbours. A jump raises at most two of the four around a
    # gap, so that the second smallest of the four is used.
    bends = np.abs(np.pad(2.0 * np.diff(slopes, axis=0) / (gaps[1:] + gaps[:-1]), ((2, 2), (0, 0)), mode="edge"))
    around = np.sort(np.stack([bends[k : len(gaps) + k] for k in range(4)]), axis=0)[1]
    # A parabola departs from the line by at most an eighth of curvature times gap squared; twice that leaves room for cubics.
    most = around * gaps**2 / 4.0
    row = (np.searchsorted(time, every, side="right") - 1).clip(0, len(time) - 2)
    line = values[row] + slopes[row] * (every - time[row])[:, None]
    return np.asarray(line + np.clip(CubicSpline(time, values)(every) - line, -most[row], most[row]))


def command_grid(record: Record, system: MechanismModel, setup: JointSetup, steps: int) -> tuple[Array, Array, Array]:
    """Compute the commands as they reach the controller in each physics step.

    Args:
        record: Commands as they were sent.
        system: Model of the mechanism.
        setup: The mechanism, whose command hooks are applied.
        steps: Number of physics steps.

    Returns:
        Target, its speed, and feedforward torque, SI units. [steps, N] each.
    """
    count, step = len(record.joints), system.time_step
    zero = np.zeros((steps, count))
    if system.controller.mode == "free":
        return zero, zero, zero
    grid = step * np.arange(steps)
    time, sent = with_lost_commands(record)
    # Add half a microsecond to allow for rounding of stamps that lie on the grid.
    rows = (np.searchsorted(time, grid + 5e-7, side="right") - 1).clip(0)
    commands: dict[str, Array] = {}
    for kind, values in sent.items():
        if system.controller.between == "line":
            commands[kind] = np.stack([np.interp(grid, time, column) for column in values.T], axis=1)
        else:
            commands[kind] = values[rows]
    for hook in setup.commands:
        commands = {kind: hook(values, step, kind) for kind, values in commands.items()}
    target, speed, extra = commands["command"], commands.get("command_velocity"), commands.get("feedforward", zero)
    if speed is None:
        every = round(system.physics_rate / system.controller.rate)
        speed = _speed_of(target, every, step) if system.controller.velocity_reference == "derivative" else zero
    return target, speed, extra


def _speed_of(target: Array, every: int, step: float) -> Array:
    """Compute the speed of a target from its values one control period before and after, which its ends cut short.

    A difference over single steps would not do: a command that is held jumps within one step, and a controller that takes up
    its speed there would keep it for the whole control period.

    Args:
        target: Target of each physics step. [K, N].
        every: Physics steps per control step.
        step: Time step, s.

    Returns:
        Its speed at each physics step. [K, N].
    """
    rows = np.arange(len(target))
    behind, ahead = np.maximum(rows - every, 0), np.minimum(rows + every, len(target) - 1)
    return np.asarray((target[ahead] - target[behind]) / ((ahead - behind) * step)[:, None])
