"""From a mechanism and three records to a diagnosis: compare, screen, identify, verify."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.effects.base import Effect
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.findings import Account, Diagnosis
from gsbridge.gap.diagnosis.results import (
    NAMED,
    ROLES,
    SILENT,
    EffectFit,
    Finding,
    GapAccount,
    Hypothesis,
    Rules,
    Verification,
)
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.account import account_of
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.between import other_way
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.effort_scale import effort_scale
from gsbridge.gap.joints.fit import derivatives
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.integral_action import integral_action
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.motion import other_noise
from gsbridge.gap.joints.noise_colour import NoiseColour
from gsbridge.gap.joints.parameter_error import BesideParameterError
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.gap.joints.scatter import RecordSizes, widened
from gsbridge.gap.joints.signatures import SignatureBank
from gsbridge.gap.joints.touches import leave_out_touches, touches_told
from gsbridge.gap.joints.verify import named_by_third, verify
from gsbridge.gap.joints.widening import Widening
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")


_FAR = 50.0
"""Gap, in units of the noise, from which on the noise itself is doubted."""


_BARELY = 1.02
"""Gap on `verify`, in units of the noise, below which it is no more than noise."""

_LOUD = 2.0
"""What is left and no motion, in units of the noise that neighbouring samples show, from which on that noise is doubted."""

_COLOURED = (
    "The noise remembers itself for up to {memory:.0f} ms, as that of a filter in a sensor does, and exceeds what neighbouring "
    "samples show. It was taken from what the effects leave, in which no channel moves with another. To be sure of it, log one "
    "motion twice and name it under 'repeats'."
)


class JointAccount(Account):
    """Puts findings about a mechanism into words and figures."""

    effects = JOINT_EFFECTS

    def effects_of(self, fit: EffectFit) -> list[Effect]:
        """Effects as they act at their joints, which turn or slide."""
        return [candidate.effect for candidate in fit.who]

    def doubts(self, diagnosis: Diagnosis) -> tuple[str, ...]:
        """Why a finding is less than an answer, beside what is known of the measurements."""
        finding, further = diagnosis.finding, super().doubts(diagnosis)
        if diagnosis.left_out and not further:
            further = (touches_told(diagnosis.left_out),)
        if not finding.coloured or finding.before < _LOUD:
            return further
        return (
            f"what is left is {finding.before:.3g} times the noise that neighbouring samples show, and nothing shows that it "
            "is motion: a filter in the sensor hides its noise from them, perhaps. Log one motion twice and name it under "
            "'repeats', or state the 'noise'",
            *further,
        )


def diagnose_joints(
    system: MechanismModel,
    records: Mapping[str, Record],
    bank_folder: str | Path,
    *,
    names: Collection[str] | None = None,
    rules: Rules | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Find out what the model of a mechanism lacks.

    Args:
        system: The mechanism.
        records: Records by role: `fit`, `select`, `verify`.
        bank_folder: Keeps signatures from run to run.
        names: Effects that may be the reason; None for the whole catalogue.
        rules: Thresholds.
        seed: Seed of replicates.
    """
    begin = time.perf_counter()
    mechanism = Mechanism(system)
    views = views_of(mechanism, {role: records[role] for role in ROLES}, bank_folder)
    first, second = views["fit"], views["select"]
    who, made = candidates(first, names, (second,)), mechanism.runs
    bank = signature_bank(first, who, bank_folder)
    made = mechanism.runs - made
    logger.info("%d candidates, %d signatures", len(who), len(bank.signatures))
    left_out = leave_out_touches(views, bank)
    search = JointIdentification(first, second, bank, who, rules, seed, views["verify"])
    seen = tuple(views.values())
    # Beside one effect, a filter's noise is known as such before sets of effects are fitted that mimic it.
    finding = search.run(lambda trial: _filtered(seen, trial.fit.effects, search.rules, seed) is not None)
    if alone := bool(left_out) and finding.verdict in SILENT:
        finding = finding.refuted()
    if finding.verdict == "none_of_the_known" and finding.best is not None:
        begin_runs = mechanism.runs
        found = _with_other_noise(search, bank, seen, finding.best.fit.effects, seed)
        search.spare(mechanism.runs - begin_runs)
        search, finding = found or (search, search.run())
        if found is None and finding.verdict == "none_of_the_known" and finding.best is not None:
            search, finding = _with_other_noise(search, bank, seen, finding.best.fit.effects, seed) or (search, finding)
    diagnosis = _diagnosis(search, finding, bank, views, made, seed)
    if diagnosis.finding.verdict == "none_of_the_known" and diagnosis.account is not None and second.colour is None:
        # Several effects leave their noise to the account alone.
        found = _with_other_noise(search, bank, seen, diagnosis.account.effects, seed)
        if found is not None:
            account_runs = diagnosis.account_runs
            diagnosis = _diagnosis(*found, bank, views, made + account_runs, seed)
            diagnosis = replace(diagnosis, account_runs=account_runs + diagnosis.account_runs)
    if left_out:
        instead = touches_told(left_out, alone) if alone else diagnosis.instead
        diagnosis = replace(diagnosis, left_out=left_out, instead=instead)
    return replace(diagnosis, seconds=time.perf_counter() - begin)


def _diagnosis(
    search: JointIdentification,
    finding: Finding,
    bank: SignatureBank,
    views: Mapping[str, JointResiduals],
    made: int,
    seed: int,
) -> Diagnosis:
    """What was found, verified and taken account of.

    Args:
        search: The search.
        finding: What it found.
        bank: Signatures.
        views: Residuals on all records, by role.
        made: Simulations that the signatures took, and an earlier account.
        seed: Seed of replicates.
    """
    first, second, third = views.values()
    mechanism, who, rules, verification = first.mechanism, search.who, search.rules, None
    other = None if finding.best is None else other_way((first, second))
    if other is not None and finding.verdict in ("named", "ambiguous") and other.rivals(finding):
        # Not a fault of the mechanism, perhaps, but of what the model says about the log.
        finding = finding.refuted()
    scale = None if finding.best is None else effort_scale((first, second))
    integral = None if finding.verdict in SILENT else integral_action((first, second))
    # Nor is a wrong unit one, nor a controller that the model does not have.
    instead = scale.sentence if scale is not None and scale.rivals(finding) else ""
    instead = integral.sentence if integral is not None else instead
    if instead:
        finding = finding.refuted()
    finding = named_by_third(finding, tuple(views.values()), rules, search.floor, search.left)
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = _verified(tuple(views.values()), finding.best.fit, rules, seed)
        said = finding.verdict in ("named", "ambiguous")
        # Enough effects together mimic a law that is missing, if not to the last per cent on two records.
        mimics = finding.something_remains and len(finding.best.fit.who) > 1 and finding.best.closure < rules.several
        asked = replace(rules, closure=rules.several) if mimics else rules
        finding = finding.refuted() if said and not verification.transfers(asked) else finding
    account, named = None, mechanism.runs - made - mechanism.shared
    if finding.best is not None and finding.verdict not in SILENT and not instead:
        if told := finding.verdict in ("named", "ambiguous"):
            spread = _unsure(finding.best.fit, tuple(views.values()), finding.after)
            finding = replace(finding, best=replace(finding.best, fit=spread))
        floors = (search.floor_first, search.floor)
        wide = Widening(first, second, who, search.screen, search.rules, floors, search.remains)
        whole = wide.widen(finding)
        if whole is not None and not (told and _same(whole.fit.effects, effects)):
            whole = replace(whole, fit=_unsure(whole.fit, tuple(views.values())))
        account = None if whole is None else account_of(wide, finding, whole, third)
        if account is not None and verification is not None and not told:
            # Shares of hardly any gap are shares of nothing, and an account that explains none of it is no account.
            tells = account.explained >= search.rules.worth and verification.before >= _BARELY
            account = account if tells else None
        if account is not None and whole is not None and not told:
            # What the account leads to is compared with what was found by the rules of a name.
            second_look = _second_look(search, account, tuple(views.values()), seed)
            if second_look is not None and not (other is not None and other.rivals(second_look[0])):
                finding, verification = second_look
                account = account_of(wide, finding, whole, third)
    if account is not None and finding.best is not None and not _same(account.effects, finding.best.fit.effects):
        verification = verify(third, account.effects, np.random.default_rng(seed))
        finding = _as_accounted(finding, finding.best, account)
    floor = {second.record.label(kind, k): float(s) for (kind, k), s in zip(second.channels, second.sigma, strict=True)}
    further = mechanism.runs - made - mechanism.shared - named
    warnings = _warnings(finding, bank, any(view.record.sigma or view.record.tolerance for view in views.values()))
    if second.colour is not None:
        warnings = (*warnings, _COLOURED.format(memory=float(second.colour.memory.max()) * second.record.period * 1e3))
    if other is not None and other.tells(finding):
        warnings = (other.sentence, *warnings)
    return Diagnosis(
        finding,
        verification,
        floor,
        bank.runs,
        named,
        0.0,
        account=account,
        warnings=warnings,
        account_runs=further,
        instead=instead,
    )


def _filtered(
    views: Sequence[JointResiduals], effects: Sequence[Applied], rules: Rules, seed: int
) -> tuple[Array, list[NoiseColour]] | None:
    """What the noise is if it is all that effects leave of three records, by `other_noise`."""
    left = [view.residual(effects) for view in views]
    return other_noise(views, left, np.random.default_rng(seed), rules.deviations)


def _with_other_noise(
    search: JointIdentification,
    bank: SignatureBank,
    views: Sequence[JointResiduals],
    effects: Sequence[Applied],
    seed: int,
) -> tuple[JointIdentification, Finding] | None:
    """A search whose noise is what some effects leave, and what it names; None if that is motion, or if nothing is named.

    Args:
        search: A search that took the noise for white.
        bank: Signatures.
        views: Residuals on all records, which keep the noise if something is named.
        effects: The effects.
        seed: Seed of replicates.
    """
    found = _filtered(views, effects, search.rules, seed)
    if found is None:
        return None
    white = [(view.sigma, view.records) for view in views]
    for view, colour in zip(views, found[1], strict=True):
        view.set_noise(found[0], view.records, colour)
    again = JointIdentification(views[0], views[1], bank, search.who, search.rules, seed, views[2])
    named = again.run()
    if named.verdict in ("named", "ambiguous"):
        return again, named
    for view, (sigma, records) in zip(views, white, strict=True):
        view.set_noise(sigma, records)
    return None


def _second_look(
    search: JointIdentification, account: GapAccount, views: Sequence[JointResiduals], seed: int
) -> tuple[Finding, Verification] | None:
    """What the first few effects of an account that close its gap are called, if the search never tried them together.

    Growing effect by effect from one record takes what explains most alone, which may be none of them.

    Args:
        search: Compares explanations.
        account: The account.
        views: Residuals on all records, `verify` last.
        seed: Seed of replicates.

    Returns:
        The finding, and what `verify` says; None where nothing else is named.
    """
    count, closes = 0, 0.0
    while count < min(search.rules.most, len(account.entries)) and closes < search.rules.closure:
        closes, count = closes + account.entries[count].share, count + 1
    first = account.entries[:count]
    if closes < search.rules.closure or any(entry.verdict == NAMED for entry in first):
        return None
    found = search.again(
        [entry.candidate for entry in first],
        [dict(entry.effect.parameters) for entry in first],
        [entry.instead for entry in first],
    )
    if found is None or found.verdict not in ("named", "ambiguous") or found.best is None:
        return None
    best, fit = found.best, found.best.fit
    found = named_by_third(found, views, search.rules, search.floor, search.left)
    checked = _verified(views, fit, search.rules, seed)
    # Enough effects together mimic a law that is missing, if not to the last per cent.
    asked = search.rules if len(fit.who) == 1 else replace(search.rules, closure=search.rules.several)
    if not checked.transfers(asked):
        return None
    return replace(found, best=replace(best, fit=_unsure(fit, views, found.after))), checked


def _verified(views: Sequence[JointResiduals], fit: EffectFit, rules: Rules, seed: int) -> Verification:
    """What the last record says of a fit to the first, or to the first two."""
    beside = BesideParameterError(views[-1], views[:-1], derivatives)
    return verify(views[-1], fit.effects, np.random.default_rng(seed), lambda: beside(fit), rules.alarm)


def _unsure(fit: EffectFit, views: Sequence[JointResiduals], size: float = 1.0) -> EffectFit:
    """A fit with deviations that know how far records disagree.

    Args:
        fit: The fit.
        views: Residuals on all records, those that it was fitted to first.
        size: What is left, in units of the noise, by which deviations are multiplied later.
    """
    wide = max(1.0, size)
    return replace(fit, deviations=widened(wide * fit.deviations, RecordSizes.of(views, fit), fit.records) / wide)


def _as_accounted(finding: Finding, best: Hypothesis, account: GapAccount) -> Finding:
    """A finding with the sizes that the account has, where it holds all that was named: one thing has one size.

    What was named was mostly fitted to one record, on which two masses of an arm may hardly be parted; the account to both.

    Args:
        finding: What was found.
        best: Its best explanation.
        account: The account.
    """
    lines = {entry.candidate: entry for entry in account.entries}
    if any(candidate not in lines for candidate in best.fit.who):
        return finding
    held = [lines[candidate] for candidate in best.fit.who]
    # Findings multiply deviations by what is left; the account's know of it.
    deviations = np.concatenate([entry.deviations for entry in held]) / max(1.0, finding.after)
    fit = replace(best.fit, effects=tuple(entry.effect for entry in held), deviations=deviations)
    return replace(finding, best=replace(best, fit=fit))


def _same(some: Sequence[Applied], others: Sequence[Applied]) -> bool:
    """Whether two lists hold the same effects with the same parameters."""
    return len(some) == len(others) and all(effect in others for effect in some)


def _warnings(finding: Finding, bank: SignatureBank, stated: bool) -> tuple[str, ...]:
    """What a reader must know before the figures; `stated` is whether the case states noise or tolerance."""
    out = []
    if finding.before > _FAR and not stated:
        out.append(
            f"The gap is {finding.before:.3g} times the noise that neighbouring samples show. Filters in an encoder hide noise "
            "from them: log one motion twice and name it under 'repeats', or state a 'tolerance'."
        )
    if finding.lost:
        out.append(f"These fits did not converge, so that nothing is said of them: {', '.join(finding.lost)}.")
    if bank.diverged:
        names = ", ".join(map(str, bank.diverged))
        out.append(f"The simulation diverged with these, so that nothing is said of them: {names}.")
    return tuple(out)


def views_of(
    mechanism: Mechanism, records: Mapping[str, Record], folder: str | Path | None = None
) -> dict[str, JointResiduals]:
    """Residuals of records, with one estimate of the noise for all of them, as they come from one set of sensors.

    Args:
        mechanism: Simulates.
        records: Records by role.
        folder: Keeps the sensitivities that records may share; nothing is kept when None.

    Returns:
        Residuals by role.
    """
    views = {role: JointResiduals.of(mechanism, record, folder=folder) for role, record in records.items()}
    share_noise(tuple(views.values()))
    return views
