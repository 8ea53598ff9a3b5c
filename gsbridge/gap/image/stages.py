"""Stages of the gap of pictures as the workflow runs them: from photos to findings, and from findings to the model."""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import atomic_file, write_json
from gsbridge.gap.image.diagnose import diagnose_images, image_findings, unsteady
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.image.model import shooting
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.workflow import fitted

logger = logging.getLogger("gsbridge")

_SHOWN = 4
"""Views in the pictures that a report shows."""


def write_image_findings(
    views: str | Path,
    before: str | Path,
    after: str | Path,
    findings: str | Path,
    pictures: str | Path,
    *,
    seed: int,
    shot: int = 0,
    names: Collection[str] | None = None,
) -> None:
    """Diagnose what changed between photos.

    Args:
        views: Folder that says what the views are (`gsbridge.gap.image.files`).
        before: Folder of earlier photos.
        after: Folder of later photos.
        findings: `findings.json`.
        pictures: What a report shows of some views of `verify` (`.npz`): photos `before`, `after` and as `expected`,
            [N, H, W, 3]; where they are `compared`, and what is apart before (`gap`) and with the explanation (`left`), in
            units of the noise, [N, h, w].
        seed: Of replicates.
        shot: Which of the later photos counts.
        names: Effects that may be the reason; None for all.

    Raises:
        InputError: Photos, views or depths cannot be used; nothing is written then.
    """
    pairs = read_pairs(views, before, after, shot=shot)
    reasons = unsteady(pairs, seed=seed)
    for reason in reasons:
        logger.warning("degraded: %s", reason)
    found = image_findings(diagnose_images(pairs, names=names, seed=seed), pairs, seed=seed, reasons=reasons)
    found["photos"] = {role: {"views": len(part), "repeats": part.repeats} for role, part in pairs.items()}
    with atomic_file(pictures) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **_pictures(pairs, found))  # type: ignore[arg-type]
    write_json(findings, found)


def _pictures(pairs: dict[str, Pairs], found: dict[str, Any]) -> dict[str, np.ndarray]:
    view = ImageResiduals(pairs["verify"], learn_noise(list(pairs.values())))
    effects = fitted(found)
    table = {"gap": view.residual(), "left": view.residual(effects)}
    shown = slice(0, _SHOWN)
    return {
        "before": view.pairs.before[shown],
        "after": view.pairs.after[shown],
        "expected": np.clip(view.expectation.photos(shooting(effects))[shown], 0.0, 1.0).astype(np.float32),
        "compared": view.mask[shown].astype(np.float32),
        **{name: np.abs(view.pictures(rows)[shown]).mean(axis=-1).astype(np.float32) for name, rows in table.items()},
    }
