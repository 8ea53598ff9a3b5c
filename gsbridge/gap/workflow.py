"""Stages of a case as the workflow runs them: each reads files, makes one thing, and leaves a record beside it.

What a stage does depends on what the case is about, a mechanism or a thrown body; what it reads and leaves does not.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.files import atomic_file, read_json, write_json, write_stage
from gsbridge.gap.amend import amend_model
from gsbridge.gap.contact.body import is_body
from gsbridge.gap.contact.workflow import ThrowBackend
from gsbridge.gap.formats.files import case_model
from gsbridge.gap.joints.workflow import JointBackend
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")


class Backend(Protocol):
    """A checked case, and what the stages do with it."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result is degraded."""

    def save(self, data: str | Path) -> None:
        """Write the measurements (`.npz`)."""

    def about(self) -> dict[str, Any]:
        """What `records.json` says."""

    def compare(self) -> dict[str, Any]:
        """What `comparison.json` says: residuals of the model as it is, and where they show."""

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """What `screen.json` says: which effects show, and which look alike, before any fit. Fills the bank."""

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """What `findings.json` says."""

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Motion before and after, and what `replays.json` says about it."""


def read_work(case: str | Path) -> Backend:
    """A user's case, checked.

    Raises:
        InputError: Something in the case cannot be used.
    """
    return ThrowBackend.read(case) if is_body(case_model(case)) else JointBackend.read(case)


def load_work(model: str | Path, data: str | Path, record: str | Path) -> Backend:
    """What `write_case_records` has left.

    Raises:
        InputError: A file is missing or damaged.
    """
    return (ThrowBackend if is_body(model) else JointBackend).load(model, data, read_json(record))


def write_case_records(case: str | Path, data: str | Path, record: str | Path) -> None:
    """Read and check a case; write its records in SI units, and what is known about them.

    Args:
        case: The case.
        data: The records (`.npz`).
        record: Their description.

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    work = read_work(case)
    about = work.about()
    work.save(data)
    digest = hashlib.sha256(Path(about["model"]).read_bytes()).hexdigest()
    write_stage(record, reasons=work.reasons, case=str(case), model_digest=digest, **about)


def write_comparison(model: str | Path, data: str | Path, record: str | Path, out: str | Path) -> None:
    """Replay the model as it is: residuals of every channel, and a map of where they show.

    Args:
        model: The model.
        data: Records.
        record: Their description.
        out: `comparison.json`.
    """
    work = load_work(model, data, record)
    write_stage(out, reasons=work.reasons, **work.compare())


def write_screening(model: str | Path, data: str | Path, record: str | Path, bank: str | Path, out: str | Path) -> None:
    """Simulate the bank of signatures, and say before any fit what these records can tell apart.

    Args:
        model: The model.
        data: Records.
        record: Their description.
        bank: Folder that keeps signatures; cases with the same model and commands share them.
        out: `screen.json`.
    """
    work = load_work(model, data, record)
    write_stage(out, reasons=work.reasons, **work.screen(bank))


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
        seed: Of replicates.
    """
    _diagnose(load_work(model, data, record), model, bank, findings, amended, seed)


def _diagnose(
    work: Backend, model: str | Path, bank: str | Path, findings: str | Path, amended: str | Path, seed: int
) -> dict[str, Any]:
    found = work.diagnose(bank, seed)
    for reason in work.reasons:
        logger.warning("degraded: %s", reason)
    write_json(findings, found)
    amend_model(model, found, amended)
    return found


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
    work = load_work(model, data, record)
    arrays, rows = work.replay(fitted(read_json(findings)))
    with atomic_file(series) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **{name: values.astype(np.float32) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_stage(out, reasons=work.reasons, **rows)


def fitted(findings: Mapping[str, Any]) -> tuple[Applied, ...]:
    """All effects of the account, whether named or not; of the best explanation where there is no account."""
    account = findings.get("account")
    return tuple(
        Applied(item["name"], item["joint"] or "", {name: row["value"] for name, row in item["parameters"].items()})
        for item in (account["entries"] if account else findings["effects"])
    )


def run_case(path: str | Path, out: str | Path, bank_folder: str | Path, seed: int = 0) -> dict[str, Any]:
    """Diagnose a case of either kind into `out`: `findings.json` and the amended `model.yaml`. Returns the findings.

    Args:
        path: The case.
        out: Folder of the results.
        bank_folder: Keeps signatures from run to run.
        seed: Of replicates.

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    work, out = read_work(path), Path(out)
    return _diagnose(work, work.about()["model"], bank_folder, out / "findings.json", out / "model.yaml", seed)
