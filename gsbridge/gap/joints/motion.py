"""Decide whether residuals beyond white noise are motion of the mechanism or coloured noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.joints.coherence import coherence_p, line_p, related, without_witness
from gsbridge.gap.joints.noise_colour import NoiseColour, forgetful
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HUGE = 5.0
"""Root mean square residual, in units of the noise, from which on a channel that no other can confirm is taken to move."""

_JOLT, _NORMAL = 6.0, 1.4826
"""Residual, in multiples of the usual size, above which a moment counts as a jolt if two channels show it at once; and ratio of
the standard deviation of normal noise to its median absolute value."""

_TOGETHER = 0.002
"""p-value below which channels do not move together by chance. It is smaller than that of an alarm, since where this test
decides nothing else speaks for motion."""


def is_motion(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator, deviations: float) -> bool:
    """Tell whether residuals are motion: channels move together or jolt at once, or are large and follow the mechanism.

    Size alone proves nothing: filtered noise may be many times as large as neighbouring samples show.

    Args:
        views: Residuals on `fit` and `select`.
        residuals: Whitened residual of each record. [T, C] each.
        rng: Random numbers for surrogates.
        deviations: Standard deviations by which a mean gain on `select` must exceed chance.
    """
    huge = np.zeros(residuals[-1].shape[1], bool)
    for view, residual in zip(views, residuals, strict=True):
        large = np.sqrt((residual**2).mean(axis=0)) >= _HUGE
        if large[without_witness(view, residual)].any():
            return True
        huge |= large
    if huge.any() and transfer(residuals[-1][:, huge], _without_course(views, residuals)[:, huge]) > deviations:
        return True
    if set.intersection(*(jolted(view, row) for view, row in zip(views, residuals, strict=True))):
        return True
    return moves_together(views, residuals, rng) or vibrates(views, residuals, rng)


def moves_together(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> bool:
    """Tell whether channels that measure the same motion agree by more than chance.

    The more records are given, the smaller is the motion that shows.

    Args:
        views: Residuals on some records.
        residuals: Whitened residual of each record. [T, C] each.
        rng: Random numbers for surrogates.
    """
    return coherence_p(views, residuals, rng) < _TOGETHER


def jolted(view: JointResiduals, residual: Array) -> set[int]:
    """Find joints of which two channels have, at the same moment, far larger residuals than at all other times.

    A slipping belt or a hit stop lasts a few samples only, which hardly show in a spectrum.

    Args:
        view: Residuals on a record.
        residual: Whitened residual. [T, C].
    """
    usual = np.maximum(1.0, _NORMAL * np.median(np.abs(residual), axis=0))
    large = np.abs(residual) > _JOLT * usual
    # The same jolt may fall on neighbouring samples in two channels.
    around = large.copy()
    around[1:] |= large[:-1]
    around[:-1] |= large[1:]
    # Whether a channel was computed from another one is judged without these moments.
    witnesses = related(view, np.where(around.any(axis=1, keepdims=True), np.nan, residual))
    places = {channel: column for column, channel in enumerate(view.channels)}
    return {k for kind, k in witnesses if (around[:, places[(kind, k)]] & around[:, places[("position", k)]]).any()}


def other_noise(
    views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator, deviations: float
) -> tuple[Array, list[NoiseColour]] | None:
    """Estimate the noise from residuals, if these are coloured noise with a short memory; None if they may be motion.

    The size of the noise is taken from the first two records alone, so that the third can still refute an explanation.

    Args:
        views: Residuals on `fit`, `select` and `verify`, with white noise.
        residuals: Whitened residual that an explanation leaves on each record. [T, C] each.
        rng: Random numbers for surrogates.
        deviations: Standard deviations by which a mean gain on `select` must exceed chance.

    Returns:
        Standard deviation of the noise of each channel, SI units [C], and its colour in each record.
    """
    parts = [[residual[a:b] for a, b in view.spans] for view, residual in zip(views, residuals, strict=True)]
    sizes = [np.sqrt((residual**2).mean(axis=0)) for residual in residuals]
    colours = [NoiseColour.of(part) for part in parts]
    laws = zip(colours, sizes, views, strict=True)
    if not all(forgetful(colour, size, view.record.period) for colour, size, view in laws):
        return None
    told, left = views[:2], residuals[:2]
    if any(without_witness(view, residual).any() for view, residual in zip(told, left, strict=True)):
        return None
    if is_motion(told, left, rng, deviations):
        return None
    return np.sqrt(np.mean([(size * view.sigma) ** 2 for size, view in zip(sizes, told, strict=False)], axis=0)), colours


def vibrates(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator) -> bool:
    """Tell whether channels of a joint share a line of their spectra, as a vibration makes it and coloured noise does not.

    Args:
        views: Residuals on `fit` and `select`.
        residuals: Whitened residual of each record. [T, C] each.
        rng: Random numbers for the null distribution.
    """
    return line_p(views, residuals, rng) < _TOGETHER


def _without_course(views: Sequence[JointResiduals], residuals: Sequence[Array]) -> Array:
    """Subtract from the last residual what a regression on each joint's nominal motion, fitted to the first, predicts. [T, C].

    The error of a sensor with a wrong scale is proportional to the motion, although the mechanism moves as simulated.
    """
    known, other = residuals
    out = np.empty_like(other)
    for column, (_, joint) in enumerate(views[0].channels):
        own = [place for place, (_, k) in enumerate(views[0].channels) if k == joint]
        replays = [np.nan_to_num(view.replay()[:, own]) for view in views]
        tables = [np.column_stack([replay, np.ones(len(replay))]) for replay in replays]
        taught = np.linalg.lstsq(tables[0], known[:, column], rcond=1e-9)[0]
        out[:, column] = other[:, column] - tables[1] @ taught
    return out
