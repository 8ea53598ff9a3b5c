"""An explanation that grows beyond what is sure: effect by effect, as long as each explains a part of the gap worth a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.closure import beyond_noise
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Finding, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import decide, transfer
from gsbridge.gap.joints.fit import fit
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import SETS, Screen, SignatureMatch

_LOOKED, _OF_JOINT = 20, 4
"""Candidates of which one simulation tells whether they help an account, and how many of them may act on one joint."""

_NEARLY = 0.8
"""Share of what an effect gains that a simpler one must gain to be told instead."""

_MUCH = 0.95
"""Share of what one account leaves that another must leave to be told instead."""


@dataclass(frozen=True)
class Widening:
    """The search for all effects that explain a part of a gap.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        screen: Signatures on `fit`.
        rules: Thresholds.
        floor: What a perfect model would leave on `select`, chi squared.
        plain_chi2: What the nominal model leaves there.
        trial_of: Judges a fit on `select`.
        remains: Whether a hypothesis leaves more than noise.
    """

    first: JointResiduals
    second: JointResiduals
    screen: Screen
    rules: Rules
    floor: float
    plain_chi2: float
    trial_of: Callable[[EffectFit], Hypothesis]
    remains: Callable[[Hypothesis], bool]

    def widen(self, finding: Finding) -> Hypothesis | None:
        """An explanation with all effects that help: grown from what was found, by what helps on `select` most.

        Args:
            finding: Of `run`.

        Returns:
            The explanation, of as many effects as earn their place; None where nothing could be fitted.
        """
        if finding.best is None or finding.best.fit.stopped:
            return None
        begins = [finding.best]
        singles = [trial for trial, _ in finding.rivals if len(trial.fit.who) == 1]
        if finding.verdict == "none_of_the_known" and singles and len(finding.best.fit.who) > 1:
            begins = [decide(singles, self.rules, self.floor).trials[0], finding.best]
        end, grown = self.first.mechanism.runs + self.rules.account, list[Hypothesis]()
        for number, trial in enumerate(begins, 1):
            grown.append(self._widened(trial, end - self.rules.account * (len(begins) - number) // len(begins)))
        # What grew from one effect is told, unless what began as several leaves much less.
        left = [beyond_noise(trial.chi2, self.floor) for trial in grown]
        return grown[0] if len(grown) == 1 or left[1] > _MUCH * left[0] else grown[1]

    def _widened(self, best: Hypothesis, end: int) -> Hypothesis:
        """One explanation, grown until nothing helps or the simulations are spent."""
        failed: set[Candidate] = set()
        while len(best.fit.who) < self.rules.entries and self.remains(best):
            before = best
            for match in self._promising(best, failed):
                if self.first.mechanism.runs >= end:
                    return best
                who, start = (*best.fit.who, match.candidate), (*best.fit.values, match.starts[0])
                trial = self.trial_of(fit(self.first, who, start, np.inf, self.screen, end))
                if self._earns(trial, best):
                    best = trial
                    break
                failed.add(match.candidate)
            if best is before:
                break
        return best

    def _promising(self, best: Hypothesis, failed: set[Candidate]) -> list[SignatureMatch]:
        """Candidates that help on `select` as they start, the most helpful first: what fits one record alone is no cause."""
        ranked = sorted(self.screen.matches(best.first), key=lambda match: -match.bound)
        counts: dict[str, int] = {}
        looked = []
        for match in ranked:
            joint = match.candidate.joint
            if match.candidate in best.fit.who or match.candidate in failed or counts.get(joint, 0) >= _OF_JOINT:
                continue
            counts[joint] = counts.get(joint, 0) + 1
            residual = self.second.residual((*best.fit.effects, match.candidate.applied(match.starts[0])))
            looked.append((float((residual**2).sum()), match))
            if len(looked) >= _LOOKED:
                break
        by_bound = [match for _, match in looked]
        looked = sorted((item for item in looked if item[0] < best.chi2), key=lambda item: item[0])
        # Those that do not help as they start may do so once all are fitted together.
        out = [match for _, match in looked]
        out = [*out, *(match for match in by_bound if not any(match is other for other in out))][:SETS]
        for chi2, match in looked[1:]:
            # What is the first one without some of its numbers, and does nearly as well, says as much with less.
            first = looked[0][1].candidate
            alike = match.candidate.joint == first.joint and match.candidate.name in first.effect.contains
            if alike and best.chi2 - chi2 > _NEARLY * (best.chi2 - looked[0][0]):
                out = [match, *(other for other in out if other is not match)]
        return out

    def _earns(self, trial: Hypothesis, best: Hypothesis) -> bool:
        """Whether one effect more explains a part of the gap on `select` worth a line, and by more than chance."""
        before, after, gap = (beyond_noise(chi2, self.floor) for chi2 in (best.chi2, trial.chi2, self.plain_chi2))
        if before - after < self.rules.least * gap or trial.fit.stopped:
            return False
        return transfer(best.residual, trial.residual) > self.rules.deviations
