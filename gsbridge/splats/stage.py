"""The splats stage: trains a Gaussian model that is bound to a mesh, from photos and that mesh."""

from __future__ import annotations

import hashlib
import logging
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from gsbridge.cameras import Views
from gsbridge.configuration.bindings import BINDINGS
from gsbridge.configuration.splats import SplatSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import write_stage
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.splats.binding import Binding, create_binding, write_binding
from gsbridge.splats.brightness import NOTICEABLE, brightness, spread
from gsbridge.splats.budget import choose_splats
from gsbridge.splats.detail import Focus, edge_sizes
from gsbridge.splats.evaluate import evaluate_cloud, write_pictures
from gsbridge.splats.exposure import Exposures, to_record
from gsbridge.splats.lpips import Lpips
from gsbridge.splats.ply import write_ply
from gsbridge.splats.remesh import remesh_isotropic
from gsbridge.splats.targets import Target, background_targets, object_targets, seen_faces
from gsbridge.splats.train import train

logger = logging.getLogger("gsbridge")

MIN_TRAINING_PSNR = 24.0
"""Masked PSNR on the training photos below which a model is underfitted, dB."""

MOST_LOST = 5.0
"""Largest accepted drop of masked PSNR from training to held-out photos, dB; with 14 photos of a real object it is 4 dB."""

MIN_OUTLINE = 0.9
"""Silhouette IoU of splats and masks on held-out photos below which the result is degraded."""

VISIBLE_OPACITY = 0.3
"""Opacity below which splats are hardly visible; the offsets of such splats are left out of the statistics."""


def train_splats(
    views: Views,
    masks_dir: str | Path | None,
    mesh_path: str | Path,
    out_ply: str | Path,
    out_binding: str | Path,
    out_views: str | Path,
    out_json: str | Path,
    settings: SplatSettings,
    binding: str,
    seed: int,
    threads: int,
    state: str | Path,
    kind: str,
    *,
    surface: str = "visual",
    scene_unit: float | None = None,
) -> None:
    """Train the splats of one object or background and measure them against its photos.

    Args:
        views: Registered views with undistorted photos, table frame.
        masks_dir: Folder of the masks; None for backgrounds.
        mesh_path: Surface to which the splats are bound, table frame, m.
        out_ply, out_binding, out_views, out_json: `splats.ply`, `binding.npz`, the folder `views/`, `splats.json`.
        settings: Budget and step sizes.
        binding: One of `gsbridge.configuration.bindings.BINDINGS`.
        seed: Seed of the splats' positions, the order of photos and the random background colours.
        threads: Threads that the job may use.
        state: Folder of the checkpoint; removed at the end.
        kind: `object` or `background`.
        surface: Name of the mesh in the record (`visual`, `hull`).
        scene_unit: Metres per unit of the reconstruction; needed only for `offset_band: scene`.

    Raises:
        InputError: A setting or file cannot be used.
        StageError: There is nothing to train on, or the training failed.
    """
    # The compiled kernels give bitwise the same result on any number of threads; torch's sums would depend on that number.
    torch.set_num_threads(1)
    if binding not in BINDINGS:
        raise InputError("splats: binding", f"{binding!r} is unknown", f"Use one of {', '.join(BINDINGS)}")
    lpips = Lpips(settings.lpips_weights) if settings.lpips_weights else None
    surface_mesh = read_mesh(mesh_path)
    if kind == "object":
        if masks_dir is None:
            raise InputError("splats", "an object needs masks", "Give the folder of the masks stage")
        targets = object_targets(views, masks_dir, settings.margin_px)
    else:
        targets = background_targets(views, surface_mesh)
    chosen = choose_splats(surface_mesh, targets, settings, kind=kind) if settings.max_splats == "auto" else None
    faces = (chosen or int(settings.max_splats)) // settings.splats_per_face
    try:
        mesh = remesh_isotropic(
            surface_mesh,
            faces,
            seen=lambda candidate: seen_faces(candidate, targets),
            # Objects get one size: photos and wrist camera see all parts of an object at similar resolution.
            sizes=edge_sizes(surface_mesh, targets, _focus(settings), seed) if kind == "background" else None,
        )
    except ValueError as error:
        raise StageError("splats", f"{mesh_path}: {error}", "Raise max_splats, or look at the mesh stage") from error
    band = _band(settings, scene_unit)
    model = create_binding(binding, mesh, settings.splats_per_face, band=band, seed=seed, sh_degree=settings.sh_degree)
    logger.info("%s: %d splats on %d faces, %d photos", binding, len(model), len(mesh.faces), len(targets))
    differ = spread(list(brightness(mesh, targets).values())) if settings.exposure == "auto" else None
    per_photo = settings.exposure == "per_photo" if differ is None else differ > NOTICEABLE
    if differ is not None and per_photo:
        logger.info("photos differ in brightness by %.0f %%: each gets an exposure of its own", 100 * differ)
    exposures = Exposures([t.name for t in targets if t.split == "train"]) if per_photo else None
    inputs = _digest(mesh, targets)
    curve = train(model, targets, settings, kind=kind, seed=seed, state=Path(state), inputs=inputs, exposures=exposures)
    cloud = model.evaluate()
    found = None if exposures is None else exposures.found()
    metrics = evaluate_cloud(cloud, targets, kind=kind, lpips=lpips, exposures=found)
    write_ply(out_ply, cloud)
    write_binding(out_binding, model)
    pictures = write_pictures(out_views, cloud, targets, kind=kind, count=settings.pictures, exposures=found)
    reasons = []
    if len(targets) < len(views):
        what = "an empty mask" if kind == "object" else "no pixel on the mesh"
        reasons.append(f"{len(views) - len(targets)} of {len(views)} views have {what} and were left out")
    fitted = metrics["train"]["masked"]["psnr"]
    if fitted is not None and fitted < MIN_TRAINING_PSNR:
        reasons.append(
            f"the splats reach {fitted:.1f} dB on their own training photos, {MIN_TRAINING_PSNR:g} are usual: there is more "
            "detail than the budget holds, or its mesh or poses are off; look at views/, and try docs/splats.md#quality"
        )
    unseen = metrics["held_out"]["masked"]
    if fitted is not None and unseen["psnr"] is not None and fitted - unseen["psnr"] > MOST_LOST:
        reasons.append(
            f"the splats reach {fitted:.1f} dB on their training photos and {unseen['psnr']:.1f} dB on others: what they show "
            "from new sides is partly made up; take more photos, or give fewer splats or degrees"
        )
    if unseen["alpha_iou"] is not None and unseen["alpha_iou"] < MIN_OUTLINE:
        reasons.append(
            f"outlines of the splats and of held-out masks overlap by {100 * unseen['alpha_iou']:.0f} % only: poses, masks or "
            "the mesh are off; look at views/"
        )
    if metrics["held_out"]["full"]["views"] == 0:
        reasons.append("no view is held out: the metrics of the training views flatter the model")
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=("torch", "numba", "pymeshlab"),
        binding=binding,
        kind=kind,
        surface=surface,
        splats=len(model),
        **({} if chosen is None else {"chosen_splats": chosen}),
        faces=len(mesh.faces),
        steps=settings.steps,
        # Record these values only if they differ from the defaults.
        **({"sh_degree": settings.sh_degree} if settings.sh_degree > 0 else {}),
        **({} if found is None else {"exposure": to_record(found)}),
        brightness_spread=differ,
        metrics=metrics,
        lpips_reason=None
        if lpips
        else "no weights file is configured (object_splats.lpips_weights, background_splats.lpips_weights)",
        offset_mm=_offsets_mm(model),
        offset_band_mm=1e3 * model.band,
        pictures=pictures,
        curve=curve,
    )
    shutil.rmtree(state, ignore_errors=True)


def _digest(mesh: Mesh, targets: Sequence[Target]) -> str:
    """Return a digest of all inputs of the training, so that a checkpoint is never continued with other inputs."""
    digest = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces):
        digest.update(np.ascontiguousarray(array).data)
    for target in targets:
        digest.update(repr((target.name, target.split, target.camera)).encode())
        for array in (target.cam_from_table, target.photo, target.weight):
            digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _focus(settings: SplatSettings) -> Focus:
    x, y = settings.focus_centre
    return Focus((float(x), float(y)), settings.focus_side, settings.focus)


def _band(settings: SplatSettings, scene_unit: float | None) -> float:
    """Return the largest offset along the normal, m."""
    if settings.offset_band != "scene":
        return float(settings.offset_band)
    if scene_unit is None:
        raise InputError(
            "splats: offset_band", "the band 'scene' needs the scale of the reconstruction", "Give a band in metres"
        )
    return scene_unit


def _offsets_mm(model: Binding) -> dict[str, float]:
    """Return statistics of the absolute offsets of visible splats, mm."""
    visible = torch.sigmoid(model.parameters["opacity"]) > VISIBLE_OPACITY
    offsets = 1e3 * model.offsets()[visible].abs().numpy().astype(np.float64)
    if len(offsets) == 0:
        return {"mean": 0.0, "p95": 0.0, "max": 0.0}
    return {"mean": float(offsets.mean()), "p95": float(np.percentile(offsets, 95)), "max": float(offsets.max())}
