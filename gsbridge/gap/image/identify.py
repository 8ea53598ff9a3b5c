"""Which image effect is missing: fits on some photos, judged on others, with the right to abstain.

The steps and the words are those of `gsbridge.gap.identify`; ranking and verdict are the same code.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsbridge.gap.fit import Fit
from gsbridge.gap.image.fit import fit
from gsbridge.gap.image.model import ImageCandidate
from gsbridge.gap.image.null import Null, Reference, block_sums
from gsbridge.gap.image.screen import Group, Match, features, gains_of, lengths, screen, signatures
from gsbridge.gap.image.view import View
from gsbridge.gap.system import Applied
from gsbridge.gap.trials import Finding, Rules, Trial
from gsbridge.gap.verdict import decide, transfer
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

_SHOWN = 9.0
"""Squared length that the signature of an effect of typical size must have for it to show at all."""

_BEGIN = 8
"""Steps of a fit before what is common is weighed."""

_NARROW = 3
"""Effects that are tried beside an explanation."""


class Identification:
    """One diagnosis.

    Args:
        first: Photos of `fit`.
        second: Photos of `select`.
        reference: Effect-free photos.
        who: Candidates.
        rules: Thresholds.
        seed: Of replicates and bootstrap.
    """

    def __init__(
        self,
        first: View,
        second: View,
        reference: Reference,
        who: Sequence[ImageCandidate],
        rules: Rules | None = None,
        seed: int = 0,
    ) -> None:
        self.first, self.second, self.who = first, second, tuple(who)
        self.rules, self.rng = rules or Rules(), np.random.default_rng(seed)
        self.null_first = reference.null(len(first.shots))
        self.null = reference.null(len(second.shots))
        self.groups, self.groups_second = signatures(first, self.who), signatures(second, self.who)
        # Large effects are found and begun where nothing is weighed down: what is common to all pictures is where they show.
        self.rough = View(first.model, first.shots, replace(first.floor, common=()))
        self.start, self.plain = first.residual(), second.residual()
        self.floor = self.null.floor
        self.plain_chi2 = _squares(self.plain)
        self.fits = 0

    def run(self) -> Finding:
        """Detect, screen, fit, rank, decide."""
        rules = self.rules
        matches = screen(self.rough, signatures(self.rough, self.who), self.rough.residual())
        p_first = self.p_of(self.first, self.null_first, self.start, (), self.groups)
        p_second = self.p_of(self.second, self.null, self.plain, ())
        p_value = min(1.0, 2.0 * min(p_first, p_second))
        seen = lengths(self.groups)
        unseen = tuple(sorted(str(c) for c in self.who if seen.get(str(c), 0.0) < _SHOWN))
        if p_value >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.who)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, unseen)
        trials = self._singles(matches)
        best = min(trials, key=lambda trial: trial.score, default=None)
        if best is not None and self._p_remaining(best) < rules.alarm:
            trials = self._several(trials)
            best = min(trials, key=lambda trial: trial.score)
        if best is None:
            return self._quiet("none_of_the_known", p_value, unseen)
        if p_first >= rules.alarm and transfer(self.plain, best.residual) <= rules.deviations:
            # The difference shows on `select` alone, so that nothing can be fitted to it and then tested.
            return self._quiet("not_enough_excitation", p_value, unseen)
        return self._decide(trials, p_value, unseen)

    @staticmethod
    def p_of(
        view: View, null: Null, residual: Array, effects: Sequence[Applied], groups: Sequence[Group] | None = None
    ) -> float:
        """Probability that nothing is missing beyond some effects: by blocks, by features of any kind, and by signatures."""
        rows = view.by_photo(residual)
        gains: dict[str, float] = {}
        for group in (*features(view, effects), *(groups or ())):
            gain, _ = gains_of(group.along(rows).sum(axis=0), group.grams().sum(axis=0), group.lows)
            gains[group.key] = max(gains.get(group.key, 0.0), float(gain))
        # Two looks at the same photos: either may be odd by chance.
        return min(1.0, 2.0 * min(null.p_blocks(block_sums(view, residual)), null.p_gains(gains)))

    def _quiet(self, verdict: str, p_value: float, unseen: tuple[str, ...]) -> Finding:
        size = self._size(self.plain)
        return Finding(verdict, None, (), (), verdict == "none_of_the_known", p_value, p_value, size, size, self.fits, unseen)

    def _size(self, residual: Array, who: Sequence[ImageCandidate] = ()) -> float:
        """Structure of a residual on `select`, in multiples of the floor."""
        mine = [group for group in self.groups_second if group.who in who]
        return structure(self.second, self.null, residual, mine)

    def _trial(self, fitted: Fit) -> Trial:
        """Judge a fit on `select`."""
        residual = self.second.residual(fitted.effects)
        before, after = (self._size(table, fitted.who) for table in (self.plain, residual))
        gap = np.sqrt(max(before**2 - 1.0, 1e-9))
        closure = 1.0 - float(np.sqrt(max(after**2 - 1.0, 0.0)) / gap)
        return Trial(fitted, residual, self.first.residual(fitted.effects), _squares(residual), closure)

    def _fitted(self, who: Sequence[ImageCandidate], starts: Sequence[dict[str, float]]) -> Trial | None:
        """A trial of some effects; None where the fit did not converge."""
        self.fits += 1
        found = fit(self.first, who, fit(self.rough, who, starts, _BEGIN).values)
        logger.info("%s: %.1f%s", " + ".join(map(str, who)), found.chi2, "" if found.converged else " (not converged)")
        return self._trial(found) if found.converged else None

    def _p_remaining(self, trial: Trial) -> float:
        """Probability that noise leaves as much on either role."""
        effects = trial.fit.effects
        second = self.p_of(self.second, self.null, trial.residual, effects)
        return min(1.0, 2.0 * min(second, self.p_of(self.first, self.null_first, trial.first, effects)))

    def _singles(self, matches: Sequence[Match]) -> list[Trial]:
        """Fits of one effect each; those that cannot reach the best are not fitted."""
        out: list[Trial] = []
        chi2, reached = _squares(self.rough.residual()), 0.0
        for number, match in enumerate(match for match in matches if match.gain > 0.0):
            slack = 4.0 * self.rules.margin + 0.5 * reached if number < self.rules.rivals else self.rules.margin
            if match.gain < reached - slack:
                break
            trial = self._fitted((match.candidate,), (match.start,))
            if trial is not None:
                out.append(trial)
                reached = max(reached, chi2 - _squares(self.rough.residual(trial.fit.effects)))
        return out

    def _several(self, singles: Sequence[Trial]) -> list[Trial]:
        """Sets of effects: forward from the best, each earlier effect swapped, then slimmed."""
        trials = list(singles)
        tried: set[frozenset[ImageCandidate]] = set()
        best = min(trials, key=lambda trial: trial.score)
        for count in range(2, self.rules.most + 1):
            bases = sorted((t for t in trials if len(t.fit.who) == count - 1), key=lambda t: t.score)[: 2 if count == 2 else 1]
            grown = [found for base in bases for found in self._beside(base.fit, tried)]
            if grown:
                # The last addition stays while those before it are put to the test.
                top = min(grown, key=lambda trial: trial.score)
                for place in range(count - 1):
                    rest = [k for k in range(count) if k != place]
                    grown += self._beside(_part(top.fit, rest), tried, 2)
            trials += grown
            new = min(trials, key=lambda trial: trial.score)
            if new is best or self._p_remaining(new) >= self.rules.alarm:
                break
            best = new
        return self._slim(trials)

    def _beside(self, base: Fit, tried: set[frozenset[ImageCandidate]], most: int = _NARROW) -> list[Trial]:
        """Fits of an explanation with one effect more, those that screen best."""
        others = [candidate for candidate in self.who if candidate not in base.who]
        left = self.rough.residual(base.effects)
        out = []
        for match in screen(self.rough, signatures(self.rough, others, base.effects), left)[:most]:
            who = (*base.who, match.candidate)
            if frozenset(who) in tried or match.gain <= self.rules.margin:
                continue
            tried.add(frozenset(who))
            trial = self._fitted(who, (*base.values, match.start))
            out += [] if trial is None else [trial]
        return out

    def _slim(self, trials: list[Trial]) -> list[Trial]:
        """Leave out sets that are hardly better than one of their subsets."""
        out = []
        for trial in trials:
            parts = [t for t in trials if set(t.fit.who) < set(trial.fit.who)]
            if all(t.score - trial.score > self.rules.margin * max(1.0, trial.chi2 / self.floor) for t in parts):
                out.append(trial)
        return out

    def _decide(self, trials: list[Trial], p_value: float, unseen: tuple[str, ...]) -> Finding:
        rules = self.rules
        found = decide(trials, rules, self.floor)
        best = found.trials[0]
        p_remaining = self._p_remaining(best)
        remains = p_remaining < rules.alarm
        names: tuple[str, ...] = ()
        poor = best.closure < rules.closure or len(best.fit.who) > 1
        if best.fit.stopped or (remains and poor):
            verdict = "none_of_the_known"
        elif found.near or found.chances[0] < rules.sure:
            verdict = "ambiguous"
            near = found.near or found.trials[1:2]
            names = tuple(dict.fromkeys(" + ".join(trial.names) for trial in (best, *near)))
        else:
            verdict = "named"
        return Finding(
            verdict, best, tuple(zip(found.trials, found.chances.tolist(), strict=True)), names, remains, p_value, p_remaining,
            self._size(self.plain, best.fit.who), self._size(best.residual, best.fit.who), self.fits, unseen,
        )  # fmt: skip


def structure(view: View, null: Null, residual: Array, groups: Sequence[Group]) -> float:
    """What is no chance in a residual, in multiples of what effect-free photos show: gains of features and of some effects,
    and grain. The whole residual would say little: photos differ in how well splats show what they see.

    Args:
        view: Photos.
        null: Replicates.
        residual: In units of the floor.
        groups: Signatures of the effects.
    """
    rows, gains = view.by_photo(residual), {}
    for group in (*features(view), *groups):
        gain, _ = gains_of(group.along(rows).sum(axis=0), group.grams().sum(axis=0), group.lows)
        gains[group.key] = max(gains.get(group.key, 0.0), float(gain))
    grain = residual[-len(view.shots) :].astype(np.float64)
    return float(np.sqrt((sum(gains.values()) + (grain**2).sum()) / null.structure(gains)))


def _squares(residual: Array) -> float:
    return float((residual.astype(np.float64) ** 2).sum())


def _part(whole: Fit, keep: Sequence[int]) -> Fit:
    """Some effects of a fit, as they were fitted with the others."""
    who, effects = tuple(whole.who[k] for k in keep), tuple(whole.effects[k] for k in keep)
    return Fit(who, effects, whole.chi2, whole.converged, np.zeros(0), 0.0, whole.rank)
