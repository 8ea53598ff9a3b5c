"""A record seen through a mechanism: residuals in units of the noise, less what the unknown initial state explains."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import comb

from gsbridge.errors import InputError
from gsbridge.gap.effects import effect_of
from gsbridge.gap.records import Record
from gsbridge.gap.replay import Mechanism, Span, State
from gsbridge.gap.setup import Setup
from gsbridge.gap.system import Applied, System
from gsbridge.geometry import Array

KINDS = ("position", "velocity", "effort")

HORIZON = 1.0
"""Length of the stretches into which records of mechanisms without position feedback are cut, s: errors grow over time there,
and a restart from what was measured keeps the later ones readable."""

_WINDOW = 0.06
"""Time over which a state is read from the measurements, s."""

_ORDER = 4
"""Order of the difference whose spread tells the noise: motion is gone from it, white noise is not."""

_BROKEN = 1e3
"""Residual given to a simulation that diverged, in units of the noise."""


def build_setup(mechanism: Mechanism, effects: Sequence[Applied]) -> Setup:
    """A mechanism with its own and further effects.

    Raises:
        InputError: An effect or its joint is unknown.
    """
    setup = mechanism.setup()
    for applied in (*mechanism.system.effects, *effects):
        effect = effect_of(applied.name)
        wanted = {parameter.name for parameter in effect.parameters}
        if set(applied.parameters) != wanted or bool(applied.joint) != (effect.scope == "joint"):
            joint = "and a joint" if effect.scope == "joint" else "and no joint"
            raise InputError(
                f"effect {applied.name}",
                "its parameters are incomplete or unknown",
                f"Give {', '.join(sorted(wanted))} {joint}",
            )
        if applied.joint and applied.joint not in setup.joints:
            raise InputError(f"effect {applied.name}", f"there is no joint '{applied.joint}'", f"Use {', '.join(setup.joints)}")
        effect.apply(setup, setup.joints.index(applied.joint) if applied.joint else -1, applied.parameters)
    return setup


def spans_of(record: Record, system: System) -> list[Span]:
    """Stretches in which a record is replayed: whole under position feedback, else cut at `HORIZON`."""
    total = len(record.time)
    if system.controller.closed_loop:
        return [(0, total)]
    starts = np.searchsorted(record.time, np.arange(0.0, record.duration, HORIZON))
    edges = [*(int(k) for k in starts), total]
    spans = [(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
    if len(spans) > 1 and spans[-1][1] - spans[-1][0] < 0.5 * (spans[0][1] - spans[0][0]):
        spans[-2:] = [(spans[-2][0], total)]
    return spans


def state_at(record: Record, row: int) -> State:
    """Positions and speeds of the joints at a sample, by a parabola through the samples around it. [N], [N]."""
    count = len(record.time)
    reach = max(3, round(_WINDOW / record.period / 2))
    first, last = max(0, row - reach), min(count, row + reach + 1)
    if last - first < 7:
        first, last = (0, min(count, 7)) if row < count // 2 else (max(0, count - 7), count)
    time = record.time[first:last] - record.time[row]
    position = record.measured["position"][first:last]
    rows, values = np.stack([np.ones_like(time), time, time**2], axis=1), position
    if "velocity" in record.measured:
        # Positions and speeds together, each weighed by its own spread.
        weight = _spread(position) / np.maximum(_spread(record.measured["velocity"][first:last]), 1e-12)
        weight = np.clip(weight, 1e-6, record.period * 10).mean()
        rows = np.concatenate([rows, weight * np.stack([0 * time, np.ones_like(time), 2 * time], axis=1)])
        values = np.concatenate([values, weight * record.measured["velocity"][first:last]])
    fit = np.linalg.lstsq(rows, values, rcond=None)[0]
    return fit[0], fit[1]


def _spread(values: Array) -> Array:
    return np.maximum(np.std(np.diff(values, 2, axis=0), axis=0), 1e-9)


def white_noise(values: Array) -> Array:
    """Spread of the white noise on smooth series, robust against jumps. [T, N] -> [N]."""
    high = np.diff(values, _ORDER, axis=0)
    norm = np.sqrt(sum(comb(_ORDER, k) ** 2 for k in range(_ORDER + 1)))
    return 1.4826 * np.median(np.abs(high - np.median(high, axis=0)), axis=0) / norm


@dataclass
class View:
    """A record, the mechanism that replays it, and the noise.

    Args:
        mechanism: Simulates.
        record: Commands and measurements.
        spans: Stretches.
        states: Their initial states as measured.
        sigma: Noise of each channel. [C].
        channels: Kind and joint of each channel, in the order of the residuals' columns.
    """

    mechanism: Mechanism
    record: Record
    spans: list[Span]
    states: list[State]
    sigma: Array
    channels: tuple[tuple[str, int], ...]

    @classmethod
    def of(cls, mechanism: Mechanism, record: Record, effects: Sequence[Applied] = ()) -> View:
        """Look at a record; the noise is what the record states, or what is left above all motion after a replay."""
        system = mechanism.system
        spans = spans_of(record, system)
        states = [state_at(record, first) for first, _ in spans]
        # What the controller asks is the command itself where nothing is fed back.
        kinds = [k for k in KINDS if k in record.measured and (k != "effort" or system.controller.closed_loop)]
        channels = tuple((kind, k) for kind in kinds for k in range(len(record.joints)))
        view = cls(mechanism, record, spans, states, np.ones(len(channels)), channels)
        view.sigma = view._noise(view._raw(view.simulate(effects)))
        view._find_nuisance(effects)
        return view

    def simulate(self, effects: Sequence[Applied] = ()) -> dict[str, Array]:
        """Outputs of the mechanism with effects."""
        return self.mechanism.run(self.record, build_setup(self.mechanism, effects), self.spans, self.states)

    def stack(self, outputs: Mapping[str, Array]) -> Array:
        """Channels side by side, SI units. [T, C]."""
        return np.stack([outputs[kind][:, k] for kind, k in self.channels], axis=1)

    def _raw(self, outputs: Mapping[str, Array]) -> Array:
        return self.stack(self.record.measured) - self.stack(outputs)

    def _noise(self, residual: Array) -> Array:
        """Noise of each channel. [T, C] -> [C]."""
        out = np.empty(len(self.channels))
        inside = np.where(np.isfinite(residual), residual, 0.0)
        found = np.median([white_noise(inside[a:b]) for a, b in self.spans if b - a > 20] or [white_noise(inside)], axis=0)
        for column, (kind, k) in enumerate(self.channels):
            declared = self.record.sigma.get(kind)
            quantum = self.record.quantum.get(kind, np.zeros(len(self.record.joints)))[k]
            out[column] = max(found[column] if declared is None else declared[k], quantum / np.sqrt(12), 1e-12)
        return out

    def _find_nuisance(self, effects: Sequence[Applied]) -> None:
        """Directions in which the outputs move with the initial state; residuals are taken orthogonal to them."""
        base, columns = self.stack(self.simulate(effects)), []
        count = len(self.record.joints)
        for k in range(2 * count):
            size = 1e-4 if k < count else 1e-3
            shifted = [(q + size * (np.arange(count) == k), v + size * (np.arange(count) == k - count)) for q, v in self.states]
            moved = self.mechanism.run(self.record, build_setup(self.mechanism, effects), self.spans, shifted)
            columns.append((self.stack(moved) - base) / size / self.sigma)
        self._basis = []
        for first, end in self.spans:
            block = np.stack([np.nan_to_num(column[first:end]).ravel() for column in columns], axis=1)
            left, values, _ = np.linalg.svd(block / np.maximum(np.linalg.norm(block, axis=0), 1e-12), full_matrices=False)
            self._basis.append(left[:, values > 1e-6])

    def project(self, whitened: Array) -> Array:
        """Take out what the initial states explain. [T, C] -> [T, C]."""
        out = np.zeros_like(whitened)
        for (first, end), basis in zip(self.spans, self._basis, strict=True):
            part = whitened[first:end].ravel()
            out[first:end] = (part - basis @ (basis.T @ part)).reshape(end - first, -1)
        return out

    def whiten(self, difference: Array) -> Array:
        """Differences in units of the noise, orthogonal to the initial states. [T, C] -> [T, C]."""
        scaled = difference / self.sigma
        return self.project(np.where(np.isfinite(scaled), np.clip(scaled, -1e6, 1e6), _BROKEN))

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Measured less simulated, in units of the noise. [T, C]."""
        return self.whiten(self._raw(self.simulate(effects)))

    @property
    def freedom(self) -> int:
        """Independent numbers in a residual."""
        return len(self.record.time) * len(self.channels) - sum(basis.shape[1] for basis in self._basis)

    def digest(self) -> str:
        """SHA-256 of what signatures depend on."""
        total = hashlib.sha256((self.mechanism.system.digest() + self.record.content_digest()).encode())
        if not self.mechanism.system.controller.closed_loop:
            for q, v in self.states:
                total.update(q.tobytes() + v.tobytes())
        total.update(repr(self.channels).encode())
        return total.hexdigest()
