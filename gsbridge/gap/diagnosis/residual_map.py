"""Map of where a difference shows: residuals by channel and by what happens (a phase, a kind of motion)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.geometry import Array

LEVEL = 0.01
"""False discovery rate: the share of marked cells that may be marked by chance."""


@dataclass(frozen=True)
class ResidualMap:
    """Root mean square residuals by channel and by what happens, in the unit of the comparison.

    Args:
        channels: Names of the rows.
        values: Residuals; not-a-number where too few samples fall into a cell. [channels, columns].
        marked: Cells that noise alone does not explain; an expected share of at most `LEVEL` by chance. [channels, columns].
        groups: Names of the columns, by group.
    """

    channels: tuple[str, ...]
    values: Array
    marked: Array
    groups: Mapping[str, tuple[str, ...]]

    def record(self) -> dict[str, Any]:
        """Return the map as it is stored in `comparison.json`."""
        return {
            "groups": {name: list(columns) for name, columns in self.groups.items()},
            "channels": list(self.channels),
            "values": self.values,
            "marked": self.marked.astype(bool),
        }


def few_false(chances: Array, counted: Array) -> Array:
    """Mark cells whose p-value is so small that at most a share `LEVEL` of the marked ones is expected to be false.

    Args:
        chances: P-value of each cell. [...].
        counted: Cells that contain enough data; the others are never marked. [...] bool.

    Returns:
        Marked cells. [...] bool.

    Source: Benjamini and Hochberg, Controlling the false discovery rate, 1995.
    """
    order = np.sort(chances[counted])
    passed = np.flatnonzero(order <= LEVEL * np.arange(1, len(order) + 1) / max(len(order), 1))
    bar = order[passed[-1]] if len(passed) else -1.0
    return counted & (chances <= bar)
