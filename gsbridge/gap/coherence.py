"""Is an excess of the residuals motion or noise? Channels that measure the same motion move together, their noises do not.

Noise that is not white (drift, hum, a filter in the sensor) exceeds what the differences of neighbouring samples show, as
missing effects do. Two relations hold for motion alone: speeds are derivatives of positions, and the efforts of a position
controller follow both. Residuals whose channels agree in neither are no sign of a missing effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.view import View
from gsbridge.geometry import Array

_HIGHEST = 8.0
"""Hz: above, the derivative of a position is noise."""

_SURROGATES = 999


def coherence_p(views: Sequence[View], residuals: Sequence[Array], rng: np.random.Generator) -> float:
    """Probability that channels without any relation would agree as well as these do.

    Args:
        views: Of some records.
        residuals: Whitened, of each. [T, C].
        rng: Of the surrogates: the same spectra with phases drawn anew.

    Returns:
        1 where there are no two channels that are related.
    """
    pairs = [pair for view, residual in zip(views, residuals, strict=True) for pair in _pairs(view, residual)]
    if not pairs:
        return 1.0
    seen = _agreement(pairs)
    count = 0
    for _ in range(_SURROGATES):
        turned = [(k, a * np.exp(2j * np.pi * rng.random(a.shape)), b) for k, a, b in pairs]
        count += _agreement(turned) >= seen
    return (1 + count) / (1 + _SURROGATES)


def _agreement(pairs: Sequence[tuple[int, Array, Array]]) -> float:
    """How well the sides agree, 1 for each relation that holds; that of the joint where they agree best."""
    totals: dict[int, float] = {}
    for k, a, b in pairs:
        size = np.sqrt((np.abs(a) ** 2).sum() * (np.abs(b) ** 2).sum())
        totals[k] = totals.get(k, 0.0) + float((a * b.conj()).real.sum() / max(size, 1e-300))
    return max(totals.values())


def _pairs(view: View, residual: Array) -> list[tuple[int, Array, Array]]:
    """Joint and two spectra that motion makes equal: of the speed and the position's derivative, of effort and controller."""
    places = {channel: column for column, channel in enumerate(view.channels)}
    controller, out = view.mechanism.system.controller, []
    for first, end in view.spans:
        rows = end - first
        window = np.hanning(rows)[:, None]
        frequencies = np.fft.rfftfreq(rows, view.record.period)
        low = (frequencies > 0) & (frequencies <= _HIGHEST)
        spectra = np.fft.rfft(residual[first:end] * view.sigma * window, axis=0)[low]
        turn = 2j * np.pi * frequencies[low]
        for k in range(len(view.record.joints)):
            position = places.get(("position", k))
            speed = places.get(("velocity", k))
            effort = places.get(("effort", k))
            if position is None:
                continue
            moved = spectra[:, position]
            rate = turn * moved if speed is None else spectra[:, speed]
            if speed is not None:
                out.append((k, rate, turn * moved))
            if effort is not None and controller.mode == "pd":
                asked = -controller.stiffness[k] * moved - controller.damping[k] * rate
                out.append((k, spectra[:, effort], asked))
    return out
