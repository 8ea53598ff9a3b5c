"""Which effect a thrown body's simulation lacks: fits on some throws, judged on others, with the right to abstain."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.gap.contact.null import Null, calibrate
from gsbridge.gap.contact.replay import Replay
from gsbridge.gap.contact.search import Fit, Match, refine, screen
from gsbridge.gap.effects import catalogue
from gsbridge.gap.system import Applied
from gsbridge.geometry import Array

FEW = 20
"""Throws of `fit` on which grids are walked; sizes are then fitted on all."""

logger = logging.getLogger("gsbridge")


@dataclass(frozen=True)
class Rules:
    """Thresholds of the verdict.

    Args:
        alarm: p-value below which a discrepancy counts.
        rivals: Effects that are fitted.
        sure: Probability of being best that a name needs.
        margin: Share of the gap by which all rivals must be behind.
        sigmas: Standard errors by which they must be behind.
        closure: Share of the gap that a name must close where something remains.
        gain: Share of what is left above the floor that a further effect must take away on throws it has not seen.
        most: Effects that are looked for at once.
        draws: Of the bootstrap over throws.
    """

    alarm: float = 0.01
    rivals: int = 4
    sure: float = 0.95
    margin: float = 0.02
    sigmas: float = 3.0
    closure: float = 0.8
    gain: float = 0.15
    most: int = 3
    draws: int = 500


@dataclass(frozen=True)
class Trial:
    """A fit and how it does on throws that it has not seen.

    Args:
        fit: The fit.
        errors: Mean error of each throw of `select`, m. [N].
    """

    fit: Fit
    errors: Array

    @property
    def error(self) -> float:
        """Mean over throws, m."""
        return float(self.errors.mean())

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(sorted(effect.name for effect in self.fit.effects))


@dataclass(frozen=True)
class Finding:
    """What was found. Lengths are mean distances on `select`, m.

    Args:
        verdict: As in `gsbridge.gap.identify.VERDICTS`.
        best: The best trial; None where nothing was fitted.
        rivals: All trials with the probability that each is best, the best first.
        ambiguous: Names among which the throws cannot decide.
        something_remains: Whether the best explanation leaves more than the floor.
        p_value: Of the hypothesis that nothing is missing.
        p_remaining: Of the hypothesis that nothing is missing beyond the best explanation.
        before: Without effects.
        after: With the best explanation.
        floor: What noise, chaos and the engine's choices explain.
        bank: Passes over all throws of `fit` for the grids.
        runs: Further passes over the throws of a role.
        unseen: Effects that do not show in these throws.
    """

    verdict: str
    best: Trial | None
    rivals: tuple[tuple[Trial, float], ...]
    ambiguous: tuple[str, ...]
    something_remains: bool
    p_value: float
    p_remaining: float
    before: float
    after: float
    floor: float
    bank: int
    runs: int
    unseen: tuple[str, ...] = ()

    def closure(self, error: float) -> float:
        """Share of the gap above the floor that an error leaves closed."""
        return closure(self.before, error, self.floor)


def closure(before: float, after: float, floor: float) -> float:
    """Share of the gap above the floor that is closed; negative where it grew."""
    return 1.0 - max(after - floor, 0.0) / max(before - floor, 1e-12)


class Identification:
    """One diagnosis of throws.

    Args:
        first: Throws of `fit`.
        second: Throws of `select`.
        names: Effects that may be the reason; None for all of a body.
        rules: Thresholds.
        seed: Of replicates and bootstrap.
    """

    def __init__(
        self, first: Replay, second: Replay, names: Collection[str] | None = None, rules: Rules | None = None, seed: int = 0
    ) -> None:
        self.first, self.second, self.rules = first, second, rules or Rules()
        self.rng = np.random.default_rng(seed)
        self.names = tuple(
            name
            for name, effect in catalogue().items()
            if effect.scope == "body"
            and (names is None or name in names)
            and (first.starts.logged or not getattr(effect, "needs_speeds", False))
        )
        self.plain = second.errors()
        self.bank = 0.0

    def run(self) -> Finding:
        """Detect, screen, fit, rank, decide."""
        rules = self.rules
        null = calibrate(self.second, (), self.rng)
        p_value = null.p_value(self.plain)
        matches = self._screen(())
        seen = [match for match in matches if match.change > 3.0 * self.first.noise.position]
        unseen = tuple(sorted(set(self.names) - {match.effect.name for match in seen}))
        if p_value >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.names)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, null, unseen)
        logger.info("throws: %s", ", ".join(f"{match.effect.name} {1e3 * match.error:.1f} mm" for match in seen[:8]))
        trials = [self._trial(refine(self.first, (match.effect,))) for match in seen[: rules.rivals]]
        trials = sorted((trial for trial in trials if trial.fit.converged), key=lambda trial: trial.error)
        if not trials:
            return self._quiet("none_of_the_known", p_value, null, unseen)
        best, rest = trials[0], calibrate(self.second, trials[0].fit.effects, self.rng)
        if rest.p_value(best.errors) < rules.alarm and rules.most > 1:
            grown = self._several(trials, rest.floor)
            if grown is not best:
                trials, rest = [grown, *trials], calibrate(self.second, grown.fit.effects, self.rng)
        return self._decide(trials, rest, p_value, unseen)

    def _screen(self, base: Sequence[Applied]) -> list[Match]:
        """Grids of all effects on top of others, the best first."""
        throws = self.first.part(FEW)
        begin = throws.runs
        taken = {applied.name for applied in base}
        matches = [screen(throws, name, base) for name in self.names if name not in taken]
        self.bank += (throws.runs - begin) * len(throws) / len(self.first)
        return sorted(matches, key=lambda match: match.error)

    def _trial(self, fit: Fit) -> Trial:
        return Trial(fit, self.second.errors(fit.effects))

    def _runs(self) -> int:
        return round(self.first.passes + self.second.passes - self.bank)

    def _quiet(self, verdict: str, p_value: float, null: Null, unseen: tuple[str, ...]) -> Finding:
        size, missing = float(self.plain.mean()), verdict == "none_of_the_known"
        return Finding(
            verdict, None, (), (), missing, p_value, p_value, size, size, null.floor, round(self.bank), self._runs(), unseen
        )  # fmt: skip

    def _better(self, new: Trial, old: Trial, floor: float) -> bool:
        """Whether one trial is better than another on `select`, beyond chance and by a part of what is left."""
        gain = old.errors - new.errors
        chance = self.rules.sigmas * float(gain.std(ddof=1)) / np.sqrt(len(gain))
        return float(gain.mean()) > max(chance, self.rules.gain * max(old.error - floor, 0.0))

    def _several(self, singles: Sequence[Trial], floor: float) -> Trial:
        """Add effects while throws that were not fitted agree: the best addition, swaps of earlier ones, dropping."""
        best = singles[0]
        for _ in range(self.rules.most - 1):
            grown = self._grow(best.fit.effects, 2)
            if grown is None or not self._better(grown, best, floor):
                break
            best = self._slim(self._swap(grown, singles), floor)
        return best

    def _grow(self, base: Sequence[Applied], tries: int) -> Trial | None:
        """The best explanation with one effect more."""
        found = [self._trial(refine(self.first, (*base, match.effect))) for match in self._screen(base)[:tries]]
        return min((trial for trial in found if trial.fit.converged), key=lambda trial: trial.error, default=None)

    def _swap(self, trial: Trial, singles: Sequence[Trial]) -> Trial:
        """Replace each effect but the last by the other singles that did well."""
        best = trial
        for place in range(len(trial.fit.effects) - 1):
            for single in singles[1:3]:
                if single.names[0] in trial.names:
                    continue
                effects = list(trial.fit.effects)
                effects[place] = single.fit.effects[0]
                other = self._trial(refine(self.first, effects))
                if other.fit.converged and other.error < best.error:
                    best = other
        return best

    def _slim(self, trial: Trial, floor: float) -> Trial:
        """Drop effects that cost nothing on throws that were not fitted."""
        for place in range(len(trial.fit.effects)):
            if len(trial.fit.effects) == 1:
                break
            less = self._trial(refine(self.first, trial.fit.effects[:place] + trial.fit.effects[place + 1 :]))
            if less.fit.converged and not self._better(trial, less, floor):
                return self._slim(less, floor)
        return trial

    def _decide(self, trials: Sequence[Trial], rest: Null, p_value: float, unseen: tuple[str, ...]) -> Finding:
        rules, best, floor = self.rules, trials[0], rest.floor
        before = float(self.plain.mean())
        # Parts of a set were beaten when it grew; they are no rivals of it.
        trials = [best, *(trial for trial in trials[1:] if not set(trial.names) < set(best.names))]
        chances = self._chances(trials)
        p_remaining = rest.p_value(best.errors)
        remains = p_remaining < rules.alarm
        near = [trial for trial in trials[1:] if self._near(trial, best, before - floor)]
        names: tuple[str, ...] = ()
        if remains and closure(before, best.error, floor) < rules.closure:
            verdict = "none_of_the_known"
        elif near or chances[0] < rules.sure:
            verdict = "ambiguous"
            near = near or [trial for trial, chance in zip(trials[1:], chances[1:], strict=True) if chance > 0.02]
            names = tuple(" + ".join(trial.names) for trial in [best, *near])
        else:
            verdict = "named"
        order = sorted(range(len(trials)), key=lambda k: trials[k].error)
        return Finding(
            verdict, best, tuple((trials[k], float(chances[k])) for k in order), names, remains, p_value, p_remaining,
            before, best.error, floor, round(self.bank), self._runs(), unseen,
        )  # fmt: skip

    def _near(self, trial: Trial, best: Trial, gap: float) -> bool:
        """Whether a rival is not clearly behind."""
        behind = trial.errors - best.errors
        chance = self.rules.sigmas * float(behind.std(ddof=1)) / np.sqrt(len(behind))
        return float(behind.mean()) < max(chance, self.rules.margin * gap)

    def _chances(self, trials: Sequence[Trial]) -> Array:
        """Probability that each trial is best, by a bootstrap over throws. [trials]."""
        errors = np.stack([trial.errors for trial in trials])
        draws = self.rng.integers(0, errors.shape[1], (self.rules.draws, errors.shape[1]))
        return np.bincount(errors[:, draws].mean(axis=2).argmin(axis=0), minlength=len(trials)) / self.rules.draws


def shift(finding: Finding, verdict: str) -> Finding:
    """The same finding with another verdict, where the third role contradicts it."""
    return replace(finding, verdict=verdict, something_remains=True)
