"""Corrections by hand at single pixels: the last resort if the prompt selects the wrong thing, or only a part of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.cameras import View
from gsbridge.configuration.scenes import MaskPoint
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.masks.prompt import Prompt
from gsbridge.photogrammetry.sparse import SparsePoints

REACH = 0.02
"""A hint also decides about measured points nearer to it than this, as a share of the photo's longer side."""

_MARGIN = 0.3
"""Margin of the box round points that hints add to the object, as a share of the object's size."""


@dataclass(frozen=True)
class Hints:
    """Hints about one photo, pixels with centres at +0.5.

    Args:
        keep: Pixels on the object. [N, 2].
        drop: Pixels beside it. [N, 2].
    """

    keep: Array
    drop: Array


def read_hints(points: Sequence[MaskPoint], views: Sequence[View]) -> list[Hints]:
    """Hints of each view, from the configuration.

    Raises:
        InputError: A photo is not among the registered ones, or has no such pixel.
    """
    known = {view.name: view for view in views}
    for name, u, v, _ in points:
        key = f"config: scenes: masks: points: {name}"
        view = known.get(name)
        if view is None:
            raise InputError(key, "no registered photo has this name", f"Use one of {', '.join(sorted(known)[:5])}, ...")
        if not (0 <= u < view.camera.width and 0 <= v < view.camera.height):
            size = f"{view.camera.width} x {view.camera.height}"
            raise InputError(key, f"({u:g}, {v:g}) lies outside its {size} pixels", "Read pixels off `gsbridge masks SCENE`")

    def chosen(view: View, what: str) -> Array:
        return np.array([(u, v) for name, u, v, kind in points if (name, kind) == (view.name, what)], float).reshape(-1, 2)

    return [Hints(chosen(view, "keep"), chosen(view, "drop")) for view in views]


def hinted(prompt: Prompt, sparse: SparsePoints, views: Sequence[View], hints: Sequence[Hints]) -> Prompt:
    """Let hints decide about the measured points near them, so that a hint in one photo helps in all.

    Args:
        prompt: The prompt from the sparse model alone.
        sparse: The sparse model.
        views: Posed views.
        hints: Hints of each view.
    """
    own = rows_among(sparse.points, prompt.points)
    table = np.zeros(len(sparse.points), bool)
    table[prompt.table] = True
    for index, (view, hint) in enumerate(zip(views, hints, strict=True)):
        seen = sparse.seen_by(index)
        pose = view.cam_from_table
        pixels = view.camera.project(sparse.points[seen] @ pose[:3, :3].T + pose[:3, 3])
        reach = REACH * max(view.camera.width, view.camera.height)
        for pixel, kept in [*((pixel, True) for pixel in hint.keep), *((pixel, False) for pixel in hint.drop)]:
            near = seen[np.linalg.norm(pixels - pixel, axis=1) < reach]
            own[near], table[near] = kept, not kept
    if not own.any():
        return prompt
    points = sparse.points[own]
    added = sparse.points[own & ~rows_among(sparse.points, prompt.points)]
    low, high = prompt.low, prompt.high
    if len(added):
        margin = _MARGIN * float((high - low).max()) / (1 + 2 * _MARGIN)
        low, high = np.minimum(low, added.min(0) - margin), np.maximum(high, added.max(0) + margin)
        low = np.array([low[0], low[1], prompt.low[2]])
    return replace(prompt, points=points, table=np.flatnonzero(table), low=low, high=high, nearer=0)


def rows_among(points: Array, chosen: Array) -> Array:
    """Which rows of `points` are among `chosen`. [N, 3], [K, 3] -> [N] bool."""
    wanted = {row.tobytes() for row in np.ascontiguousarray(chosen)}
    return np.array([row.tobytes() in wanted for row in np.ascontiguousarray(points)], bool)
