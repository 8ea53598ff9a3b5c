"""Diagnosis of a thrown body from three sets of throws: compare, screen, identify, verify."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.base import Parameter
from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.account import throw_account
from gsbridge.gap.contact.bank import grid_bank
from gsbridge.gap.contact.body import FreeBody
from gsbridge.gap.contact.identify import ThrowIdentification, ThrowRules
from gsbridge.gap.contact.interval import intervals
from gsbridge.gap.contact.null import closure
from gsbridge.gap.contact.replay import HORIZON, PHASES, ThrowReplay
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.starts import pooled_speeds
from gsbridge.gap.contact.throws import Throws
from gsbridge.gap.diagnosis.findings import Account, Diagnosis
from gsbridge.gap.diagnosis.results import ROLES, AccountEntry, Verification
from gsbridge.gap.diagnosis.wording import digits_of, plain

_HOLDS = 2.0 / 3.0
"""Share of the gap, in weighted distances, that a named effect must close on `verify`.

A wrong effect may close half of it: a small loss of speed does so for the gap of a softer contact.
"""


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
    """Find out what the simulation of a thrown body lacks. Gaps are mean distances, m.

    Args:
        body: The model.
        throws: Throws by role: `fit`, `select`, `verify`.
        bank_folder: Folder that keeps grids from run to run.
        names: Effects to consider; None for all effects of a body.
        rules: Thresholds; None for the defaults.
        horizon: Length of each throw that is replayed, s.
        seed: Random seed of replicates and bootstraps.
    """
    begin = time.perf_counter()
    first, select, third = (ThrowReplay(body, throws[role], horizon) for role in ROLES)
    replays = (first, select, third)
    # One tracker measured all sets, so their logged speeds have the same noise.
    for replay, noise in zip(replays, pooled_speeds([replay.noise for replay in replays]), strict=True):
        replay.noise = noise
    bank = grid_bank(first, names, bank_folder)
    finding = ThrowIdentification(first, select, bank, rules, seed).run()
    phases = select.phases()
    where = {phase: (phases[phase], phases[phase]) for phase in PHASES if phase in phases}
    verification, account, spans, figures = None, None, [], []
    best = finding.best
    if best is not None:
        effects = best.fit.effects
        before, after = float(third.gaps().mean()), float(third.gaps(effects).mean())
        third.weigh(finding.spread)
        share = closure(float(third.errors().mean()), float(third.errors(effects).mean()), finding.weighed)
        verification = Verification(before, after, share, {"position": (before, after)}, after <= before)
        if finding.verdict == "named" and share < _HOLDS:
            finding = finding.refuted()
        spans = intervals(first, best.fit, np.random.default_rng([seed, 1]))
        figures = _changes(body, effects)
        after_phases = select.phases(effects)
        where = {phase: (before, after_phases[phase]) for phase, (before, _) in where.items()}
    runs = round(sum(replay.passes for replay in replays))
    if best is not None:
        sure = (finding.verdict, finding.near)
        account = throw_account(best.fit.effects, sure, finding.weighed, select, third, spans, figures)
    floor, seconds = {"position": finding.floor}, time.perf_counter() - begin
    more = round(sum(replay.passes for replay in replays)) - runs
    return Diagnosis(
        finding, verification, floor, round(bank.runs), runs, seconds, tuple(spans), tuple(figures), where, account,
        account_runs=more,
    )  # fmt: skip


def _changes(body: FreeBody, effects: tuple[Applied, ...]) -> list[dict[str, tuple[float, float]]]:
    """Return the old and new value of the body's own figures, by effect and parameter."""
    was, became = (body_setup(body, added).figures for added in ((), effects))
    named = [BODY_EFFECTS[applied.name].figures for applied in effects]
    return [{key: (was[figure], became[figure]) for key, figure in figures.items()} for figures in named]


class ThrowAccount(Account):
    """Turns findings about a thrown body into words and figures, with lengths in millimetres."""

    effects = BODY_EFFECTS
    unit = "mm"
    scale = 1e3
    measured = "throws"
    others = "throws"
    agree = "Simulated and measured throws agree within noise and chaos (p = {p:.2g})."
    unexcited = "No difference shows, but most effects could not show in these throws: let the body hit, slide and turn."

    def sentence(self, diagnosis: Diagnosis) -> str:
        """Return the finding as a sentence."""
        finding = diagnosis.finding
        if finding.verdict != "not_attributable":
            return super().sentence(diagnosis)
        return (
            f"Something remains that cannot be attributed: {self._apart(diagnosis)}. They fly alike until they touch, and "
            "nothing learnt from some throws holds on others: another engine's way of pushing bodies apart differs as much, "
            "and so may contacts that no catalogue has. Do this next: slow throws that touch once, at one place."
        )

    def doubts(self, diagnosis: Diagnosis) -> tuple[str, ...]:
        """Return the reason why a finding that cannot be attributed is a degraded result."""
        if diagnosis.finding.verdict != "not_attributable":
            return ()
        return (f"{self._apart(diagnosis)}, which no known effect explains",)

    def _apart(self, diagnosis: Diagnosis) -> str:
        gap, floor = (f"{plain(self.scale * x)} mm" for x in (diagnosis.finding.before, diagnosis.floor["position"]))
        return f"simulated and measured throws are {gap} apart, where noise and chaos explain {floor}"

    def unit_of(self, parameter: Parameter) -> str:
        """Return the unit of a parameter; empty for shares."""
        return "" if parameter.unit == "1" else parameter.unit

    def lacks(self, item: Mapping[str, Any]) -> str:
        """Return the words for the new values of the model's figures; `item` is an entry of `describe`."""
        share, alone = BODY_EFFECTS[item["name"]].relative, len(item["parameters"]) == 1
        figures = ", ".join(
            _figure("" if alone else name.replace("_", " "), row, share) for name, row in item["parameters"].items()
        )
        return f"{item['title'][0].upper()}{item['title'][1:]}: {figures}"

    def _line(self, entry: AccountEntry) -> str:
        """Return an entry as part of a sentence: the new values of its figures, and its share."""
        text = self.lacks(self._entry(entry))
        return f"{text[0].lower()}{text[1:]} ({100 * entry.share:.0f} %)"

    def change(self, checked: Verification) -> str:
        """Return the words for how the mean distance changes on `verify`."""
        verb = "falls" if checked.after <= checked.before else "rises"
        sizes = f"{plain(1e3 * checked.before)} to {plain(1e3 * checked.after)} mm"
        return f"the mean distance {verb} from {sizes} on throws it has not seen"


def _figure(name: str, row: Mapping[str, Any], share: bool) -> str:
    """Return the new value of a figure with half the width of its interval, and its old value; shares in per cent."""
    half, digits = digits_of(row["interval90"], 100.0 if share else 1.0)
    if share:
        text = f"{100 * row['value']:+.{digits}f} ± {100 * half:.{digits}f} %"
    else:
        text = f"{row['becomes']:.{digits}f} ± {half:.{digits}f} {row['unit']}".rstrip() + f" instead of {row['was']:.3g}"
    return f"{name} {text}".lstrip()
