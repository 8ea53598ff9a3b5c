"""The registration stage: takes photos of the board and the arm's poses, and finds the poses of table and camera."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.configuration.registration import RegistrationSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.photogrammetry.board import MIN_TAGS, Board, find_tags
from gsbridge.registration.capture import ARM_CSV, CAMERA_JSON, BoardCapture, read_board_capture
from gsbridge.registration.fit import LeftOut, RegistrationViews, consistent, leave_one_out, pose_rms
from gsbridge.registration.handeye import start_hand_eye, turn_spread_deg
from gsbridge.registration.sightings import Sighting, sight_board
from gsbridge.registration.typed import typed_pose
from gsbridge.robot.assembly import build_robot
from gsbridge.robot.kinematics import Kinematics
from gsbridge.sfm.calibrate import MIN_VIEWS, solve

logger = logging.getLogger("gsbridge")

_STAGE = "registration"
_FEWEST = 5
"""Number of poses at which the fit stops leaving out contradicting ones. It is not above `min_poses`, so that the error message
can say how many poses agree."""

_FLOOR_PX = 0.7
"""Reprojection error up to which a pose never counts as an outlier, px: a few tenths of a pixel above the error of the tag
detection."""

_GOOD_CALIBRATION_VIEWS = 20

_FAR_M = 0.15
"""Distance of a wrist camera from the flange beyond which the arm's poses are doubted, m: tools are about as long."""

_SCALE_OFF = 0.005
"""Accepted relative error of the board's size, on top of three standard errors. Lengths in films of the print have the same
error."""


@dataclass(frozen=True)
class _Seen:
    """The photos that show the board, the arm's poses for them, and the reasons why other photos are left out."""

    names: list[str]
    base_from_flange: Array
    sightings: list[Sighting]
    left_out: dict[str, str]
    camera: Camera
    estimated: bool


def register(
    *,
    source: Mapping[str, Any],
    capture: Path | None,
    out_json: Path,
    board: Board,
    scale: str,
    settings: RegistrationSettings,
    seed: int,
) -> None:
    """Find `base_from_table` and `flange_from_camera` and write them.

    The table frame is the board's frame: origin at its centre, x to the right and y up as printed, z out of the table. One fit
    uses all tag corners of all photos and starts from a hand-eye calibration in closed form.

    Args:
        source: The configured source. If it has the key `typed`, those poses are taken as they are; otherwise the poses are
            measured from the capture.
        capture: Folder of the board capture; None for typed poses.
        out_json: The record `registration.json` to write.
        board: Layout of the board that was filmed.
        scale: `board`: the board's nominal size is taken as true. `robot`: its size is fitted from the arm's motion.
        settings: Limits for failing and for degrading the stage.
        seed: Random seed.

    Raises:
        InputError: A file of the capture or a typed pose cannot be used.
        StageError: Too few photos show the board, too few poses agree, or the hand turned about one axis only.
    """
    if "typed" in source:
        _write_typed(source["typed"], out_json)
        return
    if capture is None:
        raise InputError("config: workspace.source", "it names no board capture", "Give a folder, or typed poses")
    photos = read_board_capture(capture)
    seen = _see(photos, board, settings)
    _require(len(seen.names), len(seen.left_out), settings, "show the board")
    _require_turns(seen.base_from_flange, settings)
    views = RegistrationViews.of(seen.camera, seen.base_from_flange, seen.sightings)
    free = scale == "robot"
    begin = start_hand_eye(views.base_from_flange, views.cam_from_board, with_scale=free, seed=seed)
    fit, kept = consistent(views, begin, with_scale=free, floor_px=_FLOOR_PX, least=_FEWEST)
    used = views.only(kept)
    left_out = {**seen.left_out, **{n: "contradicts the other poses" for n, ok in zip(seen.names, kept, strict=True) if not ok}}
    _require(int(kept.sum()), len(left_out), settings, "agree with one another")
    # Check again: the poses left out may have held the only turns about a second axis.
    _require_turns(used.base_from_flange, settings)
    without = leave_one_out(used, fit, with_scale=free)
    residual_mm = 1e3 * float(np.sqrt((without.residuals_m**2).mean()))
    errors = _standard_errors(fit.covariance, without)
    reasons = _doubts(seen, left_out, fit.rms_px, residual_mm, errors, settings)
    away = np.asarray(fit.found.flange_from_camera)[:3, 3]
    if photos.base_from_flange is not None and np.linalg.norm(away) > _FAR_M:
        x, y, z = 1e3 * away
        reasons.append(
            f"the camera sits at ({x:.0f}, {y:.0f}, {z:.0f}) mm of the flange; if these are poses of a tool, which no"
            f" disagreement can tell, set the controller's tool to zero or correct {photos.arm_file}"
        )
    if free and abs(fit.found.scale - 1.0) > _SCALE_OFF + 3.0 * errors["scale"]:
        reasons.append(
            f"the board measures {fit.found.scale:.3f} of its nominal size, so that lengths in films of this print are"
            f" {100 * (1 / fit.found.scale - 1):+.1f} % off; print it at 100 % and film again"
        )
    names = [name for name, ok in zip(seen.names, kept, strict=True) if ok]
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=["opencv-python-headless", "scipy"],
        source="board",
        base_from_table=fit.found.base_from_board,
        flange_from_camera=fit.found.flange_from_camera,
        residual_px=fit.rms_px,
        residuals_mm={
            "rms": residual_mm,
            "max": 1e3 * float(without.residuals_m.max()),
            "by_photo": {name: 1e3 * float(value) for name, value in zip(names, without.residuals_m, strict=True)},
        },
        photo_rms_px=dict(zip(names, pose_rms(used, fit).tolist(), strict=True)),
        standard_errors=errors,
        poses={"photos": len(seen.names) + len(seen.left_out), "used": len(names), "left_out": left_out},
        turn_spread_deg=turn_spread_deg(used.base_from_flange),
        scale={"value": fit.found.scale, "source": scale, "se": errors.get("scale")},
        camera={**seen.camera.to_json(), "source": "estimated" if seen.estimated else CAMERA_JSON},
        sheet=board.sheet,
        settings=settings.model_dump(),
    )
    logger.info("%d poses, residual %.2f px, left one out %.2f mm", len(names), fit.rms_px, residual_mm)


def _write_typed(typed: Mapping[str, Any], out_json: Path) -> None:
    """Write the record with the poses as they were typed."""
    poses = {key: typed_pose(typed[key], f"config: workspace.source.typed.{key}") for key in typed}
    missing = {"base_from_table", "flange_from_camera"} - set(poses)
    if missing:
        raise InputError("config: workspace.source.typed", f"{' and '.join(sorted(missing))} is missing", "Type both poses")
    write_stage(
        out_json,
        reasons=["the places of table and camera are typed, not measured; film the board with the wrist camera"],
        source="typed",
        base_from_table=poses["base_from_table"],
        flange_from_camera=poses["flange_from_camera"],
        residual_px=None,
        residuals_mm=None,
        standard_errors=None,
        poses=None,
        scale={"value": 1.0, "source": "typed", "se": None},
    )


def _see(capture: BoardCapture, board: Board, settings: RegistrationSettings) -> _Seen:
    """Find the board in all photos, and the pose of the flange for each."""
    poses = _flange_poses(capture)
    tags, size = {}, None
    for name in capture.images:
        image = read_image_u8(capture.folder / name)
        here = (image.shape[1], image.shape[0])
        size = size or here
        if here != size:
            raise InputError(
                capture.folder / name,
                f"this photo has {here[0]} x {here[1]} pixels, others {size[0]} x {size[1]}",
                "Take all photos with one camera at one size",
            )
        tags[name] = find_tags(image, board)
    assert size is not None
    if capture.camera is not None and size != (capture.camera.width, capture.camera.height):
        raise InputError(
            capture.folder / CAMERA_JSON,
            f"it describes photos of {capture.camera.width} x {capture.camera.height} pixels, these have {size[0]} x {size[1]}",
            "Give the intrinsics of these photos, or delete it to have them estimated",
        )
    camera = capture.camera or _estimated_camera(tags, board, size)
    names, kept, sightings, left_out = [], [], [], {}
    for name, pose in zip(capture.images, poses, strict=True):
        found = sight_board(tags[name], board, camera, settings.gate_px)
        if isinstance(found, str):
            left_out[name] = found
            logger.warning("%s is left out: %s", name, found)
        else:
            names.append(name)
            kept.append(pose)
            sightings.append(found)
    return _Seen(names, np.array(kept).reshape(-1, 4, 4), sightings, left_out, camera, capture.camera is None)


def _flange_poses(capture: BoardCapture) -> Array:
    """Return `base_from_flange` of every photo, m, computed from the joints where no poses are given. [N, 4, 4]."""
    if capture.base_from_flange is not None:
        return capture.base_from_flange
    assert capture.joints is not None
    with TemporaryDirectory() as folder:
        kinematics = Kinematics.read(build_robot(Path(folder) / "robot").urdf)
    count, source = len(kinematics.arm_joints), capture.folder / capture.arm_file
    if capture.joints.shape[1] != count:
        raise InputError(source, f"{capture.joints.shape[1]} joints per photo, the arm has {count}", "Give one angle per joint")
    inside = kinematics.arm_limits.margin(capture.joints) > -np.deg2rad(1.0)
    if not inside.all():
        row = int(np.argmin(inside.all(1)))
        joint = int(np.argmin(inside[row]))
        raise InputError(
            source,
            f"joint {joint + 1} of {capture.images[row]} is at {capture.joints[row, joint]:.2f} rad, outside its limits",
            "Give radians" + (", or name the columns q1_deg, q2_deg, ..." if capture.arm_file == ARM_CSV else ""),
        )
    return kinematics.fk(capture.joints, ["flange"])["flange"]


def _estimated_camera(tags: Mapping[str, Mapping[int, Array]], board: Board, size: tuple[int, int]) -> Camera:
    """Estimate the intrinsics from the photos of the board alone."""
    layout = board.corners()
    matches = [
        (np.concatenate([layout[tag] for tag in sorted(found)]), np.concatenate([found[tag] for tag in sorted(found)]))
        for found in tags.values()
        if len(found) >= MIN_TAGS
    ]
    if len(matches) < MIN_VIEWS:
        raise StageError(
            _STAGE,
            f"{len(matches)} photos show {MIN_TAGS} or more tags of the board, the intrinsics need {MIN_VIEWS}",
            f"Film the board from more sides, or give {CAMERA_JSON}",
        )
    camera, rms, views = solve(matches, size)
    logger.info("intrinsics from %d photos: focal %.1f px, residual %.3f px", views, camera.fx, rms)
    return camera


def _require(count: int, left_out: int, settings: RegistrationSettings, what: str) -> None:
    """Raise a `StageError` if too few poses are usable; `what` is what the `count` poses do."""
    if count < settings.min_poses:
        raise StageError(
            _STAGE,
            f"{count} poses {what}, {settings.min_poses} are needed ({left_out} left out)",
            "Photograph the whole board, sharp and still, from 12 poses of the arm, and note each pose beside its own photo",
        )


def _require_turns(base_from_flange: Array, settings: RegistrationSettings) -> None:
    """Raise a `StageError` if the hand turned about one axis only, or hardly at all."""
    spread = turn_spread_deg(base_from_flange)
    if spread[1] < settings.min_turn_deg:
        raise StageError(
            _STAGE,
            f"the hand turned by {spread[0]:.1f}, {spread[1]:.1f} and {spread[2]:.1f} degrees about its axes (standard"
            f" deviations); {settings.min_turn_deg:g} about a second axis are needed to place the camera",
            "Tilt the hand by 20 degrees and more to all sides of the board, and turn it about its own axis too",
        )


def _standard_errors(scatter: Array, without: LeftOut) -> dict[str, Any]:
    """Return standard errors from the larger of two variances: by the corners' scatter, and by the jackknife over poses."""
    variances = np.maximum(np.diag(scatter), np.diag(without.covariance))
    out: dict[str, Any] = {}
    for name, first in (("flange_from_camera", 0), ("base_from_table", 6)):
        shift, turn = np.sqrt(variances[first : first + 3]), np.sqrt(variances[first + 3 : first + 6])
        out[name] = {
            "position_mm": 1e3 * shift,
            "angle_deg": np.rad2deg(turn),
            "position_total_mm": 1e3 * float(np.linalg.norm(shift)),
            "angle_total_deg": float(np.rad2deg(np.linalg.norm(turn))),
        }
    if len(variances) > 12:
        out["scale"] = float(np.sqrt(variances[12]))
    return out


def _doubts(
    seen: _Seen,
    left_out: Mapping[str, str],
    rms_px: float,
    residual_mm: float,
    errors: Mapping[str, Any],
    settings: RegistrationSettings,
) -> list[str]:
    """Return the reasons why the result is degraded; empty if it is not."""
    reasons = []
    contradicting = sum(why.startswith("contradicts") for why in left_out.values())
    if contradicting:
        reasons.append(f"{contradicting} photos contradict the others; was the arm still, is each pose beside its own photo?")
    if rms_px > settings.max_residual_px:
        reasons.append(f"the tags are {rms_px:.2f} px off on average; check the intrinsics and that the board lies flat")
    if residual_mm > settings.max_residual_mm:
        reasons.append(
            f"poses disagree by {residual_mm:.1f} mm; check the joint angles, and that camera and board did not move"
        )
    for name in ("flange_from_camera", "base_from_table"):
        shift, turn = errors[name]["position_total_mm"], errors[name]["angle_total_deg"]
        if shift > settings.max_se_mm or turn > settings.max_se_deg:
            reasons.append(
                f"{name} is known to {shift:.1f} mm and {turn:.2f} degrees only; add poses with more tilt on all sides"
            )
    if seen.estimated and len(seen.names) < _GOOD_CALIBRATION_VIEWS:
        reasons.append(
            f"the intrinsics come from {len(seen.names)} photos of a flat board; give {CAMERA_JSON}, or"
            f" {_GOOD_CALIBRATION_VIEWS} photos"
        )
    return reasons
