"""The blind benchmark's cases of thrown bodies, diagnosed by this package; there are no baselines for them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.gap.benchmark.campaign import OURS
from gsbridge.gap.contact.workflow import ThrowBackend


def diagnose_thrown_case(folder: Path, bank: Path, method: str, seed: int) -> Mapping[str, Any]:
    """Diagnose one case of a thrown body.

    Args:
        folder: Folder of the case.
        bank: Folder of signatures.
        method: This package's own.
        seed: Seed of replicates.

    Returns:
        The findings, in the form of `findings.json`.

    Raises:
        InputError: The case cannot be read, or another method is asked for.
    """
    if method != OURS:
        raise InputError(folder, f"'{method}' cannot name what a thrown body lacks", f"Use the method {OURS}")
    return ThrowBackend.read(folder / "case.yaml").diagnose(bank, seed)
