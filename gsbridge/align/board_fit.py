"""Similarity between the reconstruction and the board, from tag corners in many photos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gsbridge.cameras import Camera
from gsbridge.geometry import Array, Similarity, align_similarity
from gsbridge.photogrammetry.board import MIN_TAGS, Board
from gsbridge.photogrammetry.tags import Tags, corner_points, scale_standard_error


@dataclass(frozen=True)
class BoardFit:
    """Result of `fit_board`.

    Args:
        board_from_sfm: Similarity into the board frame, m.
        scale_se: Standard error of the scale, m per unit.
        residual_mm: Root mean square distance of triangulated corners from the layout, mm.
        tags: Tags used.
        observations: Tag sightings used.
    """

    board_from_sfm: Similarity
    scale_se: float
    residual_mm: float
    tags: int
    observations: int


@dataclass(frozen=True)
class _Sightings:
    """All corner observations in flat arrays; `tag` holds indices into `ids`."""

    ids: list[int]
    tag: Array
    corner: Array
    pixels: Array
    focal: Array
    centre: Array
    rotation: Array
    translation: Array


def fit_board(
    tags: Mapping[str, Mapping[int, Array]], poses: Mapping[str, tuple[Camera, Array]], board: Board, seed: int
) -> BoardFit | None:
    """Fit the printed layout to the tag corners seen in posed photos.

    Corners are first triangulated one by one, for a starting value and for the residual. The similarity then minimises the
    reprojection error of the whole layout, so that each sighting counts with its own geometry. The standard error comes from
    resampling whole tags, because the errors within one tag (a blurred edge, a bent corner) are correlated.

    Args:
        tags: Corners, px [4, 2], by image name and tag.
        poses: Pinhole and `cam_from_sfm` [4, 4] by image name.
        board: Layout.
        seed: Random seed of the resampling.

    Returns:
        The fit; None when fewer than three tags can be triangulated.
    """
    layout = board.corners()
    found: Tags = {
        name: {int(tag): np.asarray(corners, dtype=np.float64) for tag, corners in here.items() if int(tag) in layout}
        for name, here in tags.items()
    }
    corners = corner_points(found, poses)
    if len(corners) < MIN_TAGS:
        return None
    kept = sorted(corners)
    source = np.array([corners[tag] for tag in kept])
    target = np.array([layout[tag] for tag in kept])
    seen = _gather({name: {tag: here[tag] for tag in here if tag in corners} for name, here in found.items()}, poses)
    start = _robust_similarity(source, target)
    fit = _fit_reprojection(seen, layout, start)
    se = fit.scale * scale_standard_error(source, target, seed)
    residual = 1e3 * float(np.sqrt(((fit.apply(source) - target) ** 2).sum(-1).mean()))
    return BoardFit(fit, se, residual, len(kept), len(seen.tag) // 4)


def _gather(tags: Tags, poses: Mapping[str, tuple[Camera, Array]]) -> _Sightings:
    """Flatten the sightings of posed images."""
    rows = [
        (tag, k, corners[k], *poses[name])
        for name, found in sorted(tags.items())
        if name in poses
        for tag, corners in sorted(found.items())
        for k in range(4)
    ]
    ids = sorted({row[0] for row in rows})
    index = {tag: i for i, tag in enumerate(ids)}
    return _Sightings(
        ids,
        np.array([index[row[0]] for row in rows], dtype=int),
        np.array([row[1] for row in rows], dtype=int),
        np.array([row[2] for row in rows]).reshape(-1, 2),
        np.array([[row[3].fx, row[3].fy] for row in rows]).reshape(-1, 2),
        np.array([[row[3].cx, row[3].cy] for row in rows]).reshape(-1, 2),
        np.array([row[4][:3, :3] for row in rows]).reshape(-1, 3, 3),
        np.array([row[4][:3, 3] for row in rows]).reshape(-1, 3),
    )


def _robust_similarity(source: Array, target: Array) -> Similarity:
    """Similarity fitted without tags that lie far from the fit (a misread tag or a bent corner). [T, 4, 3] each."""
    keep = np.ones(len(source), dtype=bool)
    while True:
        fit = align_similarity(source[keep].reshape(-1, 3), target[keep].reshape(-1, 3))
        errors = np.sqrt(((fit.apply(source) - target) ** 2).sum(-1).mean(-1))
        limit = max(4.0 * float(np.median(errors)), 1e-4)
        # A tag that was left out stays out, or tags near the limit could come and go for ever.
        fresh = (errors <= limit) & keep
        if fresh.sum() < MIN_TAGS or (fresh == keep).all():
            return fit
        keep = fresh


def _fit_reprojection(seen: _Sightings, layout: Mapping[int, Array], start: Similarity) -> Similarity:
    """Similarity `board_from_sfm` with the least reprojection error of the layout under a robust loss."""
    corners = np.array([layout[tag] for tag in seen.ids])[seen.tag, seen.corner]
    inverse = start.inverse()
    centre = corners.mean(0)

    def sfm_from_board(x: Array) -> tuple[Array, Array, float]:
        angle = np.linalg.norm(x[:3])
        axis = x[:3] / angle if angle > 1e-15 else np.zeros(3)
        k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        scale = inverse.scale * float(np.exp(x[6]))
        rotation = turn @ inverse.rotation
        # The rotation is about the board's centre, which decouples it from the shift.
        translation = inverse.apply(centre) + inverse.scale * x[3:6] - scale * rotation @ centre
        return rotation, translation, scale

    def residual(x: Array) -> Array:
        rotation, translation, scale = sfm_from_board(x)
        world = scale * corners @ rotation.T + translation
        p = np.einsum("nij,nj->ni", seen.rotation, world) + seen.translation
        return (seen.focal * p[:, :2] / np.maximum(p[:, 2:], 1e-9) + seen.centre - seen.pixels).ravel()

    x = least_squares(residual, np.zeros(7), loss="soft_l1", f_scale=0.5, x_scale=[0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]).x
    rotation, translation, scale = sfm_from_board(x)
    return Similarity(scale, rotation, translation).inverse()
