"""Stages of a case as the workflow runs them: each reads files, makes one thing, and leaves a record beside it.

What a stage does depends on what the case is about, a mechanism, a thrown body or pictures; what it reads and leaves does not.
"""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import atomic_file, read_json, write_json, write_stage
from gsbridge.gap.contact.body import MODE, is_body
from gsbridge.gap.contact.workflow import ThrowBackend
from gsbridge.gap.diagnosis.backend import Backend, best_effects
from gsbridge.gap.formats.files import case_content, case_model
from gsbridge.gap.image.case import PHOTOS
from gsbridge.gap.image.workflow import ImageBackend
from gsbridge.gap.joints.workflow import JointBackend

logger = logging.getLogger("gsbridge")


def read_backend(case: str | Path) -> Backend:
    """A user's case, checked: about pictures where it names photos, else about what its model describes.

    Raises:
        InputError: Something in the case cannot be used.
    """
    if PHOTOS in case_content(case):
        return ImageBackend.read(case)
    return ThrowBackend.read(case) if is_body(case_model(case)) else JointBackend.read(case)


def load_backend(model: str | Path, data: str | Path, record: str | Path) -> Backend:
    """The backend of a case, from the files that `write_case_records` has left.

    Args:
        model: File of the case's model.
        data: Measurements (`.npz`).
        record: `records.json`, which tells the kind of case.

    Raises:
        InputError: A file is missing or damaged.
    """
    about = read_json(record)
    kinds: dict[str, type[Backend]] = {MODE: ThrowBackend, PHOTOS: ImageBackend}
    return kinds.get(about["mode"], JointBackend).load(model, data, about)


def write_case_records(case: str | Path, data: str | Path, record: str | Path) -> None:
    """Read and check a case; write its records in SI units, and what is known about them.

    Args:
        case: The case.
        data: The records (`.npz`).
        record: Description of the records (`records.json`).

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    backend = read_backend(case)
    about = backend.about()
    backend.save(data)
    digest = hashlib.sha256(Path(about["model"]).read_bytes()).hexdigest()
    write_stage(record, reasons=backend.reasons, case=str(case), model_digest=digest, **about)


def write_comparison(model: str | Path, data: str | Path, record: str | Path, out: str | Path) -> None:
    """Replay the model as it is: residuals of every channel, and a map of where they show.

    Args:
        model: The model.
        data: Records.
        record: Description of the records (`records.json`).
        out: `comparison.json`.
    """
    backend = load_backend(model, data, record)
    write_stage(out, reasons=backend.reasons, **backend.compare())


def write_screening(model: str | Path, data: str | Path, record: str | Path, bank: str | Path, out: str | Path) -> None:
    """Simulate the bank of signatures, and say before any fit what these records can tell apart.

    Args:
        model: The model.
        data: Records.
        record: Description of the records (`records.json`).
        bank: Folder that keeps signatures; cases with the same model and commands share them.
        out: `screen.json`.
    """
    backend = load_backend(model, data, record)
    write_stage(out, reasons=backend.reasons, **backend.screen(bank))


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
        record: Description of the records (`records.json`).
        bank: Folder of signatures.
        findings: `findings.json`.
        amended: `model.yaml`.
        seed: Seed of replicates.
    """
    _diagnose(load_backend(model, data, record), model, bank, findings, amended, seed)


def _diagnose(
    backend: Backend, model: str | Path, bank: str | Path, findings: str | Path, amended: str | Path, seed: int
) -> dict[str, Any]:
    found = backend.diagnose(bank, seed)
    for reason in backend.reasons:
        logger.warning("degraded: %s", reason)
    write_json(findings, found)
    backend.amend(model, found, amended)
    return found


def write_replays(
    model: str | Path, data: str | Path, record: str | Path, findings: str | Path, series: str | Path, out: str | Path
) -> None:
    """Replay every record with the model as it was and with the best explanation.

    Args:
        model: The model before.
        data: Records.
        record: Description of the records (`records.json`).
        findings: `findings.json`.
        series: Measured, nominal and explained motion, `{role}/{what}` (`.npz`); without `explained` where nothing was fitted.
        out: `replays.json`: residuals before and after, and a map of what remains.
    """
    backend = load_backend(model, data, record)
    arrays, rows = backend.replay(best_effects(read_json(findings)))
    with atomic_file(series) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **{name: values.astype(np.float32) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_stage(out, reasons=backend.reasons, **rows)


def run_case(path: str | Path, out: str | Path, bank_folder: str | Path, seed: int = 0) -> dict[str, Any]:
    """Diagnose a case of any kind into `out`: `findings.json` and the amended `model.yaml`. Returns the findings.

    Args:
        path: The case.
        out: Folder of the results.
        bank_folder: Keeps signatures from run to run.
        seed: Seed of replicates.

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    backend, out = read_backend(path), Path(out)
    return _diagnose(backend, backend.about()["model"], bank_folder, out / "findings.json", out / "model.yaml", seed)
