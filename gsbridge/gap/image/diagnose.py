"""From splats and photos to findings: floor, compare, screen, identify, verify."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gsbridge.gap.diagnose import Diagnosis, findings_of
from gsbridge.gap.image import common
from gsbridge.gap.image.floor import Floor, learn_floor
from gsbridge.gap.image.identify import Identification, structure
from gsbridge.gap.image.model import ImageModel, image_candidates
from gsbridge.gap.image.null import Null, Reference
from gsbridge.gap.image.screen import signatures
from gsbridge.gap.image.shots import REFERENCE, ROLES, Shots
from gsbridge.gap.image.view import View
from gsbridge.gap.system import Applied
from gsbridge.gap.trials import Rules
from gsbridge.gap.verify import Verification
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")


def views_of(
    model: ImageModel, shots: Mapping[str, Shots], names: Collection[str] | None = None
) -> tuple[dict[str, View], Reference]:
    """Views of all roles with a floor learnt from the reference, and the reference for replicates.

    Args:
        model: The model.
        shots: By role, `reference` among them.
        names: Effects that may be the reason.

    Raises:
        InputError: There are too few effect-free photos.
    """
    photos = round(float(np.mean([len(shots[role]) for role in ROLES])))
    key = (model.digest(), shots[REFERENCE].content_digest(), photos, None if names is None else tuple(sorted(names)))
    if key not in _prepared:
        if len(_prepared) >= _KEPT:
            _prepared.pop(next(iter(_prepared)))
        _prepared[key] = _prepare(model, shots[REFERENCE], photos, names)
    floor, reference = _prepared[key]
    return {role: View(model, shots[role], floor) for role in ROLES}, reference


_KEPT = 4
_prepared: dict[tuple[object, ...], tuple[Floor, Reference]] = {}
"""Floors of the last scenes: cases of one scene share them."""


def _prepare(model: ImageModel, shots: Shots, photos: int, names: Collection[str] | None) -> tuple[Floor, Reference]:
    """Floor of a scene, and its reference for replicates of roles with some photos."""
    floor = learn_floor(model, shots)
    # What one half of the film teaches is tried on the other, since it fits the photos that it was learnt from too well.
    middle, parts, shared = len(shots) // 2, [], []
    halves = [shots.part(np.arange(middle)), shots.part(np.arange(middle, len(shots)))]
    for taught, tried in (halves[::-1], halves):
        known = replace(floor, common=_common(model, taught, floor, photos))
        part, coherence = Reference.of(View(model, tried, known), image_candidates(names), photos)
        parts.append(part)
        shared.append(coherence)
    reference = parts[0].joined(parts[1])
    shared = {name: 0.5 * (shared[0][name] + shared[1][name]) for name in shared[0]}
    floor = replace(floor, common=_common(model, shots, floor, photos))
    scale = max(1.0, float(np.mean(list(shared.values()))))
    logger.info("coherence: %s", ", ".join(f"{name} {value:.2g}" for name, value in shared.items()))
    return replace(floor, scale=scale), reference.scaled(scale)


def _common(model: ImageModel, shots: Shots, floor: Floor, photos: int) -> tuple[float, ...]:
    return tuple(common.variances(View(model, shots, floor), photos).tolist())


def diagnose_images(
    model: ImageModel,
    shots: Mapping[str, Shots],
    *,
    names: Collection[str] | None = None,
    rules: Rules | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Find out what pictures lack.

    Args:
        model: Splats and camera.
        shots: Photos by role: `reference`, `fit`, `select`, `verify`.
        names: Effects that may be the reason; None for all image effects.
        rules: Thresholds.
        seed: Of replicates and bootstraps.

    Raises:
        InputError: There are too few effect-free photos.
    """
    begin = time.perf_counter()
    rules = rules or Rules()
    views, reference = views_of(model, shots, names)
    bank = model.photographer.pictures
    finding = Identification(views["fit"], views["select"], reference, image_candidates(names), rules, seed).run()
    verification = None
    if finding.best is not None:
        effects = finding.best.fit.effects
        null = reference.null(len(shots["verify"]))
        verification = verify_images(views["verify"], null, effects)
        said = finding.verdict in ("named", "ambiguous")
        if said and not verification.transfers(rules, len(effects) > 1):
            finding = replace(finding, verdict="none_of_the_known", ambiguous=(), something_remains=True)
    photos = sum(len(shots[role]) for role in ROLES) / len(ROLES)
    floor = views["fit"].floor
    runs = round((model.photographer.pictures - bank) / photos)
    about = {"flat": floor.spread[0] ** 0.5, "grain": float(np.sqrt(sum(floor.grain)))}
    return Diagnosis(finding, verification, about, round(bank / photos), runs, time.perf_counter() - begin)


def verify_images(view: View, null: Null, effects: Sequence[Applied]) -> Verification:
    """Photos that neither fitting nor choosing has seen, with and without effects."""
    names = {effect.name for effect in effects}
    groups = signatures(view, [candidate for candidate in image_candidates() if candidate.name in names])
    before, after = view.residual(), view.residual(tuple(effects))
    sizes = [structure(view, null, table, groups) for table in (before, after)]
    gap, left = np.sqrt(max(sizes[0] ** 2 - 1.0, 1e-12)), np.sqrt(max(sizes[1] ** 2 - 1.0, 0.0))
    parts = [_channels(view, table, null) for table in (before, after)]
    channels = {name: (parts[0][name], parts[1][name]) for name in parts[0]}
    p_remaining = Identification.p_of(view, null, after, tuple(effects))
    return Verification(sizes[0], sizes[1], float(1.0 - left / gap), channels, sizes[1] <= sizes[0] + 1e-9, p_remaining)


def _channels(view: View, table: Array, null: Null) -> dict[str, float]:
    """Root mean square of shape and grain in units of the floor."""
    count, height = view.shots.photos.shape[:2]
    body, grain = (table[: count * height] ** 2).sum(), (table[count * height :] ** 2).sum()
    return {"picture": float(np.sqrt(body / null.floor)), "grain": float(np.sqrt(grain / max(3 * view.flats.counts.size, 1)))}


def image_findings(
    diagnosis: Diagnosis, shots: Mapping[str, Shots], *, seed: int, reasons: Collection[str] = ()
) -> dict[str, Any]:
    """What `findings.json` holds; the layout is that of `gsbridge.gap.diagnose.findings_of`."""
    out = findings_of(diagnosis, shots, seed=seed, reasons=reasons)  # type: ignore[arg-type]
    finding = diagnosis.finding
    if finding.verdict == "no_discrepancy":
        out["sentence"] = f"Photos and pictures agree within what splats and noise leave (p = {finding.p_value:.2g})."
    elif finding.verdict == "not_enough_excitation":
        alone = finding.p_value < Rules.alarm
        out["sentence"] = (
            "A difference shows on 'select' alone; take more such photos and fit those."
            if alone
            else "No difference shows, but most effects could not show in these photos: move, show edges and colours."
        )
    return out
