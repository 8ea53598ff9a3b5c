"""From a mechanism and three records to a diagnosis: compare, screen, identify, verify."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.findings import Account, Diagnosis
from gsbridge.gap.diagnosis.results import ROLES, Rules, Verification
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise

logger = logging.getLogger("gsbridge")


class JointAccount(Account):
    """How findings about a mechanism are told."""

    effects = JOINT_EFFECTS


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
        records: By role: `fit`, `select`, `verify`.
        bank_folder: Keeps signatures from run to run.
        names: Effects that may be the reason; None for the whole catalogue.
        rules: Thresholds.
        seed: Of replicates.
    """
    begin = time.perf_counter()
    mechanism = Mechanism(system)
    views = views_of(mechanism, {role: records[role] for role in ROLES}, bank_folder)
    first, second, third = views.values()
    who, made = candidates(system, names), mechanism.runs
    bank = signature_bank(first, who, bank_folder)
    made = mechanism.runs - made
    logger.info("%d candidates, %d signatures", len(who), len(bank.signatures))
    finding = JointIdentification(first, second, bank, who, rules, seed).run()
    verification = None
    if finding.best is not None:
        effects = finding.best.fit.effects
        verification = verify(third, effects, np.random.default_rng(seed))
        said = finding.verdict in ("named", "ambiguous")
        finding = finding.refuted() if said and not verification.transfers(rules, len(effects) > 1) else finding
    floor = {second.record.label(kind, k): float(s) for (kind, k), s in zip(second.channels, second.sigma, strict=True)}
    runs = mechanism.runs - made - mechanism.shared
    return Diagnosis(finding, verification, floor, bank.runs, runs, time.perf_counter() - begin)


def views_of(
    mechanism: Mechanism, records: Mapping[str, Record], folder: str | Path | None = None
) -> dict[str, JointResiduals]:
    """Records as a mechanism replays them, with the noise of one set of sensors; `folder` keeps what records may share."""
    views = {role: JointResiduals.of(mechanism, record, folder=folder) for role, record in records.items()}
    share_noise(tuple(views.values()))
    return views


def verify(view: JointResiduals, effects: Sequence[Applied], rng: np.random.Generator) -> Verification:
    """Replay a record with and without effects; sizes are root mean squares in units of the noise (1 is noise alone).

    Args:
        view: Of a record neither fitted nor used to choose.
        effects: What was found.
        rng: Of effect-free replicates.
    """
    sizes, residual = [], np.zeros(0)
    for added in ((), tuple(effects)):
        residual = view.residual(added)
        sizes.append((float(np.sqrt((residual**2).sum() / view.freedom)), np.sqrt((residual**2).mean(axis=0))))
    (before, rows_before), (after, rows_after) = sizes
    gap, left = np.sqrt(max(before**2 - 1.0, 1e-12)), np.sqrt(max(after**2 - 1.0, 0.0))
    names = [view.record.label(kind, k) for kind, k in view.channels]
    channels = {name: (float(a), float(b)) for name, a, b in zip(names, rows_before, rows_after, strict=True)}
    p_remaining = joint_null(view, rng).p_value(residual)
    return Verification(before, after, float(1.0 - left / gap), channels, after <= before, p_remaining)
