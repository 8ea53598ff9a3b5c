"""The verdict over trials: which one is best, which others cannot be told from it, and whether any is good enough."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import norm
from scipy.stats import t as student

from gsbridge.gap.diagnosis.closure import beyond_noise
from gsbridge.gap.diagnosis.results import Finding, Hypothesis, Rules
from gsbridge.geometry import Array

_ERRING = 1.5
"""Squared residual of a number, in units of the noise, from which on the best explanation errs visibly."""

_BLOCKS = 40
"""Blocks of time that tell how a sum spreads."""

_REMEMBERED = 8
"""Blocks over which what is left may remember itself."""


@dataclass(frozen=True)
class Decision:
    """How a set of trials compares: the best of them, and those that cannot be told from it.

    Args:
        trials: Explanations that say something of their own, the best first.
        chances: Probability that each is best. [trials].
        near: Explanations that cannot be told from the best.
    """

    trials: tuple[Hypothesis, ...]
    chances: Array
    near: tuple[Hypothesis, ...]


def decide(trials: Sequence[Hypothesis], rules: Rules, floor: float) -> Decision:
    """Rank trials.

    Args:
        trials: Converged fits.
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
    """
    ranked = sorted(trials, key=lambda trial: trial.score)
    # What would have to be larger than makes sense explains nothing, beside something sensible that does as well.
    sensible = [trial for trial in ranked if not trial.fit.stopped]
    if sensible and sensible[0].score - ranked[0].score < rules.margin * max(1.0, sensible[0].chi2 / floor):
        ranked = sensible
    best = ranked[0]
    wide = max(1.0, best.chi2 / floor)
    # Where a model errs, one number more always explains a part of the error: it must explain more than it leaves.
    left = max(best.squares - 2.0 * floor, 0.0) if wide > _ERRING else 0.0
    # Schwarz's allowance instead of Akaike's, which the scores hold already.
    schwarz = max(rules.simple, np.log(best.residual.size + best.first.size) - 2.0)
    earn, simple = rules.earn * wide, max(schwarz * wide, left)
    # What holds a simpler explanation as a special case must earn its further parameters, and otherwise says nothing else.
    for trial in sorted(ranked[1:], key=lambda trial: trial.parameters):
        if best.contains(trial) and trial.score - best.score < simple:
            best = trial
    others = [t for t in ranked if t is not best and not (t.contains(best) and best.score - t.score < simple)]
    # So must a set of several effects that takes more parameters to do as well: enough of them mimic anything.
    others = [t for t in others if not (_is_larger(t, best) and best.squares - t.squares < earn)]
    kept = _without_unsure_parts([best, *others], rules.sure)
    best, others, chances = kept[0], kept[1:], _chances(kept)
    # What the probability asks of white noise, and more where the best leaves more than noise.
    margin = _margin(rules) * wide
    near = tuple(
        trial
        for trial, chance in zip(others, chances[1:], strict=True)
        # A rival that does better on the record that none has seen is one, whatever the fitted record says.
        if trial.score - best.score < margin or best.chi2 - trial.chi2 > earn or chance > 1.0 - rules.sure
    )
    return Decision(tuple(kept), chances, near)


def _without_unsure_parts(trials: list[Hypothesis], sure: float) -> list[Hypothesis]:
    """Trials, the best first, without sets of effects of which a part may as well be all that there is.

    One effect more than there is always explains some of a coloured residual: it must be as sure as a name.
    """

    def unsure(whole: Hypothesis, part: Hypothesis) -> bool:
        return set(part.fit.who) < set(whole.fit.who) and _chances([whole, part])[0] < sure

    while True:
        parts = [trial for trial in trials[1:] if unsure(trials[0], trial)]
        if not parts:
            return trials
        best = min(parts, key=lambda trial: trial.score)
        trials = [best, *(trial for trial in trials if trial is not best and not unsure(trial, best))]


def _is_larger(trial: Hypothesis, best: Hypothesis) -> bool:
    """Whether a trial is a set of several effects with more parameters than the best explanation."""
    return len(trial.fit.who) > 1 and trial.parameters > best.parameters


def _chances(trials: Sequence[Hypothesis], third: Sequence[Array] | None = None) -> Array:
    """Probability that each trial is best, the first being the best guess. [trials].

    Likelihoods, tempered: if the noise were white, squared residuals would be twice the negative logarithms. How much more they
    spread is taken from blocks of time of the records: of what the best guess leaves, along what the other would change.

    Args:
        trials: Explanations.
        third: What each leaves of a third record; None to look at two. [T, C] each.
    """
    best, odds = trials[0], [0.0]
    for number, trial in enumerate(trials[1:], 1):
        variance = squares = 0.0
        pairs, ahead = [(best.residual, trial.residual), (best.first, trial.first)], best.score - trial.score
        if third is not None:
            pairs.append((third[0], third[number]))
            ahead += float((third[0] ** 2).sum() - (third[number] ** 2).sum())
        for left, other in pairs:
            apart = other - left
            variance += _spread(left, apart)[0]
            squares += float((apart**2).sum())
        odds.append(0.5 * ahead / max(1.0, variance / max(squares, 1e-300)))
    weights = np.exp(np.array(odds) - max(odds))
    return weights / weights.sum()


def third_opinion(finding: Finding, left_by: Callable[[Hypothesis], Array], rules: Rules, floor: float) -> Finding:
    """A finding that cannot decide, with its best explanation named where `verify` makes it as sure as a name.

    `verify` cannot put another one in its place: what two records leave open is asked about once.

    Args:
        finding: What two records tell.
        left_by: What an explanation leaves of `verify`, in units of the noise. [T, C].
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
    """
    best = finding.best
    trials = [trial for trial, _ in finding.rivals if " + ".join(trial.names) in finding.ambiguous]
    if finding.verdict != "ambiguous" or best is None or len(trials) < len(finding.ambiguous) or trials[0] is not best:
        return finding
    third, wide = [left_by(trial) for trial in trials], max(1.0, best.chi2 / floor)
    for trial, residual in zip(trials[1:], third[1:], strict=True):
        behind = trial.score - best.score + float((residual**2).sum() - (third[0] ** 2).sum())
        if behind < _margin(rules) * wide or best.chi2 - trial.chi2 > rules.earn * wide:
            return finding
    sure = _chances(trials, third)[0] >= rules.sure
    return replace(finding, verdict="named", ambiguous=()) if sure else finding


def _margin(rules: Rules) -> float:
    """What the probability of a name asks of squared residuals, for white noise."""
    return float(2.0 * np.log(rules.sure / (1.0 - rules.sure)))


def slim(trials: Sequence[Hypothesis], rules: Rules, floor: float, plain: float) -> list[Hypothesis]:
    """Leave out sets that are hardly better than one of their subsets, or by less than an entry of an account must explain.

    An effect that explains so little of a gap makes up for errors in the model of those that explain the rest.

    Args:
        trials: Fits of sets of effects.
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
        plain: Squared residual of the model as it is on `select`.
    """
    out, gap = [], beyond_noise(plain, floor)
    for trial in trials:
        parts = [t for t in trials if set(t.fit.who) < set(trial.fit.who)]
        left = beyond_noise(trial.chi2, floor)
        if all(
            t.score - trial.score > rules.join * max(1.0, trial.chi2 / floor)
            and beyond_noise(t.chi2, floor) - left >= rules.least * gap
            for t in parts
        ):
            out.append(trial)
    return out


def transfer(plain: Array, residual: Array, *, remembered: bool = True) -> float:
    """How well an explanation agrees with a record that it was not fitted to, in standard deviations.

    What it explains is held against the residual without it, and the spread of that against what it leaves: from blocks of
    time, so that coloured noise does not count as certainty. An explanation that acts in a few blocks only (a limit) is held
    against what is left at all other times, too.

    Args:
        plain: Residual without it. [T, C].
        residual: Residual with it. [T, C].
        remembered: Whether blocks that are alike count for less, as noise that remembers itself asks. What is left of a real
            arm's motion comes back with it and is alike all along: that holds back an effect beside others, not an alarm.
    """
    part = plain - residual
    if not part.any():
        return 0.0
    variance, count = _spread(residual, part)
    # As many blocks, or places, as there are tell the spread; few of them have heavy tails.
    memory = _memory(residual, part) if remembered else 1.0
    deviations = float((plain * part).sum()) / max(np.sqrt(variance * memory), 1e-300)
    return float(norm.isf(max(student.sf(deviations, count), 1e-300)))


def told_apart(some: Sequence[Array], others: Sequence[Array]) -> float:
    """By how many standard deviations one explanation errs less than another, on several records. [T, C] each.

    Where both err much for a while, that tells little of either: each moment counts by what they leave around it. A delay that
    jitters errs most in fast motion, and what parts it from a filter shows where the motion turns.

    Args:
        some: What the one leaves of each record, in units of the noise. [T, C] each.
        others: What the other leaves. [T, C] each.
    """
    rows = []
    for one, other in zip(some, others, strict=True):
        around = uniform_filter1d(0.5 * (one.astype(np.float64) ** 2 + other**2), max(5, len(one) // _BLOCKS), axis=0)
        weights = 1.0 / np.sqrt(np.maximum(around, 1.0))
        rows.append((weights * one, weights * other))
    gain = 0.5 * sum(float((other**2).sum() - (one**2).sum()) for one, other in rows)
    # What the better one leaves is taken for noise.
    pairs = [(one, other - one) if gain > 0.0 else (other, one - other) for one, other in rows]
    variance = sum(_spread(*pair)[0] * _memory(*pair) for pair in pairs)
    return gain / max(float(np.sqrt(variance)), 1e-300)


def _memory(left: Array, part: Array) -> float:
    """Factor on the variance of the product of residual and change, since neighbouring blocks are correlated. Both [T, C].

    Source: Newey and West, Econometrica 55, 1987.
    """
    length = max(5, len(part) // _BLOCKS)
    rows = len(part) // length
    sums = (left * part).sum(axis=1)[: rows * length].reshape(rows, length).sum(axis=1)
    squares = total = float(sums @ sums)
    for lag in range(1, min(_REMEMBERED, rows - 1) + 1):
        total += 2.0 * (1.0 - lag / (_REMEMBERED + 1)) * float(sums[lag:] @ sums[:-lag])
    return max(1.0, total / max(squares, 1e-300))


def _spread(left: Array, part: Array) -> tuple[float, float]:
    """Variance of the product of what is left, as noise, and something else, and how many numbers tell it. Both [T, C].

    From blocks of time; of something that acts in a few of them only, from what is left at all other times, too.
    """
    length = max(5, len(part) // _BLOCKS)
    rows = len(part) // length
    left, part = left[: rows * length], part[: rows * length]

    def blocks(values: Array) -> Array:
        return values.sum(axis=1).reshape(rows, length).sum(axis=1)

    squares = blocks(part**2)
    count = float(squares.sum() ** 2 / max(float((squares**2).sum()), 1e-300))
    if count * count >= rows:
        return float((blocks(left * part) ** 2).sum()), count
    moved = [float((left * np.roll(part, k * length, axis=0)).sum()) for k in range(rows)]
    return float(np.mean(np.square(moved))), rows / max(count, 1e-300)
