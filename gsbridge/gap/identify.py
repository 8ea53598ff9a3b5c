"""Which effect is missing: fits on one record, judged on another with different excitation, with the right to abstain."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.gap.bank import Bank
from gsbridge.gap.candidates import Candidate
from gsbridge.gap.detect import Null, calibrate
from gsbridge.gap.effects import effect_of
from gsbridge.gap.fit import Fit, fit_from
from gsbridge.gap.screen import screen
from gsbridge.gap.view import View
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

VERDICTS = ("no_discrepancy", "named", "ambiguous", "none_of_the_known", "not_enough_excitation")


@dataclass(frozen=True)
class Rules:
    """Thresholds of the verdict.

    Args:
        alarm: p-value below which a discrepancy counts.
        rivals: Candidates that are fitted.
        sure: Probability of being best that a name needs.
        margin: Squared residual, in units of the noise, by which all rivals must be behind.
        closure: Share of the gap that a name must close where something remains.
        most: Effects that are looked for at once.
        draws: Of the block bootstrap.
    """

    alarm: float = 0.01
    rivals: int = 6
    sure: float = 0.95
    margin: float = 9.0
    closure: float = 0.8
    most: int = 3
    draws: int = 500


@dataclass(frozen=True)
class Trial:
    """A fit and how it does on the record that it has not seen.

    Args:
        fit: The fit.
        residual: Whitened, on `select`. [T, C].
        chi2: Its square.
        closure: Share of the gap that it closes.
    """

    fit: Fit
    residual: Array
    chi2: float
    closure: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects with their joints."""
        return tuple(sorted(str(candidate) for candidate in self.fit.who))


@dataclass(frozen=True)
class Finding:
    """What was found.

    Args:
        verdict: One of `VERDICTS`.
        best: The best trial; None where nothing was fitted.
        rivals: All trials with the probability that each is best, the best first.
        ambiguous: Names among which the data cannot decide.
        something_remains: Whether the best explanation leaves more than noise.
        p_value: Of the hypothesis that nothing is missing, on `select`.
        p_remaining: Of the hypothesis that nothing is missing beyond the best explanation.
        before: Root mean square residual on `select` without effects, in units of the noise.
        after: With the best explanation.
        runs: Simulations after the bank.
        unseen: Candidates that do not show in these records at any sensible size.
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
    runs: int
    unseen: tuple[str, ...] = field(default=())


class Identification:
    """One diagnosis.

    Args:
        first: View of the record `fit`.
        second: View of the record `select`.
        bank: Signatures on `fit`.
        who: Candidates.
        rules: Thresholds.
        seed: Of replicates and bootstrap.
    """

    def __init__(
        self, first: View, second: View, bank: Bank, who: Sequence[Candidate], rules: Rules | None = None, seed: int = 0
    ) -> None:
        self.first, self.second, self.bank, self.who = first, second, bank, tuple(who)
        self.rules, self.rng = rules or Rules(), np.random.default_rng(seed)
        self.null_first: Null = calibrate(first, self.rng, bank)
        self.null: Null = calibrate(second, self.rng)
        self.plain = second.residual()
        self.floor = self.null.share * self.plain.size
        self.plain_chi2 = float((self.plain**2).sum())

    def run(self) -> Finding:
        """Detect, screen, fit, rank, decide."""
        rules, begin = self.rules, self.first.mechanism.runs
        residual = self.first.residual()
        p_first = self.null_first.p_value(residual)
        p_second = self.null.p_value(self.plain)
        p_value = min(p_first, p_second)
        matches = screen(self.first, self.bank, residual)
        p_gain = self.null_first.p_gain(matches[0].gain) if matches else 1.0
        unseen = tuple(sorted(str(c) for c in set(self.who) - {match.candidate for match in matches}))
        if min(p_value, p_gain) >= rules.alarm:
            few = len(unseen) > 0.5 * len(self.who)
            return self._quiet("not_enough_excitation" if few else "no_discrepancy", p_value, unseen, begin)
        trials = self._singles(residual)
        best = trials[0] if trials else None
        if p_first >= rules.alarm and p_gain >= rules.alarm and (best is None or best.closure < rules.closure):
            # The difference shows on `select` alone, so that nothing can be fitted to it and then tested.
            return self._quiet("not_enough_excitation", p_value, unseen, begin)
        if p_second >= rules.alarm and (best is None or self.plain_chi2 - best.chi2 < rules.margin):
            # A chance alarm on one record that the other does not confirm.
            return self._quiet("no_discrepancy", p_value, unseen, begin)
        if best is None:
            return self._quiet("none_of_the_known", p_value, unseen, begin)
        if self._remains(best):
            trials = self._several(trials)
        return self._decide(trials, p_value, unseen, begin)

    def _quiet(self, verdict: str, p_value: float, unseen: tuple[str, ...], begin: int) -> Finding:
        size = float(np.sqrt(self.plain_chi2 / self.second.freedom))
        runs = self.first.mechanism.runs - begin
        return Finding(verdict, None, (), (), verdict == "none_of_the_known", p_value, p_value, size, size, runs, unseen)

    def _trial(self, fitted: Fit) -> Trial:
        """Judge a fit on `select`."""
        residual = self.second.residual(fitted.effects)
        chi2 = float((residual**2).sum())
        gap = max(self.plain_chi2 - self.floor, 1e-9)
        return Trial(fitted, residual, chi2, 1.0 - float(np.sqrt(max(chi2 - self.floor, 0.0) / gap)))

    def _singles(self, residual: Array) -> list[Trial]:
        """Fits of one effect each, best on `select` first; those that did not converge are left out."""
        matches = [match for match in screen(self.first, self.bank, residual) if match.gain > 0]
        keep = matches[: self.rules.rivals] + [
            match for match in matches[self.rules.rivals : self.rules.rivals + 3] if match.gain > 0.9 * matches[0].gain
        ]
        out: list[Trial] = []
        bar = np.inf
        for place, match in enumerate(keep):
            several = len(match.candidate.effect.parameters) > 1 and place < 3
            starts = [(start,) for start in match.starts[: 2 if several else 1]]
            out.append(self._trial(fit_from(self.first, (match.candidate,), starts, bar)))
            # Twice the squared noise and some: a fit that ends there is no rival on the other record.
            bar = min(bar, out[-1].fit.chi2 * 1.3 + 100.0)
        return sorted((trial for trial in out if trial.fit.converged), key=lambda trial: trial.chi2)

    def _remains(self, trial: Trial) -> bool:
        """Whether a trial leaves more than noise on `select`."""
        return self.null.p_value(trial.residual) < self.rules.alarm

    def _several(self, singles: list[Trial]) -> list[Trial]:
        """Add effects one by one: the best addition, then swaps of the earlier ones, then dropping what costs nothing."""
        trials, best = list(singles), singles[0]
        for _ in range(self.rules.most - 1):
            grown = self._grow(best)
            if grown is None or grown.chi2 > best.chi2 - max(self.rules.margin, 0.15 * (best.chi2 - self.floor)):
                break
            swapped = self._swap(grown)
            best = swapped if swapped is not None and swapped.chi2 < grown.chi2 else grown
            trials.append(best)
            if not self._remains(best):
                break
        return sorted(self._slim(trials), key=lambda trial: trial.chi2)

    def _grow(self, base: Trial, tries: int = 3) -> Trial | None:
        """The best explanation with one effect more."""
        left = self.first.residual(base.fit.effects)
        values = [dict(effect.parameters) for effect in base.fit.effects]
        found = []
        for match in [m for m in screen(self.first, self.bank, left) if m.candidate not in base.fit.who][:tries]:
            bar = min((trial.fit.chi2 * 1.3 + 100.0 for trial in found), default=base.fit.chi2)
            trial = self._trial(fit_from(self.first, (*base.fit.who, match.candidate), [(*values, match.starts[0])], bar))
            if trial.fit.converged:
                found.append(trial)
        return min(found, key=lambda trial: trial.chi2, default=None)

    def _swap(self, trial: Trial) -> Trial | None:
        """Replace each effect but the last by what screens best without it."""
        best = None
        for place in range(len(trial.fit.who) - 1):
            who = trial.fit.who[:place] + trial.fit.who[place + 1 :]
            kept = [dict(e.parameters) for k, e in enumerate(trial.fit.effects) if k != place]
            alone = self._trial(fit_from(self.first, who, [tuple(kept)]))
            grown = self._grow(alone)
            if grown is not None and (best is None or grown.chi2 < best.chi2):
                best = grown
        return best

    def _slim(self, trials: list[Trial]) -> list[Trial]:
        """Leave out sets that are hardly better than one of their subsets."""
        out = []
        for trial in trials:
            parts = [t for t in trials if set(t.fit.who) < set(trial.fit.who)]
            if all(t.chi2 - trial.chi2 > self.rules.margin * self._inflation(trial) for t in parts):
                out.append(trial)
        return out

    def _inflation(self, trial: Trial) -> float:
        """Factor by which squared residuals exceed white noise's: coloured residuals hold less than their number says."""
        return max(1.0, trial.chi2 / self.floor)

    def _decide(self, trials: list[Trial], p_value: float, unseen: tuple[str, ...], begin: int) -> Finding:
        rules = self.rules
        trials = self._prefer_simple(trials)
        best = trials[0]
        # What holds the best as a special case and is no better says nothing else.
        trials = [best, *(trial for trial in trials[1:] if not self._contains(trial, best))]
        chances = self._chances(trials)
        p_remaining = self.null.p_value(best.residual)
        remains = p_remaining < rules.alarm
        margin = rules.margin * self._inflation(best)
        near = [trial for trial in trials[1:] if trial.chi2 - best.chi2 < margin]
        if remains and best.closure < rules.closure:
            verdict, names = "none_of_the_known", ()
        elif near or chances[0] < rules.sure:
            verdict = "ambiguous"
            names = tuple(" + ".join(trial.names) for trial in [best, *near])
            if len(names) == 1:
                names += tuple(
                    " + ".join(trial.names) for trial, chance in zip(trials[1:], chances[1:], strict=True) if chance > 0.02
                )
        else:
            verdict, names = "named", ()
        return Finding(
            verdict, best, tuple(zip(trials, chances.tolist(), strict=True)), names, remains, p_value, p_remaining,
            float(np.sqrt(self.plain_chi2 / self.second.freedom)), float(np.sqrt(best.chi2 / self.second.freedom)),
            self.first.mechanism.runs - begin, unseen,
        )  # fmt: skip

    def _prefer_simple(self, trials: list[Trial]) -> list[Trial]:
        """An effect that holds another as a special case must earn its further parameters."""
        out = sorted(trials, key=lambda trial: trial.chi2)
        for trial in out[1:]:
            if self._contains(out[0], trial) and trial.chi2 - out[0].chi2 < self.rules.margin * self._inflation(trial):
                out.remove(trial)
                out.insert(0, trial)
                break
        return out

    @staticmethod
    def _contains(large: Trial, small: Trial) -> bool:
        """Whether one explanation holds another as a special case."""
        if set(small.fit.who) < set(large.fit.who):
            return True
        if len(large.fit.who) != len(small.fit.who):
            return False
        return all(
            any(b == a or (b.name in effect_of(a.name).contains and a.joint == b.joint) for b in small.fit.who)
            for a in large.fit.who
        )

    def _chances(self, trials: list[Trial]) -> Array:
        """Probability that each trial is best, by a bootstrap over blocks of time. [trials]."""
        squares = np.stack([(trial.residual**2).sum(axis=1) for trial in trials])
        length = max(5, squares.shape[1] // 40)
        rows = squares.shape[1] // length
        blocks = squares[:, : rows * length].reshape(len(trials), rows, length).sum(axis=2)
        draws = self.rng.integers(0, rows, (self.rules.draws, rows))
        totals = blocks[:, draws].sum(axis=2)
        return np.bincount(totals.argmin(axis=0), minlength=len(trials)) / self.rules.draws
