"""The stage: keyframes in, undistorted and posed photos out."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from gsbridge.cameras import Camera, split_of
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_directory, read_json, write_json, write_stage
from gsbridge.geometry import Array
from gsbridge.photogrammetry.board import Board
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix, quiet
from gsbridge.sfm import gates
from gsbridge.sfm.known_poses import map_posed_photos
from gsbridge.sfm.mapping import MappingOutcome, map_photos, rematch
from gsbridge.sfm.photos import Photos
from gsbridge.sfm.refine import is_planar, refine_with_tags
from gsbridge.sfm.tags import Tags, corner_points, find_all, layout_error
from gsbridge.sfm.undistort import pinhole_of, undistort_photos, undistort_pixels, undistorted_model

logger = logging.getLogger("gsbridge")


def reconstruct(
    *,
    frames: Path,
    keyframes_json: Path,
    out_model: Path,
    out_images: Path,
    out_json: Path,
    out_tags: Path,
    settings: SfmSettings,
    camera: Camera | None,
    board: Board | None,
    workspace: Path,
    seed: int,
    threads: int,
) -> None:
    """Reconstruct cameras and sparse points from keyframes, and undistort the photos.

    Args:
        frames: Folder of the keyframes.
        keyframes_json: Record of the keyframes.
        out_model: Folder of the undistorted COLMAP model (binary).
        out_images: Folder of the undistorted photos.
        out_json: Record `sfm.json`.
        out_tags: Tag corners in undistorted pixels, `tags.json`.
        settings: Limits.
        camera: Calibrated camera of the keyframes, from `calibrate_camera`; None to find it from these photos alone.
            Photos that come with cameras keep these.
        board: Layout of the board, None where none was laid out.
        workspace: Folder for the database and raw models; emptied first.
        seed: Random seed.
        threads: Threads to use.

    Raises:
        InputError: The record is damaged, or the camera's image size differs from the photos'.
        StageError: Too few images register.
    """
    record = read_json(keyframes_json)
    photos, known = _read_input(record, keyframes_json, frames, camera)
    shutil.rmtree(workspace, ignore_errors=True)
    workspace.mkdir(parents=True)
    raw_tags = find_all(frames, photos.names, board) if board is not None else {name: {} for name in photos.names}
    posed: list[str] = []
    with quiet(workspace / "colmap.log"):
        if known:
            outcome, posed = map_posed_photos(photos, known, settings, workspace, seed, threads)
        else:
            outcome = map_photos(photos, settings, workspace, seed, threads, lambda model: gates.doubt(model, raw_tags, board))
        stage = f"sfm of {keyframes_json.parent.parent.name}"
        reasons = gates.check(outcome, photos, settings, stage) + posed
        model = outcome.model
        assert model is not None
        if not known:
            model = rematch(model, photos, workspace, seed, threads)
        refinement: dict[str, Any] = {"used": False}
        if settings.tag_refinement and board is not None and not known:
            model, refinement = refine_with_tags(model, raw_tags, board, seed)
        if not known:
            reasons += _doubts(model, refinement, camera)
    _write(
        model,
        outcome,
        photos,
        raw_tags,
        board,
        reasons,
        refinement,
        settings,
        seed,
        threads,
        (frames, out_model, out_images, out_json, out_tags),
    )


def _doubts(model: pycolmap.Reconstruction, refinement: dict[str, Any], camera: Camera | None) -> list[str]:
    """Reasons to doubt a model: its board's, and a calibration from a flat scene, told by the board or else the model."""
    reasons = []
    if not refinement["used"] and "layout_before" in refinement:
        reasons.append(f"the board does not fit the reconstruction: {refinement['why']}")
    if camera is None and (refinement["flat"] if "flat" in refinement else is_planar(model)):
        reasons.append(
            "the camera was calibrated from a flat scene alone, which leaves its focal length and tilt in doubt; "
            "name a `camera` that is calibrated from several captures"
        )
    return reasons


def _read_input(
    record: dict[str, Any], source: Path, frames: Path, camera: Camera | None
) -> tuple[Photos, dict[str, tuple[Camera, Array]]]:
    """Photos to reconstruct, and the cameras and poses that came with them, by name."""
    try:
        names = [frame["name"] for frame in record["frames"]]
        size = (int(record["width"]), int(record["height"]))
        known = {
            name: (Camera.from_json(item["camera"]), np.array(item["cam_from_world"], dtype=np.float64))
            for name, item in record["known_cameras"].items()
        }
        sized = [frame for frame in record["frames"] if "size" in frame]
        others = {frame["name"]: (int(frame["size"][0]), int(frame["size"][1])) for frame in sized}
        lenses = {frame["name"]: (int(frame["lens"]), frame["focal_prior_px"]) for frame in record["frames"] if "lens" in frame}
        ordered = record["source"]["kind"] in ("video", "film")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(source, f"the record of the keyframes is damaged ({error})", "Delete it and run again") from error
    if known:
        camera = None
    missing = [name for name in names if not (frames / name).is_file()]
    if missing:
        raise InputError(frames / missing[0], "a keyframe is missing", "Delete the capture folder of this scene and run again")
    unlike = [one for one in (size, *others.values()) if camera is not None and (camera.width, camera.height) != one]
    if camera is not None and unlike:
        raise InputError(
            source,
            f"keyframes have {unlike[0][0]} x {unlike[0][1]} pixels, the calibrated camera {camera.width} x {camera.height}",
            "Give this scene another camera in config.yaml",
        )
    taken = [lenses.get(name, (0, record.get("focal_prior_px"))) for name in names]
    if camera is not None and len(set(taken)) > 1:
        focals = sorted({round(focal) for _, focal in taken if focal})
        other = next(name for name, lens in zip(names, taken, strict=True) if lens != taken[0])
        lengths = f", with focal lengths of {focals[0]} to {focals[-1]} px" if len(focals) > 1 else ""
        raise InputError(
            source,
            f"by their EXIF data {names[0]} and {other} come from two lenses{lengths}; the calibrated camera has one",
            "Leave out the photos of another lens and those without EXIF data, or give this scene no camera in config.yaml",
        )
    return Photos(frames, names, ordered, camera, record.get("focal_prior_px"), size, others, lenses), known


def pinhole_poses(model: pycolmap.Reconstruction) -> dict[str, tuple[Camera, Array]]:
    """Uncropped pinhole and `cam_from_world` of each registered image by name."""
    out = {}
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        out[image.name] = (camera_from_colmap(image.camera, image.name).undistorted(), pose_matrix(image))
    return out


def _write(
    model: pycolmap.Reconstruction,
    outcome: MappingOutcome,
    photos: Photos,
    raw_tags: Tags,
    board: Board | None,
    reasons: list[str],
    refinement: dict[str, Any],
    settings: SfmSettings,
    seed: int,
    threads: int,
    paths: tuple[Path, Path, Path, Path, Path],
) -> None:
    """Write all outputs of the stage, the record last."""
    frames, out_model, out_images, out_json, out_tags = paths
    cameras = {
        model.image(i).camera_id: camera_from_colmap(model.image(i).camera, model.image(i).name) for i in model.reg_image_ids()
    }
    pinholes = {camera_id: pinhole_of(camera) for camera_id, camera in cameras.items()}
    by_name = {
        model.image(i).name: (cameras[model.image(i).camera_id], pinholes[model.image(i).camera_id])
        for i in sorted(model.reg_image_ids(), key=lambda i: model.image(i).name)
    }
    tags: Tags = {}
    for name, (camera, pinhole) in by_name.items():
        shift = np.array([pinhole.cx - camera.cx, pinhole.cy - camera.cy])
        tags[name] = {tag: undistort_pixels(corners, camera) + shift for tag, corners in raw_tags[name].items()}
    undistorted = undistorted_model(model, pinholes)
    undistorted.update_point_3d_errors()
    with atomic_directory(out_images) as folder:
        undistort_photos(frames, by_name, folder, threads)
    with atomic_directory(out_model) as folder:
        undistorted.write_binary(folder)
    write_json(out_tags, tags)
    poses = {model_name: (by_name[model_name][1], pose) for model_name, (_, pose) in pinhole_poses(model).items()}
    error = layout_error(corner_points(tags, poses), board) if board is not None else None
    first = next(iter(by_name.values()))
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=["pycolmap", "opencv-python-headless"],
        registered=len(by_name),
        total=len(photos.names),
        missing=[name for name in photos.names if name not in by_name],
        splits={name: split_of(position) for position, name in enumerate(photos.names) if name in by_name},
        reprojection_px=undistorted.compute_mean_reprojection_error(),
        points=undistorted.num_points3D(),
        track_length=undistorted.compute_mean_track_length(),
        mapper=outcome.mapper,
        attempt=outcome.attempt,
        retries=max(0, len(outcome.tried) - 1),
        tried=outcome.tried,
        camera=first[0].to_json(),
        other_cameras={name: camera.to_json() for name, (camera, _) in by_name.items() if camera != first[0]},
        pinhole=first[1].to_json(),
        calibrated=photos.camera is not None,
        images_with_tags=sum(bool(found) for found in tags.values()),
        layout_error=error,
        tag_refinement=refinement,
        settings=settings.model_dump(),
    )
    logger.info(
        "%d of %d images, %d points, %.2f px",
        len(by_name),
        len(photos.names),
        undistorted.num_points3D(),
        undistorted.compute_mean_reprojection_error(),
    )


__all__ = ["StageError", "reconstruct"]
