"""Checks that a model must pass before later stages may use it."""

from __future__ import annotations

import pycolmap

from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.photogrammetry.board import MIN_TAGS, Board
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix
from gsbridge.sfm.mapping import MappingOutcome
from gsbridge.sfm.photos import Photos
from gsbridge.sfm.tags import MAX_LAYOUT_ERROR, Tags, corner_points, layout_error
from gsbridge.sfm.undistort import undistort_pixels

MIN_POINTS = 30
"""Least number of points of a model."""


def doubt(model: pycolmap.Reconstruction, raw_tags: Tags, board: Board | None) -> str | None:
    """Why a global model must not be trusted; None when the board's layout confirms it.

    Neither the number of registered images nor the reprojection error reveals a wrong global model (`docs/capture.md`).

    Args:
        model: The model, with distorted cameras.
        raw_tags: Corners in distorted pixels.
        board: Layout.
    """
    if board is None:
        return "no board that could confirm it"
    error = layout_error(model_corners(model, raw_tags), board)
    if error is None:
        return f"fewer than {MIN_TAGS} tags could be triangulated"
    if error > MAX_LAYOUT_ERROR:
        return f"the tags miss their layout by {100 * error:.1f} % of the board's width"
    return None


def model_corners(model: pycolmap.Reconstruction, raw_tags: Tags) -> dict[int, Array]:
    """Triangulated tag corners of a model by tag id. [4, 3] each."""
    tags: Tags = {}
    poses = {}
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        camera = camera_from_colmap(image.camera, image.name)
        poses[image.name] = (camera.undistorted(), pose_matrix(image))
        tags[image.name] = {tag: undistort_pixels(c, camera) for tag, c in raw_tags.get(image.name, {}).items()}
    return corner_points(tags, poses)


def gaps(names: list[str], registered: set[str]) -> list[tuple[str, str, int]]:
    """Runs of images without a pose: first name, last name, length."""
    runs: list[tuple[str, str, int]] = []
    run: list[str] = []
    for name in [*names, ""]:
        if name and name not in registered:
            run.append(name)
        elif run:
            runs.append((run[0], run[-1], len(run)))
            run = []
    return runs


def advice(names: list[str], registered: set[str], ordered: bool) -> str:
    """Advice on what to film again, in plain words.

    Args:
        names: All images, in the order of the capture.
        registered: Images that have a pose.
        ordered: Whether the images are frames of a film instead of single photos.
    """
    runs = sorted(gaps(names, registered), key=lambda run: -run[2])[:3]
    where = "; ".join(first if first == last else f"{first} to {last} ({count} images)" for first, last, count in runs)
    more = max(len(names) - len(registered), 20 - len(registered), 5)
    if ordered:
        how = "film that part again, slowly and without cuts"
    else:
        how = f"take about {more} more photos there, at most 15 degrees apart, so that each overlaps its neighbours"
    return f"Without a pose: {where}; {how}; a board or a patterned cloth on the table gives features to hold on to"


def check(outcome: MappingOutcome, photos: Photos, settings: SfmSettings, stage: str) -> list[str]:
    """Apply the gates on the share of registered images.

    Args:
        outcome: Result of the mapping.
        photos: Images that went into it.
        settings: Shares of images that must be registered.
        stage: Name of the stage, for the message.

    Returns:
        Reasons why the result is degraded; none if it passes.

    Raises:
        StageError: Too few images registered, or they have too few points.
    """
    total = len(photos.names)
    registered: set[str] = set()
    if outcome.model is not None:
        registered = {outcome.model.image(i).name for i in outcome.model.reg_image_ids()}
    share = len(registered) / total
    text = f"{len(registered)} of {total} images registered ({100 * share:.0f} %)"
    if share < settings.degraded_share or len(registered) < 3 or outcome.model is None:
        need = f"{text}, {100 * settings.degraded_share:.0f} % are needed"
        raise StageError(stage, need, advice(photos.names, registered, photos.ordered))
    points = outcome.model.num_points3D()
    if points < MIN_POINTS:
        raise StageError(
            stage,
            f"{text}, but only {points} points are found in them, {MIN_POINTS} are needed",
            "Take sharp photos with more overlap, with a board or a patterned cloth on the table; where poses came with the "
            "photos, check that each belongs to its photo",
        )
    if share < settings.pass_share:
        return [f"{text}. {advice(photos.names, registered, photos.ordered)}"]
    return []
