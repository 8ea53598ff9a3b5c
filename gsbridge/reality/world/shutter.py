"""When each row of a picture takes its light, while everything moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array

_SHORTEST, _BLUR, _SHEAR = 1e-3, 4e-3, 8e-3
"""Shortest exposure of a row, and how far apart moments are at most, of one exposure and of the whole picture, s: at half a
metre per second, half a metre before the camera, things move by less than a pixel of 64 in the latter. Every moment costs time:
bodies have to be moved in the scene."""


@dataclass(frozen=True)
class Moment:
    """A moment that some rows of a picture see.

    Args:
        before: How long before now, s.
        top, bottom: Rows that see it.
        weights: Share of each of these rows' light. [bottom - top].
    """

    before: float
    top: int
    bottom: int
    weights: Array


def moments(exposure: float, readout: float, rows: int) -> list[Moment]:
    """Moments of which a picture is the sum; the last row ends now.

    Args:
        exposure: How long a row takes light, s.
        readout: From the first row to the last, s.
        rows: Rows of the picture.
    """
    exposure = max(exposure, _SHORTEST)
    window = exposure + readout
    count = int(np.ceil(max(exposure / _BLUR, window / _SHEAR) - 1e-9))
    edges = np.linspace(-window, 0.0, count + 1)
    opens = -window + readout * (np.arange(rows) + 0.5) / rows
    out = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        share = np.clip(np.minimum(high, opens + exposure) - np.maximum(low, opens), 0.0, None) / exposure
        seen = np.flatnonzero(share > 0.0)
        if len(seen):
            top, bottom = int(seen[0]), int(seen[-1]) + 1
            out.append(Moment(-0.5 * (low + high), top, bottom, share[top:bottom]))
    return out
