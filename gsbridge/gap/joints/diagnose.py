"""From a mechanism and three records to findings: compare, screen, identify, verify."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Finding, Hypothesis, Rules
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.account import Account, account_of
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import Candidate, candidates
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.gap.joints.verify import PART, Verification, verify

logger = logging.getLogger("gsbridge")

ROLES = ("fit", "select", "verify")

_FAR = 50.0
"""Gap, in units of the noise, from which on the noise itself is doubted."""

_LISTED = 5
"""Rivals that a sentence names."""

_NINETY = 1.645
"""Standard deviations either side of a 90 % interval."""


@dataclass(frozen=True)
class Diagnosis:
    """All about one case.

    Args:
        finding: Verdict and trials.
        verification: Of all that the account holds, on the third record.
        account: All effects that explain a part of the gap.
        floor: Noise of each channel of `select`, SI units.
        bank_runs: Simulations of the bank, whether made now or read.
        runs: Simulations of this case beside it.
        seconds: Of the whole.
        diverged: Candidates with which no simulation ran through.
    """

    finding: Finding
    verification: Verification | None
    account: Account | None
    floor: dict[str, float]
    bank_runs: int
    runs: int
    seconds: float
    diverged: tuple[str, ...] = ()

    @property
    def effects(self) -> tuple[Applied, ...]:
        """What may be added to the model: the whole account, if it makes the third record no worse.

        An account without a name must close a good part of the gap there: little may be anything.
        """
        account, better = self.account, self.verification is not None and self.verification.accepted
        if account is None or not better:
            return ()
        sure = self.finding.verdict in ("named", "ambiguous")
        return account.effects if sure or account.explained >= PART else ()


def diagnose_joints(
    system: MechanismModel,
    records: Mapping[str, Record],
    bank_folder: str | Path,
    *,
    names: Collection[str] | None = None,
    rules: Rules | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Find out what a model lacks.

    Args:
        system: The mechanism.
        records: By role: `fit`, `select`, `verify`.
        bank_folder: Keeps signatures from run to run.
        names: Effects that may be the reason; None for the whole catalogue.
        rules: Thresholds.
        seed: Of replicates.
    """
    begin = time.perf_counter()
    mechanism = Mechanism(system)
    first = JointResiduals.of(mechanism, records["fit"], folder=bank_folder)
    second = JointResiduals.of(mechanism, records["select"], folder=bank_folder)
    third = JointResiduals.of(mechanism, records["verify"], folder=bank_folder)
    share_noise((first, second, third))
    who, made = candidates(system, names), mechanism.runs
    bank = signature_bank(first, who, bank_folder)
    made = mechanism.runs - made
    logger.info("%d candidates, %d signatures", len(who), len(bank.signatures))
    search = JointIdentification(first, second, bank, who, rules, seed)
    finding = search.run()
    verification = None
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = verify(third, effects, np.random.default_rng(seed))
        said = finding.verdict in ("named", "ambiguous")
        if said and not verification.transfers(rules or Rules()):
            # It closed the gap where it was chosen, but not elsewhere: whatever is missing, it is something else.
            finding = replace(finding, verdict="none_of_the_known", ambiguous=(), something_remains=True)
    account = account_of(search, finding, third)
    if (
        account is not None
        and verification is not None
        and len(account.entries) > len(finding.best.fit.who if finding.best else ())
    ):
        verification = verify(third, account.effects, np.random.default_rng(seed))
    floor = {second.record.label(kind, k): float(s) for (kind, k), s in zip(second.channels, second.sigma, strict=True)}
    runs = mechanism.runs - made - mechanism.shared
    return Diagnosis(
        finding, verification, account, floor, bank.runs, runs, time.perf_counter() - begin, tuple(map(str, bank.diverged))
    )


def findings_of(
    diagnosis: Diagnosis, records: Mapping[str, Record], *, seed: int, reasons: Collection[str] = ()
) -> dict[str, Any]:
    """What `findings.json` holds.

    Args:
        diagnosis: The diagnosis.
        records: Its records.
        seed: As given to `diagnose_joints`.
        reasons: Why the result is degraded.
    """
    finding, checked = diagnosis.finding, diagnosis.verification
    return {
        "status": "degraded" if reasons else "pass",
        "reasons": list(reasons),
        "warnings": warnings_of(diagnosis, records),
        "sentence": sentence(diagnosis),
        "verdict": finding.verdict,
        "something_remains": finding.something_remains,
        "effects": [] if finding.best is None else describe(finding.best, finding),
        "account": None if diagnosis.account is None else account_record(diagnosis.account, finding),
        "lost": list(finding.lost),
        "amended": [effect.record() for effect in diagnosis.effects],
        "ambiguous": list(finding.ambiguous),
        "p_value": finding.p_value,
        "p_remaining": finding.p_remaining,
        "rivals": [
            {
                "effects": list(trial.names),
                "behind": trial.score - finding.rivals[0][0].score,
                "probability": chance,
                "closure": trial.closure,
            }
            for trial, chance in finding.rivals
        ],
        "select": {"before": finding.before, "after": finding.after, "unit": "noise"},
        "verify": None
        if checked is None
        else {
            "before": checked.before,
            "after": checked.after,
            "closure": checked.closure,
            "accepted": checked.accepted,
            "p_remaining": checked.p_remaining,
            "channels": checked.channels,
            "unit": "noise",
        },
        "noise_floor": diagnosis.floor,
        "unseen": list(finding.unseen),
        "simulations": {"bank": diagnosis.bank_runs, "case": diagnosis.runs},
        "seconds": diagnosis.seconds,
        "records": {role: record.digest or record.content_digest() for role, record in records.items()},
        "seed": seed,
    }


def warnings_of(diagnosis: Diagnosis, records: Mapping[str, Record]) -> list[str]:
    """What a reader must know before the figures.

    Args:
        diagnosis: The diagnosis.
        records: Its records.
    """
    out, finding = [], diagnosis.finding
    stated = any(record.sigma or record.tolerance for record in records.values())
    if finding.before > _FAR and not stated:
        out.append(
            f"The gap is {finding.before:.3g} times the noise that neighbouring samples show. Filters in an encoder hide noise "
            "from them: log one motion twice and name it under 'repeats', or state a 'tolerance'."
        )
    if finding.lost:
        out.append(f"These fits did not converge, so that nothing is said of them: {', '.join(finding.lost)}.")
    if diagnosis.diverged:
        out.append(f"The simulation diverged with these, so that nothing is said of them: {', '.join(diagnosis.diverged)}.")
    return out


def account_record(account: Account, finding: Finding) -> dict[str, Any]:
    """An account as `findings.json` holds it."""
    rows = []
    for entry in account.entries:
        described = _described(entry.candidate, entry.effect, entry.deviations, max(1.0, finding.after))
        rows.append(
            {
                "label": str(entry.candidate),
                **described,
                "share": entry.share,
                "verdict": entry.verdict,
                "instead": list(entry.instead),
            }
        )
    return {
        "entries": rows,
        "explained": account.explained,
        "remains": {"channel": account.channel, "phase": account.phase, "size": account.left, "unit": "noise"},
    }


def describe(trial: Hypothesis, finding: Finding) -> list[dict[str, Any]]:
    """Parameters of a trial's effects with units and 90 % intervals."""
    out, place = [], 0
    # Residuals above the noise widen the intervals as they would under noise of that size.
    wide = max(1.0, finding.after)
    for candidate, effect in zip(trial.fit.who, trial.fit.effects, strict=True):
        count = len(candidate.effect.parameters)
        out.append(_described(candidate, effect, trial.fit.deviations[place : place + count], wide))
        place += count
    return out


def _described(candidate: Candidate, effect: Applied, deviations: Sequence[float], wide: float) -> dict[str, Any]:
    """One effect with units and 90 % intervals, made wider by a factor."""
    rows = {}
    for parameter, deviation in zip(candidate.effect.parameters, deviations, strict=True):
        value, spread = effect.parameters[parameter.name], _NINETY * wide * float(deviation)
        interval = [max(value - spread, parameter.low), min(value + spread, parameter.high)]
        rows[parameter.name] = {"value": value, "unit": parameter.unit, "interval90": interval}
    return {
        "name": candidate.name,
        "joint": candidate.joint,
        "title": candidate.effect.title,
        "hook": candidate.effect.hook,
        "parameters": rows,
        "confused_with": list(candidate.effect.confused_with),
        "tell_apart": candidate.effect.tell_apart,
    }


def sentence(diagnosis: Diagnosis) -> str:
    """The finding in words."""
    finding, checked = diagnosis.finding, diagnosis.verification
    if finding.coloured and finding.untold:
        return (
            "No known effect: more than white noise is left, nothing learnt from one record holds on the other, and no two "
            "channels here measure the same motion, which would tell noise of another colour from motion. Log speeds, too."
        )
    if finding.coloured:
        return (
            "Simulation and measurement agree: what exceeds white noise is no motion, and nothing learnt from one record holds "
            "on the other."
        )
    if finding.verdict == "no_discrepancy":
        return f"Simulation and measurement agree within the noise (p = {finding.p_value:.2g})."
    if finding.verdict == "not_enough_excitation" and finding.p_value < Rules.alarm:
        return "A difference shows on 'select' alone; log another record of such motion and fit that one."
    if finding.verdict == "not_enough_excitation":
        return "No difference shows, but most effects could not show in these records: excite the mechanism more."
    best = finding.best
    if best is None:
        return f"Something is missing (p = {finding.p_value:.2g}), and no known effect could be fitted to it."
    if finding.verdict == "none_of_the_known":
        return _closest(diagnosis, finding)
    if finding.verdict == "ambiguous":
        how = best.fit.who[0].effect.tell_apart
        names = list(finding.ambiguous)
        listed = " and ".join(names if len(names) <= _LISTED else [*names[:_LISTED], f"{len(names) - _LISTED} more"])
        return f"These records cannot decide between {listed}. To tell them apart: {how}."
    parts = []
    for item in describe(best, finding):
        figures = ", ".join(
            f"{name} {_pair(row['value'], row['interval90'])} {row['unit']}".rstrip()
            for name, row in item["parameters"].items()
        )
        where = f"Joint '{item['joint']}' lacks" if item["joint"] else "The model lacks"
        parts.append(f"{where} {item['title']} ({figures})")
    tail = ""
    if checked is not None:
        verb = "falls" if checked.after <= checked.before else "rises"
        tail = f"; the gap {verb} from {checked.before:.3g} to {checked.after:.3g} times the noise on a record it has not seen"
    rest = ", but something remains" if finding.something_remains else ""
    return "; ".join(parts) + tail + rest + "."


def _closest(diagnosis: Diagnosis, finding: Finding) -> str:
    """What comes nearest where nothing can be named, what it leaves, and what to do next."""
    account = diagnosis.account
    if account is None or not account.entries:
        return f"Something is missing (p = {finding.p_value:.2g}), and no single known effect suffices."
    shown = account.entries[:_LISTED]
    listed = ", ".join(f"{entry.effect.joint and entry.effect.joint + ': '}{entry.candidate.effect.title} "
                       f"({100 * entry.share:.0f} %)" for entry in shown)  # fmt: skip
    more = f" and {len(account.entries) - _LISTED} more" if len(account.entries) > _LISTED else ""
    rest = f", mostly in {account.channel}, {account.phase}" if account.channel else ""
    return (
        f"No single known effect suffices. Closest are {listed}{more}; with them in the model, "
        f"{100 * (1.0 - account.explained):.0f} % of the gap remains on a record that they have not seen{rest}. Do this next: "
        f"{shown[0].candidate.effect.tell_apart}."
    )


def _pair(value: float, interval: list[float]) -> str:
    """A value with half the width of its interval, rounded to the width's second digit."""
    half = max(0.5 * (interval[1] - interval[0]), 1e-12)
    digits = max(0, int(1 - np.floor(np.log10(half))))
    return f"{value:.{digits}f} ± {half:.{digits}f}"
