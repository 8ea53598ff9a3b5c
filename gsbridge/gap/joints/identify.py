"""Which effect is missing: fits on one record, judged on another with different excitation, with the right to abstain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gsbridge.gap.diagnosis.closure import beyond_noise, closed_at_most_times, closed_beside_rest
from gsbridge.gap.diagnosis.pvalues import LEAST
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Finding, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import Decision, decide, slim, transfer
from gsbridge.gap.joints.bank import SignatureBank
from gsbridge.gap.joints.candidates import closed_beside_knocks, special_cases, thresholds
from gsbridge.gap.joints.coherence import related
from gsbridge.gap.joints.detect import JointNull, joint_null
from gsbridge.gap.joints.fit import derivatives, fit, nearer, ordered, polish
from gsbridge.gap.joints.motion import is_motion, vibrates
from gsbridge.gap.joints.parameter_error import BesideParameterError
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import SETS, Screen, SignatureMatch
from gsbridge.gap.joints.stand_ins import stand_ins

_RESERVE = 12
"""Simulations kept for the derivatives of the best explanation."""

_AS_LITTLE, _LITTLE = 5.0, 0.01
"""Multiple of what the best explanation leaves, and share of the gap, up to which others leave as little: the model's error
decides between them."""

_PAIR = 12
"""Simulations kept for sets of effects while play and limits are tried at several sizes."""

_JUDGED = 2
"""Simulations after a fit: with another step of time, and on the record that it has not seen."""

_NEAR = 2.0
"""Multiple of the best squared residual up to which an explanation's special cases are fitted, too."""

_MOST = 0.5
"""Share of a gap's squares that the best fit must explain for others to be looked for no further."""


class JointIdentification:
    """One diagnosis of a mechanism.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        bank: Signatures on `fit`.
        who: Candidates.
        rules: Thresholds.
        seed: Seed of replicates.
    """

    def __init__(
        self,
        first: JointResiduals,
        second: JointResiduals,
        bank: SignatureBank,
        who: Sequence[Candidate],
        rules: Rules | None = None,
        seed: int = 0,
    ) -> None:
        self.first, self.second, self.who = first, second, tuple(who)
        self.rules, self.rng = rules or Rules(), np.random.default_rng(seed)
        self.screen = Screen(first, bank)
        self.null_first: JointNull = joint_null(first, self.rng, self.screen)
        self.null: JointNull = joint_null(second, self.rng)
        self._begin = first.mechanism.runs
        self.start, self.plain = first.residual(), second.residual()
        self.floor, self.floor_first = self.null.share * self.plain.size, self.null_first.share * self.start.size
        self.plain_chi2 = float((self.plain**2).sum())
        self.lost: set[str] = set()
        self._alone: list[Hypothesis] = []
        self._beside = BesideParameterError(second, first, derivatives)
        self._seen: tuple[list[Hypothesis], Sequence[SignatureMatch], float, tuple[str, ...]] | None = None

    def run(self, filtered: Callable[[Hypothesis], bool] = lambda trial: False) -> Finding:
        """Detect, screen, fit, rank, decide; no further where an effect leaves a filter's noise, if that is asked."""
        rules, residual = self.rules, self.start
        p_first, p_second = self.null_first.p_value(residual), self.null.p_value(self.plain)
        p_value = min(p_first, p_second)
        matches = self.screen.matches(residual)
        p_gain = self.null_first.p_gain(matches[0].gain) if matches else 1.0
        unseen = tuple(sorted(str(c) for c in set(self.who) - {match.candidate for match in matches}))
        if min(p_value, p_gain) >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.who)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, unseen)
        trials = self._alone = self._alone or self._singles(matches)
        best = decide(trials, rules, self.floor).trials[0] if trials else None
        if best is not None and self.remains(best):
            if self._transfers(best) and filtered(best):
                return replace(self._quiet("none_of_the_known", p_value, unseen), best=best)
            trials = self._several(trials, best)
            best = min(trials, key=lambda trial: trial.score)
        moves = best is not None and self._transfers(best)
        views = (self.first, self.second), (self.start, self.plain)
        if not moves and not is_motion(*views, self.rng, rules.deviations):
            # What exceeds white noise is no motion, and nothing learnt from one record holds on the other.
            untold = not related(self.first, self.start)
            return replace(self._quiet("no_discrepancy", p_value, unseen), coloured=True, untold=untold)
        if best is None:
            return self._quiet("none_of_the_known", p_value, unseen)
        if p_first >= rules.alarm and p_gain >= rules.alarm and not moves and not vibrates(*views, self.rng):
            # The difference shows on `select` alone, so that nothing can be fitted to it and then tested.
            return self._quiet("not_enough_excitation", p_value, unseen)
        self._seen = trials, matches, p_value, unseen
        return self._decide(*self._seen)

    def again(
        self, who: Sequence[Candidate], values: Sequence[dict[str, float]], instead: Sequence[Sequence[str]] = ()
    ) -> Finding | None:
        """The finding with an explanation more among those that are compared.

        Args:
            who: Its effects.
            values: Parameters of each to start from.
            instead: Names of what may stand in the place of each, which is compared, too.

        Returns:
            None where there is nothing to compare it with, where it was compared before, or where it cannot be fitted.
        """
        if self._seen is None or any(set(trial.fit.who) == set(who) for trial in self._seen[0]):
            return None
        # As many simulations again as the search may take.
        self._begin = self.first.mechanism.runs
        fitted = fit(self.first, who, values, np.inf, None, self._limit())
        if not fitted.converged:
            return None
        trials, matches, p_value, unseen = self._seen
        trials = [*trials, self.trial_of(fitted)]
        for k, names in enumerate(instead):
            kept = [j for j in range(len(who)) if j != k]
            left = self.first.residual([fitted.effects[j] for j in kept])
            for match in (m for m in self.screen.matches(left) if str(m.candidate) in names):
                others, starts = [who[j] for j in kept], [fitted.values[j] for j in kept]
                if self.first.mechanism.runs < self._limit():
                    rival = fit(self.first, (*others, match.candidate), (*starts, match.starts[0]), limit=self._limit())
                    trials.append(self.trial_of(rival))
        return self._decide(slim(trials, self.rules, self.floor, self.plain_chi2), matches, p_value, unseen)

    def spare(self, runs: int) -> None:
        """Let so many simulations that others took count no longer against the budget."""
        self._begin += runs

    def _used(self) -> int:
        return self.first.mechanism.runs - self._begin

    def _affords(self, fits: int, reserve: int = _RESERVE) -> bool:
        """Whether simulations are left for so many fits' parameters."""
        return self._used() + 4 + fits <= self.rules.budget - reserve

    def _limit(self, reserve: int = _RESERVE) -> int:
        """Simulations at which a fit is given up, so that judging it and the reserve stay within the budget."""
        return self._begin + self.rules.budget - reserve - _JUDGED

    def _transfers(self, trial: Hypothesis) -> bool:
        """Whether a trial explains a part of the other record, by more than chance and colour of the noise allow.

        The part must be worth a word: what hardly anything is taken off is no more of that kind than it was before.
        """
        gap, left = (beyond_noise(chi2, self.floor) for chi2 in (self.plain_chi2, trial.chi2))
        if self.plain_chi2 - trial.chi2 < self.rules.margin or gap - left < self.rules.least * gap:
            return False
        return transfer(self.plain, trial.residual) > self.rules.deviations

    def _quiet(self, verdict: str, p_value: float, unseen: tuple[str, ...]) -> Finding:
        size, lost = float(np.sqrt(self.plain_chi2 / self.second.freedom)), tuple(sorted(self.lost))
        remains = verdict == "none_of_the_known"
        return Finding(verdict, None, (), (), remains, p_value, p_value, size, size, self._used(), unseen, lost=lost)

    def trial_of(self, fitted: EffectFit) -> Hypothesis:
        """Judge a fit on `select`."""
        residual = self.second.residual(fitted.effects)
        chi2 = float((residual**2).sum())
        gap = max(self.plain_chi2 - self.floor, 1e-9)
        closure = 1.0 - float(np.sqrt(max(chi2 - self.floor, 0.0) / gap))
        return Hypothesis(fitted, residual, self.first.residual(fitted.effects), chi2, closure)

    def remains(self, trial: Hypothesis) -> bool:
        """Whether a trial leaves more than noise."""
        return self._p_remaining(trial) < self.rules.alarm

    def _p_remaining(self, trial: Hypothesis) -> float:
        """Probability that noise leaves as much on either record, or as much that looks like some effect."""
        matches = self.screen.matches(trial.first)
        p_gain = self.null_first.p_gain(matches[0].gain) if matches else 1.0
        looks = (self.null_first.p_value(trial.first), p_gain)
        unseen, alarm = self.null.p_value(trial.residual), self.rules.alarm / 3
        # What is beyond all replicates has another cause than the error of the parameters.
        left = self._limit(0) - self.first.mechanism.runs
        if LEAST < unseen < alarm <= min(looks) and 2 * len(trial.fit.deviations) + 2 <= left:
            unseen = max(unseen, self.null.p_value(self._beside(trial.fit)))
        return min(1.0, 3 * min(unseen, *looks))

    def _singles(self, matches: Sequence[SignatureMatch]) -> list[Hypothesis]:
        """Fits of one effect each; those that cannot reach the best are not fitted, those that did not converge are told."""
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
            for start in starts[1:2]:
                # A start in the wrong valley leaves more than a projection onto the signatures promised.
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
                self.lost.add(str(match.candidate))
        out += self._thresholds(out)
        return out + self._simpler(out, out)

    def _thresholds(self, trials: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Fits of what begins at a threshold, on the joint that errs most, where all others leave most of the gap.

        Its signature at one size tells nothing of another: play of a centirad looks like none of a millirad.
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
                self.lost.add(str(who))
        return out

    def _simpler(self, trials: Sequence[Hypothesis], known: Sequence[Hypothesis], reserve: int = _RESERVE) -> list[Hypothesis]:
        """Special cases of good explanations that were not fitted, or went astray, from where those ended."""
        out = list[Hypothesis]()
        for every, starts in special_cases(trials, known, self.who, _NEAR):
            if self._affords(2 + sum(len(c.effect.parameters) for c in every), reserve):
                out.append(self.trial_of(fit(self.first, every, starts, np.inf, self.screen, self._limit())))
                self.lost -= {str(who) for who in every}
        return out

    def _several(self, singles: list[Hypothesis], best: Hypothesis) -> list[Hypothesis]:
        """Sets of effects: what grows from the best smaller set, then the best sums of signatures; larger sets only if
        smaller ones leave something."""
        trials = list(singles)
        for count in range(2, self.rules.most + 1):
            tried: set[frozenset[Candidate]] = set()
            mixtures = self.screen.beside(best.fit, best.first, count) + self.screen.mixtures(self.start, count, 6)
            reached = np.inf
            for mixture in mixtures:
                who = frozenset(mixture.who)
                if who in tried or len(tried) >= SETS:
                    continue
                if not self._affords(3 + sum(len(c.effect.parameters) for c in mixture.who)):
                    break
                tried.add(who)
                fitted = fit(self.first, mixture.who, mixture.starts, 1.3 * reached + 100.0, self.screen, self._limit())
                if fitted.converged:
                    trials.append(self.trial_of(fitted))
                    reached = min(reached, fitted.chi2)
            new = min(trials, key=lambda trial: trial.score)
            if new is best and count > 2:
                break
            best = new
            if not self.remains(best):
                break
        if len(best.fit.who) > 1:
            trials += self._simpler([best], trials, 0)
            best = min(trials, key=lambda trial: trial.score)
            kept = sum(len(c.effect.parameters) for c in best.fit.who)  # what polishing the best takes
            for every, starts in stand_ins(self.first, self.screen, best, trials, lambda: self._affords(3 + kept, kept)):
                fitted = fit(self.first, every, starts, 1.3 * best.fit.chi2 + 100.0, self.screen, self._limit(kept))
                trials += [self.trial_of(fitted)] if fitted.converged else []
        return slim(trials, self.rules, self.floor, self.plain_chi2)

    def _decide(
        self, trials: list[Hypothesis], matches: Sequence[SignatureMatch], p_value: float, unseen: tuple[str, ...]
    ) -> Finding:
        rules = self.rules
        first = decide(trials, rules, self.floor)
        # The best and what comes near it are fitted once more, with derivatives of their own.
        again, kept = {id(t) for t in (first.trials[0], *first.near[:2])}, []
        for trial in first.trials:
            derivatives = sum(len(c.effect.parameters) for c in trial.fit.who)
            if id(trial) in again and self.first.mechanism.runs + derivatives < self._limit(0):
                better = polish(self.first, trial.fit, self._limit(0))
                trial = self.trial_of(better) if better.converged or better.chi2 < trial.fit.chi2 else trial
            kept.append(trial)
        found = decide(kept, rules, self.floor)
        best = found.trials[0]
        p_remaining = self._p_remaining(best)
        remains = p_remaining < rules.alarm
        names: tuple[str, ...] = ()
        part = None
        if best.fit.stopped or best.fit.blurred or (remains and not self._suffices(best, trials)):
            verdict = "none_of_the_known"
            part = self._sure_part(found, trials)
        elif found.near or found.chances[0] < rules.sure:
            verdict = "ambiguous"
            names = tuple(dict.fromkeys(" + ".join(trial.names) for trial in (best, *found.near)))
            if len(best.fit.who) == 1:
                # Candidates that were not fitted, but whose signatures explain as much, are not ruled out either.
                gained = float((self.start**2).sum()) - best.fit.chi2 - rules.margin
                tried = {candidate for trial in trials for candidate in trial.fit.who}
                as_good = (str(m.candidate) for m in matches if m.candidate not in tried and m.bound > gained)
                names += tuple(name for name in as_good if name not in names)
        else:
            verdict = "named"
        if part is not None:
            # More effects than that mimic what is left; this one is in all that do.
            verdict, best, remains, p_remaining = "named", part, True, self._p_remaining(part)
            found = replace(found, trials=(part, *(t for t in found.trials if t is not part)))
        if verdict == "ambiguous" and len(names) == 1:
            names += tuple(" + ".join(trial.names) for trial in found.trials[1:2])
        return Finding(
            verdict, best, tuple(zip(found.trials, found.chances.tolist(), strict=True)), names, remains, p_value, p_remaining,
            float(np.sqrt(self.plain_chi2 / self.second.freedom)), float(np.sqrt(best.chi2 / self.second.freedom)),
            self._used(), unseen, lost=tuple(sorted(self.lost)),
        )  # fmt: skip

    def _suffices(self, trial: Hypothesis, trials: Sequence[Hypothesis]) -> bool:
        """Whether a trial explains enough to be named although more than noise is left.

        Several effects together fit much that they do not explain: each must explain more than what remains, which is the
        error of the model as far as anybody knows, and a hundredth of the gap: an effect that small mends another's law.
        """
        rules, closure = self.rules, min(self._closed(trial), self._closed_first(trial))
        if closure < rules.closure:
            return False
        if len(trial.fit.who) == 1:
            return True
        left = max(trial.chi2 - self.floor, 0.0)
        for candidate in trial.fit.who:
            kept = [k for k, c in enumerate(trial.fit.who) if c != candidate]
            known = [t for t in trials if set(t.fit.who) <= set(trial.fit.who) - {candidate}]
            if not any(len(t.fit.who) == len(kept) for t in known):
                who, values = [trial.fit.who[k] for k in kept], [trial.fit.values[k] for k in kept]
                known.append(self.trial_of(fit(self.first, who, values, np.inf, self.screen, self._limit(0))))
            # A fit that ends in a poor valley, with even fewer effects doing better, would make an effect look needed.
            without = min(known, key=lambda t: t.chi2)
            left_without, left_with, gap = (
                beyond_noise(chi2, self.floor) for chi2 in (without.chi2, trial.chi2, self.plain_chi2)
            )
            if left_without - left_with < rules.least * gap or without.chi2 - trial.chi2 < rules.larger * left:
                return False
        return True

    def _sure_part(self, found: Decision, trials: Sequence[Hypothesis]) -> Hypothesis | None:
        """What all of the best explanations hold, if that alone closes the gap but for a little and has no rival; else None."""
        best = found.trials[0]
        if len(best.fit.who) == 1:
            return None
        leaves = max(_AS_LITTLE * (1.0 - self._closed(best)), _LITTLE)
        good = [trial for trial in (*found.near, *trials) if 1.0 - self._closed(trial) <= leaves]
        core = {who for who in best.fit.who if all(trial.holds(who) for trial in good)}
        if not core or core == set(best.fit.who):
            return None
        part = next((trial for trial in trials if set(trial.fit.who) == core), None)
        if part is None or part.fit.stopped or part.fit.blurred:
            return None
        if min(self._closed(part), self._closed_first(part)) < self.rules.closure:
            return None
        if len(core) > 1 and not self._suffices(part, trials):
            return None
        # What holds one of them as a special case is no rival here: it is one of the ways to mend its law.
        others = [t for t in trials if len(t.fit.who) <= len(core) and (t is part or not t.contains(part))]
        alone = decide(others, self.rules, self.floor)
        sure = alone.trials[0] is part and not alone.near and alone.chances[0] >= self.rules.sure
        return part if sure else None

    def _closed(self, trial: Hypothesis) -> float:
        """Share of the gap on `select` that a trial closes, as far as noise tells."""
        held = [c.joint for c in trial.fit.who if c.effect.sticks]
        rests = self.second.rests(trial.fit.effects, held)
        closes = closed_beside_rest(self.plain, trial.residual, self.null.share, *rests)
        return max(closes, closed_beside_knocks(trial.fit.effects, self.plain, trial.residual, self.null.share))

    def _closed_first(self, trial: Hypothesis) -> float:
        """Share of the gap on `fit` that a trial closes; `select` tells whether something else happened there for a while."""
        return closed_at_most_times(self.start, trial.first, self.null_first.share)
