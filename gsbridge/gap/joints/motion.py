"""Whether residuals beyond white noise are motion of the mechanism, or noise of another colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.joints.coherence import coherence_p, line_p, related, without_witness
from gsbridge.gap.joints.noise_colour import NoiseColour, forgetful
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HUGE = 5.0
"""Residual, in units of the noise, from which on a channel that no other one bears witness to is taken to move."""

_JOLT, _NORMAL = 6.0, 1.4826
"""Residual, in multiples of the usual one, of a moment that no noise makes in two channels at once, and standard deviation of
normal noise in units of its median size."""

_TOGETHER = 0.002
"""Probability below which channels do not move together by chance. Smaller than that of an alarm, since nothing else speaks for
motion where this decides."""


def is_motion(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator, deviations: float) -> bool:
    """Whether the channels of the residuals move together or jolt at once, or are large and follow the mechanism.

    Noise that passed a filter is any number of times what neighbouring samples tell of it.

    Args:
        views: The records `fit` and `select`.
        residuals: Whitened, of each. [T, C].
        rng: Generator of surrogates.
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
    return coherence_p(views, residuals, rng) < _TOGETHER or vibrates(views, residuals, rng)


def jolted(view: JointResiduals, residual: Array) -> set[int]:
    """Joints of which two channels err at once, for a moment, by far more than at all other times.

    A belt that slips and a stop that is hit are over in some samples, which hardly show in a spectrum.

    Args:
        view: A record.
        residual: Whitened. [T, C].
    """
    usual = np.maximum(1.0, _NORMAL * np.median(np.abs(residual), axis=0))
    large = np.abs(residual) > _JOLT * usual
    # Two samples of one moment may be neighbours.
    around = large.copy()
    around[1:] |= large[:-1]
    around[:-1] |= large[1:]
    # Whether a channel was computed from another one is told by all other moments.
    witnesses = related(view, np.where(around.any(axis=1, keepdims=True), np.nan, residual))
    places = {channel: column for column, channel in enumerate(view.channels)}
    return {k for kind, k in witnesses if (around[:, places[(kind, k)]] & around[:, places[("position", k)]]).any()}


def other_noise(
    views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator, deviations: float
) -> tuple[Array, list[NoiseColour]] | None:
    """What the noise is, if residuals beyond white noise are noise that forgets itself soon; None if they are motion, perhaps.

    Its size is told by the first two records alone, so that the third can still refute what was found.

    Args:
        views: The records `fit`, `select` and `verify`, with white noise.
        residuals: What an explanation leaves of each, whitened. [T, C].
        rng: Generator of surrogates.
        deviations: Standard deviations by which a mean gain on `select` must exceed chance.

    Returns:
        Its standard deviation, [C], and its law in each record.
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
    """Whether channels of a joint share a line of their spectra, which no colour of the noise makes.

    Args:
        views: The records `fit` and `select`.
        residuals: Whitened, of each. [T, C].
        rng: Generator of surrogates.
    """
    return line_p(views, residuals, rng) < _TOGETHER


def _without_course(views: Sequence[JointResiduals], residuals: Sequence[Array]) -> Array:
    """Residual on the last record without what the first teaches of how it goes with the nominal motion of each joint. [T, C].

    A sensor in another scale errs by the motion, though nothing moves otherwise.
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
