"""The stage: sparse model in, everything in the table frame out."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.align.board_fit import BoardFit, fit_board
from gsbridge.align.length import KnownLength, reading_error, scale_from_length
from gsbridge.align.plane import Attention, Plane, attention, find_table, why_no_table
from gsbridge.cameras import Camera, View, camera_centre, write_views
from gsbridge.configuration.align import AlignSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file, read_json, write_stage
from gsbridge.geometry import Array, Similarity, rotation_between
from gsbridge.photogrammetry.board import Board
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix, read_model
from gsbridge.photogrammetry.standing import box_sides, find_standing

logger = logging.getLogger("gsbridge")

MAX_BOARD_HEIGHT_MM = 3.0
"""If the board lies higher than this above the table's points, it lies on something else, and the table's z = 0 is in doubt."""

MAX_BOARD_RESIDUAL_MM = 1.5
"""Root mean square distance of the tags' corners from their printed places above which the board is bent, misprinted or
wrong."""

MAX_READING_ERROR = 0.01
"""Largest relative change of the scale by an error of one pixel in the points of a known length."""

MAX_UNIT_MISMATCH = 0.02
"""Largest relative difference of the board's scale from the stated unit of the poses, or of either from a known length."""

MIN_OBJECT_POINTS = 20
"""Least number of points above the table from which the object's longest side is measured."""

UNKNOWN_EXTENT = 0.1
"""Longest side that the object is given if nothing tells the scale, m: a guess of the right order, marked so in the record."""

_STRAGGLERS = 1.0
"""Percentage of points beyond each side of the object's box that are ignored: the outermost points change even if the same
photos are only rotated."""


@dataclass(frozen=True)
class _Model:
    """Parts of the sparse model that the stage reads."""

    names: list[str]
    cameras: list[Camera]
    poses: Array
    points: Array
    colours: Array
    errors: Array
    view_index: Array
    point_index: Array


def align_scene(
    *,
    sfm_json: Path,
    model: Path,
    tags: Path,
    out_json: Path,
    out_views: Path,
    out_points: Path,
    settings: AlignSettings,
    board: Board | None,
    known_length: Mapping[str, Any] | None,
    seed: int,
    up: str | None = None,
    metres_per_unit: float | None = None,
    measured: str | Path | None = None,
) -> None:
    """Find the table frame of a reconstruction and write cameras and points in it.

    Args:
        sfm_json: Record of the sfm stage.
        model: Undistorted COLMAP model of the scene.
        tags: Tag corners of the scene.
        out_json: Record `align.json`.
        out_views: Cameras in the table frame, `views.json`.
        out_points: Sparse points in the table frame, `points.npz`.
        settings: Limits.
        board: Layout of the board; None if none was laid out.
        known_length: A length the user knows, see `KnownLength`; used if the board gives no scale.
        measured: Record of the longest side of the object's mesh, sfm units; None takes the longest side of its sparse points.
        seed: Random seed.
        up: Side of the photos that is up, see `attention`.
        metres_per_unit: Unit of the poses that came with the photos, m; used if the board gives no scale.

    Raises:
        InputError: A file or the known length is damaged.
        StageError: No table plane is found, or the scale is required and nothing gives it.
    """
    stage = f"align of {out_json.parent.parent.name}"
    record = read_json(sfm_json)
    sparse = _read(model)
    looks = attention(sparse.poses, up)
    plane = find_table(sparse.points, looks, threshold=settings.plane_threshold, seed=seed)
    fit = None
    if board is not None:
        pairs = {name: (camera, pose) for name, camera, pose in zip(sparse.names, sparse.cameras, sparse.poses, strict=True)}
        fit = fit_board(read_json(tags), pairs, board, seed)
    if plane is None and fit is None:
        raise StageError(
            stage,
            f"no table plane among {len(sparse.points)} points: "
            + why_no_table(sparse.points, looks, threshold=settings.plane_threshold, seed=seed),
            "Film with more of the table in view, on a patterned cloth or with the board on it; where the photos lie on their "
            "side or head, name the side of theirs that is up (`up: left`)",
        )
    length = KnownLength.parse(known_length) if known_length is not None else None
    reasons: list[str] = []
    numbers: dict[str, Any] = {}
    if fit is not None:
        table_from_sfm, source, numbers = _from_board(fit, plane, sparse, record, settings, reasons)
        if metres_per_unit is not None and abs(table_from_sfm.scale / metres_per_unit - 1.0) > MAX_UNIT_MISMATCH:
            reasons.append(
                f"the board says {table_from_sfm.scale:.4g} m per unit of the poses, `metres_per_unit` {metres_per_unit:.4g}; "
                "one of them is wrong, the board is taken"
            )
        unscaled = Similarity(1.0, table_from_sfm.rotation, table_from_sfm.translation / table_from_sfm.scale)
        reasons += _contradiction(
            length, unscaled, sparse, record, table_from_sfm.scale, "the board", " (was the board printed at 100 %?)"
        )
    else:
        assert plane is not None
        if settings.require_scale and length is None and metres_per_unit is None:
            sought = "no board" if board is None else "fewer than 3 tags of the board"
            raise StageError(
                stage,
                f"the scale is required, but {sought} could be found and no known length is given",
                "Print the board (`gsbridge board`) and film it beside the object, or set `known_length`",
            )
        table_from_sfm, source, numbers = _from_plane(
            plane, looks, sparse, record, length, metres_per_unit, board is not None, reasons, measured
        )
    _write(sparse, record, table_from_sfm, (out_views, out_points), sfm_json)
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=["pycolmap"],
        table_from_sfm=table_from_sfm.matrix(),
        scale=table_from_sfm.scale,
        scale_source=source,
        metres_per_unit=table_from_sfm.scale * record.get("tag_refinement", {}).get("metres_per_unit", 1.0)
        if record.get("tag_refinement", {}).get("used")
        else table_from_sfm.scale,
        plane_inliers=0 if plane is None else int(plane.inliers.sum()),
        points=len(sparse.points),
        settings=settings.model_dump(),
        **numbers,
    )
    logger.info("scale from %s: %.6g m per unit", source, table_from_sfm.scale)


def _from_board(
    fit: BoardFit,
    plane: Plane | None,
    sparse: _Model,
    record: Mapping[str, Any],
    settings: AlignSettings,
    reasons: list[str],
) -> tuple[Similarity, str, dict[str, Any]]:
    """Table frame of the board; the points' plane is compared with it."""
    scale = fit.board_from_sfm.scale
    # A model adjusted to the tags fits them more closely than its scale is known, so the larger error, from before, counts.
    stated = [fit.scale_se / scale, record.get("tag_refinement", {}).get("scale_se")]
    relative = max((value for value in stated if value is not None and np.isfinite(value)), default=float("nan"))
    numbers: dict[str, Any] = {
        "scale_se": relative * scale,
        "residual_mm": fit.residual_mm,
        "tags": fit.tags,
        "sightings": fit.observations,
        "tilt_deg": None,
        "height_mm": None,
        "plane_residual_mm": None,
    }
    if plane is not None:
        normal = fit.board_from_sfm.rotation @ plane.normal
        tilt = float(np.rad2deg(np.arccos(np.clip(normal[2], -1.0, 1.0))))
        on_plane = sparse.points[plane.inliers]
        numbers["tilt_deg"] = tilt
        numbers["height_mm"] = 1e3 * float(np.median(fit.board_from_sfm.apply(on_plane)[:, 2]))
        numbers["plane_residual_mm"] = 1e3 * scale * plane.residual
        if tilt > settings.max_tilt_deg:
            reasons.append(f"the board is tilted by {tilt:.1f} degrees against the table's points; lay it flat")
        if abs(numbers["height_mm"]) > MAX_BOARD_HEIGHT_MM:
            reasons.append(f"the table's points lie {-numbers['height_mm']:.1f} mm below the board; lay it on the table itself")
    else:
        reasons.append("the table shows too few points to check the board against; use a patterned table")
    if fit.residual_mm > MAX_BOARD_RESIDUAL_MM:
        reasons.append(
            f"the board's tags are {fit.residual_mm:.1f} mm off their printed places; print it at 100 % and lay it flat"
        )
    if not np.isfinite(relative):
        reasons.append("too few tags are seen to tell how well the scale is known; show the whole board")
    elif relative > settings.max_scale_se:
        reasons.append(f"the scale is known to {100 * relative:.2f} % only; show the board in more photos")
    return fit.board_from_sfm, "tags", numbers


def _from_plane(
    plane: Plane,
    looks: Attention,
    sparse: _Model,
    record: dict[str, Any],
    length: KnownLength | None,
    metres_per_unit: float | None,
    board_expected: bool,
    reasons: list[str],
    measured: str | Path | None,
) -> tuple[Similarity, str, dict[str, Any]]:
    """Table frame without a board: origin below the object, x to the first camera's right, scale from a length or unknown."""
    above = object_points(sparse.points, plane, looks)
    centre = np.median(sparse.points[above], axis=0) if len(above) >= 5 else looks.point
    foot = centre - plane.heights(centre) * plane.normal
    rotation = rotation_between(plane.normal, np.array([0.0, 0.0, 1.0]))
    ahead = rotation @ (foot - camera_centre(sparse.poses[0]))
    # The first camera looks along +y, so that its right is +x.
    yaw = np.pi / 2 - np.arctan2(ahead[1], ahead[0])
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    unscaled = Similarity(1.0, rotation, -rotation @ foot)
    source = "unknown"
    if board_expected:
        reasons.append("fewer than 3 tags of the board could be found, so the board does not give the scale")
    extents = box_sides(unscaled.apply(sparse.points[above])) if len(above) >= 5 else np.full(3, 0.3 * looks.distance)
    side, unsure = float(extents.max()), None
    if metres_per_unit is not None:
        scale, source = metres_per_unit, "poses"
        reasons += _contradiction(length, unscaled, sparse, record, scale, "`metres_per_unit`")
    elif length is not None:
        if length.between is None:
            if measured is not None:
                content = read_json(measured)
                side = float(content["side"])
                reasons += [f"the length is measured on a mesh that may be wrong: {doubt}" for doubt in content["doubts"]]
            elif len(above) < MIN_OBJECT_POINTS:
                raise StageError(
                    "align",
                    f"the object's longest side is to give the scale, but only {len(above)} points lie on the object",
                    "Give `known_length` as two points on the table (`between`), or film the board",
                )
            what = "sparse points of" if measured is None else "the mesh along"
            reasons.append(f"the scale rests on {what} the object's longest side, which is good to some 5 %")
        scale, unsure = _scale_by_length(length, unscaled, sparse, record, side)
        source = "known_length"
        if unsure is not None and unsure > MAX_READING_ERROR:
            reasons.append(
                f"a pixel of error in the two points of `known_length` changes the scale by {100 * unsure:.1f} %: name points "
                "farther apart"
            )
    else:
        if len(above) >= MIN_OBJECT_POINTS:
            side = float(box_sides(unscaled.apply(sparse.points[above]), _STRAGGLERS).max())
        scale = UNKNOWN_EXTENT / side
        reasons.append(
            f"the scale is unknown: lengths are in units in which the object's longest side is some {UNKNOWN_EXTENT:g} m; "
            "film the board, or set `known_length`"
        )
    numbers = {
        "scale_se": None if unsure is None else unsure * scale,
        "residual_mm": 1e3 * scale * plane.residual,
        "tags": 0,
        "tilt_deg": None,
        "object_points": len(above),
        "object_extent": scale * extents,
    }
    return Similarity(scale, rotation, -scale * rotation @ foot), source, numbers


def _contradiction(
    length: KnownLength | None,
    unscaled: Similarity,
    sparse: _Model,
    record: Mapping[str, Any],
    scale: float,
    taken: str,
    ask: str = "",
) -> list[str]:
    """The reason for doubt where a length between two points contradicts the scale that is taken, m per sfm unit; or none."""
    if length is None or length.between is None:
        return []
    other, unsure = _scale_by_length(length, unscaled, sparse, record, 1.0)
    if abs(other / scale - 1.0) <= MAX_UNIT_MISMATCH + (unsure or 0.0):
        return []
    return [
        f"`known_length` makes lengths {100 * other / scale:.0f} % of what {taken} makes them; one of them is wrong{ask}, "
        f"{taken} is taken"
    ]


def _scale_by_length(
    length: KnownLength, unscaled: Similarity, sparse: _Model, record: Mapping[str, Any], side: float
) -> tuple[float, float | None]:
    """Metres per sfm unit by a known length, and its relative standard error (see `reading_error`; None for a whole side)."""
    cameras = dict(zip(sparse.names, zip(sparse.cameras, sparse.poses, strict=True), strict=True))
    others = {name: Camera.from_json(item) for name, item in record.get("other_cameras", {}).items()}
    taken = Camera.from_json(record["camera"])
    scale = scale_from_length(length, unscaled, cameras, taken, side, others)
    return scale, None if length.between is None else reading_error(length, unscaled, cameras, taken, others)


def object_points(points: Array, plane: Plane, looks: Attention) -> Array:
    """Indices of the points of the object that stands on the table where the cameras look. [N, 3] -> [K].

    Args:
        points: Sparse points. [N, 3].
        plane: The table.
        looks: Where the cameras look.
    """
    upright = rotation_between(plane.normal, np.array([0.0, 0.0, 1.0]))
    onto = Similarity(1.0, upright, np.array([0.0, 0.0, -plane.offset]))
    return find_standing(onto.apply(points), onto.apply(looks.point), looks.distance).members


def _read(folder: Path) -> _Model:
    """Read views in the order of their names, and points."""
    model = read_model(folder)
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda image: image.name)
    place = {image.image_id: position for position, image in enumerate(images)}
    ids = sorted(model.points3D)
    view_index, point_index = [], []
    for number, point_id in enumerate(ids):
        # An image may observe a point twice; it counts once.
        seen = sorted({place[element.image_id] for element in model.points3D[point_id].track.elements})
        view_index += seen
        point_index += [number] * len(seen)
    return _Model(
        [image.name for image in images],
        [camera_from_colmap(image.camera, folder) for image in images],
        np.array([pose_matrix(image) for image in images]),
        np.array([model.points3D[i].xyz for i in ids]).reshape(-1, 3),
        np.array([model.points3D[i].color for i in ids], dtype=np.uint8).reshape(-1, 3),
        np.array([model.points3D[i].error for i in ids], dtype=np.float64),
        np.array(view_index, dtype=np.int32),
        np.array(point_index, dtype=np.int32),
    )


def _write(
    sparse: _Model, record: dict[str, Any], table_from_sfm: Similarity, paths: tuple[Path, Path], sfm_json: Path
) -> None:
    """Write `views.json` and `points.npz`.

    Raises:
        InputError: The record of the sfm stage does not belong to the model.
    """
    out_views, out_points = paths
    try:
        splits = [record["splits"][name] for name in sparse.names]
    except KeyError as error:
        raise InputError(sfm_json, f"it does not name the image {error} of the model", "Run the sfm stage again") from error
    moved = table_from_sfm.move_pose(sparse.poses)
    views = [View(*item) for item in zip(sparse.names, sparse.cameras, moved, splits, strict=True)]
    write_views(out_views, views)
    with atomic_file(out_points) as temporary:
        np.savez_compressed(
            temporary,
            points=table_from_sfm.apply(sparse.points),
            colours=sparse.colours,
            errors=sparse.errors,
            view_index=sparse.view_index,
            point_index=sparse.point_index,
        )
