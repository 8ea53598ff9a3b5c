"""Identification of the effect that a thrown body's simulation lacks: fit on some throws, judge on others, or abstain."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.bank import FEW, GridBank
from gsbridge.gap.contact.null import ThrowNull, closure, throw_null
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import GridMatch, ThrowFit, mean_error, promised, refine, screen
from gsbridge.gap.diagnosis.results import Finding
from gsbridge.geometry import Array

_CANDIDATES = 4
"""Number of further effects that are simulated on top of an explanation: those that `promised` predicts to explain most."""

_NEAR = 1.5
"""Multiple of the best fit's error up to which other fits are also refined on all throws."""

_FINE = 0.3
"""Bracket for refining, on all throws, a size that was fitted on a few, as a share of the grid's spacing."""

logger = logging.getLogger("gsbridge")


@dataclass(frozen=True)
class ThrowRules:
    """Thresholds of the verdict.

    Args:
        alarm: p-value below which a discrepancy counts.
        rivals: Number of single effects that are fitted.
        sure: Probability of being the best that an effect needs to be named.
        margin: Share of the gap by which the best effect must lead all rivals.
        sigmas: Number of standard errors by which the best effect must lead all rivals.
        closure: Share of the gap, in unweighted distances, that named effects must close if something unexplained remains.
        gain: Share of the error above the floor that a further effect must remove on held-out throws.
        least: Share of the whole gap that a further effect must remove there. Engines turn a body a little more or less at
            impacts, and a changed inertia would fit that difference beside any other effect.
        most: Largest number of effects in one explanation.
        draws: Number of draws of the bootstrap over throws.
        budget: Number of passes over the throws of a role, without those of the bank, after which no further effect is sought.
    """

    alarm: float = 0.01
    rivals: int = 4
    sure: float = 0.95
    margin: float = 0.02
    sigmas: float = 3.0
    closure: float = 0.8
    gain: float = 0.15
    least: float = 0.1
    most: int = 3
    draws: int = 500
    budget: float = 90.0


@dataclass(frozen=True)
class ThrowHypothesis:
    """A fit, and its errors on the held-out throws of `select`.

    Args:
        fit: The fit.
        errors: Mean weighted error of each throw of `select`, m. [N].
        closure: Share of the gap above the floor that it closes; 0 until all hypotheses are judged.
    """

    fit: ThrowFit
    errors: Array
    closure: float = 0.0

    @property
    def score(self) -> float:
        """Mean error over throws, m."""
        return float(self.errors.mean())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects, sorted."""
        return tuple(sorted(effect.name for effect in self.fit.effects))


@dataclass(frozen=True)
class ThrowFinding(Finding[ThrowHypothesis]):
    """Findings about a thrown body. Gaps are mean distances on `select`, m; simulations are passes over the throws of a role.

    Args:
        floor: Mean distance that noise, chaos and the engine's choices explain, m.
        weighed: The same in the weighted distances that are used for fitting and judging, m.
        spread: Expected distance at each moment of a throw, in the form that `ThrowReplay.weigh` takes.
        near: Names of the explanations that are not clearly worse than the best.
    """

    floor: float = 0.0
    weighed: float = 0.0
    spread: Callable[[Array], Array] = np.ones_like
    near: tuple[str, ...] = ()


class ThrowIdentification:
    """One diagnosis of throws.

    Args:
        first: Throws of `fit`.
        second: Throws of `select`.
        bank: Grids that were simulated on throws of `first`.
        rules: Thresholds; None for the defaults.
        seed: Random seed of replicates and bootstrap.
    """

    def __init__(
        self, first: ThrowReplay, second: ThrowReplay, bank: GridBank, rules: ThrowRules | None = None, seed: int = 0
    ) -> None:
        self.first, self.second, self.bank, self.rules = first, second, bank, rules or ThrowRules()
        self.few = first.part(FEW)
        self.rng = np.random.default_rng(seed)

    def run(self) -> ThrowFinding:
        """Detect, screen, fit, rank, decide."""
        rules = self.rules
        null = throw_null(self.second, (), self.rng, weigh=True)
        self.spread = null.spread
        self.first.weigh(null.spread)
        self.plain = self.second.errors()
        p_value = null.p_value(self.plain, self.second.early())
        bank = replace(self.bank, matches=tuple(self._again()))
        seen, unseen = bank.seen(self.first), bank.unseen(self.first)
        if p_value >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.bank.names)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, null, unseen)
        logger.info("throws: %s", ", ".join(f"{match.effect.name} {1e3 * match.error:.1f} mm" for match in seen[:8]))
        trials = self._trials([refine(self.few, (match.effect,)) for match in seen[: rules.rivals]])
        alike = null.p_early(self.second.early()) >= rules.alarm
        if not trials:
            verdict = "not_attributable" if alike else "none_of_the_known"
            return replace(self._quiet(verdict, p_value, null, unseen), something_remains=True)
        best, rest = trials[0], throw_null(self.second, trials[0].fit.effects, self.rng)
        if self._remaining(rest, best) < rules.alarm and rules.most > 1:
            grown = self._several(trials, rest.floor)
            if grown is not best:
                sets = sorted([grown, *self._stand_ins(grown, rest.floor)], key=lambda trial: trial.score)
                trials, rest = [*sets, *trials], throw_null(self.second, sets[0].fit.effects, self.rng)
        if alike and not self._learns(trials[0], null.floor):
            # The flight agrees, and nothing learnt from the contacts of some throws holds on others. Another engine's contacts
            # would look like this, and so would contacts that are not in the catalogue.
            return replace(self._quiet("not_attributable", p_value, null, unseen), something_remains=True)
        return self._decide(trials, rest, p_value, unseen)

    def _again(self) -> list[GridMatch]:
        """Evaluate the bank's grids again with weighted distances; their throws are in the cache."""
        return sorted((screen(self.few, name) for name in self.bank.names), key=lambda match: match.error)

    def _learns(self, best: ThrowHypothesis, floor: float) -> bool:
        """Whether an explanation closes a part of the gap on held-out throws, beyond chance."""
        gain = self.plain - best.errors
        chance = self.rules.sigmas * float(gain.std(ddof=1)) / np.sqrt(len(gain))
        return float(gain.mean()) > max(chance, self.rules.gain * (float(self.plain.mean()) - floor))

    def _remaining(self, rest: ThrowNull, best: ThrowHypothesis) -> float:
        """Return the p-value of the errors that an explanation leaves on `select`."""
        return rest.p_value(best.errors, self.second.early(best.fit.effects))

    def _trials(self, fits: Sequence[ThrowFit]) -> list[ThrowHypothesis]:
        """Judge fits of a few throws on `select`, and return them, the best first.

        Fits whose error is near that of the best one are refined on all throws first.
        """
        fits = [fit for fit in fits if fit.converged]
        bar = _NEAR * min((fit.error for fit in fits), default=0.0)
        if self.few is not self.first:
            fits = [refine(self.first, fit.effects, _FINE) if fit.error <= bar else fit for fit in fits]
        trials = [ThrowHypothesis(fit, self.second.errors(fit.effects)) for fit in fits if fit.converged]
        return sorted(trials, key=lambda trial: trial.score)

    def _runs(self) -> int:
        return round(self.first.passes + self.second.passes)

    def _affords(self, passes: float) -> bool:
        """Whether the budget allows this many further passes."""
        return self._runs() + passes <= self.rules.budget

    def _quiet(self, verdict: str, p_value: float, null: ThrowNull, unseen: tuple[str, ...]) -> ThrowFinding:
        size, missing = float(self.second.gaps().mean()), verdict == "none_of_the_known"
        return ThrowFinding(
            verdict, None, (), (), missing, p_value, p_value, size, size, self._runs(), unseen, floor=null.plain
        )

    def _better(self, new: ThrowHypothesis, old: ThrowHypothesis, floor: float) -> bool:
        """Whether a trial is clearly better than another on `select`.

        The gain must exceed chance, the required shares of the old trial's remaining error and of the whole gap, and also what
        the new trial leaves: an effect that is smaller than the model's own error is not named.
        """
        gain = old.errors - new.errors
        chance = self.rules.sigmas * float(gain.std(ddof=1)) / np.sqrt(len(gain))
        parts = (self.rules.gain * (old.score - floor), self.rules.least * (float(self.plain.mean()) - floor))
        return float(gain.mean()) > max(chance, *parts, new.score - floor)

    def _several(self, singles: Sequence[ThrowHypothesis], floor: float) -> ThrowHypothesis:
        """Add effects one by one while that helps on held-out throws; after each, try to swap and to drop earlier ones."""
        best = singles[0]
        for _ in range(self.rules.most - 1):
            grown = self._grow(best.fit.effects, 2, floor)
            if grown is None or not self._better(grown, best, floor):
                break
            best = self._slim(self._swap(grown, singles), floor)
        return best

    def _grow(self, base: Sequence[Applied], tries: int, floor: float) -> ThrowHypothesis | None:
        """Return the best explanation with one effect more; None if no effect helps enough on a few throws."""
        others = [name for name in self.bank.names if name not in {applied.name for applied in base}]
        if not self._affords((_CANDIDATES + 10.0) * len(self.few) / len(self.first)):
            return None
        likely = sorted((promised(self.few, name, base) for name in others), key=lambda found: -found[1])[:_CANDIDATES]
        starts = sorted(((mean_error(self.few, (*base, effect)), effect) for effect, _ in likely), key=lambda start: start[0])
        plain, left = (float(self.few.errors(effects).mean()) for effects in ((), base))
        near = [effect for error, effect in starts[:tries] if error <= _NEAR * starts[0][0]]
        # Fit only the new effect here; the sizes of the base are refined later, for the best set only, on all throws.
        fits = [refine(self.few, (*base, effect), held=len(base)) for effect in near]
        # Skip candidates whose gain on the few throws is below half of what `_better` asks for on held-out throws; fitting them
        # on all throws would rarely pass.
        wanted = max(self.rules.gain * (left - floor), self.rules.least * (plain - floor), 0.0)
        fits = [fit for fit in fits if left - fit.error > 0.5 * wanted]
        fits = sorted((fit for fit in fits if fit.converged), key=lambda fit: fit.error)
        return next(iter(self._trials(fits[:1])), None)

    def _swap(self, trial: ThrowHypothesis, singles: Sequence[ThrowHypothesis]) -> ThrowHypothesis:
        """Try to replace each effect but the last by other single effects that did well, and return the best set."""
        fits = []
        for place in range(len(trial.fit.effects) - 1):
            for single in singles[1:3]:
                if single.names[0] not in trial.names and self._affords(10.0):
                    effects = list(trial.fit.effects)
                    effects[place] = single.fit.effects[0]
                    fits.append(refine(self.few, effects))
        bar = _NEAR * float(self.few.errors(trial.fit.effects).mean())
        return min([trial, *self._trials([fit for fit in fits if fit.error <= bar])], key=lambda one: one.score)

    def _stand_ins(self, trial: ThrowHypothesis, floor: float) -> list[ThrowHypothesis]:
        """Fit the sets in which one effect of a trial is replaced by its most promising stand-in; return those near the trial.

        A set grows by one effect at a time, so a stand-in with the same equations as one of its effects was never compared.
        No set is named without this comparison, so it is not bound by the budget. A set that does better than the trial must
        also be better than each of its own subsets, as a grown set is.
        """
        if len(trial.fit.effects) < 2:
            return []
        fits = []
        for place in range(len(trial.fit.effects)):
            base = trial.fit.effects[:place] + trial.fit.effects[place + 1 :]
            others = [name for name in self.bank.names if name not in trial.names]
            if others:
                effect, _ = max((promised(self.few, name, base) for name in others), key=lambda found: found[1])
                fits.append(refine(self.few, (*base, effect), held=len(base)))
        bar = _NEAR * mean_error(self.few, trial.fit.effects)
        near = [fit for fit in fits if fit.error <= bar]
        if self.few is self.first:
            # The other effects' sizes were fitted beside the replaced effect; refine them beside the new one.
            near = [refine(self.first, fit.effects, _FINE) for fit in near]
        return [found for found in self._trials(near) if found.score >= trial.score or self._earned(found, floor)]

    def _earned(self, trial: ThrowHypothesis, floor: float) -> bool:
        """Whether a set is clearly better than each of its subsets with one effect less."""
        effects = trial.fit.effects
        parts = [refine(self.few, effects[:place] + effects[place + 1 :]) for place in range(len(effects))]
        return all(self._better(trial, part, floor) for part in self._trials(parts))

    def _slim(self, trial: ThrowHypothesis, floor: float) -> ThrowHypothesis:
        """Drop effects without which the explanation is not clearly worse on held-out throws."""
        for place in range(len(trial.fit.effects)):
            if len(trial.fit.effects) == 1 or not self._affords(10.0):
                break
            less = self._trials([refine(self.few, trial.fit.effects[:place] + trial.fit.effects[place + 1 :])])
            if less and not self._better(trial, less[0], floor):
                return self._slim(less[0], floor)
        return trial

    def _decide(
        self, trials: Sequence[ThrowHypothesis], rest: ThrowNull, p_value: float, unseen: tuple[str, ...]
    ) -> ThrowFinding:
        rules, best, floor = self.rules, trials[0], rest.floor
        before = float(self.plain.mean())
        # Subsets of the best set were beaten when it grew, so they are not its rivals.
        trials = [best, *(trial for trial in trials[1:] if not set(trial.names) < set(best.names))]
        chances = self._chances(trials)
        p_remaining = self._remaining(rest, best)
        remains = p_remaining < rules.alarm
        near = [trial for trial in trials[1:] if self._near(trial, best, before - floor)]
        if not near and chances[0] < rules.sure:
            near = [trial for trial, chance in zip(trials[1:], chances[1:], strict=True) if chance > 0.02]
        names: tuple[str, ...] = ()
        gap, left = (float(self.second.gaps(effects).mean()) for effects in ((), best.fit.effects))
        # The closure is reported and judged in plain distances. Weighted ones only separate rivals: in them, a tenth of a
        # millimetre in flight counts as much as a centimetre after the body has tumbled.
        if remains and (closure(gap, left, rest.plain) < rules.closure or self._flies_otherwise(rest, best)):
            verdict = "none_of_the_known"
        elif near or chances[0] < rules.sure:
            verdict = "ambiguous"
            names = tuple(" + ".join(trial.names) for trial in [best, *near])
        else:
            verdict = "named"
        trials = [replace(trial, closure=closure(before, trial.score, floor)) for trial in trials]
        best = trials[0]
        order = sorted(range(len(trials)), key=lambda k: trials[k].score)
        return ThrowFinding(
            verdict, best, tuple((trials[k], float(chances[k])) for k in order), names, remains, p_value, p_remaining,
            gap, left, self._runs(), unseen, floor=rest.plain, weighed=floor, spread=self.spread,
            near=tuple(" + ".join(trial.names) for trial in near),
        )  # fmt: skip

    def _flies_otherwise(self, rest: ThrowNull, best: ThrowHypothesis) -> bool:
        """Whether an explanation changes the flight, but leaves too much of it unexplained.

        Another engine's contacts cannot be the reason for that. Example: a gusty wind is not a steady force, although such a
        force closes most of the gap after the impact.
        """
        left = self.second.early(best.fit.effects)
        before, after = (float(errors[rest.numbers].mean()) for errors in (self.second.early(), left))
        closed = closure(before, after, float(rest.early.mean()))
        return rest.p_early(left) < self.rules.alarm and self.rules.gain < closed < self.rules.closure

    def _near(self, trial: ThrowHypothesis, best: ThrowHypothesis, gap: float) -> bool:
        """Whether a rival is not clearly worse than the best."""
        behind = trial.errors - best.errors
        chance = self.rules.sigmas * float(behind.std(ddof=1)) / np.sqrt(len(behind))
        return float(behind.mean()) < max(chance, self.rules.margin * gap)

    def _chances(self, trials: Sequence[ThrowHypothesis]) -> Array:
        """Return the probability that each trial is the best, by a bootstrap over throws. [trials]."""
        errors = np.stack([trial.errors for trial in trials])
        draws = self.rng.integers(0, errors.shape[1], (self.rules.draws, errors.shape[1]))
        return np.bincount(errors[:, draws].mean(axis=2).argmin(axis=0), minlength=len(trials)) / self.rules.draws
