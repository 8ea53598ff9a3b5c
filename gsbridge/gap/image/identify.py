"""Identification of missing image effects: fits on some views, judged on others, with the right to abstain.

The steps and terms are those of `gsbridge.gap.joints.identify`; ranking and verdict are the same code.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from gsbridge.gap.diagnosis.closure import closed
from gsbridge.gap.diagnosis.results import EffectFit, Finding, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import decide, transfer
from gsbridge.gap.image.fit import fit
from gsbridge.gap.image.model import Candidate
from gsbridge.gap.image.null import ImageNull
from gsbridge.gap.image.residuals import ImageResiduals
from gsbridge.gap.image.screen import ImageMatch, screen, signatures, unseen_of
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

_EDGE = 0.01
"""Distance from a bound, as a share of the range, within which a parameter counts as stopped by it."""

_PLACES = ("x", "y", "radius")
"""Parameters that say where an effect acts, if they are no amplitudes; hard edges and flicker may be at their bounds."""

_BESIDE = 3
"""Number of further effects that are tried in addition to an explanation."""


class ImageIdentification:
    """Identification of effects in the photos of one case.

    Args:
        first: Residuals on the views of `fit`.
        second: Residuals on the views of `select`.
        who: Candidate effects.
        rules: Thresholds; None for the default ones.
        seed: Seed of replicates.
    """

    def __init__(
        self,
        first: ImageResiduals,
        second: ImageResiduals,
        who: Sequence[Candidate],
        rules: Rules | None = None,
        seed: int = 0,
    ) -> None:
        self.first, self.second = first, second
        self.rough = first.coarse()
        self.who, self._all = tuple(c for c in who if first.tells(c)), tuple(who)
        self.rules, rng = rules or Rules(), np.random.default_rng(seed)
        self.null_first, self.null = ImageNull.of(first, rng), ImageNull.of(second, rng)
        self.groups = signatures(first, self.who)
        self.start, self.plain = first.residual(), second.residual()
        self.floor, self.plain_chi2 = float(second.numbers), _squares(self.plain)

    def run(self) -> Finding:
        """Test for a difference, screen the candidates, fit them, rank the fits, and decide on a verdict."""
        rules = self.rules
        p_first, p_second = self.null_first.p_value(self.first, self.start), self.null.p_value(self.second, self.plain)
        p_value = min(1.0, 2.0 * min(p_first, p_second))
        unseen = unseen_of(self.first, self._all, self.groups)
        if p_value >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.who)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, unseen)
        trials = self._singles(screen(self.groups, self.start))
        best = min(trials, key=lambda trial: trial.score, default=None)
        if best is not None and self._p_remaining(best) < rules.alarm:
            trials = self._several(trials)
            best = min(trials, key=lambda trial: trial.score)
        if best is None:
            return self._quiet("none_of_the_known", p_value, unseen)
        if p_first >= rules.alarm and transfer(self.plain, best.residual) <= rules.deviations:
            # The difference shows on `select` alone, so nothing can be fitted on `fit` and then tested on `select`.
            return self._quiet("not_enough_excitation", p_value, unseen)
        return self._decide(trials, p_value, unseen)

    def _quiet(self, verdict: str, p_value: float, unseen: tuple[str, ...]) -> Finding:
        size, remains = float(np.sqrt(self.plain_chi2 / self.floor)), verdict == "none_of_the_known"
        return Finding(verdict, None, (), (), remains, p_value, p_value, size, size, self._used(), unseen)

    def _used(self) -> int:
        """Return the number of image sets computed so far."""
        return sum(view.expectation.pictures for view in (self.first, self.second))

    def _fitted(self, who: Sequence[Candidate], starts: Sequence[dict[str, float]]) -> Hypothesis | None:
        """Fit some effects on `fit` and evaluate them on `select`; None if the fit did not converge."""
        if any(candidate.effect.hook in ("geometry", "time") for candidate in who):
            # Coarse rows first: details displaced by more than their own size would lead the fit to a local minimum.
            starts = fit(self.rough, who, starts).values
        found = fit(self.first, who, starts)
        logger.info("%s: %.1f%s", " + ".join(map(str, who)), found.chi2, "" if found.converged else " (not converged)")
        if not found.converged:
            return None
        residual = self.second.residual(found.effects)
        closure = closed(self.plain, residual, self.floor / self.plain.size)
        return Hypothesis(found, residual, self.first.residual(found.effects), _squares(residual), closure)

    def _p_remaining(self, trial: Hypothesis) -> float:
        """Return the p-value of what a trial leaves on `fit` and `select`, with a Bonferroni correction."""
        looks = self.null.p_value(self.second, trial.residual), self.null_first.p_value(self.first, trial.first)
        return min(1.0, len(looks) * min(looks))

    def _singles(self, matches: Sequence[ImageMatch]) -> list[Hypothesis]:
        """Fit single effects, in the order of their screened gains; skip those that cannot reach the best fit."""
        out: list[Hypothesis] = []
        chi2, reached = _squares(self.start), 0.0
        # Effects with far starts come first and are never skipped: signatures of small motions do not predict large ones.
        matches = sorted(matches, key=lambda match: not match.candidate.effect.far)
        for number, match in enumerate(match for match in matches if match.gain > 0.0 or match.candidate.effect.far):
            # Geometric effects are not linear in their size, so a screened gain is only a rough estimate.
            slack = 4.0 * self.rules.margin + 0.5 * reached if number < self.rules.rivals else self.rules.margin
            if match.gain < reached - slack and not match.candidate.effect.far:
                break
            trial = self._fitted((match.candidate,), (self._start(match),))
            if trial is not None:
                out.append(trial)
                reached = max(reached, chi2 - trial.fit.chi2)
        return out

    def _start(self, match: ImageMatch) -> dict[str, float]:
        """Choose the start of a fit: the signature's parameters, or a far start if that leaves less on coarse rows."""
        none = {parameter.name: 0.0 for parameter in match.candidate.effect.parameters}
        starts = [match.start, *(none | dict(values) for values in match.candidate.effect.far)]
        if len(starts) == 1:
            return match.start
        who = match.candidate
        return min(starts, key=lambda start: _squares(self.rough.residual((who.from_vector(who.vector(start)),))))

    def _several(self, singles: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Search sets of effects by forward selection: after each addition, try to replace every earlier effect; then prune."""
        trials = list(singles)
        tried: set[frozenset[Candidate]] = set()
        best = min(trials, key=lambda trial: trial.score)
        for count in range(2, self.rules.most + 1):
            bases = sorted((t for t in trials if len(t.fit.who) == count - 1), key=lambda t: t.score)[: 2 if count == 2 else 1]
            grown = [found for base in bases for found in self._beside(base, tried)]
            if grown:
                # Keep the last addition, and try to replace each of the effects before it.
                top = min(grown, key=lambda trial: trial.score)
                for place in range(count - 1):
                    rest = [top.fit.who[k] for k in range(count) if k != place]
                    base = next((t for t in trials if set(t.fit.who) == set(rest)), None) or self._again(rest, top)
                    grown += [] if base is None else self._beside(base, tried)
            trials += grown
            new = min(trials, key=lambda trial: trial.score)
            if new is best:
                break
            best = new
            if self._p_remaining(best) >= self.rules.alarm:
                break
        # A subset of the best set may do as well, but its earlier fit may have started from worse values.
        for part in combinations(best.fit.who, len(best.fit.who) - 1):
            trial = self._again(part, best) if part else None
            trials += [] if trial is None else [trial]
        return self._slim(trials)

    def _again(self, who: Sequence[Candidate], top: Hypothesis) -> Hypothesis | None:
        """Fit some effects of an explanation without the others, starting from their values in it."""
        values = dict(zip(top.fit.who, top.fit.values, strict=True))
        return self._fitted(who, [values[candidate] for candidate in who])

    def _beside(self, base: Hypothesis, tried: set[frozenset[Candidate]]) -> list[Hypothesis]:
        """Fit an explanation with one further effect, for the best-screened candidates that are not in `tried`."""
        out: list[Hypothesis] = []
        others = [match for match in screen(self.groups, base.first) if match.candidate not in base.fit.who]
        for match in others[:_BESIDE]:
            who = (*base.fit.who, match.candidate)
            if frozenset(who) in tried or match.gain <= self.rules.margin:
                continue
            tried.add(frozenset(who))
            trial = self._fitted(who, (*base.fit.values, match.start))
            out += [] if trial is None else [trial]
        return out

    def _slim(self, trials: list[Hypothesis]) -> list[Hypothesis]:
        """Drop sets that are hardly better than one of their subsets, and all but the best fit of each set."""
        fits: dict[frozenset[Candidate], Hypothesis] = {}
        for trial in sorted(trials, key=lambda trial: trial.score):
            fits.setdefault(frozenset(trial.fit.who), trial)
        trials = list(fits.values())
        out, gap = [], self.plain_chi2 + _squares(self.start) - self.floor - self.first.numbers
        for trial in trials:
            parts = [t for t in trials if set(t.fit.who) < set(trial.fit.who)]
            least = max(self.rules.join * max(1.0, trial.chi2 / self.floor), self.first.model_tolerance * gap)
            if all(t.score - trial.score > least for t in parts):
                out.append(trial)
        return out

    def _decide(self, trials: list[Hypothesis], p_value: float, unseen: tuple[str, ...]) -> Finding:
        rules = self.rules
        found = decide(trials, rules, self.floor)
        best = found.trials[0]
        p_remaining = self._p_remaining(best)
        remains = p_remaining < rules.alarm
        names: tuple[str, ...] = ()
        first = closed(self.start, best.first, self.first.numbers / self.start.size)
        least = rules.closure if len(best.fit.who) == 1 else rules.several
        poor = min(best.closure, first) < least or _cornered(best.fit)
        if best.fit.stopped or best.fit.blurred or (remains and poor):
            verdict = "none_of_the_known"
        elif found.near or found.chances[0] < rules.sure:
            verdict = "ambiguous"
            near = found.near or found.trials[1:2]
            names = tuple(dict.fromkeys(" + ".join(trial.names) for trial in (best, *near)))
        else:
            verdict = "named"
        best = replace(best, fit=self._widened(best.fit))
        return Finding(
            verdict, best, tuple(zip(found.trials, found.chances.tolist(), strict=True)), names, remains, p_value, p_remaining,
            float(np.sqrt(self.plain_chi2 / self.floor)), float(np.sqrt(best.chi2 / self.floor)), self._used(), unseen,
        )  # fmt: skip

    def _widened(self, found: EffectFit) -> EffectFit:
        """Widen a fit's standard deviations by the known error of the effects' models."""
        law = np.sqrt(self.first.model_tolerance * max(_squares(self.start) - self.first.numbers, 0.0))
        return replace(found, deviations=found.deviations * np.hypot(1.0, law))


def _cornered(found: EffectFit) -> bool:
    """Whether the place or the size of an effect stopped at a bound: a spot beyond the picture mimics something else."""
    return any(
        min(values[parameter.name] - parameter.low, parameter.high - values[parameter.name])
        <= _EDGE * (parameter.high - parameter.low)
        for candidate, values in zip(found.who, found.values, strict=True)
        for parameter in candidate.effect.parameters
        if parameter.name in _PLACES and not parameter.amplitude
    )


def _squares(residual: Array) -> float:
    return float((residual.astype(np.float64) ** 2).sum())
