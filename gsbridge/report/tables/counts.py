"""Successes and trials of cells, read from the rows of success tables, and summaries over many cells."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row
from gsbridge.report.tables.statistics import (
    fisher_p,
    mean_interval,
    mean_maximum_rank_violation,
    mean_relative_drop,
    pearson,
    relative_change,
)
from gsbridge.report.tables.success_rows import ROBOT, STRICT_WORLD, cell_in, tallies_in
from gsbridge.statistics import Tally
from gsbridge.tasks.poses import POSE_SETS


@dataclass(frozen=True)
class Count:
    """Trials and successes of one cell in one world from one set of start poses; rates are shares, 0..1.

    Args:
        successes, trials, seeds: The columns of these names in the rows.
        tallies: Successes and trials of each training; empty where they are not known one by one.
        sim: Successes and trials in simulation from the same start poses; None where there are none.
    """

    successes: int
    trials: int
    seeds: int = 1
    tallies: tuple[Tally, ...] = ()
    sim: Tally | None = None

    @property
    def rate(self) -> float:
        """Success rate."""
        return self.successes / self.trials

    @property
    def each(self) -> tuple[Tally, ...]:
        """Successes and trials of each training; one pair for all trials where `tallies` is empty."""
        return self.tallies or ((self.successes, self.trials),)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the rate, see `mean_interval`."""
        return mean_interval([self.each])


Counts = dict[tuple[CellPaths, str, str], Count]
"""Trials and successes by cell, world and set of start poses."""


def read_counts(rows: Sequence[Row]) -> Counts:
    """Read the counts from rows of success tables; a row that appears in two tables counts once."""
    return {
        (cell_in(row), row["world"], row["pose_set"]): Count(
            int(row["successes"]),
            int(row["trials"]),
            int(row["seeds"]),
            tallies_in(row["by_training"]),
            (int(row["sim_successes"]), int(row["sim_trials"])) if row["sim_trials"] else None,
        )
        for row in rows
    }


def worlds_in(counts: Counts) -> list[str]:
    """List the worlds of the counts in the order simulation, mirrors, robot."""
    return sorted({world for _, world, _ in counts}, key=lambda world: (world != STRICT_WORLD, world == ROBOT, world))


def pose_sets_in(counts: Counts) -> list[str]:
    """List the sets of start poses of the counts, in the order of `POSE_SETS`."""
    found = {pose_set for _, _, pose_set in counts}
    return [pose_set for pose_set in POSE_SETS if pose_set in found]


def change(counts: Counts, cell: CellPaths, world: str, pose_set: str) -> float | None:
    """Relative change of a cell from simulation to another world; None where it is not known.

    Args:
        counts: Trials and successes.
        cell, world, pose_set: The cell, the other world, and the set of start poses.
    """
    real = counts.get((cell, world, pose_set))
    return None if real is None or real.sim is None else relative_change(real.sim[0] / real.sim[1], real.rate)


def p_of_change(counts: Counts, cell: CellPaths, world: str, pose_set: str) -> float | None:
    """Fisher's p of the change of a cell from simulation to another world; None where it is not known.

    Args:
        counts, cell, world, pose_set: See `change`.
    """
    real = counts.get((cell, world, pose_set))
    return None if real is None or real.sim is None else fisher_p(*real.sim, real.successes, real.trials)


@dataclass(frozen=True)
class Overview:
    """Summary over cells in one world, from one set of start poses.

    Args:
        world, pose_set: The world and the set of start poses.
        rates: Success rate of each cell, 0..1.
        total: Trials of all cells together.
        interval: 95 % interval of the mean, see `mean_interval`.
        changes: Relative change from simulation of each cell that has one; empty for simulation itself.
        correlation: Pearson's r of the cells' rates in simulation and in this world; None where it is not defined.
        violation: Mean maximum rank violation (MMRV) of the same rates, a share of success; None where no cell is compared.
    """

    world: str
    pose_set: str
    rates: Mapping[CellPaths, float]
    total: Count
    interval: tuple[float, float]
    changes: Mapping[CellPaths, float]
    correlation: float | None
    violation: float | None

    @property
    def mean(self) -> float:
        """Mean success over the cells, each counting the same."""
        return statistics.fmean(self.rates.values())

    def drop(self, cells: Sequence[CellPaths] | None = None) -> tuple[float | None, int]:
        """Mean relative drop over `cells` (all cells if None), and the number of cells in that mean."""
        found = [value for cell, value in self.changes.items() if cells is None or cell in cells]
        return mean_relative_drop(found), len(found)


def overviews(counts: Counts, cells: Sequence[CellPaths]) -> list[Overview]:
    """Make one overview per set of poses and world, over those of `cells` that were tried there."""
    out = []
    for pose_set in pose_sets_in(counts):
        for world in worlds_in(counts):
            found = {cell: counts[cell, world, pose_set] for cell in cells if (cell, world, pose_set) in counts}
            if not found:
                continue
            sim = {cell: good / tried for cell, count in found.items() if count.sim for good, tried in [count.sim]}
            compared = [] if world == STRICT_WORLD else list(sim)
            pairs = [sim[cell] for cell in compared], [found[cell].rate for cell in compared]
            changes = {cell: change(counts, cell, world, pose_set) for cell in compared}
            total = Count(
                sum(count.successes for count in found.values()),
                sum(count.trials for count in found.values()),
                min(count.seeds for count in found.values()),
            )
            out.append(
                Overview(
                    world=world,
                    pose_set=pose_set,
                    rates={cell: count.rate for cell, count in found.items()},
                    total=total,
                    interval=mean_interval([count.each for count in found.values()]),
                    changes={cell: value for cell, value in changes.items() if value is not None},
                    correlation=pearson(*pairs),
                    violation=mean_maximum_rank_violation(*pairs) if compared else None,
                )
            )
    return out
