"""Test whether residuals are motion or noise: channels that measure the same motion are coherent, their noises are not.

Noise that is not white (drift, hum, a filter in the sensor) exceeds what the differences of neighbouring samples show, as
missing effects do. Two relations hold for motion alone: speeds are derivatives of positions, and the efforts of a position
controller follow both. Residuals whose channels agree in neither are no sign of a missing effect. A channel that was computed
from a logged position (a speed by differences, the torque of a controller that reads the same encoder) shares its noise with
the position and can therefore confirm nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.pvalues import tail_pvalue
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HIGHEST = 8.0
"""Highest frequency that is compared, Hz: above it, the derivative of a position is mostly noise."""

_LINE = 1
"""Neighbouring frequencies on either side that belong to one line of a spectrum, since the window spreads it."""

_AROUND = 5
"""Neighbouring frequencies on either side from which the noise level around a line is estimated."""

_SURROGATES = 1999

_ORDER = 4
"""Order of the difference that removes the motion from a channel and leaves its noise."""

_BEHIND, _AHEAD = 8, 2
"""Samples before and after a sample from which it may have been computed."""

_COMPUTED = 0.5
"""Share of a channel's noise that other channels must predict for the channel to count as computed from them."""

_AGREED = 0.8
"""Mean cosine of the phase differences of a joint's pairs, weighted by strength, above which channels agree in a line."""

_DRAWS = 20000
"""Random draws for the null distribution of a line's sum in noise without lines."""


@dataclass(frozen=True)
class _Pair:
    """Two spectra of one stretch of time that are equal if the residual is motion.

    Args:
        joint: Number of the joint.
        raw: Spectrum of the first channel without a window, from frequency 0. [K].
        one: Spectrum of the first channel with the window. [F].
        other: Spectrum that the first channel should have by the motion in other channels, with the window. [F].
        ahead, back: Matrices that turn `raw` and its conjugate into the windowed spectrum. [F, K].
    """

    joint: int
    raw: Array
    one: Array
    other: Array
    ahead: Array
    back: Array

    def surrogates(self, rng: np.random.Generator) -> Array:
        """Draw windowed spectra of series with the first channel's amplitudes and random phases. [S, F]."""
        phases = np.exp(2j * np.pi * rng.random((_SURROGATES, len(self.raw))))
        phases[:, 0] = rng.choice((-1.0, 1.0), _SURROGATES)
        turned = self.raw * phases
        return turned @ self.ahead.T + turned.conj() @ self.back.T


def related(view: JointResiduals, residual: Array) -> list[tuple[str, int]]:
    """Find channels that follow the motion of a joint's logged position but have noise of their own: speeds and efforts.

    Args:
        view: Residuals on a record.
        residual: Whitened residual; not-a-number at moments that are not to be used. [T, C].

    Returns:
        Kind and joint of each channel.
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
    """Mark channels for which no independent channel can tell motion from noise. [C] bool.

    Args:
        view: Residuals on a record.
        residual: Whitened residual. [T, C].
    """
    joints = {k for _, k in related(view, residual)}
    kinds = ("position", *_follow(view))
    return np.array([kind not in kinds or k not in joints for kind, k in view.channels])


def _follow(view: JointResiduals) -> tuple[str, ...]:
    """Return the kinds of channels that follow from a joint's motion alone."""
    return ("velocity", "effort") if view.mechanism.system.controller.mode == "pd" else ("velocity",)


def _computed(values: Array, sources: Array) -> bool:
    """Tell whether a channel's noise [T] is that of other channels [T, S], filtered; not-a-number is left out."""
    rows = len(values) - _BEHIND - _AHEAD
    table = np.stack([column[k : k + rows] for column in sources.T for k in range(_BEHIND + _AHEAD + 1)], axis=1)
    wanted = values[_BEHIND : _BEHIND + rows]
    known = np.isfinite(wanted) & np.isfinite(table).all(axis=1)
    table, wanted, rows = table[known], wanted[known], int(known.sum())
    if rows <= 2 * table.shape[1]:
        return False
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    left = wanted - table @ (np.linalg.lstsq(table / scale, wanted, rcond=1e-9)[0] / scale)
    # Divide by the degrees of freedom: each fitted coefficient reduces the residual by chance.
    unexplained = (left @ left) / (rows - table.shape[1]) / max(float(wanted @ wanted) / rows, 1e-300)
    return bool(1.0 - unexplained > _COMPUTED)


def coherence_p(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> float:
    """Compute the p-value of the agreement of related channels, over all frequencies or in one line.

    Args:
        views: Residuals on some records.
        residuals: Whitened residual of each record. [T, C] each.
        rng: Random numbers for the surrogates, which have the same amplitudes and random phases.

    Returns:
        Probability that unrelated channels would agree as well; 1 if no channels are related.
    """
    pairs = [pair for view, residual in zip(views, residuals, strict=True) for pair in _pairs(view, residual)]
    if not pairs:
        return 1.0
    # Row 0 holds the record itself, the other rows its surrogates.
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
    # Take the joint with the best agreement: once over all frequencies, once in one line.
    found = np.max(list(broad.values()), axis=0), np.max([line.max(axis=1) for line in lines.values()], axis=0)
    chances = [(values >= values[0]).mean() for values in found]
    return float(min(1.0, len(chances) * min(chances)))


def line_p(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> float:
    """Compute the p-value of a line that related channels share in their spectra, as a vibration makes it.

    A line's strength is its height above the noise around it, the lesser of that in two related channels. It counts only where
    the channels agree in phase, as motion requires: hum in one channel, or hum that several have picked up, does not. The
    strengths of all pairs of a joint at one frequency, in all records, are added.

    Args:
        views: Residuals on some records of equal length.
        residuals: Whitened residual of each record. [T, C] each.
        rng: Random numbers for the null distribution of the sums, for noise with a smooth spectrum.

    Returns:
        Probability that unrelated channels would share such a line; 1 if no channels are related.
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
        # The power of noise is exponentially distributed. The lesser of a pair is drawn as if the other were always larger.
        drawn = rng.standard_exponential((_DRAWS, counts[joint])) * np.cos(2 * np.pi * rng.random((_DRAWS, counts[joint])))
        chances.append(tail_pvalue(drawn.sum(axis=1), float(line.max())) * line.size * len(sums))
    return float(min(chances))


def _above(spectrum: Array) -> Array:
    """Compute the power of a spectrum in multiples of the mean power around each frequency. [F] -> [F]."""
    power = np.abs(spectrum) ** 2
    padded = np.pad(power, _AROUND, mode="reflect") if len(power) > _AROUND else np.full(len(power) + 2 * _AROUND, power.mean())
    level = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1), axis=1) / np.log(2.0)
    return power / np.maximum(level, 1e-300)


def _summed(values: Array) -> Array:
    """Sum values over the frequencies of each line. [S, F] -> [S, F - 2 _LINE]."""
    totals = np.cumsum(np.pad(values, ((0, 0), (1, 0))), axis=1)
    width = 2 * _LINE + 1
    return totals[:, width:] - totals[:, :-width]


def _added(total: Array | None, values: Array) -> Array:
    """Add tables of which one may hold more frequencies. [S, F]."""
    if total is None:
        return values
    width = max(total.shape[1], values.shape[1])
    return sum((np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in (total, values)), np.zeros((1, 1)))


def _pairs(view: JointResiduals, residual: Array) -> list[_Pair]:
    """Make the pairs of spectra that motion makes equal.

    These are the speed and the position's derivative, and the effort and what the controller would ask for.
    """
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
        # Frequencies of the unwindowed stretch, as far up as the window spreads them into the compared ones.
        count = min(int((_HIGHEST + 4.0 / time[-1]) * rows * view.record.period) + 1, (rows + 1) // 2)
        waves = np.exp(2j * np.pi * np.arange(count) / (rows * view.record.period) * time[:, None]) / rows
        ahead, back = window @ waves, window @ waves.conj()
        # Frequency 0 is its own conjugate: halve both terms, so that the mean is counted once.
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
