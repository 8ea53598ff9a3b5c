"""Features, matches and models; several attempts are made until enough images register."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2  # noqa: F401  (must be loaded before pycolmap)
import pycolmap

from gsbridge.configuration.sfm import SfmSettings
from gsbridge.logs import ProgressLog
from gsbridge.photogrammetry.colmap import colmap_params
from gsbridge.sfm.matching import can_be_listed, match
from gsbridge.sfm.numbering import number_images
from gsbridge.sfm.photos import Photos

logger = logging.getLogger("gsbridge")

DOUBLED_UP_TO_PX = 1000
"""Images with a longer side of up to this are enlarged twofold before features are searched. In larger images the finest
features are mostly noise."""

REMATCH_PX = 4.0
"""Largest distance of a match from its epipolar line once the poses are known, px."""

MIN_IMAGE_POINTS = 30
"""Observed points below which the pose of an image is not trusted."""


@dataclass(frozen=True)
class Attempt:
    """One attempt at a model; the last one if a share `enough` of the images registers (None: the share that passes)."""

    name: str
    exhaustive: bool
    relaxed: bool
    mapper: str = "incremental"
    enough: float | None = None


@dataclass
class MappingOutcome:
    """Best model so far. `tried`: the attempts that were made, with the number of images that each registered."""

    model: pycolmap.Reconstruction | None
    mapper: str
    attempt: str
    tried: list[dict[str, Any]]


def ladder(photos: Photos, settings: SfmSettings) -> list[Attempt]:
    """Attempts, the cheapest and most reliable first; the global mapper is last.

    Names of photos mostly follow the camera's path round the object. So if there are many, photos with neighbouring names are
    matched first: from 50 photos on these are less than half of all pairs. Names may mislead, so this attempt must register
    every photo to be the last one.
    """
    count = len(photos.names)
    if not photos.ordered:
        listed = count >= settings.neighbours_from and can_be_listed(photos.names)
        near = [Attempt("neighbours", False, False, enough=1.0)] if listed else []
        every = [Attempt("exhaustive", True, False), Attempt("exhaustive, relaxed", True, True)]
        return [*near, *every, Attempt("global", True, False, "global")]
    sequential = count > settings.overlap
    attempts = [Attempt("sequential" if sequential else "exhaustive", not sequential, False)]
    attempts.append(Attempt(f"{attempts[0].name}, relaxed", not sequential, True))
    wide = sequential and count <= settings.exhaustive_up_to
    if wide:
        attempts += [Attempt("exhaustive", True, False), Attempt("exhaustive, relaxed", True, True)]
    attempts.append(Attempt("global", wide or not sequential, False, "global"))
    return attempts


def map_photos(
    photos: Photos,
    settings: SfmSettings,
    workspace: Path,
    seed: int,
    threads: int,
    confirm: Callable[[pycolmap.Reconstruction], str | None],
) -> MappingOutcome:
    """Make one attempt after the other until enough images register.

    Args:
        photos: Input.
        settings: Limits.
        workspace: Empty folder for the database.
        seed: Random seed.
        threads: Threads to use.
        confirm: Returns why a *global* model must not be trusted, or None if the board's layout confirms it.

    Returns:
        The model with most images; `model` is None when nothing was found.
    """
    database = workspace / "database.db"
    extract(database, photos, settings, threads)
    outcome = MappingOutcome(None, "incremental", "", [])
    matched: set[bool] = set()
    sufficient = settings.pass_share
    for attempt in ladder(photos, settings):
        if outcome.model is not None and outcome.model.num_reg_images() >= sufficient * len(photos.names):
            break
        sufficient = settings.pass_share if attempt.enough is None else attempt.enough
        enough = outcome.model is not None and outcome.model.num_reg_images() >= settings.degraded_share * len(photos.names)
        if attempt.mapper == "global" and enough:
            break
        if attempt.exhaustive not in matched:
            match(database, photos, settings, seed, threads, exhaustive=attempt.exhaustive)
            matched.add(attempt.exhaustive)
        model = map_database(database, photos, attempt, workspace, seed)
        count = 0 if model is None else model.num_reg_images()
        record: dict[str, Any] = {"attempt": attempt.name, "registered": count}
        outcome.tried.append(record)
        logger.info("%s: %d of %d images registered", attempt.name, count, len(photos.names))
        if model is None or count < 3:
            continue
        if attempt.mapper == "global":
            doubt = confirm(model)
            if doubt is not None:
                record["refused"] = doubt
                logger.warning("the global model is refused: %s", doubt)
                continue
        if outcome.model is None or count > outcome.model.num_reg_images():
            outcome.model, outcome.mapper, outcome.attempt = model, attempt.mapper, attempt.name
    return outcome


def extract(database: Path, photos: Photos, settings: SfmSettings, threads: int, *, per_image: bool = False) -> None:
    """Find SIFT features of all photos, which share a camera per image size and lens or have one each.

    Args:
        database: COLMAP's database, which gets the features.
        photos: Images to use.
        settings: See `SfmSettings`.
        threads: Threads to use.
        per_image: Whether each image gets a camera of its own.
    """
    logger.info("find features in %d images", len(photos.names))
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = threads
    options.sift.max_num_features = settings.max_features
    options.sift.peak_threshold = settings.peak_threshold
    if max(photos.size) > DOUBLED_UP_TO_PX:
        options.sift.first_octave = 0
    for (width, height), focal, names in photos.by_camera():
        reader = pycolmap.ImageReaderOptions()
        if photos.camera is not None:
            # The OPENCV model is used without distortion, too, so that one camera model serves every case.
            reader.camera_model = "OPENCV"
            params = [*colmap_params(photos.camera.undistorted()), *photos.camera.distortion]
            reader.camera_params = ",".join(repr(float(value)) for value in params)
        elif focal is not None:
            reader.camera_model = "SIMPLE_RADIAL"
            reader.camera_params = f"{focal!r},{width / 2!r},{height / 2!r},0.0"
        # Each call creates one camera, which the images of one size and lens share.
        pycolmap.extract_features(
            database,
            photos.folder,
            image_names=names,
            camera_mode=pycolmap.CameraMode.PER_IMAGE if per_image else pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
            device=pycolmap.Device.cpu,
        )
    if threads > 1:
        number_images(database, [name for _, _, names in photos.by_camera() for name in names])


def incremental_options(photos: Photos, seed: int, *, relaxed: bool) -> pycolmap.IncrementalPipelineOptions:
    """Options of the incremental mapper.

    The mapper runs on one thread, like every adjustment here: with several, Ceres sums in the order in which the threads end,
    and results differ from run to run.

    Args:
        photos: Their calibrated camera, if any, is kept fixed.
        seed: Random seed.
        relaxed: Whether weaker pairs and poses are accepted.
    """
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1
    options.random_seed = seed
    options.mapper.random_seed = seed
    options.triangulation.random_seed = seed
    options.mapper.num_threads = 1
    options.min_model_size = 3
    if photos.camera is not None:
        options.ba_refine_focal_length = False
        options.ba_refine_extra_params = False
        options.mapper.abs_pose_refine_focal_length = False
        options.mapper.abs_pose_refine_extra_params = False
    if relaxed:
        options.min_num_matches = 10
        options.mapper.init_min_num_inliers = 40
        options.mapper.init_min_tri_angle = 8.0
        options.mapper.abs_pose_min_num_inliers = 15
        options.mapper.abs_pose_min_inlier_ratio = 0.15
        options.mapper.max_reg_trials = 6
    return options


def map_database(
    database: Path, photos: Photos, attempt: Attempt, workspace: Path, seed: int
) -> pycolmap.Reconstruction | None:
    """Run one mapper on the matches in the database.

    Args:
        database: Features and verified matches.
        photos: Their calibrated camera, if any, is kept fixed.
        attempt: The mapper, and how strict it is.
        workspace: Folder that gets the models.
        seed: Random seed.

    Returns:
        The model with most images, or None.
    """
    pycolmap.set_random_seed(seed)
    out = workspace / "models" / attempt.name.replace(", ", "_")
    out.mkdir(parents=True, exist_ok=True)
    if attempt.mapper == "global":
        options = pycolmap.GlobalPipelineOptions()
        options.num_threads = 1
        options.random_seed = seed
        options.mapper.random_seed = seed
        options.mapper.num_threads = 1
        options.mapper.global_positioning.use_gpu = False
        options.mapper.global_positioning.random_seed = seed
        options.mapper.rotation_averaging.random_seed = seed
        options.mapper.bundle_adjustment.ceres.use_gpu = False
        if photos.camera is not None:
            options.mapper.bundle_adjustment.refine_focal_length = False
            options.mapper.bundle_adjustment.refine_extra_params = False
        models = pycolmap.global_mapping(database, photos.folder, out, options=options)
    else:
        progress = ProgressLog(len(photos.names), "register images")
        models = pycolmap.incremental_mapping(
            database,
            photos.folder,
            out,
            options=incremental_options(photos, seed, relaxed=attempt.relaxed),
            next_image_callback=lambda: progress.update() if progress.done < progress.total else None,
        )
    if not models:
        return None
    for key in sorted(models):
        drop_weak_images(models[key])
    # Ties go to the model with the lowest key, so that the choice does not depend on the order of the dictionary.
    return max((models[key] for key in sorted(models)), key=lambda model: model.num_reg_images())


def drop_weak_images(model: pycolmap.Reconstruction) -> None:
    """Remove poses that rest on few points: relaxed thresholds accept images whose poses are wrong by metres."""
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        if image.num_points3D < MIN_IMAGE_POINTS:
            logger.info("%s is left out: its pose hangs on %d points", image.name, image.num_points3D)
            model.deregister_frame(image.frame_id)


def rematch(
    model: pycolmap.Reconstruction, photos: Photos, workspace: Path, seed: int, threads: int
) -> pycolmap.Reconstruction:
    """Verify all matches again with the poses now known, triangulate afresh and adjust.

    The first verification may take the table for the whole scene: if one homography explains most matches of a pair, it drops
    the others as outliers, and with them every point of a plain object that stands on the table.

    Args:
        model: Posed model of `photos`.
        photos: Input.
        workspace: Folder that holds the database.
        seed: Random seed.
        threads: Threads to use.

    Returns:
        The model with new points; the old model if that has more points.
    """
    logger.info("verify the matches again with the poses found")
    database = workspace / "database.db"
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    verification.ransac.max_error = REMATCH_PX
    pycolmap.guided_geometric_verification(model, database, two_view_geometry_options=verification, num_threads=threads)
    out = workspace / "models" / "rematched"
    out.mkdir(parents=True, exist_ok=True)
    options = incremental_options(photos, seed, relaxed=False)
    fresh = pycolmap.triangulate_points(
        pycolmap.Reconstruction(model), database, photos.folder, out, clear_points=True, options=options
    )
    if fresh.num_points3D() < model.num_points3D():
        return model
    adjust(fresh, intrinsics=photos.camera is None)
    return fresh


def adjust(model: pycolmap.Reconstruction, *, intrinsics: bool) -> None:
    """Robust bundle adjustment of poses and points, in place.

    Args:
        model: Reconstruction, which is changed.
        intrinsics: Whether focal lengths and distortion are refined, too.
    """
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = intrinsics
    options.refine_extra_params = intrinsics
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = 30
    options.ceres.solver_options.function_tolerance = 1e-6
    pycolmap.bundle_adjustment(model, options)
    model.update_point_3d_errors()
