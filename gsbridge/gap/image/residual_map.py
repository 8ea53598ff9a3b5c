"""Map of where photos differ: residuals by colour, by place in the image, by brightness and by detail."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from gsbridge.gap.diagnosis.residual_map import ResidualMap, few_false
from gsbridge.gap.image.noise_model import slopes_of
from gsbridge.gap.image.residuals import ImageResiduals, shrunk
from gsbridge.geometry import Array

CHANNELS = ("red", "green", "blue")

FEWEST = 50
"""Smallest number of compared pixels in a cell of the map; cells with fewer stay empty."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    "across": ("left", "middle", "right"),
    "down": ("top", "centre", "bottom"),
    "brightness": ("dark", "medium", "bright"),
    "detail": ("flat", "edges"),
}
"""Columns of the map. Brightness and detail are those of the earlier photos, split at quantiles of the compared pixels."""


def map_pictures(view: ImageResiduals, table: Array) -> ResidualMap:
    """Map the root mean square residual by colour and by place, brightness and detail.

    Args:
        view: The views of a role.
        table: Residual, as from `ImageResiduals.residual`. [N * h + N, 3 * w].
    """
    pictures, kept = view.pictures(table).astype(np.float64), view.mask > 0
    before = shrunk(view.pairs.before, view.size)
    _, height, width = view.shape
    down, across = (np.minimum(3 * np.arange(count) // count, 2) for count in (height, width))
    grey, slope = before.mean(axis=-1), slopes_of(before.astype(np.float32))
    level = np.digitize(grey, np.quantile(grey[kept], (1 / 3, 2 / 3)) if kept.any() else (0.3, 0.6))
    edges = (slope > np.median(slope[kept]) if kept.any() else slope > 0).astype(int)
    kinds = [np.broadcast_to(across, view.shape), np.broadcast_to(down[:, None], view.shape), level, edges]
    cells = [kept & (kind == k) for kind, names in zip(kinds, GROUPS.values(), strict=True) for k in range(len(names))]
    values, chances = np.full((len(CHANNELS), len(cells)), np.nan), np.ones((len(CHANNELS), len(cells)))
    for column, inside in enumerate(cells):
        number = int(inside.sum())
        if number >= FEWEST:
            total = (pictures[inside] ** 2).sum(axis=0)
            values[:, column], chances[:, column] = np.sqrt(total / number), stats.chi2.sf(total, number)
    return ResidualMap(CHANNELS, values, few_false(chances, np.isfinite(values)), GROUPS)
