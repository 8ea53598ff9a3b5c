"""Residuals of a record under a mechanism, in units of the noise.

Their parts along nuisance directions are taken out: changes of the unknown initial state, and changes of how commands go on
between two samples.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.closure import stretches
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.first_states import HIGHEST, lonely, state_at
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism, Span, State
from gsbridge.gap.joints.noise import pooled, white_noise
from gsbridge.gap.joints.noise_colour import NoiseColour
from gsbridge.gap.joints.sensitivity import FINE, KINDS, Sensitivity, sensitivity_of, start_states
from gsbridge.geometry import Array

HORIZON = 1.0
"""Length of the stretches into which records of mechanisms without position feedback are cut, s: their errors grow over time,
and a restart from the measured state keeps the later ones small."""

_BROKEN = 1e3
"""Residual given to a simulation that diverged, in units of the noise."""

_RICHARDSON = FINE / (FINE - 1)
"""Richardson extrapolation: change by a vanishing time step, in multiples of that by the finer step. The error is of first
order in the step."""

_SEEN = 0.1
"""Length of the change by curved commands between samples, in units of the noise, up to which it is not taken out."""

_ROUNDED = 0.5
"""Standard deviation of an encoder's rounding, in units of the noise, above which rounding makes up most of the noise."""

_STILL = 0.02
"""Share of a joint's root mean square speed below which it counts as at rest."""

_FORGOTTEN = float(np.exp(-1.0))
"""Share of a displacement that is left after one time constant of the controller."""

_KEPT = 128
"""Number of replays kept in memory, since fits, checks and bootstraps ask for some of them again."""


def spans_of(record: Record, system: MechanismModel) -> list[Span]:
    """Cut a record into the stretches that are replayed: the whole record under position feedback, else parts of `HORIZON`."""
    total = len(record.time)
    if system.controller.closed_loop:
        return [(0, total)]
    starts, alone = np.searchsorted(record.time, np.arange(0.0, record.duration, HORIZON)), lonely(record)
    # Between two holes a few samples tell no speed: the stretch before goes on there.
    edges = [*(int(k) for k in starts if k == 0 or not alone[k]), total]
    spans = [(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
    if len(spans) > 1 and spans[-1][1] - spans[-1][0] < 0.5 * (spans[0][1] - spans[0][0]):
        spans[-2:] = [(spans[-2][0], total)]
    return spans


def _behind(still: Array, memory: int) -> Array:
    """Mark the first `memory` samples after each rest of at least that length; reversals are shorter. [T] -> [T]."""
    out = np.zeros(len(still), bool)
    for begin, end in stretches(still):
        if end - begin >= memory:
            out[end : end + memory] = True
    return out


@dataclass
class JointResiduals:
    """A record, the mechanism that replays it, and the noise.

    Args:
        mechanism: The mechanism that replays the record.
        record: Commands and measurements.
        spans: Stretches that are replayed: first sample of each, and the one behind its last.
        states: Initial state of each stretch: measured, or commanded if the joints were not measured.
        sigma: Standard deviation of each channel's noise, SI units. [C].
        channels: Kind and joint of each channel, in the order of the residuals' columns.
        frame: Derivatives of the nominal replay by its initial state and its time step.
        records: Number of records from which the noise was estimated.
        colour: Autocorrelation of the noise; None for white noise.
        kept: Samples that count; None for all. [T] bool.
    """

    mechanism: Mechanism
    record: Record
    spans: list[Span]
    states: list[State]
    sigma: Array
    channels: tuple[tuple[str, int], ...]
    frame: Sensitivity
    records: int = 1
    colour: NoiseColour | None = None
    kept: Array | None = None
    _fine: Array | float = 0.0
    _replays: dict[str, Array] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, mechanism: Mechanism, record: Record, effects: Sequence[Applied] = (), folder: str | Path | None = None
    ) -> JointResiduals:
        """Make the residuals of a record, replayed from its measured first states.

        Args:
            mechanism: The mechanism that replays the record.
            record: Commands and measurements. The noise is estimated from fast changes of the residual; it is at least what
                the record states.
            effects: Effects in the replay from which the noise is estimated.
            folder: Folder that keeps sensitivities from run to run; None to keep nothing.
        """
        system = mechanism.system
        spans = spans_of(record, system)
        if "position" in record.measured:
            highest = 2 if system.controller.closed_loop else HIGHEST
            states = [state_at(record, first, highest) for first, _ in spans]
        else:
            # The joints were not measured: they begin at their commands.
            states = start_states(mechanism, record, spans, ())
        # Without feedback, the logged effort is the command itself and tells nothing.
        kinds = [k for k in KINDS if k in record.measured and (k != "effort" or system.controller.closed_loop)]
        channels = tuple((kind, k) for kind in kinds for k in range(record.measured[kind].shape[1]))
        frame = sensitivity_of(mechanism, record, spans, states, folder)
        view = cls(mechanism, record, spans, states, np.ones(len(channels)), channels, frame)
        if system.centred:
            view._fine = np.nan_to_num(_RICHARDSON * view._columns(frame.stepping))
        view.sigma = view._noise(view._raw(view.replay(effects)))
        view._find_nuisance()
        return view

    def simulate(self, effects: Sequence[Applied] = ()) -> dict[str, Array]:
        """Simulate the outputs of the mechanism with effects, SI units. Each [T, N]; `tool` [T, 3]."""
        return self.mechanism.run(self.record, apply_effects(self.mechanism, effects), self.spans, self.states)

    def replay(self, effects: Sequence[Applied] = ()) -> Array:
        """Simulate the channels, corrected for the time step's error in the nominal motion, SI units. [T, C].

        Replays are kept in memory.
        """
        key = repr([effect.record() for effect in effects])
        if key not in self._replays:
            if len(self._replays) >= _KEPT:
                del self._replays[next(iter(self._replays))]
            self._replays[key] = self.stack(self.simulate(effects)) + self._fine
        return self._replays[key]

    def stack(self, outputs: Mapping[str, Array]) -> Array:
        """Put the channels side by side, SI units. [T, C]."""
        return np.stack([outputs[kind][:, k] for kind, k in self.channels], axis=1)

    def _raw(self, replayed: Array) -> Array:
        return self.stack(self.record.measured) - replayed

    def _noise(self, residual: Array) -> Array:
        """Estimate the noise of each channel from a residual, SI units. [T, C] -> [C]."""
        out = np.empty(len(self.channels))
        inside = np.where(np.isfinite(residual), residual, 0.0)
        found = np.median([white_noise(inside[a:b]) for a, b in self.spans if b - a > 20] or [white_noise(inside)], axis=0)
        for column, (kind, k) in enumerate(self.channels):
            declared = self.record.sigma.get(kind)
            quantum = self.record.quantum[kind][k] if kind in self.record.quantum else 0.0
            # A stated noise may raise the estimate, but not lower it below the white noise that is in the data.
            out[column] = max(found[column], 0.0 if declared is None else declared[k], quantum / np.sqrt(12), 1e-12)
        return out

    def _find_nuisance(self) -> None:
        """Find the directions in which the outputs move with the initial state; residuals are made orthogonal to them."""
        columns = [self._counted(self.decoloured(self._columns(nudge) / self.sigma)) for nudge in self.frame.nudges]
        self._basis = []
        for first, end in self.spans:
            block = np.stack([np.nan_to_num(column[first:end]).ravel() for column in columns], axis=1)
            left, values, _ = np.linalg.svd(block / np.maximum(np.linalg.norm(block, axis=0), 1e-12), full_matrices=False)
            self._basis.append(left[:, values > 1e-6])
        self._curve, self._less = np.zeros((len(self.record.time), len(self.channels))), 0.0
        curve = self.project(self.decoloured(np.nan_to_num(self._columns(self.frame.curving)) / self.sigma))
        size = float(np.linalg.norm(curve))
        if size > _SEEN:
            # A normal prior: how commands go on between two samples is uncertain by one such change (standard deviation).
            self._curve, self._less = curve / size, 1.0 - 1.0 / float(np.hypot(1.0, size))

    def project(self, whitened: Array) -> Array:
        """Take out what initial states, and commands between their samples, explain of whitened values. [T, C] -> [T, C]."""
        whitened, out = self._counted(whitened), np.zeros_like(whitened)
        for (first, end), basis in zip(self.spans, self._basis, strict=True):
            part = whitened[first:end].ravel()
            out[first:end] = (part - basis @ (basis.T @ part)).reshape(end - first, -1)
        if self._less:
            out -= self._less * float((self._curve * out).sum()) * self._curve
        return out

    def whiten(self, difference: Array) -> Array:
        """Convert differences from SI units to units of the noise and take out nuisance directions. [T, C] -> [T, C]."""
        scaled = difference / self.sigma
        return self.project(self.decoloured(np.where(np.isfinite(scaled), np.clip(scaled, -1e6, 1e6), _BROKEN)))

    def decoloured(self, scaled: Array) -> Array:
        """Whiten values in units of the noise: take off what the samples before predict of coloured noise. [T, C] -> [T, C]."""
        return scaled if self.colour is None else self._by_span(scaled, self.colour.whiten)

    def coloured(self, residual: Array) -> Array:
        """Invert `decoloured`. [T, C] -> [T, C]."""
        return residual if self.colour is None else self._by_span(residual, self.colour.colour)

    def _counted(self, values: Array) -> Array:
        """Set values to zero at samples that do not count. [T, C] -> [T, C]."""
        return values if self.kept is None else np.where(self.kept[:, None], values, 0.0)

    def _by_span(self, values: Array, act: Callable[[Array], Array]) -> Array:
        return np.concatenate([act(values[first:end]) for first, end in self.spans])

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Compute measured less simulated, in units of the noise. [T, C]."""
        return self.whiten(self._raw(self.replay(effects)))

    def residual_of(self, other: Mechanism) -> Array:
        """Compute measured less the replay by another model without further effects, in units of the noise. [T, C]."""
        moved = other.run(self.record, apply_effects(other, ()), self.spans, self.states)
        return self.whiten(self._raw(self.stack(moved) + self._fine))

    def rests(self, effects: Sequence[Applied], joints: Sequence[str]) -> tuple[Array, Array]:
        """Find samples at which some joint rests in a replay, and those after rests at which the controller corrects it.

        Args:
            effects: Effects of the replay.
            joints: Joints that may rest.

        Returns:
            Samples at rest, by the replayed positions, and samples within one time constant of the controller after a rest.
            [T], [T] bool.
        """
        out, behind = np.zeros((2, len(self.record.time)), bool)
        for joint in joints:
            number = self.record.joints.index(joint)
            if ("position", number) in self.channels:
                speed = np.abs(np.gradient(self.replay(effects)[:, self.channels.index(("position", number))]))
                still = speed < _STILL * np.sqrt((speed**2).mean())
                out |= still
                behind |= _behind(still, self.memory(number))
        return out, behind & ~out

    def memory(self, joint: int) -> int:
        """Count the samples after which a displaced start of a joint stays below 1/e in the nominal replay; all if never.

        A joint with weak damping swings through zero long before it has forgotten where it began.
        """
        first, end = self.spans[0]
        moved = np.abs(self.frame.nudges[joint][first:end, KINDS.index("position"), joint])
        # A start displaced by a replay that diverged is not-a-number: it never decays.
        above = np.flatnonzero(~(moved < _FORGOTTEN * moved[0]))
        return int(above[-1]) + 1

    def tolerance(self) -> Array:
        """Compute the size of slow deviations that need no explanation, in units of the noise. [C].

        It is the stated tolerance, or an encoder's rounding if that is larger: at a joint that rests or creeps, many samples
        are rounded alike, unless noise exceeds the encoder's step.
        """
        out = np.zeros(len(self.channels))
        for column, (kind, k) in enumerate(self.channels):
            if kind in self.record.tolerance:
                out[column] = self.record.tolerance[kind][k] / self.sigma[column]
            rounding = self.record.quantum[kind][k] / np.sqrt(12) / self.sigma[column] if kind in self.record.quantum else 0.0
            if rounding > _ROUNDED:
                out[column] = max(out[column], rounding)
        return out if self.colour is None else out * self.colour.steady

    def stepping(self) -> Array:
        """Compute the change of the nominal replay by a finer time step, in units of the noise. [T, C]."""
        return self.whiten(self._columns(self.frame.stepping))

    def stepping_beyond(self, effects: Sequence[Applied]) -> Array:
        """Compute what a vanishing time step changes in a replay with effects, beyond its change of the nominal one.

        In units of the noise; zero for models whose nominal error is not corrected (not `centred`). [T, C].
        """
        system = self.mechanism.system
        if not system.centred:
            return np.zeros((len(self.record.time), len(self.channels)))
        fine = Mechanism(replace(system, physics_rate=FINE * system.physics_rate))
        moved = self.stack(fine.run(self.record, apply_effects(fine, effects), self.spans, self.states))
        self.mechanism.runs += fine.runs
        return self.whiten(_RICHARDSON * (moved + self._fine - self.replay(effects)) - self._fine)

    def _columns(self, values: Array) -> Array:
        """Put the channels of an array of `frame` side by side. [T, kinds, N] -> [T, C]."""
        rows, joints = [KINDS.index(kind) for kind, _ in self.channels], [k for _, k in self.channels]
        return np.asarray(values, dtype=np.float64)[:, rows, joints]

    @property
    def replays(self) -> int:
        """Number of simulations that one residual takes."""
        return 1

    @property
    def freedom(self) -> int:
        """Degrees of freedom of a residual: its numbers less the directions of the initial states."""
        return self.count * len(self.channels) - sum(basis.shape[1] for basis in self._basis)

    @property
    def count(self) -> int:
        """Number of samples that count."""
        return len(self.record.time) if self.kept is None else int(self.kept.sum())

    def set_noise(self, sigma: Array, records: int, colour: NoiseColour | None = None) -> None:
        """Set the noise.

        Args:
            sigma: Standard deviation of each channel, SI units. [C].
            records: Number of records from which it was estimated.
            colour: Autocorrelation of the noise; None for white noise.
        """
        self.sigma, self.records, self.colour = sigma, records, colour
        self._find_nuisance()

    def leave_out(self, spans: Sequence[Span]) -> None:
        """Leave out stretches of the record in which something happened that is no part of the model."""
        self.kept = np.ones(len(self.record.time), bool)
        for first, end in spans:
            self.kept[first:end] = False
        self._find_nuisance()

    def digest(self) -> str:
        """Return the SHA-256 of all that signatures depend on."""
        total = hashlib.sha256((self.mechanism.system.digest() + self.record.content_digest()).encode())
        if not self.mechanism.system.controller.closed_loop:
            for q, v in self.states:
                total.update(q.tobytes() + v.tobytes())
        total.update(repr(self.channels).encode())
        return total.hexdigest()


def share_noise(views: Sequence[JointResiduals]) -> None:
    """Pool the noise of records of one mechanism, channel by channel, since the same sensors logged them."""
    if len({view.channels for view in views}) == 1:
        found = pooled([view.sigma for view in views], [view.count for view in views])
        for view, sigma in zip(views, found, strict=True):
            view.set_noise(sigma, len(views))
