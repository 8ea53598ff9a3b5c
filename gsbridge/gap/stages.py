"""Stages of a case as the workflow runs them: each reads files, makes one thing, and leaves a record beside it."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import atomic_file, read_json, write_json, write_stage
from gsbridge.gap.amend import amend_model
from gsbridge.gap.bank import Bank, bank_of
from gsbridge.gap.candidates import Candidate, candidates
from gsbridge.gap.case import read_case
from gsbridge.gap.diagnose import diagnose, findings_of
from gsbridge.gap.formats.store import load_records, save_records
from gsbridge.gap.records import Record
from gsbridge.gap.replay import Mechanism
from gsbridge.gap.screen import cosines
from gsbridge.gap.system import Applied, System, read_system
from gsbridge.gap.view import View, share_noise
from gsbridge.gap.where import where
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

ALIKE = 0.95
"""Cosine of two signatures from which on a fit can hardly tell their effects apart."""


@dataclass(frozen=True)
class Ready:
    """A case whose records were read by an earlier stage.

    Args:
        system: The model.
        records: By role.
        names: Effects that may be the reason; None for all.
        reasons: Why the result is degraded.
    """

    system: System
    records: Mapping[str, Record]
    names: tuple[str, ...] | None
    reasons: tuple[str, ...]


def write_case_records(case: str | Path, data: str | Path, record: str | Path) -> None:
    """Read and check a case; write its records in SI units, and what is known about them.

    Args:
        case: The case.
        data: The records (`.npz`).
        record: Their description.

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    read = read_case(case)
    # What only building it can tell is told here, too, before anything is written.
    Mechanism(read.system)
    save_records(data, read.records)
    write_stage(
        record,
        reasons=read.reasons,
        case=str(case),
        model=str(read.model),
        model_digest=hashlib.sha256(read.model.read_bytes()).hexdigest(),
        mechanism_digest=read.system.digest(),
        joints=list(read.system.joints),
        mode=read.system.controller.mode,
        effects=None if read.names is None else list(read.names),
        records={role: _about(item) for role, item in read.records.items()},
    )


def _about(record: Record) -> dict[str, Any]:
    """What a person wants to know about a record."""
    return {
        "name": record.name,
        "samples": len(record.time),
        "seconds": record.duration,
        "rate_hz": 1.0 / record.period,
        "commands": sorted(record.commands),
        "measured": sorted(record.measured),
        "quantum": {kind: values.tolist() for kind, values in record.quantum.items()},
        "digest": record.digest or record.content_digest(),
    }


def ready(model: str | Path, data: str | Path, record: str | Path) -> Ready:
    """What `write_case_records` has left.

    Raises:
        InputError: A file is missing or damaged.
    """
    about = read_json(record)
    names = about["effects"]
    return Ready(read_system(model), load_records(data), None if names is None else tuple(names), tuple(about["reasons"]))


def write_comparison(model: str | Path, data: str | Path, record: str | Path, out: str | Path) -> None:
    """Replay the model as it is: residuals of every channel, and a map of where they show.

    Args:
        model: The model.
        data: Records.
        record: Their description.
        out: `comparison.json`.
    """
    case = ready(model, data, record)
    mechanism = Mechanism(case.system)
    views = {role: View.of(mechanism, item) for role, item in case.records.items()}
    share_noise(tuple(views.values()))
    write_stage(
        out,
        reasons=case.reasons,
        unit="noise",
        records={role: _residuals(view) for role, view in views.items()},
        simulations=mechanism.runs,
    )


def _residuals(view: View) -> dict[str, Any]:
    """Size of the residuals of one record, noise of its channels, and where they show."""
    residual = view.residual()
    found = where(view, residual, view.simulate())
    return {
        "whole": float(np.sqrt((residual**2).sum() / view.freedom)),
        "channels": dict(zip(found.channels, np.sqrt((residual**2).mean(axis=0)).tolist(), strict=True)),
        "noise": dict(zip(found.channels, view.sigma.tolist(), strict=True)),
        "where": found.record(),
    }


def write_screening(model: str | Path, data: str | Path, record: str | Path, bank: str | Path, out: str | Path) -> None:
    """Simulate the bank of signatures, and say before any fit what these records can tell apart.

    Args:
        model: The model.
        data: Records.
        record: Their description.
        bank: Folder that keeps signatures; cases with the same model and commands share them.
        out: `screen.json`.
    """
    case = ready(model, data, record)
    mechanism = Mechanism(case.system)
    views = {role: View.of(mechanism, item, folder=bank) for role, item in case.records.items()}
    # As the diagnosis does: the noise sets the sizes of the signatures, and so the bank.
    share_noise(tuple(views.values()))
    view = views["fit"]
    who = candidates(case.system, case.names)
    found = bank_of(view, who, bank)
    shown = {signature.candidate for signature in found.signatures}
    write_stage(
        out,
        reasons=case.reasons,
        candidates=[str(candidate) for candidate in who],
        unseen=sorted(str(candidate) for candidate in set(who) - shown),
        alike=_alike(view, found, who),
        signatures=len(found.signatures),
        simulations=found.runs,
    )


def _alike(view: View, bank: Bank, who: Sequence[Candidate]) -> list[dict[str, Any]]:
    """Pairs of candidates that look alike in these records, the closest first."""
    first = {}
    for signature in bank.signatures:
        first.setdefault(signature.candidate, signature)
    chosen = [first[candidate] for candidate in who if candidate in first]
    if len(chosen) < 2:
        return []
    table = np.abs(cosines(view, chosen))
    pairs = [
        {"pair": [str(chosen[a].candidate), str(chosen[b].candidate)], "cosine": float(table[a, b])}
        for a in range(len(chosen))
        for b in range(a)
        if table[a, b] >= ALIKE
    ]
    return sorted(pairs, key=lambda item: -item["cosine"])


def write_findings(
    model: str | Path,
    data: str | Path,
    record: str | Path,
    bank: str | Path,
    findings: str | Path,
    amended: str | Path,
    seed: int,
) -> None:
    """Diagnose a case: what is missing, proven on the third record, and the amended model.

    Args:
        model: The model.
        data: Records.
        record: Their description.
        bank: Folder of signatures.
        findings: `findings.json`.
        amended: `model.yaml`.
        seed: Of replicates and bootstraps.
    """
    case = ready(model, data, record)
    diagnosis = diagnose(case.system, case.records, bank, names=case.names, seed=seed)
    found = findings_of(diagnosis, case.records, seed=seed, reasons=case.reasons)
    for reason in case.reasons:
        logger.warning("degraded: %s", reason)
    write_json(findings, found)
    amend_model(model, found, amended)


def write_replays(
    model: str | Path, data: str | Path, record: str | Path, findings: str | Path, series: str | Path, out: str | Path
) -> None:
    """Replay every record with the model as it was and with the best explanation.

    Args:
        model: The model before.
        data: Records.
        record: Their description.
        findings: `findings.json`.
        series: Measured, nominal and explained motion, `{role}/{what}` (`.npz`); without `explained` where nothing was fitted.
        out: `replays.json`: residuals before and after, and a map of what remains.
    """
    case, found = ready(model, data, record), read_json(findings)
    effects = tuple(
        Applied(item["name"], item["joint"] or "", {name: row["value"] for name, row in item["parameters"].items()})
        for item in found["effects"]
    )
    mechanism = Mechanism(case.system)
    arrays: dict[str, Array] = {}
    rows = {}
    for role, item in case.records.items():
        # The noise is judged by what the better replay leaves, as in the verification.
        view = View.of(mechanism, item, effects)
        nominal, explained = view.simulate(), view.simulate(effects)
        before, after = view.residual(), view.residual(effects)
        arrays |= {f"{role}/time": item.time, f"{role}/sigma": view.sigma, f"{role}/measured": view.stack(item.measured)}
        arrays |= {f"{role}/nominal": view.stack(nominal), f"{role}/before": before}
        arrays |= {f"{role}/position": item.measured["position"], f"{role}/nominal_position": nominal["position"]}
        if effects:
            arrays |= {f"{role}/explained": view.stack(explained), f"{role}/after": after}
            arrays[f"{role}/explained_position"] = explained["position"]
        rows[role] = {
            "before": float(np.sqrt((before**2).sum() / view.freedom)),
            "after": float(np.sqrt((after**2).sum() / view.freedom)),
            "channels": [f"{kind}.{item.joints[k]}" for kind, k in view.channels],
            "remains": where(view, after, explained).record(),
        }
    with atomic_file(series) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **{name: values.astype(np.float32) for name, values in arrays.items()})
    write_stage(out, reasons=case.reasons, unit="noise", records=rows, simulations=mechanism.runs)
