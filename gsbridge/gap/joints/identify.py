"""Identification of the missing effect: fit on one record, judge on another with different excitation, or abstain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gsbridge.gap.diagnosis.closure import beyond_noise, closed_at_most_times, closed_beside_rest
from gsbridge.gap.diagnosis.results import Candidate, Finding, Hypothesis
from gsbridge.gap.diagnosis.verdict import Decision, decide, slim, transfer
from gsbridge.gap.joints.arcs import arcs_of
from gsbridge.gap.joints.candidates import closed_beside_knocks
from gsbridge.gap.joints.coherence import related
from gsbridge.gap.joints.explanations import CHECKED, Explanations, without_one
from gsbridge.gap.joints.limits import nothing_fitted
from gsbridge.gap.joints.motion import is_motion, moves_together, vibrates
from gsbridge.gap.joints.screen import SignatureMatch
from gsbridge.gap.joints.verify import stepped

_AS_LITTLE, _LITTLE = 5.0, 0.01
"""Multiple of what the best explanation leaves, and share of the gap, up to which another explanation counts as equally good:
a smaller difference may come from errors of the model."""

_CLOSE, _TWINS = 6.0, 3
"""How far behind the best explanation another may lie to be compared at a finer time step, in margins, and how many are."""

_FAR = 2.0
"""Multiple of the best explanation's squared residual on `fit` above which a fit that was given up is ruled out."""


class JointIdentification(Explanations):
    """The search for the effects that a mechanism's model lacks, and its verdict.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        bank: Signatures on `fit`.
        who: Candidates.
        rules: Thresholds.
        seed: Seed of the replicates of the noise.
        third: Residuals on the record `verify`.
    """

    _seen: tuple[list[Hypothesis], Sequence[SignatureMatch], float, tuple[str, ...]] | None = None

    def run(self, filtered: Callable[[Hypothesis], bool] = lambda trial: False) -> Finding:
        """Detect, screen, fit, rank and decide.

        Args:
            filtered: Whether what an explanation leaves is noise of a filter. If so, the search stops after single effects.
        """
        rules, residual = self.rules, self.start
        self._limited.clear()
        p_first, p_second = self.null_first.p_value(residual), self.null.p_value(self.plain)
        p_value = min(p_first, p_second)
        matches = self.screen.matches(residual)
        p_gain = self.null_first.p_gain(matches[0].gain) if matches else 1.0
        unseen = tuple(sorted(str(c) for c in set(self.who) - {match.candidate for match in matches}))
        if min(p_value, p_gain) >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.who)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, unseen)
        trials = self._alone = self._alone or self._singles(matches)
        if min(p_first, p_gain) >= rules.alarm:
            trials = [*trials, *self._late(self.trial_of(nothing_fitted(residual)))]
        best = decide(trials, rules, self.floor).trials[0] if trials else None
        if best is not None and self.remains(best):
            if self._transfers(best) and filtered(best):
                return replace(self._quiet("none_of_the_known", p_value, unseen), best=best)
            trials = self._several(trials, best)
            best = min(trials, key=lambda trial: trial.score)
        moves = best is not None and self._transfers(best)
        views = (self.first, self.second), (self.start, self.plain)
        if not moves and not is_motion(*views, self.rng, rules.deviations):
            if self._moves_on_all():
                # It is a motion, but so small that no fit to one record holds on the other.
                return self._quiet("none_of_the_known", p_value, unseen)
            # The excess over white noise is no motion, and no fit to one record holds on the other: it is coloured noise.
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
        """Decide again with one explanation more.

        Args:
            who: Effects of the new explanation.
            values: Start parameters of each effect.
            instead: For each effect, names of the effects that may stand in its place; these sets are compared, too.

        Returns:
            The new finding. None if `run` compared nothing, if this explanation was compared before or its fit does not
            converge, or if it holds a limit that does not show on `fit` and that `select` and `verify` do not confirm.
        """
        if self._seen is None:
            return None
        # Grant a second budget of simulations, as large as that of the search.
        self._begin = self.first.mechanism.runs
        late = [k for k, candidate in enumerate(who) if candidate.effect.cuts and self._hidden(who, values, k)]
        known = [trial for trial in self._seen[0] if set(trial.fit.who) == set(who)]
        if any(trial.fit.records > 1 or not late for trial in known):
            return None
        fitted = self.fits.fit(who, values, limit=self._limit(), near=True, both=bool(late))
        if not fitted.converged:
            return None
        trial = self.trial_of(fitted)
        if not all(self.is_confirmed(trial, who[k]) for k in late):
            return None
        self.fits.late |= {who[k] for k in late}
        trials, matches, p_value, unseen = self._seen
        trials = [*(one for one in trials if set(one.fit.who) != set(who)), trial]
        for k, names in enumerate(instead):
            others, starts = without_one(who, k), without_one(fitted.values, k)
            left = self.first.residual(without_one(fitted.effects, k))
            for match in (m for m in self.screen.matches(left) if str(m.candidate) in names):
                if self.first.mechanism.runs < self._limit():
                    rival = (*others, match.candidate), (*starts, match.starts[0])
                    trials.append(self.trial_of(self.fits.fit(*rival, limit=self._limit(), both=bool(late))))
        return self._decide(slim(trials, self.rules, self.floor, self.plain_chi2), matches, p_value, unseen)

    def _hidden(self, who: Sequence[Candidate], values: Sequence[dict[str, float]], k: int) -> bool:
        """Tell whether effect number `k` does not show on `fit` beside the others."""
        effects = [candidate.applied(one) for candidate, one in zip(who, values, strict=True)]
        change = self.first.residual(effects) - self.first.residual(without_one(effects, k))
        return float((change**2).sum()) < self.rules.margin

    def _moves_on_all(self) -> bool:
        """Tell whether channels move together on all three records, as a small motion does that two of them do not prove."""
        if self.third is None:
            return False
        views, residuals = (self.first, self.second, self.third), (self.start, self.plain, self.third.residual())
        return moves_together(views, residuals, self.rng)

    def _transfers(self, trial: Hypothesis) -> bool:
        """Tell whether a trial explains more of `select` than chance does, even with coloured noise.

        It must also close at least the share `least` of the gap, as each of several named effects must.
        """
        gap, left = (beyond_noise(chi2, self.floor) for chi2 in (self.plain_chi2, trial.chi2))
        if self.plain_chi2 - trial.chi2 < self.rules.margin or gap - left < self.rules.least * gap:
            return False
        return transfer(self.plain, trial.residual) > self.rules.deviations

    def _quiet(self, verdict: str, p_value: float, unseen: tuple[str, ...]) -> Finding:
        size, lost = float(np.sqrt(self.plain_chi2 / self.second.freedom)), tuple(sorted(self.lost))
        remains = verdict == "none_of_the_known"
        return Finding(verdict, None, (), (), remains, p_value, p_value, size, size, self._used(), unseen, lost=lost)

    def _decide(
        self, trials: list[Hypothesis], matches: Sequence[SignatureMatch], p_value: float, unseen: tuple[str, ...]
    ) -> Finding:
        rules = self.rules
        trials = self._without_arcs(trials)
        first = decide(trials, rules, self.floor)
        # Refit the best explanation, its near rivals, and those that do as well on `fit`, with derivatives of their own:
        # derivatives from signatures lead some fits to parameters that hold on no other record.
        again, kept = {id(t) for t in (first.trials[0], *first.near[:2], *self._as_well(first)[:2])}, []
        for trial in first.trials:
            derivatives = sum(len(c.effect.parameters) for c in trial.fit.who) * trial.fit.records
            if id(trial) in again and self.first.mechanism.runs + derivatives < self._limit(CHECKED):
                better = self.fits.polish(trial.fit, self._limit(CHECKED))
                trial = self.trial_of(better) if better.converged or better.chi2 < trial.fit.chi2 else trial
            kept.append(trial)
        found = decide(kept, rules, self.floor)
        best = found.trials[0]
        p_remaining = self._p_remaining(best)
        remains = p_remaining < rules.alarm
        names: tuple[str, ...] = ()
        part = None
        mimics = best.fit.stopped or best.fit.blurred or self._arcs(best)
        if mimics or (remains and not self._suffices(best, trials)):
            verdict = "none_of_the_known"
            part = self._sure_part(found, trials)
        elif found.near or found.chances[0] < rules.sure or self._untried((best, *found.near), trials):
            verdict = "ambiguous"
            names = tuple(" + ".join(trial.names) for trial in (best, *found.near))
            untried = self._untried((best, *found.near), trials)
            names = tuple(dict.fromkeys((*names, *(" + ".join(sorted(map(str, every))) for every in untried))))
            if len(best.fit.who) == best.fit.records == 1:
                # Candidates that were not fitted, but whose signatures explain as much, remain possible. Candidates whose
                # fit was given up while it left far more are ruled out.
                gained = float((self.start**2).sum()) - best.fit.chi2 - rules.margin
                tried = {candidate for trial in trials for candidate in trial.fit.who}
                ruled_out = {name for name, left in self.lost.items() if left > _FAR * best.fit.chi2 + rules.margin}
                open_ = (m for m in matches if m.candidate not in tried and str(m.candidate) not in ruled_out)
                as_good = (str(m.candidate) for m in open_ if m.bound > gained)
                names += tuple(name for name in as_good if name not in names)
        else:
            # The difference between very similar effects may be no larger than the error of the time step.
            twins = self._twins_at_a_finer_step(found)
            verdict = "ambiguous" if twins else "named"
            names = tuple(" + ".join(trial.names) for trial in (best, *twins) if twins)
        if part is not None:
            # All good explanations hold this part; their further effects only mimic what it leaves.
            verdict, best, remains, p_remaining = "named", part, True, self._p_remaining(part)
            found = replace(found, trials=(part, *(t for t in found.trials if t is not part)))
        if verdict == "ambiguous" and len(names) == 1:
            names += tuple(" + ".join(trial.names) for trial in found.trials[1:2])
        return Finding(
            verdict, best, tuple(zip(found.trials, found.chances.tolist(), strict=True)), names, remains, p_value, p_remaining,
            float(np.sqrt(self.plain_chi2 / self.second.freedom)), float(np.sqrt(best.chi2 / self.second.freedom)),
            self._used(), unseen, lost=tuple(sorted(self.lost)),
        )  # fmt: skip

    def _arcs(self, trial: Hypothesis) -> tuple[Candidate, ...]:
        """Find ripples in a trial that may stand for any smooth curve over the angle."""
        return arcs_of((self.first, self.second), trial.fit.who, trial.fit.effects)

    def _without_arcs(self, trials: list[Hypothesis]) -> list[Hypothesis]:
        """Drop explanations by arcs if another one does about as well; else keep all."""
        told, best = [t for t in trials if not self._arcs(t)], min(trials, key=lambda trial: trial.score)
        wide = max(1.0, best.chi2 / self.floor)
        return told if told and min(t.score for t in told) - best.score < self.rules.margin * wide else trials

    def _twins_at_a_finer_step(self, found: Decision) -> list[Hypothesis]:
        """Find rivals that cannot be told from the best explanation once the time step's error is taken off.

        The list is empty if no simulations are left to compare them.
        """
        best, reach = found.trials[0], _CLOSE * self.rules.margin * max(1.0, found.trials[0].chi2 / self.floor)
        close = [trial for trial in found.trials[1:] if trial.score - best.score < reach][:_TWINS]
        if not close or self.first.mechanism.runs + 2 * (1 + len(close)) >= self._limit(CHECKED):
            return []
        fine = [stepped(trial, (self.first, self.second)) for trial in (best, *close)]
        again = decide(fine, self.rules, self.floor)
        alike = (again.trials[0], *again.near)
        return [trial for trial, one in zip(close, fine[1:], strict=True) if any(one is other for other in alike)]

    def _untried(self, near: Sequence[Hypothesis], trials: Sequence[Hypothesis]) -> list[tuple[Candidate, ...]]:
        """List the sets that might explain as much as those in `near` but were not fitted."""
        fitted = {frozenset(trial.fit.who) for trial in trials}
        sets = (every for trial in near for every in self.untried.get(frozenset(trial.fit.who), []))
        return [every for every in sets if frozenset(every) not in fitted]

    def _as_well(self, found: Decision) -> list[Hypothesis]:
        """List explanations that do as well as the best one on `fit`, but worse on `select`."""
        best = found.trials[0]

        def behind(trial: Hypothesis) -> float:
            return trial.fit.chi2 - best.fit.chi2 + 2.0 * (trial.parameters - best.parameters)

        most, near = self.rules.margin * max(1.0, best.chi2 / self.floor), {id(trial) for trial in found.near}
        return sorted((t for t in found.trials[1:] if id(t) not in near and behind(t) < most), key=behind)

    def _suffices(self, trial: Hypothesis, trials: Sequence[Hypothesis]) -> bool:
        """Tell whether a trial explains enough to be named although it leaves more than noise.

        Several effects together can fit errors of the model. Each must therefore explain clearly more than what remains, and
        at least a hundredth of the gap: a smaller effect only corrects the law of another one.
        """
        rules, closure = self.rules, min(self._closed(trial), self._closed_first(trial))
        if closure < rules.closure:
            return False
        if len(trial.fit.who) == 1:
            return True
        left = max(trial.chi2 - self.floor, 0.0)
        for candidate in trial.fit.who:
            k, both = trial.fit.who.index(candidate), trial.fit.records > 1
            who, values = without_one(trial.fit.who, k), without_one(trial.fit.values, k)
            known = [t for t in trials if set(t.fit.who) <= set(who)]
            if not any(len(t.fit.who) == len(who) and t.fit.records == trial.fit.records for t in known):
                known.append(self.trial_of(self.fits.fit(who, values, np.inf, self._limit(CHECKED), both=both)))
            # Take the best of all subsets: a fit that ended in a poor local minimum would make the effect look needed.
            without = min(known, key=lambda t: t.chi2)
            left_without, left_with, gap = (
                beyond_noise(chi2, self.floor) for chi2 in (without.chi2, trial.chi2, self.plain_chi2)
            )
            if left_without - left_with < rules.least * gap or without.chi2 - trial.chi2 < rules.larger * left:
                return False
        return True

    def _sure_part(self, found: Decision, trials: Sequence[Hypothesis]) -> Hypothesis | None:
        """Return the explanation by the effects that all good ones share, if it nearly closes the gap and has no rival."""
        best = found.trials[0]
        if len(best.fit.who) == 1:
            return None
        leaves = max(_AS_LITTLE * (1.0 - self._closed(best)), _LITTLE)
        good = [trial for trial in (*found.near, *trials) if 1.0 - self._closed(trial) <= leaves]
        core = {who for who in best.fit.who if all(trial.holds(who) for trial in good)}.difference(self._arcs(best))
        if not core or core == set(best.fit.who):
            return None
        part = next((trial for trial in trials if set(trial.fit.who) == core), None)
        if part is None or part.fit.stopped or part.fit.blurred:
            return None
        if min(self._closed(part), self._closed_first(part)) < self.rules.closure:
            return None
        if len(core) > 1 and not self._suffices(part, trials):
            return None
        # An explanation that contains this part as a special case is no rival, but one of the ways to correct its law.
        others = [t for t in trials if len(t.fit.who) <= len(core) and (t is part or not t.contains(part))]
        alone = decide(others, self.rules, self.floor)
        sure = alone.trials[0] is part and not alone.near and alone.chances[0] >= self.rules.sure
        return part if sure else None

    def _closed(self, trial: Hypothesis) -> float:
        """Compute the share of the gap on `select` that a trial closes, noise taken off.

        For effects with dry friction or play, moments of rest or of knocking parts may be left out.
        """
        held = [c.joint for c in trial.fit.who if c.effect.sticks]
        rests = self.second.rests(trial.fit.effects, held)
        closes = closed_beside_rest(self.plain, trial.residual, self.null.share, *rests)
        return max(closes, closed_beside_knocks(trial.fit.effects, self.plain, trial.residual, self.null.share))

    def _closed_first(self, trial: Hypothesis) -> float:
        """Compute the share of the gap on `fit` that a trial closes at most times; `select` shows if the rest is its fault."""
        if trial.fit.records > 1 and self.null_first.p_value(self.start) >= self.rules.alarm:
            return self._closed(trial)  # There is no gap on `fit`.
        return closed_at_most_times(self.start, trial.first, self.null_first.share)
