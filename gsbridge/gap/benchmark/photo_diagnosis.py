"""The blind benchmark's cases of photos, diagnosed by this package or by a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.gap.benchmark.campaign import OURS
from gsbridge.gap.benchmark.photo_baselines import run_photo_baseline
from gsbridge.gap.benchmark.photo_cases import read_photos
from gsbridge.gap.image.diagnose import ImageAccount, diagnose_images, unsteady


def diagnose_photo_case(folder: Path, bank: Path, method: str, seed: int) -> Mapping[str, Any]:
    """Diagnose one case of photos, for which no signatures are kept.

    Args:
        folder: Folder of the case.
        bank: Unused.
        method: This package's own, or one of `run_photo_baseline`.
        seed: Seed of replicates.

    Returns:
        The findings, in the form of `findings.json`.

    Raises:
        InputError: The case cannot be read.
    """
    pairs = read_photos(folder)
    if method != OURS:
        return run_photo_baseline(method, pairs)
    diagnosis, reasons = diagnose_images(pairs, seed=seed), unsteady(pairs, seed=seed)
    return ImageAccount().findings_of(diagnosis, pairs, seed=seed, reasons=reasons)
