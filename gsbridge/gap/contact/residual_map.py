"""Map of where a difference shows: distances along a throw, across it and in height, by phase and kind of throw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from gsbridge.gap.contact.replay import PHASES, ThrowReplay, phase_numbers
from gsbridge.gap.contact.world import Flight
from gsbridge.gap.diagnosis.residual_map import ResidualMap, few_false
from gsbridge.geometry import Array

CHANNELS = ("along the throw", "across it", "height")
"""Axes of a throw: the horizontal direction in which it starts, the other one, and up."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    "phase": PHASES,
    "start speed": ("slow", "fast"),
    "start spin": ("little", "much"),
}
"""Columns of the map. Speed and spin are those of a throw's start, below or above the median of all throws."""

FEWEST = 4
"""Smallest number of throws in a cell; cells with fewer stay empty."""


def map_distances(replay: ThrowReplay, flights: Sequence[Flight], null: Array) -> ResidualMap:
    """Map the distances between replay and measurement.

    Args:
        replay: Throws.
        flights: Simulated throws, one per throw.
        null: Return values of `cells` for effect-free replicates, m. [K, M, channels, columns].

    Returns:
        Root mean square distances, mm; cells are marked if they exceed those of the replicates by more than chance.
    """
    found = cells(replay, [measured - flight.position for flight, measured in zip(flights, replay.measured, strict=True)])
    counts = np.isfinite(found).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.where(counts >= FEWEST, 1e3 * np.sqrt(np.nansum(found**2, axis=0) / counts), np.nan)
    chances = np.ones(values.shape)
    for row, column in np.argwhere(np.isfinite(values)):
        seen, expected = found[:, row, column], null[..., row, column].ravel()
        seen, expected = seen[np.isfinite(seen)], expected[np.isfinite(expected)]
        if len(expected) >= FEWEST:
            chances[row, column] = stats.mannwhitneyu(seen, expected, alternative="greater").pvalue
    return ResidualMap(CHANNELS, values, few_false(chances, np.isfinite(values)), GROUPS)


def cells(replay: ThrowReplay, differences: Sequence[Array]) -> Array:
    """Return the root mean square difference of each throw in each cell.

    Args:
        replay: The throws that the differences belong to.
        differences: Differences of position, log's frame, m. Each [T, 3].

    Returns:
        Root mean squares, m; not-a-number if a throw has no sample in a cell. [throws, channels, columns].
    """
    starts = replay.starts
    speed, spin = np.linalg.norm(starts.velocity, axis=1), np.linalg.norm(starts.spin, axis=1)
    out = np.full((len(differences), len(CHANNELS), sum(len(names) for names in GROUPS.values())), np.nan)
    for number, (difference, phases) in enumerate(zip(along(replay, differences), phase_numbers(replay), strict=True)):
        fast, much = speed[number] > np.median(speed), spin[number] > np.median(spin)
        whole = np.ones(len(difference), dtype=bool)
        inside = [phases == place for place in range(len(PHASES))] + [whole & ~fast, whole & fast, whole & ~much, whole & much]
        for column, rows in enumerate(inside):
            if rows.any():
                out[number, :, column] = np.sqrt((difference[rows] ** 2).mean(axis=0))
    return out


def along(replay: ThrowReplay, differences: Sequence[Array]) -> list[Array]:
    """Turn differences from the log's frame into the axes of each throw, in the order of `CHANNELS`. Each [T, 3]."""
    velocity = replay.starts.velocity
    level = np.hypot(velocity[:, 0], velocity[:, 1])
    # A throw straight up or down has no direction of its own.
    ahead = np.where(level > 1e-6, np.arctan2(velocity[:, 1], velocity[:, 0]), 0.0)
    out = []
    for angle, difference in zip(ahead, differences, strict=True):
        c, s = np.cos(angle), np.sin(angle)
        out.append(difference @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    return out
