"""The second step of the blind benchmark: the diagnosis of its cases, one by one."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark.baselines import METHODS, run_baseline
from gsbridge.gap.benchmark.body_cases import MODEL
from gsbridge.gap.benchmark.photo_baselines import run_photo_baseline
from gsbridge.gap.benchmark.photo_cases import CAMERA_FILE, read_photos
from gsbridge.gap.contact.body import is_body
from gsbridge.gap.contact.workflow import ThrowBackend
from gsbridge.gap.image.diagnose import ImageAccount, diagnose_images, unsteady
from gsbridge.gap.joints.workflow import JointBackend

__all__ = ["METHODS", "case_keys", "diagnose_cases"]

logger = logging.getLogger("gsbridge")


def case_keys(cases: str | Path, chunk: int = 0, chunks: int = 1) -> tuple[str, ...]:
    """Return the keys of one part of the cases, sorted so that cases that share courses, and so a bank, are together.

    Args:
        cases: Folder of cases that `generate_cases` made.
        chunk: Number of the part, from 0.
        chunks: Number of parts.
    """
    rows = read_json(Path(cases) / "manifest.json")["cases"]
    keys = [row["key"] for row in sorted(rows, key=lambda row: (row["courses"], row["key"]))]
    edges = np.linspace(0, len(keys), chunks + 1).astype(int)
    return tuple(keys[edges[chunk] : edges[chunk + 1]])


def diagnose_cases(
    cases: str | Path,
    keys: Iterable[str],
    findings: str | Path,
    bank: str | Path,
    *,
    method: str = METHODS[0],
    seed: int = 0,
) -> None:
    """Diagnose cases; skip those whose finding exists already.

    Args:
        cases: Folder of cases that `generate_cases` made.
        keys: Keys of the cases to diagnose.
        findings: Folder to which `{key}.json` is written.
        bank: Folder of signatures, which all parts may share.
        method: One of `METHODS`: this package's own, or a baseline.
        seed: Seed of replicates.

    Raises:
        InputError: A case cannot be read, or the method is unknown or cannot run here.
    """
    for key in keys:
        path = Path(findings) / f"{key}.json"
        if path.exists():
            continue
        write_json(path, _found(Path(cases) / key, Path(bank), method, seed))
        logger.info("%s diagnosed by %s", key, method)


def _found(folder: Path, bank: Path, method: str, seed: int) -> Mapping[str, Any]:
    if is_body(folder / MODEL):
        return ThrowBackend.read(folder / "case.yaml").diagnose(bank, seed)
    if (folder / CAMERA_FILE).exists():
        pairs = read_photos(folder)
        if method != METHODS[0]:
            return run_photo_baseline(method, pairs)
        diagnosis, reasons = diagnose_images(pairs, seed=seed), unsteady(pairs, seed=seed)
        return ImageAccount().findings_of(diagnosis, pairs, seed=seed, reasons=reasons)
    backend = JointBackend.read(folder / "case.yaml")
    if method == METHODS[0]:
        return backend.diagnose(bank, seed)
    return run_baseline(method, backend.replayed.system, backend.replayed.records, bank, seed)
