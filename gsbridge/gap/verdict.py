"""The verdict over trials: which one is best, which others cannot be told from it, and whether any is good enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from gsbridge.gap.trials import Rules, Trial
from gsbridge.geometry import Array

_BLOCKS = 40
"""Blocks of time of a bootstrap."""


@dataclass(frozen=True)
class Decision:
    """Of a set of trials.

    Args:
        trials: Explanations that say something of their own, the best first.
        chances: Probability that each is best. [trials].
        near: Those that cannot be told from the best.
    """

    trials: tuple[Trial, ...]
    chances: Array
    near: tuple[Trial, ...]


def decide(trials: Sequence[Trial], rules: Rules, floor: float, rng: np.random.Generator) -> Decision:
    """Rank trials.

    Args:
        trials: Converged fits.
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
        rng: Of the bootstrap.
    """
    ranked = sorted(trials, key=lambda trial: trial.score)
    # What would have to be larger than makes sense explains nothing, beside something sensible that does as well.
    sensible = [trial for trial in ranked if not trial.fit.stopped]
    if sensible and sensible[0].score - ranked[0].score < rules.margin * max(1.0, sensible[0].chi2 / floor):
        ranked = sensible
    best = ranked[0]
    wide = max(1.0, best.chi2 / floor)
    earn = rules.earn * wide
    # What holds a simpler explanation as a special case must earn its further parameters, and otherwise says nothing else.
    for trial in sorted(ranked[1:], key=lambda trial: trial.parameters):
        if best.contains(trial) and trial.score - best.score < earn:
            best = trial
    others = [t for t in ranked if t is not best and not (t.contains(best) and best.score - t.score < earn)]
    # So must a set of several effects that takes more parameters to do as well: enough of them mimic anything.
    others = [t for t in others if not (_is_larger(t, best) and best.squares - t.squares < earn)]
    kept = [best, *others]
    chances = _chances(kept, rng, rules.draws)
    margin = rules.margin * wide
    near = tuple(
        trial
        for trial, chance in zip(others, chances[1:], strict=True)
        # A rival that does better on the record that none has seen is one, whatever the fitted record says.
        if trial.score - best.score < margin or best.chi2 - trial.chi2 > earn or chance > 1.0 - rules.sure
    )
    return Decision(tuple(kept), chances, near)


def _is_larger(trial: Trial, best: Trial) -> bool:
    """Whether a trial is a set of several effects with more parameters than the best explanation."""
    return len(trial.fit.who) > 1 and trial.parameters > best.parameters


def _chances(trials: Sequence[Trial], rng: np.random.Generator, draws: int) -> Array:
    """Probability that each trial is best, by a bootstrap over blocks of time of both records. [trials]."""
    totals = np.array([[2.0 * trial.parameters] for trial in trials])
    for residuals in ([trial.residual for trial in trials], [trial.first for trial in trials]):
        squares = np.stack([(residual**2).sum(axis=1) for residual in residuals])
        length = max(5, squares.shape[1] // _BLOCKS)
        rows = squares.shape[1] // length
        blocks = squares[:, : rows * length].reshape(len(trials), rows, length).sum(axis=2)
        totals = totals + blocks[:, rng.integers(0, rows, (draws, rows))].sum(axis=2)
    return np.bincount(totals.argmin(axis=0), minlength=len(trials)) / draws


def transfer(plain: Array, residual: Array) -> float:
    """By how many standard deviations an explanation agrees with a record that it was not fitted to. Both [T, C].

    What it explains is held against the residual without it, and the spread of that against what it leaves: from blocks of
    time, so that coloured noise does not count as certainty. An explanation that acts in a few blocks only (a limit) is held
    against what is left at all other times, too.
    """
    part = plain - residual
    length = max(5, len(plain) // _BLOCKS)
    rows = len(plain) // length
    part, left = part[: rows * length], residual[: rows * length]

    def blocks(values: Array) -> Array:
        return values.sum(axis=1).reshape(rows, length).sum(axis=1)

    squares = blocks(part**2)
    if not squares.any():
        return 0.0
    count = float(squares.sum() ** 2 / (squares**2).sum())
    if count * count >= rows:
        variance = float((blocks(left * part) ** 2).sum())
    else:
        moved = [float((left * np.roll(part, k * length, axis=0)).sum()) for k in range(rows)]
        variance, count = float(np.mean(np.square(moved))), rows / count
    # As many blocks, or places, as there are tell the spread; few of them have heavy tails.
    deviations = float((plain[: rows * length] * part).sum()) / max(np.sqrt(variance), 1e-300)
    return float(norm.isf(max(student.sf(deviations, count), 1e-300)))
