"""Comparison of trials (fits judged on `select`): which is best, which cannot be told from it, and which say nothing new."""

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
"""Mean square residual, in units of the noise, above which the best explanation visibly errs."""

_BLOCKS = 40
"""Number of blocks of time from which the variance of a sum is estimated."""

_REMEMBERED = 8
"""Largest lag, in blocks, at which residuals may be correlated."""


@dataclass(frozen=True)
class Decision:
    """Ranking of a set of trials: the best one, and those that cannot be told from it.

    Args:
        trials: Explanations that are not mere variants of a better one, the best first.
        chances: Probability that each is the best. [trials].
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
    # An explanation of implausible size is dropped if a plausible one does about as well.
    sensible = [trial for trial in ranked if not trial.fit.stopped]
    if sensible and sensible[0].score - ranked[0].score < rules.margin * max(1.0, sensible[0].chi2 / floor):
        ranked = sensible
    best = ranked[0]
    wide = max(1.0, best.chi2 / floor)
    # If the model errs, a further parameter always explains a part of the error: it must explain more than it leaves.
    left = max(best.squares - 2.0 * floor, 0.0) if wide > _ERRING else 0.0
    # Schwarz's penalty replaces Akaike's, which the scores already contain.
    schwarz = max(rules.simple, np.log(best.residual.size + best.first.size) - 2.0)
    earn, simple = rules.earn * wide, max(schwarz * wide, left)
    # A trial that contains a simpler one as a special case must gain enough by its further parameters; otherwise it is dropped.
    for trial in sorted(ranked[1:], key=lambda trial: trial.parameters):
        if best.contains(trial) and trial.score - best.score < simple:
            best = trial
    others = [t for t in ranked if t is not best and not (t.contains(best) and best.score - t.score < simple)]
    # So must a set of several effects with more parameters than the best: enough effects mimic anything.
    others = [t for t in others if not (_is_larger(t, best) and best.squares - t.squares < earn)]
    kept = _without_unsure_parts([best, *others], rules.sure)
    best, others, chances = kept[0], kept[1:], _chances(kept)
    # The lead that `rules.sure` requires under white noise, and more if the best one leaves more than noise.
    margin = _margin(rules) * wide
    near = tuple(
        trial
        for trial, chance in zip(others, chances[1:], strict=True)
        # A trial that does clearly better on `select`, which was held out, is a rival however it does on `fit`.
        if trial.score - best.score < margin or best.chi2 - trial.chi2 > earn or chance > 1.0 - rules.sure
    )
    return Decision(tuple(kept), chances, near)


def _without_unsure_parts(trials: list[Hypothesis], sure: float) -> list[Hypothesis]:
    """Drop sets of effects that are not surely better than one of their subsets; return the trials, the best first.

    A superfluous effect always explains some of a coloured residual, so each effect must be as sure as a name.
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
    """Return the probability that each trial is the best, from tempered likelihoods. [trials].

    Under white noise a squared residual is -2 log likelihood. Under coloured noise squared residuals vary more. The factor
    comes from blocks of time: the variance of the product of the first trial's residual and its difference to the other's.

    Args:
        trials: Explanations, the best guess first.
        third: Residual of each on a third record, in units of the noise; None to compare two records. [T, C] each.
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
    """Name the best explanation of an ambiguous finding if `verify` makes it sure enough; else return the finding unchanged.

    `verify` can only confirm the best explanation of the other two records, never choose another one.

    Args:
        finding: The finding from `fit` and `select`.
        left_by: Returns an explanation's residual on `verify`, in units of the noise. [T, C].
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
    """Return the difference in squared residual that gives the probability `rules.sure` under white noise."""
    return float(2.0 * np.log(rules.sure / (1.0 - rules.sure)))


def slim(trials: Sequence[Hypothesis], rules: Rules, floor: float, plain: float) -> list[Hypothesis]:
    """Drop sets of effects that are hardly better than one of their subsets.

    They must gain `rules.join` in score and close a further `rules.least` of the gap. An effect that explains less of a gap
    only compensates for errors in the models of the other effects.

    Args:
        trials: Judged fits of sets of effects.
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
    """Return how well an explanation agrees with a held-out record, in standard deviations.

    The score is the inner product of the residual without the explanation and the change that the explanation makes, divided
    by its standard deviation. The deviation is that of the product of change and remaining residual over blocks of time, so
    that coloured noise does not count as certainty. For an explanation that acts in a few blocks only (a limit), the change is
    also shifted to all other times.

    Args:
        plain: Residual without it. [T, C].
        residual: Residual with it. [T, C].
        remembered: Whether correlation between blocks lowers the score, as it must under noise with a long memory. The
            residual of a real arm repeats with its motion and is correlated throughout; a test of one effect beside others
            ignores that, an alarm does not.
    """
    part = plain - residual
    if not part.any():
        return 0.0
    variance, count = _spread(residual, part)
    # The variance has as many degrees of freedom as there are blocks (or shifts); few of them mean heavy tails.
    memory = _memory(residual, part) if remembered else 1.0
    deviations = float((plain * part).sum()) / max(np.sqrt(variance * memory), 1e-300)
    return float(norm.isf(max(student.sf(deviations, count), 1e-300)))


def told_apart(some: Sequence[Array], others: Sequence[Array]) -> float:
    """Return by how many standard deviations one explanation errs less than another over several records.

    Each moment is weighted down by the residual that both leave around it, since moments in which both err say little about
    either. Example: a jittering delay errs most in fast motion, but differs from a filter where the motion turns.

    Args:
        some: Residual of the one explanation on each record, in units of the noise. [T, C] each.
        others: Residual of the other explanation. [T, C] each.
    """
    rows = []
    for one, other in zip(some, others, strict=True):
        around = uniform_filter1d(0.5 * (one.astype(np.float64) ** 2 + other**2), max(5, len(one) // _BLOCKS), axis=0)
        weights = 1.0 / np.sqrt(np.maximum(around, 1.0))
        rows.append((weights * one, weights * other))
    gain = 0.5 * sum(float((other**2).sum() - (one**2).sum()) for one, other in rows)
    # The residual of the better one serves as the noise.
    pairs = [(one, other - one) if gain > 0.0 else (other, one - other) for one, other in rows]
    variance = sum(_spread(*pair)[0] * _memory(*pair) for pair in pairs)
    return gain / max(float(np.sqrt(variance)), 1e-300)


def _memory(left: Array, part: Array) -> float:
    """Return the factor by which correlated blocks raise the variance of the product of residual and change. Both [T, C].

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
    """Return the variance of the inner product of a residual and a change, and its degrees of freedom. Both [T, C].

    It is estimated from blocks of time. If the change acts in a few blocks only, it is shifted over the whole record instead.
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
