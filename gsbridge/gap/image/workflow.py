"""Workflow stages for camera images: from photos to findings, and from findings to the simulation's camera model."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file, read_json, write_json
from gsbridge.gap.diagnosis.amend import ordered, write_amended
from gsbridge.gap.diagnosis.backend import CaseBackend, best_effects, stored_names
from gsbridge.gap.diagnosis.findings import similar_pairs
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.gap.image.case import PHOTOS, ImageCase, load_pairs, read_image_case, save_pairs
from gsbridge.gap.image.diagnose import (
    ImageAccount,
    SplatAccount,
    channel_sizes,
    diagnose_images,
    diagnose_splats,
    unsteady,
)
from gsbridge.gap.image.doubts import shared_photos
from gsbridge.gap.image.files import REGISTRATION, read_pairs
from gsbridge.gap.image.model import image_candidates, shooting
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residual_map import map_pictures
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.image.screen import cosines, signatures, unseen_of
from gsbridge.gap.image.splat_error import SplatError, SplatResiduals, learn_splat_error, reduced
from gsbridge.geometry import Array
from gsbridge.sim.model import parse_model

logger = logging.getLogger("gsbridge")

_SHOWN = 4
"""Number of views that a report shows."""


@dataclass(frozen=True)
class ImageBackend(CaseBackend):
    """A case of camera images; see `gsbridge.gap.diagnosis.backend.Backend`.

    Args:
        case: The case.
    """

    case: ImageCase

    @classmethod
    def read(cls, path: str | Path) -> ImageBackend:
        """Read a case from its file and check it.

        Raises:
            InputError: The case cannot be used.
        """
        return cls(read_image_case(path))

    @classmethod
    def load(cls, model: str | Path, data: str | Path, about: Mapping[str, Any]) -> ImageBackend:
        """Restore a case from what `save` and `about` stored.

        Args:
            model: File of the model.
            data: File that `save` wrote (`.npz`).
            about: Result of `about`, read from `records.json`.

        Raises:
            InputError: A file is missing or damaged.
        """
        pairs = load_pairs(data)
        early = pairs.pop(REGISTRATION, None)
        return cls(ImageCase(Path(model), pairs, stored_names(about), tuple(about["reasons"]), early))

    def save(self, data: str | Path) -> None:
        """Write the photos (`.npz`)."""
        early = {} if self.case.registration is None else {REGISTRATION: self.case.registration}
        save_pairs(data, {**self.case.pairs, **early})

    def about(self) -> dict[str, Any]:
        """Return the content of `records.json`."""
        digest = hashlib.sha256(self.case.model.read_bytes()).hexdigest()
        return self.described(digest, PHOTOS, {role: _about(part) for role, part in self.case.pairs.items()})

    def _views(self) -> dict[str, ImageResiduals]:
        """Return residuals by role, in units of the noise, or of the model error if photos are compared with renderings."""
        if self.case.registration is not None:
            error = learn_splat_error(self.case.registration)
            return {role: SplatResiduals(error.corrected(reduced(part)), error) for role, part in self.case.pairs.items()}
        noise = learn_noise(list(self.case.pairs.values()))
        return {role: ImageResiduals(part, noise) for role, part in self.case.pairs.items()}

    def compare(self) -> dict[str, Any]:
        """Return the content of `comparison.json`: sizes of the photos' differences, and maps of where they show."""
        views = self._views()
        return {
            "unit": ImageAccount.unit,
            "records": {role: _differences(view) for role, view in views.items()},
            "simulations": sum(view.expectation.pictures for view in views.values()),
        }

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """Return the content of `screen.json`: which effects the photos can tell apart, before any fit. `bank` is not used."""
        view, who = self._views()["fit"], image_candidates(self.case.names)
        groups = signatures(view, [one for one in who if view.tells(one)])
        return {
            "candidates": [str(one) for one in who],
            "unseen": list(unseen_of(view, who, groups)),
            "signature_similarity": similar_pairs(*cosines(groups)),
            "signatures": sum(len(group.tables) for group in groups),
            "simulations": view.expectation.pictures,
        }

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """Return the content of `findings.json`: the diagnosis, verified on the role `verify`. `bank` is not used."""
        case = self.case
        if case.registration is None:
            diagnosis = diagnose_images(case.pairs, names=case.names, seed=seed)
            found = ImageAccount().findings_of(diagnosis, case.pairs, seed=seed, reasons=case.reasons)
        else:
            error = learn_splat_error(case.registration)
            diagnosis = diagnose_splats(case.pairs, error, names=case.names, seed=seed)
            found = SplatAccount().findings_of(diagnosis, case.pairs, seed=seed, reasons=case.reasons, **_model_error(error))
        return found | {PHOTOS: {role: {"views": len(part), "repeats": part.repeats} for role, part in case.pairs.items()}}

    def amend(self, model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
        """Write the simulation's model with those named effects that it can reproduce; list the others in the file's head."""
        played = [item for item in findings["amended"] if IMAGE_EFFECTS[item["name"]].amendable]
        left = [IMAGE_EFFECTS[item["name"]] for item in findings["amended"] if item not in played]
        for effect in left:
            logger.warning("the model cannot hold '%s': %s. %s", effect.name, effect.reason, effect.instead)
        _write_camera(model, findings, played, out, [f"not held: {effect.name} ({effect.reason})" for effect in left])

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Compare the photos of every role with the expected ones, without and with some effects.

        Returns:
            The arrays that `write_image_findings` describes as `pictures`, for the role `verify`; and the content of
            `replays.json`: for each role, the sizes of the residuals without and with the effects, and a map of what remains.
        """
        views, rows = self._views(), {}
        for role, view in views.items():
            before, after = view.residual(), view.residual(effects)
            rows[role] = {
                "before": view.size_of(before),
                "after": view.size_of(after),
                "channels": list(channel_sizes(view, before)),
                "remains": map_pictures(view, after).record(),
            }
        unit, pictures = ImageAccount.unit, sum(view.expectation.pictures for view in views.values())
        return _pictures(views["verify"], effects), {"unit": unit, "records": rows, "simulations": pictures}


def _model_error(error: SplatError) -> dict[str, Any]:
    """Return the entry of `findings.json` on the model error: what rendered images lack compared with photos."""
    drawn, calibrated, corrected = error.left
    return {
        "model_error": {
            "calibration": [effect.record() for effect in error.calibration],
            "rms": {"drawn": drawn, "calibrated": calibrated, "corrected": corrected},
        }
    }


def _about(part: Pairs) -> dict[str, Any]:
    """Return the entry of `records.json` that describes the photos of a role."""
    return {
        "name": part.name,
        "views": len(part),
        "repeats": part.repeats,
        "size": [part.camera.width, part.camera.height],
        "commands": [],
        "measured": [PHOTOS],
        "quantum": {},
        "digest": part.digest or part.content_digest(),
    }


def _differences(view: ImageResiduals) -> dict[str, Any]:
    """Return the entry of `comparison.json` for one role: sizes of the photos' differences, and a map of where they show."""
    table = view.residual()
    return {
        "whole": view.size_of(table),
        "channels": channel_sizes(view, table),
        "noise": view.noise.levels(),
        "residual_map": map_pictures(view, table).record(),
    }


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
    """Diagnose what changed between photos, and write the findings and the images for a report.

    Args:
        views: Folder that describes the views (`gsbridge.gap.image.files`).
        before: Folder of earlier photos.
        after: Folder of later photos.
        findings: File to write: `findings.json`.
        pictures: File to write (`.npz`), with images of some views of `verify` for a report: photos `before` and `after`, and
            the later photos as `expected`, [N, H, W, 3]; a mask of the pixels that are `compared`, and the mean absolute
            residual without (`gap`) and with the explanation (`left`), in units of the noise, [N, h, w].
        seed: Seed of replicates.
        shot: Number of the later photo of each view that is diagnosed.
        names: Effects among which the diagnosis searches; None for all.

    Raises:
        InputError: Photos, views or depths cannot be used; nothing is written then.
    """
    pairs = read_pairs(views, before, after, shot=shot)
    reasons = (*unsteady(pairs, seed=seed), *shared_photos(pairs))
    case = ImageCase(Path(views), pairs, None if names is None else tuple(names), reasons)
    for reason in case.reasons:
        logger.warning("degraded: %s", reason)
    found = ImageBackend(case).diagnose("", seed)
    view = ImageResiduals(pairs["verify"], learn_noise(list(pairs.values())))
    with atomic_file(pictures) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **_pictures(view, best_effects(found)))  # type: ignore[arg-type]
    write_json(findings, found)


def _pictures(view: ImageResiduals, effects: Sequence[Applied]) -> dict[str, Array]:
    """Return the arrays for a report on the views of a role; `write_image_findings` describes them as `pictures`."""
    table = {"gap": view.residual(), "left": view.residual(effects)}
    shown = slice(0, _SHOWN)
    return {
        "before": view.pairs.before[shown],
        "after": view.pairs.after[shown],
        "expected": np.clip(view.expectation.photos(shooting(effects, view.pairs.edge))[shown], 0.0, 1.0).astype(np.float32),
        "compared": view.mask[shown].astype(np.float32),
        **{name: np.abs(view.pictures(rows)[shown]).mean(axis=-1).astype(np.float32) for name, rows in table.items()},
    }


def amend_camera(nominal: str | Path, findings: str | Path, model: str | Path, reference: str | Path | None = None) -> None:
    """Write the simulation's model with the named image effects, so that a policy trained with it sees them.

    Args:
        nominal: Model file of the simulation, without the effects.
        findings: `findings.json` of the diagnosis.
        model: Amended model file to write; its head states the evidence.
        reference: `findings.json` of a control: further photos of the first day, in which nothing must be found.

    Raises:
        StageError: Nothing was named, or the control found a difference.
        InputError: The simulation cannot render a named effect, or a file is damaged.
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
    _write_camera(nominal, found, found["amended"], model)


def _write_camera(
    nominal: str | Path,
    found: Mapping[str, Any],
    effects: Sequence[Mapping[str, Any]],
    out: str | Path,
    notes: Sequence[str] = (),
) -> None:
    """Write a simulation's model with further image effects, and with the evidence in the file's head.

    Args:
        nominal: Model file without the further effects.
        found: Content of `findings.json`.
        effects: Effects to add, as entries of a model file.
        out: Amended model file to write.
        notes: Further lines of the head.

    Raises:
        InputError: The model cannot hold an effect.
    """
    content = read_yaml(nominal, "model", "models/nominal.yaml")
    content = ordered({**content, "effects": [*(content.get("effects") or []), *effects]}, nominal)
    head = [
        f"Amended by the gap of pictures; made from {Path(nominal).name} and not to be edited.",
        found["sentence"],
        *(f"photos {role}: {digest}" for role, digest in found["records"].items()),
        f"seed {found['seed']}",
        *notes,
    ]
    write_amended(out, content, head)


def _findings(path: str | Path) -> dict[str, Any]:
    """Read `findings.json`.

    Raises:
        InputError: The file lacks a key.
    """
    found = read_json(path)
    missing = [key for key in ("verdict", "sentence", "amended", "records", "seed") if key not in found]
    if missing:
        raise InputError(path, f"it has no '{missing[0]}'", "Diagnose the photos again")
    return found
