"""The light over a table: the share from each direction, fitted to the shadow that an object casts in its own film."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls

from gsbridge.errors import InputError
from gsbridge.geometry import Array

RINGS = ((90.0, 1), (68.0, 6), (45.0, 10), (25.0, 12))
"""Elevation of each ring of the sky's parts, degrees, and the number of parts in the ring; parts are some 25 degrees apart."""

WIDTH = 0.09
"""Half angle of each part's source, rad. It is smaller than the angle between parts, because a lamp is smaller than a part; a
wider light takes up several parts."""

_EVEN = 0.02
"""Weight of a ridge penalty on each share, relative to the root mean square residual of the places. The penalty spreads the
light evenly over parts that no shadow tells apart."""

_WHOLE = 3.0
"""Weight, on the same scale, of the condition that the shares add up to 1: an unshaded table looks as it was filmed."""

_ROUNDS = 5


def directions() -> Array:
    """Unit vectors towards the sky's parts, table frame. [M, 3]."""
    out = []
    for elevation, count in RINGS:
        height = np.radians(elevation)
        # The middle ring is turned by half a step against its neighbours.
        for k in range(count):
            heading = 2 * np.pi * (k + 0.5 * (count == 10)) / count
            out.append([np.cos(height) * np.cos(heading), np.cos(height) * np.sin(heading), np.sin(height)])
    return np.array(out)


@dataclass(frozen=True)
class SkyLight:
    """Light on a level surface.

    Args:
        floor: Share that no body blocks: light that walls, table and bodies reflect.
        shares: Share of each of `directions()`. [M]; with `floor` they add up to 1.
    """

    floor: float
    shares: Array

    def record(self) -> dict[str, Any]:
        """Plain mapping for a JSON file."""
        return {"floor": float(self.floor), "shares": [float(share) for share in self.shares]}

    @classmethod
    def of(cls, content: Mapping[str, Any], source: str) -> SkyLight:
        """Inverse of `record`.

        Raises:
            InputError: The mapping is damaged; `source` names its file.
        """
        try:
            light = cls(float(content["floor"]), np.array(content["shares"], dtype=np.float64))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(source, f"the light is damaged ({error!r})", "Delete it and calibrate again") from error
        every = np.append(light.shares, light.floor)
        whole = np.isfinite(every).all() and (every >= 0).all() and abs(every.sum() - 1.0) < 1e-3
        if light.shares.shape != (len(directions()),) or not whole:
            raise InputError(
                source, "the shares of the light are not those of the sky's parts", "Delete it and calibrate again"
            )
        return light


def fit_light(transmitted: Array, ratios: Array) -> tuple[SkyLight, float]:
    """Fit the light under which places are as bright as they were seen.

    Args:
        transmitted: Share of each direction's light that reaches each place (`gsbridge.scene.occlusion`). [N, M].
        ratios: Brightness of each place with the body there, relative to without, linear. [N].

    Returns:
        The light, and the scatter of the residuals of `ratios` (1.48 median absolute deviations).

    Raises:
        InputError: There are fewer places than directions.
    """
    parts = transmitted.shape[1] + 1
    if len(ratios) < 10 * parts:
        raise InputError("light", f"only {len(ratios)} places show the table round the object", "Film it from more sides")
    places, pull = np.sqrt(len(ratios)), np.zeros((parts, parts))
    np.fill_diagonal(pull, _EVEN)
    columns = np.concatenate([np.ones((len(ratios), 1)), transmitted], axis=1).astype(np.float64)
    weights, shares, scatter = np.ones(len(ratios)), np.zeros(parts), 0.0
    for _ in range(_ROUNDS):
        rows = np.concatenate([columns * weights[:, None], places * pull, np.full((1, parts), places * _WHOLE)])
        shares = nnls(rows, np.concatenate([ratios * weights, np.zeros(parts), [places * _WHOLE]]))[0]
        left = ratios - columns @ shares
        scatter = float(1.48 * np.median(np.abs(left - np.median(left))))
        # Cauchy weights, because glints and edges of the table's pattern say nothing about the light.
        weights = 1.0 / np.sqrt(1.0 + (left / max(2.0 * scatter, 1e-6)) ** 2)
    shares /= shares.sum()
    return SkyLight(float(shares[0]), shares[1:]), scatter
