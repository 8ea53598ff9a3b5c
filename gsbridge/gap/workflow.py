"""Stages of a case, as the workflow runs them: each reads files, writes one result, and leaves a record beside it.

How a stage works depends on the kind of case (a mechanism, a thrown body or photos); its input and output files do not.
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
    """Read and check a user's case: one about pictures if it names photos, otherwise one about what its model describes.

    Raises:
        InputError: Something in the case cannot be used.
    """
    if PHOTOS in case_content(case):
        return ImageBackend.read(case)
    return ThrowBackend.read(case) if is_body(case_model(case)) else JointBackend.read(case)


def load_backend(model: str | Path, data: str | Path, record: str | Path) -> Backend:
    """Load the backend of a case from the files that `write_case_records` wrote.

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
    """Read and check a case; write its records in SI units, and a description of them.

    Args:
        case: The case's file.
        data: File to write the records to (`.npz`).
        record: File to write the description of the records to (`records.json`).

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    backend = read_backend(case)
    about = backend.about()
    backend.save(data)
    digest = hashlib.sha256(Path(about["model"]).read_bytes()).hexdigest()
    write_stage(record, reasons=backend.reasons, case=str(case), model_digest=digest, **about)


def write_comparison(model: str | Path, data: str | Path, record: str | Path, out: str | Path) -> None:
    """Replay the model as it is; write the residuals of every channel and a map of where they show.

    Args:
        model: The model.
        data: Records.
        record: Description of the records (`records.json`).
        out: File to write, `comparison.json`.
    """
    backend = load_backend(model, data, record)
    write_stage(out, reasons=backend.reasons, **backend.compare())


def write_screening(model: str | Path, data: str | Path, record: str | Path, bank: str | Path, out: str | Path) -> None:
    """Simulate the bank of signatures, and write which effects these records can tell apart, before any fit.

    Args:
        model: The model.
        data: Records.
        record: Description of the records (`records.json`).
        bank: Folder that keeps signatures; cases with the same model and commands share them.
        out: File to write, `screen.json`.
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
    """Diagnose a case; write what is missing, tested on the third record, and the amended model.

    Args:
        model: The model.
        data: Records.
        record: Description of the records (`records.json`).
        bank: Folder of signatures.
        findings: File to write, `findings.json`.
        amended: File to write, `model.yaml`.
        seed: Random seed of the noise replicates.
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
    """Replay every record with the original model and with the best explanation.

    Args:
        model: The original model.
        data: Records.
        record: Description of the records (`records.json`).
        findings: `findings.json`.
        series: File to write (`.npz`): measured, nominal and explained motion as `{role}/{what}`; no `explained` if nothing was
            fitted.
        out: File to write, `replays.json`: residuals before and after, and a map of what remains.
    """
    backend = load_backend(model, data, record)
    arrays, rows = backend.replay(best_effects(read_json(findings)))
    with atomic_file(series) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **{name: values.astype(np.float32) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_stage(out, reasons=backend.reasons, **rows)


def run_case(path: str | Path, out: str | Path, bank_folder: str | Path, seed: int = 0) -> dict[str, Any]:
    """Diagnose a case of any kind, write `findings.json` and the amended `model.yaml` into `out`, and return the findings.

    Args:
        path: The case's file.
        out: Folder of the results.
        bank_folder: Folder that keeps signatures from run to run.
        seed: Random seed of the noise replicates.

    Raises:
        InputError: Something in the case cannot be used; nothing is written then.
    """
    backend, out = read_backend(path), Path(out)
    return _diagnose(backend, backend.about()["model"], bank_folder, out / "findings.json", out / "model.yaml", seed)
