"""A map of residuals by channel, phase of the motion and state, which shows at a glance where a difference occurs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from gsbridge.gap.diagnosis.residual_map import ResidualMap, few_false
from gsbridge.gap.formats.records import TOOL
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

REST = 0.05
"""Share of a joint's largest speed below which it counts as at rest."""

STEADY = 0.15
"""Share of a joint's largest acceleration below which its speed counts as steady."""

FEWEST = 8
"""Least number of samples in a cell; cells with fewer stay empty."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    "phase": ("at rest", "speeds up +", "speeds up −", "steady +", "steady −", "slows down +", "slows down −"),
    "speed": ("slow", "fast"),
    "position": ("low", "middle", "high"),
    "load": ("light", "heavy"),
}
"""Columns of the map, in groups. + and − are directions of the joint."""


def map_residuals(view: JointResiduals, residual: Array, outputs: Mapping[str, Array]) -> ResidualMap:
    """Map the residuals of a record onto the phases and states of its motion.

    Args:
        view: Residuals on the record.
        residual: Whitened residual. [T, C].
        outputs: Simulated motion without noise, SI units: `position`, `velocity`, `effort`. Each [T, N]; `tool` [T, 3] where
            measured.
    """
    names, time = tuple(view.record.label(kind, k) for kind, k in view.channels), view.record.time
    motion = [np.nan_to_num(outputs[kind]) for kind in ("position", "velocity", "effort")]
    cells = {False: [_cells(motion[0][:, k], motion[1][:, k], motion[2][:, k], time) for k in range(len(view.record.joints))]}
    if TOOL in outputs:
        # For the tool, use its own motion along each axis, and the sum of all motors' efforts as its load.
        load = np.abs(motion[2]).sum(axis=1)
        cells[True] = [_cells(q, np.gradient(q, time), load, time) for q in np.nan_to_num(outputs[TOOL]).T]
    count = sum(len(columns) for columns in GROUPS.values())
    values, chances = np.full((len(names), count), np.nan), np.ones((len(names), count))
    for row, (kind, k) in enumerate(view.channels):
        for column, inside in enumerate(cells[kind == TOOL][k]):
            number = int(inside.sum())
            if number >= FEWEST:
                total = float((residual[inside, row] ** 2).sum())
                values[row, column] = np.sqrt(total / number)
                chances[row, column] = stats.chi2.sf(total, number)
    return ResidualMap(names, values, few_false(chances, np.isfinite(values)), GROUPS)


def _cells(q: Array, v: Array, effort: Array, time: Array) -> list[Array]:
    """Find the samples of each column of the map, for one joint or axis.

    Args:
        q, v, effort: Positions, speeds and efforts, SI units. [T] each.
        time: Times, s. [T].

    Returns:
        Samples of each column, in the order of `GROUPS`. [T] bool each.
    """
    load, a = np.abs(effort), np.gradient(v, time)
    rest = np.abs(v) <= REST * max(np.abs(v).max(), 1e-12)
    even = ~rest & (np.abs(a) <= STEADY * np.quantile(np.abs(a), 0.99))
    faster, slower = ~rest & ~even & (a * v > 0), ~rest & ~even & (a * v <= 0)
    out = [rest]
    for phase in (faster, even, slower):
        out += [phase & (v > 0), phase & (v < 0)]
    middle = np.median(np.abs(v[~rest])) if (~rest).any() else np.inf
    out += [~rest & (np.abs(v) <= middle), ~rest & (np.abs(v) > middle)]
    low, high = q.min() + (q.max() - q.min()) * np.array([1 / 3, 2 / 3])
    out += [q <= low, (q > low) & (q <= high), q > high]
    half = np.median(load)
    return [*out, load <= half, load > half]
