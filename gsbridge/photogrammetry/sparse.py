"""The sparse model of a scene in the table frame, which the align stage writes for later stages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array


@dataclass(frozen=True)
class SparsePoints:
    """Sparse model of a scene in the table frame.

    Args:
        points: Positions of the points. [N, 3].
        view_index, point_index: One pair per observation: which view saw which point. [M] each.
    """

    points: Array
    view_index: Array
    point_index: Array

    def seen_by(self, view: int) -> Array:
        """Indices of the points that a view observes."""
        return self.point_index[self.view_index == view]


def read_points(path: str | Path) -> SparsePoints:
    """Read `points.npz` of the align stage.

    Raises:
        InputError: The file is missing or damaged.
    """
    if not Path(path).is_file():
        raise InputError(path, "the sparse points do not exist", "Run the align stage")
    try:
        with np.load(path) as content:
            out = SparsePoints(
                content["points"].astype(np.float64), content["view_index"].astype(int), content["point_index"].astype(int)
            )
    except Exception as error:  # a damaged archive raises many kinds (zip, pickle, key, value); the user needs one line
        raise InputError(path, f"the file is damaged ({error})", "Delete it and run the align stage again") from error
    consistent = out.points.ndim == 2 and out.points.shape[1] == 3 and out.view_index.shape == out.point_index.shape
    if not consistent or (len(out.point_index) and out.point_index.max() >= len(out.points)):
        raise InputError(path, "points and observations do not fit together", "Delete it and run the align stage again")
    return out
