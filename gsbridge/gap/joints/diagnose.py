"""The diagnosis of a mechanism from three records: compare, screen, identify, verify."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gsbridge.effects.base import Effect
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.findings import Account, Diagnosis
from gsbridge.gap.diagnosis.results import (
    ABSTAINING,
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
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.account import account_of
from gsbridge.gap.joints.arcs import arc_warning, arcs_of
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
from gsbridge.gap.joints.warnings import to_know_noise, warnings_of
from gsbridge.gap.joints.widening import Widening
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")


_BARELY = 1.02
"""Gap on `verify`, in units of the noise, below which it counts as noise alone."""

_LOUD = 2.0
"""Residual without motion, in units of the noise that neighbouring samples show, above which that noise estimate is doubted."""


@dataclass(frozen=True)
class JointAccount(Account):
    """Turns findings about a mechanism into sentences and figures.

    Args:
        repeatable: Whether repeats of a motion would tell the noise.
    """

    repeatable: bool = True

    effects = JOINT_EFFECTS

    def effects_of(self, fit: EffectFit) -> list[Effect]:
        """Return the effects as they act at their joints, which turn or slide."""
        return [candidate.effect for candidate in fit.who]

    def doubts(self, diagnosis: Diagnosis) -> tuple[str, ...]:
        """List the reasons why a finding is uncertain, apart from those that concern the measurements."""
        finding, further = diagnosis.finding, super().doubts(diagnosis)
        if diagnosis.left_out and not further:
            further = (touches_told(diagnosis.left_out),)
        if not finding.coloured or finding.before < _LOUD:
            return further
        advice = to_know_noise(self.repeatable, "the 'noise'")
        return (
            f"what is left is {plain(finding.before)} times the noise that neighbouring samples show, and nothing shows that "
            f"it is motion: a filter in the sensor hides its noise from them, perhaps. {advice[0].upper()}{advice[1:]}",
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
    """Find out which effects the model of a mechanism lacks.

    Args:
        system: Model of the mechanism.
        records: Records by role: `fit`, `select`, `verify`.
        bank_folder: Folder that keeps signatures from run to run.
        names: Effects that may be the cause; None for the whole catalogue.
        rules: Thresholds.
        seed: Seed of the replicates of the noise.
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
    # Ask after single effects whether the residual is noise of a filter; sets of effects could be fitted to such noise.
    finding = search.run(lambda trial: _filtered(seen, trial.fit.effects, search.rules, seed) is not None)
    if finding.verdict == "none_of_the_known" and finding.best is not None:
        begin_runs = mechanism.runs
        found = _with_other_noise(search, bank, seen, finding.best.fit.effects, seed)
        search.spare(mechanism.runs - begin_runs)
        search, finding = found or (search, search.run())
        if found is None and finding.verdict == "none_of_the_known" and finding.best is not None:
            search, finding = _with_other_noise(search, bank, seen, finding.best.fit.effects, seed) or (search, finding)
    if alone := bool(left_out) and finding.verdict in SILENT:
        finding = finding.refuted()
    diagnosis = _diagnosis(search, finding, bank, views, made, seed)
    if diagnosis.finding.verdict == "none_of_the_known" and diagnosis.account is not None and second.colour is None:
        # With several missing effects, only the account explains all of them and so leaves the noise alone.
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
    """Verify a finding on the third record and take account of the whole gap.

    Args:
        search: The search that made the finding.
        finding: Finding of the search.
        bank: Signatures.
        views: Residuals on all records, by role.
        made: Simulations spent on the signatures and on an earlier account.
        seed: Seed of the replicates of the noise.
    """
    first, second, third = views.values()
    mechanism, who, rules, verification = first.mechanism, search.who, search.rules, None
    other = None if finding.best is None else other_way((first, second))
    if other is not None and finding.verdict in ("named", "ambiguous") and other.rivals(finding):
        # Perhaps the mechanism is right, and the model misstates how commands go on between two samples.
        finding = finding.refuted()
    scale = None if finding.best is None else effort_scale((first, second))
    integral = None if finding.verdict in SILENT else integral_action((first, second))
    # Likewise, a wrong unit of the efforts or a controller with an integral is no fault of the mechanism.
    instead = scale.sentence if scale is not None and scale.rivals(finding) else ""
    instead = integral.sentence if integral is not None else instead
    if instead:
        finding = finding.refuted()
    finding = named_by_third(finding, tuple(views.values()), rules, search.floor, search.left)
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = _verified(tuple(views.values()), finding.best.fit, rules, seed)
        said = finding.verdict in ("named", "ambiguous")
        # Several effects together can mimic a missing law, but hardly close the last per cent on two records.
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
            # Drop the account if the gap on `verify` is hardly more than noise, or if the account explains too little of it.
            tells = account.explained >= search.rules.worth and verification.before >= _BARELY
            account = account if tells else None
        if account is not None and whole is not None and not told:
            # The first effects of the account may be a better explanation: judge them by the rules for naming effects.
            second_look = _second_look(search, account, tuple(views.values()), seed)
            if second_look is not None and not (other is not None and other.rivals(second_look[0])):
                finding, verification = second_look
                account = account_of(wide, finding, whole, third)
    if account is not None and finding.best is not None and not _same(account.effects, finding.best.fit.effects):
        verification = verify(third, account.effects, np.random.default_rng(seed))
        finding = _as_accounted(finding, finding.best, account)
    floor = {second.record.label(kind, k): float(s) for (kind, k), s in zip(second.channels, second.sigma, strict=True)}
    further = mechanism.runs - made - mechanism.shared - named
    stated = any(view.record.sigma or view.record.tolerance for view in views.values())
    warnings = warnings_of(finding, bank, second, stated)
    if other is not None and other.tells(finding):
        warnings = (other.sentence, *warnings)
    listed = () if account is None else account.entries
    arcs = arcs_of((first, second), [entry.candidate for entry in listed], [entry.effect for entry in listed])
    if arcs and finding.verdict in ABSTAINING:
        warnings = (arc_warning(arcs), *warnings)
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
    """Estimate the noise by `other_noise` from what effects leave on all three records; None if that may be motion."""
    left = [view.residual(effects) for view in views]
    return other_noise(views, left, np.random.default_rng(seed), rules.deviations)


def _with_other_noise(
    search: JointIdentification,
    bank: SignatureBank,
    views: Sequence[JointResiduals],
    effects: Sequence[Applied],
    seed: int,
) -> tuple[JointIdentification, Finding] | None:
    """Search again with the residuals of some effects as the noise; None if they are motion, or if the search names nothing.

    Args:
        search: A search that assumed white noise.
        bank: Signatures.
        views: Residuals on all records; they keep the new noise only if the search names something.
        effects: Effects whose residuals are taken for noise.
        seed: Seed of the replicates of the noise.

    Returns:
        The new search and its finding.
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
    """Fit and judge together the first effects of an account that close the gap, since the search may never have tried them.

    The search adds effects one by one, starting with the one that explains most alone, and may so miss all of the right set.

    Args:
        search: Search that compares explanations.
        account: The account.
        views: Residuals on all records, `verify` last.
        seed: Seed of the replicates of the noise.

    Returns:
        The finding and its verification; None where these effects are not named.
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
    # Several effects together can mimic a missing law, but hardly close the last per cent.
    asked = search.rules if len(fit.who) == 1 else replace(search.rules, closure=search.rules.several)
    if not checked.transfers(asked):
        return None
    return replace(found, best=replace(best, fit=_unsure(fit, views, found.after))), checked


def _verified(views: Sequence[JointResiduals], fit: EffectFit, rules: Rules, seed: int) -> Verification:
    """Verify, on the last record, a fit to the first one or to the first two."""
    beside = BesideParameterError(views[-1], views[:-1], derivatives)
    return verify(views[-1], fit.effects, np.random.default_rng(seed), lambda: beside(fit), rules.alarm)


def _unsure(fit: EffectFit, views: Sequence[JointResiduals], size: float = 1.0) -> EffectFit:
    """Widen the standard deviations of a fit by how far the records disagree about its parameters.

    Args:
        fit: The fit.
        views: Residuals on all records, the fitted ones first.
        size: Root mean square residual that is left, in units of the noise; deviations are multiplied by it later if above 1.
    """
    wide = max(1.0, size)
    return replace(fit, deviations=widened(wide * fit.deviations, RecordSizes.of(views, fit), fit.records) / wide)


def _as_accounted(finding: Finding, best: Hypothesis, account: GapAccount) -> Finding:
    """Give the effects of a finding the parameters of the account, if it holds all of them: both must state the same sizes.

    A finding was mostly fitted to one record, which may hardly tell two masses of an arm apart; the account was fitted to two.

    Args:
        finding: The finding.
        best: Best explanation of the finding.
        account: The account.
    """
    lines = {entry.candidate: entry for entry in account.entries}
    if any(candidate not in lines for candidate in best.fit.who):
        return finding
    held = [lines[candidate] for candidate in best.fit.who]
    # Findings multiply deviations by the size of the residual later; those of the account include it already.
    deviations = np.concatenate([entry.deviations for entry in held]) / max(1.0, finding.after)
    fit = replace(best.fit, effects=tuple(entry.effect for entry in held), deviations=deviations)
    return replace(finding, best=replace(best, fit=fit))


def _same(some: Sequence[Applied], others: Sequence[Applied]) -> bool:
    """Tell whether two lists hold the same effects with the same parameters."""
    return len(some) == len(others) and all(effect in others for effect in some)


def views_of(
    mechanism: Mechanism, records: Mapping[str, Record], folder: str | Path | None = None
) -> dict[str, JointResiduals]:
    """Make the residuals of all records with one shared estimate of the noise, since all come from the same sensors.

    Args:
        mechanism: The mechanism that replays the records.
        records: Records by role.
        folder: Folder that keeps sensitivities from run to run; nothing is kept when None.

    Returns:
        Residuals by role.
    """
    views = {role: JointResiduals.of(mechanism, record, folder=folder) for role, record in records.items()}
    share_noise(tuple(views.values()))
    return views
