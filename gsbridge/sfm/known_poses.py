"""Photos with given poses: exact poses are used as they are, rough ones only give the unit of length."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import cv2  # noqa: F401  (must be loaded before pycolmap)
import numpy as np
import pycolmap

from gsbridge.cameras import Camera, camera_centre
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.geometry import Array, Similarity, align_similarity
from gsbridge.photogrammetry.colmap import colmap_params, pose_matrix
from gsbridge.sfm.mapping import (
    MIN_IMAGE_POINTS,
    Attempt,
    MappingOutcome,
    adjust,
    extract,
    incremental_options,
    map_database,
    rematch,
)
from gsbridge.sfm.matching import can_be_listed, match
from gsbridge.sfm.photos import Photos

logger = logging.getLogger("gsbridge")

ROUGH_PX = 1.0
"""Mean reprojection error of given poses, px, above which they may be rough; exact poses leave only the features' noise."""

BETTER = 0.8
"""Given poses are rough if bundle adjustment lowers that error to this share of it or less."""

STRANGE = 0.1
"""A photo's given pose is taken for wrong if the photo has less than this share of the median number of points."""

LOOSE = 0.03
"""Mean distance between given and found camera centres, as a share of their spread, from which the unit is in doubt."""


def map_posed_photos(
    photos: Photos, known: Mapping[str, tuple[Camera, Array]], settings: SfmSettings, workspace: Path, seed: int, threads: int
) -> tuple[MappingOutcome, list[str]]:
    """Build a model of photos with given poses, in the poses' unit.

    Poses from another reconstruction are exact to a fraction of a pixel. Those of a phone (ARKit: Polycam, Record3D) are off by
    centimetres and degrees, too much to reconstruct a surface. Then the cameras are estimated anew from the photos, with the
    given intrinsics, and a similarity fits them to the given camera centres, which provide the unit.

    Args:
        photos: Input; its own camera is not used.
        known: Camera and `cam_from_world` [4, 4] by image name.
        settings: Limits.
        workspace: Empty folder for the database.
        seed: Random seed.
        threads: Threads to use.

    Returns:
        The model, and the reasons to doubt it.
    """
    model, base = triangulate_known(photos, known, settings, workspace, seed, threads)
    doubts = drop_contradicted(model)
    given = MappingOutcome(model, "known", "known poses", [])
    before = model.compute_mean_reprojection_error() if model.num_points3D() else np.inf
    if before <= ROUGH_PX:
        return given, doubts
    adjusted = pycolmap.Reconstruction(model)
    if model.num_points3D():
        adjust(adjusted, intrinsics=False)
    after = adjusted.compute_mean_reprojection_error() if model.num_points3D() else 0.0
    if after > BETTER * before:
        return given, [
            *doubts,
            f"the poses and cameras that came with the photos leave {before:.1f} px, and other poses hardly fewer: their "
            "intrinsics may be wrong, or the photos are blurred",
        ]
    logger.info("the given poses leave %.1f px, the photos want others: find them anew", before)
    fresh = map_database(workspace / "database.db", base, Attempt("rough poses", False, False), workspace, seed)
    if fresh is None or fresh.num_reg_images() < settings.pass_share * len(photos.names):
        count = 0 if fresh is None else fresh.num_reg_images()
        return given, [
            *doubts,
            f"the poses that came with the photos leave {before:.1f} px and only {count} of {len(photos.names)} photos "
            "register by themselves; surfaces will be blurred: take sharper photos with more overlap",
        ]
    fresh = rematch(fresh, base, workspace, seed, threads)
    move, loose = laid_onto(fresh, known)
    fresh.transform(pycolmap.Sim3d(move.scale, pycolmap.Rotation3d(move.rotation), move.translation))
    reasons = []
    if loose > LOOSE:
        reasons.append(
            f"the poses that came with the photos differ from those found in them by {100 * loose:.0f} % of their spread, so "
            "that the unit of the poses is known as badly; lay out the board, or give a known length"
        )
    return MappingOutcome(fresh, "incremental", "known poses, refined", []), reasons


def drop_contradicted(model: pycolmap.Reconstruction) -> list[str]:
    """Remove photos that share next to no points with the others from a model of given poses, and report which.

    A photo whose pose is wrong triangulates nothing, so that no reprojection error reveals it.
    """
    counts = {model.image(i).name: (model.image(i).num_points3D, model.image(i).frame_id) for i in model.reg_image_ids()}
    usual = float(np.median([count for count, _ in counts.values()])) if counts else 0.0
    gone = sorted(name for name, (count, _) in counts.items() if count < STRANGE * usual) if usual >= MIN_IMAGE_POINTS else []
    for name in gone:
        model.deregister_frame(counts[name][1])
    if not gone:
        return []
    shown = ", ".join(gone[:5]) + (", ..." if len(gone) > 5 else "")
    return [
        f"the poses of {len(gone)} of {len(counts)} photos share next to no points with the others and are left out ({shown}): "
        "they may be wrong"
    ]


def laid_onto(model: pycolmap.Reconstruction, known: Mapping[str, tuple[Camera, Array]]) -> tuple[Similarity, float]:
    """Fit a similarity from a model to given poses by the camera centres, ignoring the fifth with the largest residuals.

    Args:
        model: Posed model.
        known: Camera and `cam_from_world` [4, 4] by image name.

    Returns:
        `given_from_model`, and the mean distance of the centres that count, as a share of their spread.
    """
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda image: image.name)
    found = np.array([camera_centre(pose_matrix(image)) for image in images])
    given = np.array([camera_centre(known[image.name][1]) for image in images])
    kept = np.arange(len(found))
    for _ in range(3):
        move = align_similarity(found[kept], given[kept])
        away = np.linalg.norm(move.apply(found) - given, axis=1)
        kept = np.sort(np.argsort(away, kind="stable")[: max(3, round(0.8 * len(found)))])
    spread = float(np.linalg.norm(given[kept] - given[kept].mean(0), axis=1).mean())
    return move, float(away[kept].mean()) / max(spread, 1e-12)


def triangulate_known(
    photos: Photos, known: Mapping[str, tuple[Camera, Array]], settings: SfmSettings, workspace: Path, seed: int, threads: int
) -> tuple[pycolmap.Reconstruction, Photos]:
    """Triangulate points with cameras and poses that came with the photos; also return the photos with a fixed camera.

    Args:
        photos: Input; its own camera is not used.
        known: Camera and `cam_from_world` [4, 4] by image name.
        settings: Limits.
        workspace: Empty folder for the database.
        seed: Random seed.
        threads: Threads to use.
    """
    database_path = workspace / "database.db"
    first = next(iter(known.values()))[0]
    base = Photos(photos.folder, photos.names, photos.ordered, first, None, photos.size, photos.other_sizes)
    extract(database_path, base, settings, threads, per_image=True)
    model = pycolmap.Reconstruction()
    database = pycolmap.Database.open(database_path)
    try:
        for image in database.read_all_images():
            camera, cam_from_world = known[image.name]
            stored = database.read_camera(image.camera_id)
            stored.params = [*colmap_params(camera.undistorted()), *camera.distortion]
            stored.has_prior_focal_length = True
            database.update_camera(stored)
            model.add_camera_with_trivial_rig(stored)
            keypoints = database.read_keypoints(image.image_id)[:, :2].astype(np.float64)
            copy = pycolmap.Image(image.name, keypoints, image.camera_id, image.image_id)
            model.add_image_with_trivial_frame(copy, pycolmap.Rigid3d(np.asarray(cam_from_world)[:3]))
    finally:
        database.close()
    few = len(photos.names) <= settings.exhaustive_up_to
    exhaustive = not photos.ordered and (few or not can_be_listed(photos.names))
    match(database_path, photos, settings, seed, threads, exhaustive=exhaustive)
    out = workspace / "models" / "known"
    out.mkdir(parents=True, exist_ok=True)
    options = incremental_options(base, seed, relaxed=False)
    model = pycolmap.triangulate_points(model, database_path, photos.folder, out, clear_points=True, options=options)
    return model, base
