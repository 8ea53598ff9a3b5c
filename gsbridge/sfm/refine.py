"""Bundle adjustment with the board's tag corners as points of known layout."""

from __future__ import annotations

import logging
from collections import Counter
from typing import Any

import cv2  # noqa: F401  (must be loaded before pycolmap)
import numpy as np
import pycolmap

from gsbridge.cameras import camera_centre
from gsbridge.geometry import Array, align_similarity
from gsbridge.photogrammetry.board import MIN_TAGS, Board
from gsbridge.photogrammetry.colmap import pose_matrix
from gsbridge.photogrammetry.tags import scale_standard_error
from gsbridge.sfm.gates import model_corners
from gsbridge.sfm.tags import Tags, layout_error

logger = logging.getLogger("gsbridge")

MAX_WORSENING = 1.05
"""Largest factor by which the natural features' residual may grow if the refined model is to be kept; a bent or misprinted
board raises it more."""

TAG_COPIES = 8
"""Weight of a tag's corner, relative to a natural feature: a corner is found several times more precisely."""

LAYOUT_SLACK = 2e-4
"""Growth of the layout's residual that is accepted, as a share of the board's width (0.06 mm on A4)."""

FLAT_BOARD = 0.005
"""Layout residual above which the board is taken for bent or the model for wrong, as a share of the board's width (1.5 mm)."""

MIN_IMAGES_INTRINSICS = 15
"""Least number of a camera's images from which its intrinsics are refined; with fewer, the principal point cannot be told from
a rotation of the camera."""

FLAT_HEIGHT = 0.006
FLAT_SHARE = 0.03
"""A scene is flat if less than `FLAT_SHARE` of its points lie more than `FLAT_HEIGHT`, m, off the table."""

PLANAR_HEIGHT = 0.01
"""The same where no board gives metres, as a share of the cameras' distance. In nine films the share of points beyond it is at
most 0.7 % in those of the empty table, and at least 4.6 % in those of objects."""


def refine_with_tags(
    model: pycolmap.Reconstruction, raw_tags: Tags, board: Board, seed: int
) -> tuple[pycolmap.Reconstruction, dict[str, Any]]:
    """Adjust intrinsics, poses and points together with the tag corners, which stay at the printed layout.

    A calibration from the board alone leaves the principal point uncertain by pixels, which shifts the cameras by millimetres.
    Natural features all over the image determine it, unless they all lie on the table: in a flat scene the principal point is
    confounded with the cameras' tilt and height, so there the intrinsics stay as they are.

    Args:
        model: Model with distorted cameras; not changed.
        raw_tags: Corners in distorted pixels.
        board: Layout.
        seed: Random seed of the scale's error.

    Returns:
        The refined model, in metres and in the board's frame, and a record of what was done; the old model if the tags are too
        few or do not fit.
    """
    corners = model_corners(model, raw_tags)
    before = layout_error(corners, board)
    if before is None:
        return model, {"used": False, "why": f"fewer than {MIN_TAGS} tags could be triangulated"}
    if before > FLAT_BOARD:
        return model, {"used": False, "why": "the tags do not fit their layout; is the board flat?", "layout_before": before}
    layout = board.corners()
    ids = [tag for tag in corners if tag in layout]
    source, target = np.array([corners[i] for i in ids]), np.array([layout[i] for i in ids])
    fit = align_similarity(source.reshape(-1, 3), target.reshape(-1, 3))
    metric = pycolmap.Reconstruction(model)
    metric.transform(pycolmap.Sim3d(fit.scale, pycolmap.Rotation3d(fit.rotation), fit.translation))
    joint, tag_points = _with_tag_points(metric, raw_tags, {i: layout[i] for i in ids})
    flat = is_flat(metric)
    _adjust(joint, tag_points, free=not flat)
    for point_id in tag_points:
        joint.delete_point3D(point_id)
    joint.update_point_3d_errors()
    model.update_point_3d_errors()
    old, new = model.compute_mean_reprojection_error(), joint.compute_mean_reprojection_error()
    after = layout_error(model_corners(joint, raw_tags), board)
    record = {
        "flat": flat,
        "metres_per_unit": fit.scale,
        "scale_se": scale_standard_error(source, target, seed),
        "layout_before": before,
        "layout_after": after,
        "reprojection_before_px": old,
        "reprojection_after_px": new,
    }
    if new > MAX_WORSENING * old or after is None or after > before + LAYOUT_SLACK:
        return model, {"used": False, "why": "the natural features fit worse with the tags; is the board flat?", **record}
    logger.info(
        "tags refine the model: layout residual %.2f -> %.2f mm", 1e3 * before * board.size[0], 1e3 * after * board.size[0]
    )
    return joint, {"used": True, **record}


def is_flat(model: pycolmap.Reconstruction) -> bool:
    """Whether hardly any point of a model in the board's frame stands off the table."""
    heights = np.array([abs(point.xyz[2]) for point in model.points3D.values()])
    return bool(np.mean(heights > FLAT_HEIGHT) < FLAT_SHARE)


def is_planar(model: pycolmap.Reconstruction) -> bool:
    """Whether hardly any point of a model in a frame and unit of its own stands off the plane that fits most of its points."""
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    centres = np.array([camera_centre(pose_matrix(model.image(i))) for i in model.reg_image_ids()]).reshape(-1, 3)
    kept = np.ones(len(points), dtype=bool)
    for _ in range(10):
        middle = points[kept].mean(0)
        normal = np.linalg.eigh(np.cov((points[kept] - middle).T))[1][:, 0]
        heights = np.abs((points - middle) @ normal)
        kept = heights <= np.quantile(heights, 1 - FLAT_SHARE)
    distance = float(np.median(np.linalg.norm(centres - middle, axis=1)))
    return bool(np.mean(heights > PLANAR_HEIGHT * distance) < FLAT_SHARE)


def _with_tag_points(
    model: pycolmap.Reconstruction, raw_tags: Tags, layout: dict[int, Array]
) -> tuple[pycolmap.Reconstruction, list[int]]:
    """Copy of a model with the tag corners appended to its observations, and the ids of their points."""
    out = pycolmap.Reconstruction()
    for camera in model.cameras.values():
        out.add_camera_with_trivial_rig(camera)
    tracks: dict[tuple[int, int, int], pycolmap.Track] = {}
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        pixels = [np.array([point.xy for point in image.points2D]).reshape(-1, 2)]
        index = len(pixels[0])
        for tag, corners in sorted(raw_tags.get(image.name, {}).items()):
            if tag not in layout:
                continue
            for copy in range(TAG_COPIES):
                pixels.append(corners)
                for k in range(4):
                    tracks.setdefault((tag, k, copy), pycolmap.Track()).add_element(image_id, index + k)
                index += 4
        moved = pycolmap.Image(image.name, np.concatenate(pixels), image.camera_id, image_id)
        out.add_image_with_trivial_frame(moved, pycolmap.Rigid3d(pose_matrix(image)[:3]))
    for point_id, point in model.points3D.items():
        out.add_point3D_with_id(point_id, point)
    points = [out.add_point3D(layout[tag][k], track) for (tag, k, _), track in sorted(tracks.items(), key=lambda item: item[0])]
    return out, points


def _adjust(model: pycolmap.Reconstruction, constant: list[int], *, free: bool) -> None:
    """Robust bundle adjustment in place, with some points fixed; if `free`, intrinsics of cameras with many images move."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = free
    options.refine_principal_point = free
    options.refine_extra_params = free
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    # With several threads, Ceres sums in the order in which they end, and results differ from run to run.
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = 50
    options.ceres.solver_options.function_tolerance = 1e-7
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    taken = Counter(model.image(image_id).camera_id for image_id in model.reg_image_ids())
    for camera_id in model.cameras:
        if not free or taken[camera_id] < MIN_IMAGES_INTRINSICS:
            config.set_constant_cam_intrinsics(camera_id)
    for point_id in constant:
        config.add_constant_point(point_id)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
