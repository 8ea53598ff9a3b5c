"""From a body and three sets of throws to findings: compare, screen, identify, verify."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.bank import grid_bank
from gsbridge.gap.contact.body import FreeBody
from gsbridge.gap.contact.identify import ThrowFinding, ThrowIdentification, ThrowRules, closure, shift
from gsbridge.gap.contact.interval import intervals
from gsbridge.gap.contact.replay import HORIZON, PHASES, ThrowReplay
from gsbridge.gap.contact.throws import Throws
from gsbridge.gap.joints.diagnose import ROLES

TRANSFERS = 0.5
"""Share of the gap that a name must close on throws that neither fitting nor choosing has seen."""


@dataclass(frozen=True)
class Verification:
    """Mean distances on `verify`, m.

    Args:
        before: Without the effects.
        after: With them.
        floor: What noise, chaos and the engine's choices explain.
    """

    before: float
    after: float
    floor: float

    @property
    def closure(self) -> float:
        """Share of the gap above the floor that is closed."""
        return closure(self.before, self.after, self.floor)

    @property
    def accepted(self) -> bool:
        """Whether the amended model is no worse."""
        return self.after <= self.before

    @property
    def transfers(self) -> bool:
        """Whether the effects close a good part of the gap there too."""
        return self.closure >= TRANSFERS


@dataclass(frozen=True)
class Diagnosis:
    """All about one case of throws.

    Args:
        body: The model.
        finding: Verdict and trials.
        verification: On the third role, where something was fitted.
        intervals: 90 % intervals of the best trial's parameters, by effect.
        where: Mean distance on `select` in each phase before and after, m.
        bank_runs: Passes over all throws of `fit` that the bank took, whether made now or read.
        runs: Further passes over the throws of a role.
        seconds: Of the whole.
    """

    body: FreeBody
    finding: ThrowFinding
    verification: Verification | None
    intervals: tuple[Mapping[str, tuple[float, float]], ...]
    where: Mapping[str, tuple[float, float]]
    bank_runs: int
    runs: int
    seconds: float

    @property
    def effects(self) -> tuple[Applied, ...]:
        """What may be added to the model: named, and no worse on the third role."""
        named = self.finding.verdict == "named" and self.verification is not None and self.verification.accepted
        return self.finding.best.fit.effects if named and self.finding.best is not None else ()


def diagnose_throws(
    body: FreeBody,
    throws: Mapping[str, Throws],
    bank_folder: str | Path,
    *,
    names: Collection[str] | None = None,
    rules: ThrowRules | None = None,
    horizon: float = HORIZON,
    seed: int = 0,
) -> Diagnosis:
    """Find out what the simulation of a thrown body lacks.

    Args:
        body: The model.
        throws: By role: `fit`, `select`, `verify`.
        bank_folder: Keeps grids from run to run.
        names: Effects that may be the reason; None for all of a body.
        rules: Thresholds.
        horizon: Length that is replayed, s.
        seed: Of replicates and bootstraps.
    """
    begin = time.perf_counter()
    first, select, third = (ThrowReplay(body, throws[role], horizon) for role in ROLES)
    bank = grid_bank(first, names, bank_folder)
    finding = ThrowIdentification(first, select, bank, rules, seed).run()
    verification, spans = None, []
    phases = select.phases()
    where = {phase: (phases[phase], phases[phase]) for phase in PHASES if phase in phases}
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = Verification(float(third.errors().mean()), float(third.errors(effects).mean()), finding.floor)
        if finding.verdict == "named" and not verification.transfers:
            # It closed the gap where it was chosen, but not elsewhere: whatever is missing, it is something else.
            finding = shift(finding, "none_of_the_known")
        spans = intervals(first, finding.best.fit, np.random.default_rng([seed, 1]))
        after = select.phases(effects)
        where = {phase: (before, after[phase]) for phase, (before, _) in where.items()}
    runs = round(sum(replay.passes for replay in (first, select, third)))
    seconds = time.perf_counter() - begin
    return Diagnosis(body, finding, verification, tuple(spans), where, round(bank.runs), runs, seconds)
