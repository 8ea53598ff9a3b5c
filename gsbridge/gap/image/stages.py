"""Stages of the gap of pictures as the workflow runs them: from photos to findings, and from findings to the model."""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file, read_json, write_json
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.gap.image.diagnose import diagnose_images, image_findings, unsteady
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.image.model import shooting
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.workflow import fitted
from gsbridge.sim.model import parse_model

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


def amend_camera(nominal: str | Path, findings: str | Path, model: str | Path, reference: str | Path | None = None) -> None:
    """Write the simulation's model with the image effects that were named: a policy that learns with it sees them.

    Args:
        nominal: The simulation's model as it was.
        findings: `findings.json`.
        model: The amended model; the evidence stands in its head.
        reference: `findings.json` of further photos of the first day, in which nothing may be found.

    Raises:
        StageError: Nothing was named, or something was found in photos of one day.
        InputError: An episode's pictures cannot have a named effect, or a file is damaged.
    """
    found, content = _findings(findings), read_yaml(nominal, "model", "models/nominal.yaml")
    parse_model(content, str(nominal))
    if reference is not None and _findings(reference)["verdict"] != "no_discrepancy":
        raise StageError(
            "amend_camera",
            f"photos of one day differ: {_findings(reference)['sentence']}",
            f"Take them again, or more of them; see {reference}",
        )
    if not found["amended"]:
        raise StageError(
            "amend_camera", f"the diagnosis named nothing ({found['verdict']}): {found['sentence']}", f"See {findings}"
        )
    for named in found["amended"]:
        effect = IMAGE_EFFECTS.effect(named["name"], findings)
        if not effect.amendable:
            what = f"a policy's pictures cannot be drawn with '{effect.name}': {effect.reason}"
            raise InputError(findings, what, effect.instead)
    content["effects"] = [*(content.get("effects") or []), *found["amended"]]
    parse_model(content, str(nominal))
    head = [
        f"Amended by the gap of pictures; made from {Path(nominal).name} and not to be edited.",
        found["sentence"],
        *(f"photos {role}: {digest}" for role, digest in found["records"].items()),
        f"seed {found['seed']}",
    ]
    text = "".join(f"# {line}\n" for line in head)
    text += yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=128)
    with atomic_file(model) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _findings(path: str | Path) -> dict[str, Any]:
    """What a diagnosis has left.

    Raises:
        InputError: It is damaged.
    """
    found = read_json(path)
    missing = [key for key in ("verdict", "sentence", "amended", "records", "seed") if key not in found]
    if missing:
        raise InputError(path, f"it has no '{missing[0]}'", "Diagnose the photos again")
    return found
