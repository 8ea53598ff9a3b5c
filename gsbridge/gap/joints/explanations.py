"""Explanations of a gap: single effects and sets of effects, fitted to one record and judged on another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from gsbridge.gap.diagnosis.pvalues import LEAST
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import slim
from gsbridge.gap.joints.candidates import special_cases, thresholds
from gsbridge.gap.joints.detect import JointNull, joint_null
from gsbridge.gap.joints.fit import derivatives, differ, fit, nearer, ordered, polish
from gsbridge.gap.joints.limits import limits_beside, nothing_fitted, shown_by, shows_more
from gsbridge.gap.joints.parameter_error import BesideParameterError
from gsbridge.gap.joints.pooled import PooledResiduals
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import SETS, Mixture, Screen, SignatureMatch
from gsbridge.gap.joints.signatures import SignatureBank
from gsbridge.gap.joints.stand_ins import stand_ins

CHECKED = 6
"""Simulations reserved for verifying the best explanation."""

_RESERVE = CHECKED + 6
"""Simulations reserved for verifying the best explanation and for its derivatives."""

_PAIR = 12
"""Simulations that stay reserved for sets of effects while play and limits are tried at several sizes."""

_JUDGED = 2
"""Simulations that follow a fit: one at another time step, and one on the record that it has not seen."""

_PAIRS = 2
"""Pairs of effects that are tried beside the best single one."""

_NEAR = 2.0
"""Multiple of the best squared residual up to which an explanation's special cases are fitted, too."""

_MOST = 0.5
"""Share of a gap's squares that the best fit must explain; if it explains less, effects with a threshold are tried, too."""


T = TypeVar("T")


@dataclass
class SetFits:
    """Fits of sets of effects to `fit`, or to `fit` and `select` together if one of the effects does not show on `fit`.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        screen: Signatures on `fit`.
        late: Effects that were found on `select` although they do not show on `fit`.
    """

    first: JointResiduals
    second: JointResiduals
    screen: Screen
    late: set[Candidate] = field(default_factory=set)

    def fit(
        self,
        who: Sequence[Candidate],
        starts: Sequence[dict[str, float]],
        bar: float = np.inf,
        limit: float = np.inf,
        near: bool = False,
        both: bool = False,
    ) -> EffectFit:
        """Fit all parameters together, as the function `fit` does; `chi2` of the result is that on `fit` alone.

        Args:
            who: Candidates.
            starts: Start parameters of each candidate.
            bar: Squared residual that a rival has reached: on `fit`, or on both records if `both` is set.
            limit: Number of simulations at which the fit is given up.
            near: Whether the starts are near the solution, so that derivatives by differences are worth their simulations.
            both: Whether to fit to both records in any case, for comparison with another fit to both.
        """
        if not both and not self.late & set(who):
            return fit(self.first, who, starts, bar, None if near else self.screen, limit)
        if not who:
            return nothing_fitted(self.first.residual(), 2)
        return self._as_on_first(fit(self._both, who, starts, bar if both else np.inf, limit=limit))

    def polish(self, rough: EffectFit, limit: float = np.inf) -> EffectFit:
        """Improve a fit, as the function `polish` does."""
        if rough.records == 1:
            return polish(self.first, rough, limit)
        return self._as_on_first(polish(self._both, rough, limit))

    @property
    def _both(self) -> PooledResiduals:
        return PooledResiduals((self.first, self.second))

    def _as_on_first(self, fitted: EffectFit) -> EffectFit:
        return replace(fitted, chi2=float((self.first.residual(fitted.effects) ** 2).sum()))


class Explanations:
    """A search for explanations of a gap within a budget of simulations.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        bank: Signatures on `fit`.
        who: Candidates.
        rules: Thresholds.
        seed: Seed of the replicates of the noise.
        third: Residuals on the record `verify`, which must confirm effects that do not show on `fit`; if None, no such effect
            is looked for.
    """

    def __init__(
        self,
        first: JointResiduals,
        second: JointResiduals,
        bank: SignatureBank,
        who: Sequence[Candidate],
        rules: Rules | None = None,
        seed: int = 0,
        third: JointResiduals | None = None,
    ) -> None:
        self.first, self.second, self.third, self.who = first, second, third, tuple(who)
        self.rules, self.rng = rules or Rules(), np.random.default_rng(seed)
        self.screen = Screen(first, bank)
        self.null_first: JointNull = joint_null(first, self.rng, self.screen)
        self.null: JointNull = joint_null(second, self.rng)
        self._begin = first.mechanism.runs
        self.start, self.plain = first.residual(), second.residual()
        self.floor, self.floor_first = self.null.share * self.plain.size, self.null_first.share * self.start.size
        self.plain_chi2 = float((self.plain**2).sum())
        # Squared residual of each candidate whose fit was given up; zero if the simulations ran out.
        self.lost: dict[str, float] = {}
        self._alone: list[Hypothesis] = []
        self._limited: set[frozenset[Candidate]] = set()
        # For a set of effects, the sets that may explain as much but were not fitted, since no simulations were left.
        self.untried: dict[frozenset[Candidate], list[tuple[Candidate, ...]]] = {}
        self.fits = SetFits(first, second, self.screen)
        self._beside = BesideParameterError(second, (first, second), derivatives)

    def spare(self, runs: int) -> None:
        """Take simulations that another stage spent off the count against the budget."""
        self._begin += runs

    @property
    def left(self) -> int:
        """Number of simulations that are left of the budget."""
        return self.rules.budget - self._used()

    def _used(self) -> int:
        return self.first.mechanism.runs - self._begin

    def _affords(self, fits: int, reserve: int = _RESERVE) -> bool:
        """Tell whether the budget, less the reserve, allows a fit that takes four simulations and `fits` more."""
        return self._used() + 4 + fits <= self.rules.budget - reserve

    def _limit(self, reserve: int = _RESERVE) -> int:
        """Compute the number of simulations at which a fit is given up, to leave enough for judging it and for the reserve."""
        return self._begin + self.rules.budget - reserve - _JUDGED

    def trial_of(self, fitted: EffectFit) -> Hypothesis:
        """Judge a fit on `select`."""
        residual = self.second.residual(fitted.effects)
        chi2 = float((residual**2).sum())
        gap = max(self.plain_chi2 - self.floor, 1e-9)
        closure = 1.0 - float(np.sqrt(max(chi2 - self.floor, 0.0) / gap))
        return Hypothesis(fitted, residual, self.first.residual(fitted.effects), chi2, closure)

    def remains(self, trial: Hypothesis) -> bool:
        """Tell whether a trial leaves more than noise."""
        return self._p_remaining(trial) < self.rules.alarm

    def _p_on_fit(self, trial: Hypothesis) -> tuple[float, float]:
        """Compute p-values of what a trial leaves on `fit`: of its size, and of its best match with a signature."""
        matches = self.screen.matches(trial.first)
        return self.null_first.p_value(trial.first), self.null_first.p_gain(matches[0].gain) if matches else 1.0

    def _p_remaining(self, trial: Hypothesis) -> float:
        """Compute the p-value of what a trial leaves on both records, by its size and by its best match with a signature."""
        looks = self._p_on_fit(trial)
        unseen, alarm = self.null.p_value(trial.residual), self.rules.alarm / 3
        # A residual far beyond all replicates is no error of the parameters, which is then not worth simulating.
        left = self._limit(CHECKED) - self.first.mechanism.runs
        if LEAST < unseen < alarm <= min(looks) and 2 * len(trial.fit.deviations) + 2 <= left:
            unseen = max(unseen, self.null.p_value(self._beside(trial.fit)))
        return min(1.0, 3 * min(unseen, *looks))

    def _singles(self, matches: Sequence[SignatureMatch]) -> list[Hypothesis]:
        """Fit single effects; skip candidates that cannot reach the best, and record those that do not converge as lost."""
        ranked = sorted((match for match in matches if match.gain > 0), key=lambda match: -match.bound)
        out: list[Hypothesis] = []
        chi2, reached = float((self.start**2).sum()), -np.inf
        for number, match in enumerate(ranked):
            slack = 4 * self.rules.margin + 0.3 * max(reached, 0.0) if number < self.rules.rivals else self.rules.margin
            far = match.bound < reached - slack
            if far or not self._affords(2 + len(match.candidate.effect.parameters)):
                break
            bar = chi2 - reached + 0.3 * max(reached, 0.0) + 100.0 if np.isfinite(reached) else np.inf
            starts = ordered(self.first, match, self._affords)
            begin = nearer(self.first, match.candidate, starts[0], self._affords)
            fitted = fit(self.first, (match.candidate,), (begin,), bar, self.screen, self._limit())
            for start in (other for other in starts[1:2] if differ(other, begin)):
                # A fit from the wrong start ends in a local minimum far above what the projection onto signatures promised.
                poor = chi2 - fitted.chi2 < 0.5 * match.bound
                if (fitted.converged and not poor) or not self._affords(2 + len(match.candidate.effect.parameters)):
                    break
                other = fit(self.first, (match.candidate,), (start,), bar, self.screen, self._limit())
                if other.chi2 < fitted.chi2:
                    fitted = other
            if fitted.converged:
                out.append(self.trial_of(fitted))
                reached = max(reached, chi2 - fitted.chi2)
            else:
                self._given_up(match.candidate, fitted)
        out += self._thresholds(out)
        return out + self._simpler(out, out)

    def _thresholds(self, trials: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Fit effects with a threshold on the joint with the largest residual, if all other fits leave most of the gap.

        Their signature at one size tells nothing of other sizes: play of a centiradian looks unlike play of a milliradian.
        """
        chi2, out = float((self.start**2).sum()), list[Hypothesis]()
        reached = chi2 - min((trial.fit.chi2 for trial in trials), default=chi2)
        if reached > _MOST * (chi2 - self.floor_first):
            return out
        fitted = {who for trial in trials for who in trial.fit.who}
        for who in thresholds(self.who, self.first, self.start):
            starts = [who.effect.scaled(way, size) for way in who.directions() for size in who.effect.sizes]
            if who in fitted or not self._affords(len(starts) + _PAIR):
                continue
            squares = [float((self.first.residual((who.applied(values),)) ** 2).sum()) for values in starts]
            if chi2 - min(squares) < max(reached, self.rules.margin):
                continue
            begin = nearer(self.first, who, starts[int(np.argmin(squares))], self._affords)
            found = fit(self.first, (who,), (begin,), np.inf, None, self._limit())
            if found.converged:
                out.append(self.trial_of(found))
            else:
                self._given_up(who, found)
        return out

    def _given_up(self, who: Candidate, fitted: EffectFit) -> None:
        self.lost[str(who)] = fitted.chi2 if self.first.mechanism.runs < self._limit() else 0.0

    def _simpler(self, trials: Sequence[Hypothesis], known: Sequence[Hypothesis], reserve: int = _RESERVE) -> list[Hypothesis]:
        """Fit special cases of good explanations that were not fitted or did not converge, starting from the explanations."""
        out = list[Hypothesis]()
        for every, starts in special_cases(trials, known, self.who, _NEAR):
            if self._affords(2 + sum(len(c.effect.parameters) for c in every), reserve):
                out.append(self.trial_of(self.fits.fit(every, starts, np.inf, self._limit())))
                self.lost = {name: left for name, left in self.lost.items() if name not in map(str, every)}
        return out

    def _several(self, singles: list[Hypothesis], best: Hypothesis) -> list[Hypothesis]:
        """Fit sets of effects: the best smaller set with one effect more, then the best sums of signatures; larger sets only
        if the smaller ones leave more than noise."""
        trials, base = list(singles), best
        for count in range(2, self.rules.most + 1):
            tried: set[frozenset[Candidate]] = set()
            trials = self._with_limits(trials)
            if not self.remains(late := min(trials, key=lambda trial: trial.score)):
                best = late
                break
            reached = np.inf
            for mixture in self._grown(best, base, count) + self.screen.mixtures(self.start, count, 6):
                who = frozenset(mixture.who)
                if who in tried or len(tried) >= SETS:
                    continue
                if not self._affords(3 + self._numbers(mixture.who)):
                    break
                tried.add(who)
                fitted = self.fits.fit(mixture.who, mixture.starts, 1.3 * reached + 100.0, self._limit())
                if not fitted.converged and fitted.chi2 < reached and self._affords(2 + len(fitted.deviations)):
                    fitted = self.fits.polish(fitted, self._limit())
                if fitted.converged:
                    trials.append(self.trial_of(fitted))
                    reached = min(reached, fitted.chi2)
            new = min(trials, key=lambda trial: trial.score)
            if new is best and count > 2:
                break
            best = new
            if not self.remains(best):
                break
        if self.remains(best):
            trials = self._with_limits(trials, anyway=True)
            best = min(trials, key=lambda trial: trial.score)
        if len(best.fit.who) > 1:
            trials += self._simpler([best], trials, CHECKED)
            best = min(trials, key=lambda trial: trial.score)
            kept = self._numbers(best.fit.who)  # Simulations for polishing the best.
            for one in stand_ins(self.first, self.screen, best, trials, self.rules.margin):
                if self._affords(0, CHECKED + kept):
                    limit, reached = self._limit(CHECKED + kept), best.fit.chi2 + self.rules.margin
                    fitted = self.fits.fit(one.who, one.values, 1.3 * best.fit.chi2 + 100.0, limit)
                    if not fitted.converged and fitted.chi2 < reached:
                        fitted = self.fits.polish(fitted, limit)
                    if fitted.converged:
                        trials.append(self.trial_of(fitted))
                        continue
                    if self.first.mechanism.runs < limit and fitted.chi2 >= reached:
                        continue
                if one.behind < self.rules.margin:
                    self.untried.setdefault(frozenset(best.fit.who), []).append(one.who)
        return slim(trials, self.rules, self.floor, self.plain_chi2)

    def _grown(self, best: Hypothesis, base: Hypothesis, count: int) -> list[Mixture]:
        """Propose sets with one effect beside `best`, or with two beside `base` that may show only together."""
        grown = [
            replace(m, gain=m.gain + base.fit.chi2 - best.fit.chi2) for m in self.screen.beside(best.fit, best.first, count)
        ]
        if count == 3:
            pairs = [pair for pair in self.screen.mixtures(base.first, 2, _PAIRS) if not set(pair.who) & set(base.fit.who)]
            grown += [Mixture((*base.fit.who, *m.who), (*base.fit.values, *m.starts), m.gain) for m in pairs]
        return sorted(grown, key=lambda mixture: -mixture.gain)

    def _numbers(self, who: Sequence[Candidate]) -> int:
        """Count the simulations that derivatives by all parameters of some effects take."""
        return sum(len(c.effect.parameters) for c in who) * (2 if self.fits.late & set(who) else 1)

    def _with_limits(self, trials: Sequence[Hypothesis], anyway: bool = False) -> list[Hypothesis]:
        """Add explanations, at most two, with one limit more that `select` passes and `fit` does not.

        A limit is sought beside explanations that leave only noise on `fit`, so that they lack nothing that shows there. The
        best one on `fit` is tried first: a missing limit makes `select` a poor judge of the other effects.

        Args:
            trials: The explanations.
            anyway: Whether to look beside explanations that leave more on `fit`, too, since nothing better was found.
        """
        few = [trial for trial in trials if len(trial.fit.who) < self.rules.most]
        if not few:
            return list(trials)
        on_fit = min(few, key=lambda trial: trial.fit.chi2 + 2.0 * trial.parameters)
        for base in (on_fit, min(few, key=lambda trial: trial.score)):
            if (anyway or min(self._p_on_fit(base)) >= self.rules.alarm / 3) and (found := self._late(base)):
                sets = [set(trial.fit.who) for trial in found]
                return [*found, *(trial for trial in trials if set(trial.fit.who) not in sets)]
        return list(trials)

    def _late(self, best: Hypothesis) -> list[Hypothesis]:
        """Fit `best` with one limit more that `select` passes and `fit` does not, and keep what `verify` confirms."""
        views, effects = (self.first, self.second), best.fit.effects
        if self.third is None or frozenset(best.fit.who) in self._limited:
            return []
        self._limited.add(frozenset(best.fit.who))
        if not shows_more(*views, effects, (self.floor_first, self.floor)) or not self._shows_more_than_noise(best):
            return []
        out = list[Hypothesis]()
        for candidate, values in limits_beside(*views, self.who, effects, self.rules.join, self._affords):
            who, starts = (*best.fit.who, candidate), (*best.fit.values, values)
            fitted = self.fits.fit(who, starts, limit=self._limit(), both=True)
            if fitted.converged and self.is_confirmed(trial := self.trial_of(fitted), candidate):
                self.fits.late.add(candidate)
                out.append(trial)
        return out

    def _shows_more_than_noise(self, trial: Hypothesis) -> bool:
        """Tell whether an explanation leaves more on `select` than noise and the errors of its parameters."""
        if self.null.p_value(trial.residual) >= self.rules.alarm:
            return False
        affords = trial.fit.who and trial.fit.records == 1 and self._affords(2 * self._numbers(trial.fit.who))
        return not affords or self.null.p_value(self._beside(trial.fit)) < self.rules.alarm

    def is_confirmed(self, trial: Hypothesis, late: Candidate) -> bool:
        """Tell whether an effect that does not show on `fit` is needed on `select` and shows on `verify`.

        The other effects, refitted to both records, must not explain as much without it; nor, where there are no others, the
        best single effect.
        """
        k, least = trial.fit.who.index(late), self.rules.join * max(1.0, trial.chi2 / self.floor)
        if self.third is None or not shown_by(self.third, trial.fit, without_one(trial.fit.effects, k), self.rules):
            return False
        rivals = [(without_one(trial.fit.who, k), without_one(trial.fit.values, k))]
        if not rivals[0][0] and self._alone:
            alone = min(self._alone, key=lambda single: single.score).fit
            rivals.append((list(alone.who), list(alone.values)))
        for who, values in rivals:
            other = self.fits.fit(who, values, limit=self._limit(), both=True)
            # A rival fit that ran out of simulations decides nothing, so that the effect is not confirmed.
            told = other.converged or self.first.mechanism.runs < self._limit()
            if not told or self.trial_of(other).score - trial.score <= least:
                return False
            if not shown_by(self.third, trial.fit, other.effects, self.rules):
                return False
        return True


def without_one(items: Sequence[T], k: int) -> list[T]:
    """Return all items but number `k`."""
    return [*items[:k], *items[k + 1 :]]
