"""The second step of the blind benchmark: the diagnosis of its cases, one by one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import read_json, write_json

logger = logging.getLogger("gsbridge")

OURS = "gsbridge"
"""This package's own way of naming; the others are in `gsbridge.gap.benchmark.baselines`."""

Diagnose = Callable[[Path, Path, str, int], Mapping[str, Any]]
"""Diagnoses one kind of case: folder of the case, folder of signatures, method and seed of replicates -> findings.

Each kind has a module of its own, and nothing here imports them: an edit of how thrown bodies are diagnosed then leaves the
findings about joints as they are, and the workflow does not make them anew."""


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
    diagnose: Diagnose,
    *,
    method: str = OURS,
    seed: int = 0,
) -> None:
    """Diagnose cases; skip those whose finding exists already.

    Args:
        cases: Folder of cases that `generate_cases` made.
        keys: Keys of the cases to diagnose.
        findings: Folder to which `{key}.json` is written.
        bank: Folder of signatures, which all parts may share.
        diagnose: Diagnoses a case of this kind.
        method: This package's own, or a baseline.
        seed: Seed of replicates.

    Raises:
        InputError: A case cannot be read, or the method is unknown or cannot run here.
    """
    for key in keys:
        path = Path(findings) / f"{key}.json"
        if path.exists():
            continue
        write_json(path, diagnose(Path(cases) / key, Path(bank), method, seed))
        logger.info("%s diagnosed by %s", key, method)
