"""Tag corners in space: triangulated with the estimated poses, compared with the board's layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.geometry import Array, align_similarity
from gsbridge.images import read_image_u8
from gsbridge.logs import track
from gsbridge.photogrammetry.board import MIN_TAGS, Board, find_tags
from gsbridge.photogrammetry.tags import Tags, corner_points, triangulate

MAX_LAYOUT_ERROR = 0.02
"""Largest layout residual of a trusted model, as a share of the board's width; a wrong model is off by about that width."""


def find_all(frames: Path, names: list[str], board: Board) -> Tags:
    """Find the board in all photos, in their own (distorted) pixels.

    Args:
        frames: Folder of the photos.
        names: Their names.
        board: The board.

    Returns:
        Corners of each tag that was found, by photo.
    """
    return {name: find_tags(read_image_u8(frames / name), board) for name in track(names, "find tags")}


def layout_error(corners: dict[int, Array], board: Board) -> float | None:
    """Residual of triangulated corners against the printed layout.

    Args:
        corners: Corners by tag, world frame. [4, 3] each.
        board: Layout.

    Returns:
        Root mean square residual after the best similarity, as a share of the sheet's width; None with fewer than three tags.
    """
    layout = board.corners()
    ids = [tag for tag in corners if tag in layout]
    if len(ids) < MIN_TAGS:
        return None
    target = np.concatenate([layout[tag] for tag in ids])
    source = np.concatenate([corners[tag] for tag in ids])
    fit = align_similarity(source, target)
    return float(np.sqrt(((fit.apply(source) - target) ** 2).sum(-1).mean()) / board.size[0])


__all__ = ["Tags", "corner_points", "find_all", "layout_error", "triangulate"]
