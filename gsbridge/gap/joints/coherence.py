"""Is an excess of the residuals motion or noise? Channels that measure the same motion move together, their noises do not.

Noise that is not white (drift, hum, a filter in the sensor) exceeds what the differences of neighbouring samples show, as
missing effects do. Two relations hold for motion alone: speeds are derivatives of positions, and the efforts of a position
controller follow both. Residuals whose channels agree in neither are no sign of a missing effect. What was computed from a
logged position, a speed by differences or the torque of a controller that reads the same encoder, agrees with it in its noise,
too, and bears no witness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.pvalues import tail_pvalue
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HIGHEST = 8.0
"""Hz: above, the derivative of a position is noise."""

_LINE = 1
"""Neighbouring frequencies on either side that belong to one line of a spectrum, as the window spreads it."""

_AROUND = 5
"""Frequencies on either side that tell the level from which a line stands out."""

_SURROGATES = 1999

_ORDER = 4
"""Order of the difference that leaves noise of a channel and no motion."""

_BEHIND, _AHEAD = 8, 2
"""Samples before and after one that its channel may be computed from."""

_COMPUTED = 0.5
"""Share of the noise of a channel that another one tells, from which on the one was computed from the other."""

_AGREED = 0.8
"""Cosine, over all pairs of a joint, from which on channels agree in a line."""

_DRAWS = 20000
"""Random draws of the sums that noise without lines would make."""


@dataclass(frozen=True)
class _Pair:
    """Two spectra of one stretch of time, which motion makes equal.

    Args:
        joint: Number of the joint.
        raw: Spectrum of the first side without a window, from frequency 0. [K].
        one: Spectrum of the first side through the window. [F].
        other: Spectrum of what the first side should be. [F].
        ahead, back: The window's spectrum of `raw` and of its conjugate. [F, K].
    """

    joint: int
    raw: Array
    one: Array
    other: Array
    ahead: Array
    back: Array

    def surrogates(self, rng: np.random.Generator) -> Array:
        """Spectra of records with the first side's spectrum, its phases drawn anew. [S, F]."""
        phases = np.exp(2j * np.pi * rng.random((_SURROGATES, len(self.raw))))
        phases[:, 0] = rng.choice((-1.0, 1.0), _SURROGATES)
        turned = self.raw * phases
        return turned @ self.ahead.T + turned.conj() @ self.back.T


def related(view: JointResiduals, residual: Array) -> list[tuple[str, int]]:
    """Channels that measure, each by itself, the motion that a joint's position does: speeds, and efforts of a controller.

    Args:
        view: A record.
        residual: Whitened; not-a-number at moments that say nothing of it. [T, C].

    Returns:
        Kind and joint of each.
    """
    places = {channel: column for column, channel in enumerate(view.channels)}
    high, out = np.diff(residual, _ORDER, axis=0), list[tuple[str, int]]()
    for k in range(len(view.record.joints)):
        if ("position", k) not in places:
            continue
        sources = high[:, [places[("position", k)]]]
        for kind in _follow(view):
            if (kind, k) not in places:
                continue
            own = high[:, places[(kind, k)]]
            if not _computed(own, sources):
                out.append((kind, k))
            sources = np.concatenate([sources, own[:, None]], axis=1)
    return out


def without_witness(view: JointResiduals, residual: Array) -> Array:
    """Channels of which no other one could show that they move, or do not. [C].

    Args:
        view: A record.
        residual: Whitened. [T, C].
    """
    joints = {k for _, k in related(view, residual)}
    kinds = ("position", *_follow(view))
    return np.array([kind not in kinds or k not in joints for kind, k in view.channels])


def _follow(view: JointResiduals) -> tuple[str, ...]:
    """Kinds of channels that follow from a joint's motion alone."""
    return ("velocity", "effort") if view.mechanism.system.controller.mode == "pd" else ("velocity",)


def _computed(values: Array, sources: Array) -> bool:
    """Whether the noise of a channel is that of others, filtered; moments with not-a-number are left out. [T], [T, S]."""
    rows = len(values) - _BEHIND - _AHEAD
    table = np.stack([column[k : k + rows] for column in sources.T for k in range(_BEHIND + _AHEAD + 1)], axis=1)
    wanted = values[_BEHIND : _BEHIND + rows]
    known = np.isfinite(wanted) & np.isfinite(table).all(axis=1)
    table, wanted, rows = table[known], wanted[known], int(known.sum())
    if rows <= 2 * table.shape[1]:
        return False
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    left = wanted - table @ (np.linalg.lstsq(table / scale, wanted, rcond=1e-9)[0] / scale)
    # Each number that was fitted takes off its part by chance.
    unexplained = (left @ left) / (rows - table.shape[1]) / max(float(wanted @ wanted) / rows, 1e-300)
    return bool(1.0 - unexplained > _COMPUTED)


def coherence_p(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> float:
    """Probability that channels without any relation would agree as well as these do, at all frequencies or in one line.

    Args:
        views: Residuals of some records.
        residuals: Whitened, of each. [T, C].
        rng: Random numbers for the surrogates: the same spectra with phases drawn anew before the window.

    Returns:
        1 where there are no two channels that are related.
    """
    pairs = [pair for view, residual in zip(views, residuals, strict=True) for pair in _pairs(view, residual)]
    if not pairs:
        return 1.0
    # The records themselves come first, their surrogates after them.
    broad: dict[int, Array] = {}
    lines: dict[int, Array] = {}
    for pair in pairs:
        ones = np.concatenate([pair.one[None], pair.surrogates(rng)])
        products, squares = (ones * pair.other.conj()).real, np.abs(ones) ** 2
        own = np.abs(pair.other) ** 2
        agreed = products.sum(axis=1) / np.sqrt(np.maximum(squares.sum(axis=1) * own.sum(), 1e-300))
        narrow = _summed(products) / np.sqrt(np.maximum(_summed(squares) * _summed(own[None]), 1e-300))
        broad[pair.joint] = broad.get(pair.joint, 0.0) + agreed
        lines[pair.joint] = _added(lines.get(pair.joint), narrow)
    # Of the joint where they agree best, and in which line.
    found = np.max(list(broad.values()), axis=0), np.max([line.max(axis=1) for line in lines.values()], axis=0)
    chances = [(values >= values[0]).mean() for values in found]
    return float(min(1.0, len(chances) * min(chances)))


def line_p(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> float:
    """Probability that channels without any relation would share a line of their spectra, as a vibration makes it.

    A line counts as far as it stands out from the noise around it in both of two related channels, and only where they agree:
    hum in one channel alone is none, nor is hum that several have picked up. Lines of all pairs of a joint at one frequency, in
    all records, are added.

    Args:
        views: Residuals of some records of equal length.
        residuals: Whitened, of each. [T, C].
        rng: Random numbers for sums that noise with a smooth spectrum would make.

    Returns:
        1 where there are no two channels that are related.
    """
    pairs = [pair for view, residual in zip(views, residuals, strict=True) for pair in _pairs(view, residual)]
    sums: dict[int, Array] = {}
    counts: dict[int, int] = {}
    for pair in pairs:
        strength = np.minimum(_above(pair.one), _above(pair.other))
        agreed = np.cos(np.angle(pair.one) - np.angle(pair.other))
        sums[pair.joint] = _added(sums.get(pair.joint), np.stack([strength * agreed, strength]))
        counts[pair.joint] = counts.get(pair.joint, 0) + 1
    chances = [1.0]
    for joint, (agreeing, strong) in sums.items():
        line = np.where(agreeing > _AGREED * strong, agreeing, 0.0)
        # Powers of noise are distributed exponentially; the stronger of the two is anything.
        drawn = rng.standard_exponential((_DRAWS, counts[joint])) * np.cos(2 * np.pi * rng.random((_DRAWS, counts[joint])))
        chances.append(tail_pvalue(drawn.sum(axis=1), float(line.max())) * line.size * len(sums))
    return float(min(chances))


def _above(spectrum: Array) -> Array:
    """Power of a spectrum in multiples of its mean around each frequency. [F] -> [F]."""
    power = np.abs(spectrum) ** 2
    padded = np.pad(power, _AROUND, mode="reflect") if len(power) > _AROUND else np.full(len(power) + 2 * _AROUND, power.mean())
    level = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1), axis=1) / np.log(2.0)
    return power / np.maximum(level, 1e-300)


def _summed(values: Array) -> Array:
    """Sums over lines. [S, F] -> [S, F - 2 _LINE]."""
    totals = np.cumsum(np.pad(values, ((0, 0), (1, 0))), axis=1)
    width = 2 * _LINE + 1
    return totals[:, width:] - totals[:, :-width]


def _added(total: Array | None, values: Array) -> Array:
    """Sum of tables of which one may hold more frequencies. [S, F]."""
    if total is None:
        return values
    width = max(total.shape[1], values.shape[1])
    return sum((np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in (total, values)), np.zeros((1, 1)))


def _pairs(view: JointResiduals, residual: Array) -> list[_Pair]:
    """Pairs that motion makes equal: the speed and the position's derivative, the effort and what the controller asks."""
    places = {channel: column for column, channel in enumerate(view.channels)}
    controller, out = view.mechanism.system.controller, []
    witnesses = related(view, residual)
    measured = view.coloured(residual) * view.sigma
    longest = max(end - first for first, end in view.spans) * view.record.period
    for first, end in view.spans:
        rows = end - first
        time = np.arange(rows) * view.record.period
        frequencies = np.arange(1, int(_HIGHEST * longest) + 1) / longest
        if len(frequencies) < 2 * _LINE + 1:
            continue
        window = np.hanning(rows) * np.exp(-2j * np.pi * frequencies[:, None] * time)
        # Frequencies of the stretch without a window, as far as the window brings them to those above.
        count = min(int((_HIGHEST + 4.0 / time[-1]) * rows * view.record.period) + 1, (rows + 1) // 2)
        waves = np.exp(2j * np.pi * np.arange(count) / (rows * view.record.period) * time[:, None]) / rows
        ahead, back = window @ waves, window @ waves.conj()
        # The mean is there once, not as two halves.
        ahead[:, 0], back[:, 0] = 0.5 * ahead[:, 0], 0.5 * back[:, 0]
        values = measured[first:end]
        raw, spectra = np.fft.fft(values, axis=0)[:count], window @ values
        turn = 2j * np.pi * frequencies

        for k in range(len(view.record.joints)):
            position = places.get(("position", k))
            speed = places.get(("velocity", k))
            effort = places.get(("effort", k))
            if position is None:
                continue
            moved = spectra[:, position]
            rate = turn * moved if speed is None else spectra[:, speed]
            if ("velocity", k) in witnesses:
                out.append(_Pair(k, raw[:, speed], spectra[:, speed], turn * moved, ahead, back))
            if ("effort", k) in witnesses:
                asked = -controller.stiffness[k] * moved - controller.damping[k] * rate
                out.append(_Pair(k, raw[:, effort], spectra[:, effort], asked, ahead, back))
    return out
