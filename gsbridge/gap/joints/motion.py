"""Whether residuals beyond white noise are motion of the mechanism, or noise of another colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.joints.coherence import coherence_p, line_p, without_witness
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HUGE = 5.0
"""Residual, in units of the noise, from which on a channel that no other one bears witness to is taken to move."""

_TOGETHER = 0.002
"""Probability below which channels do not move together by chance. Smaller than that of an alarm, since nothing else speaks for
motion where this decides."""


def is_motion(views: Sequence[JointResiduals], residuals: Sequence[Array], rng: np.random.Generator, deviations: float) -> bool:
    """Whether the channels of the residuals move together, or are large and follow the mechanism, as far as can be told.

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
    return coherence_p(views, residuals, rng) < _TOGETHER or vibrates(views, residuals, rng)


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
