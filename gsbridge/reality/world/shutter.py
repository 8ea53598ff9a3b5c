"""Rolling shutter and exposure time: which moments each row of a picture sees while the scene moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array

_SHORTEST, _BLUR, _SHEAR = 1e-3, 4e-3, 8e-3
"""Shortest exposure of a row, and largest spacing of the moments within one row's exposure and within the whole picture, s. At
0.5 m/s and 0.5 m from the camera, a body moves by less than a pixel of a 64 px picture within the last of these times. More
moments would cost time, because each moves the bodies in the scene."""


@dataclass(frozen=True)
class Moment:
    """A moment that some rows of a picture see.

    Args:
        before: Time before now, s.
        top, bottom: First row that sees the moment, and the row after the last.
        weights: Share of each row's light that comes from this moment. [bottom - top].
    """

    before: float
    top: int
    bottom: int
    weights: Array


def moments(exposure: float, readout: float, rows: int) -> list[Moment]:
    """Return the moments whose weighted sum is a picture; the exposure of the last row ends now.

    Args:
        exposure: Exposure time of a row, s.
        readout: Time from the first row to the last, s.
        rows: Number of rows of the picture.
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
