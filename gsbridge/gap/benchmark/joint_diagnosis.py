"""The blind benchmark's cases of joints, diagnosed by this package or by a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.gap.benchmark.baselines import run_baseline
from gsbridge.gap.benchmark.campaign import OURS
from gsbridge.gap.joints.workflow import JointBackend


def diagnose_joint_case(folder: Path, bank: Path, method: str, seed: int) -> Mapping[str, Any]:
    """Diagnose one case of joints.

    Args:
        folder: Folder of the case.
        bank: Folder of signatures.
        method: One of `gsbridge.gap.benchmark.baselines.METHODS`.
        seed: Seed of replicates.

    Returns:
        The findings, in the form of `findings.json`.

    Raises:
        InputError: The case cannot be read, or the method is unknown or cannot run here.
    """
    backend = JointBackend.read(folder / "case.yaml")
    if method == OURS:
        return backend.diagnose(bank, seed)
    return run_baseline(method, backend.replayed.system, backend.replayed.records, bank, seed)
