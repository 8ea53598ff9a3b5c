"""What the success tables come to: means over cells, drops from simulation to another world, and how well one foretells it."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gsbridge.report.tables.paper import PAPER_SCENARIOS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import Cell
from gsbridge.report.tables.rows import Row
from gsbridge.report.tables.statistics import (
    fisher_p,
    mean_maximum_rank_violation,
    mean_relative_drop,
    pearson,
    relative_change,
    wilson_interval,
)
from gsbridge.report.tables.success_rows import ROBOT, cell_in
from gsbridge.report.tables.trials import STRICT_WORLD
from gsbridge.tasks.poses import POSE_SETS


@dataclass(frozen=True)
class Count:
    """Successes of a cell, world and set of poses; a rate is a share, 0..1."""

    successes: int
    trials: int
    seeds: int = 1

    @property
    def rate(self) -> float:
        """Success rate."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the rate."""
        return wilson_interval(self.successes, self.trials)


Counts = dict[tuple[Cell, str, str], Count]
"""By cell, world and set of poses."""


def read_counts(rows: Sequence[Row]) -> Counts:
    """Counts of the rows of success tables; a row that stands in two tables counts once."""
    return {
        (cell_in(row), row["world"], row["pose_set"]): Count(int(row["successes"]), int(row["trials"]), int(row["seeds"]))
        for row in rows
    }


def worlds_in(counts: Counts) -> list[str]:
    """Worlds of the counts: simulation, mirrors, robot."""
    return sorted({world for _, world, _ in counts}, key=lambda world: (world != STRICT_WORLD, world == ROBOT, world))


def pose_sets_in(counts: Counts) -> list[str]:
    """Sets of start poses of the counts."""
    found = {pose_set for _, _, pose_set in counts}
    return [pose_set for pose_set in POSE_SETS if pose_set in found]


def change(counts: Counts, cell: Cell, world: str, pose_set: str) -> float | None:
    """Relative change of a cell from simulation to another world; None where it is not known."""
    sim, real = counts.get((cell, STRICT_WORLD, pose_set)), counts.get((cell, world, pose_set))
    return None if sim is None or real is None else relative_change(sim.rate, real.rate)


def p_of_change(counts: Counts, cell: Cell, world: str, pose_set: str) -> float | None:
    """Fisher's p of the same; None where it is not known."""
    sim, real = counts.get((cell, STRICT_WORLD, pose_set)), counts.get((cell, world, pose_set))
    if sim is None or real is None:
        return None
    return fisher_p(sim.successes, sim.trials, real.successes, real.trials)


@dataclass(frozen=True)
class Overview:
    """Cells together in one world and set of poses.

    Args:
        world, pose_set: Which.
        rates: Success rate of each cell, 0..1.
        total: Trials of all cells together.
        changes: Relative change from simulation of each cell that has one; empty for simulation itself.
        correlation: Pearson's r of the cells' rates in simulation and in this world; None where it is not defined.
        violation: MMRV likewise, as a share of success.
    """

    world: str
    pose_set: str
    rates: Mapping[Cell, float]
    total: Count
    changes: Mapping[Cell, float]
    correlation: float | None
    violation: float | None

    @property
    def mean(self) -> float:
        """Mean success over the cells, each counting the same."""
        return statistics.fmean(self.rates.values())

    def drop(self, cells: Sequence[Cell] | None = None) -> tuple[float | None, int]:
        """Mean relative drop over cells (None: all), and the number of those that it is taken over."""
        found = [value for cell, value in self.changes.items() if cells is None or cell in cells]
        return mean_relative_drop(found), len(found)


def overviews(counts: Counts, cells: Sequence[Cell]) -> list[Overview]:
    """One overview per set of poses and world, over those of the cells that were tried there."""
    out = []
    for pose_set in pose_sets_in(counts):
        for world in worlds_in(counts):
            found = {cell: counts[cell, world, pose_set] for cell in cells if (cell, world, pose_set) in counts}
            if not found:
                continue
            sim = {cell: counts[cell, STRICT_WORLD, pose_set] for cell in found if (cell, STRICT_WORLD, pose_set) in counts}
            compared = [] if world == STRICT_WORLD else list(sim)
            pairs = [sim[cell].rate for cell in compared], [found[cell].rate for cell in compared]
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
                    changes={cell: value for cell, value in changes.items() if value is not None},
                    correlation=pearson(*pairs),
                    violation=mean_maximum_rank_violation(*pairs) if compared else None,
                )
            )
    return out


def standard_cells(rows: Sequence[Row], task: str, renderer: str = "gs") -> list[Cell]:
    """Cells of a task that were trained the paper's way on one renderer's pictures, in the rows' order."""
    cells = dict.fromkeys(map(cell_in, rows))
    return [cell for cell in cells if (cell.task, cell.renderer, cell.variant) == (task, renderer, "default")]


def paper_mean(cells: Sequence[Cell], world: str) -> float | None:
    """Mean of the paper's success rates over cells, if it has them all; 0..1."""
    known = [PAPER_SUCCESS[cell].rate(world) for cell in cells if cell in PAPER_SUCCESS]
    return statistics.fmean(known) if known and len(known) == len(cells) else None


def paper_change(cell: Cell) -> float | None:
    """The paper's relative change of a cell, from its simulation to its robot."""
    paper = PAPER_SUCCESS.get(cell)
    return paper and relative_change(paper.rate(STRICT_WORLD), paper.rate(ROBOT))


def paper_drop(cells: Sequence[Cell] = PAPER_SCENARIOS) -> float | None:
    """The paper's mean relative drop over cells, if it has them all."""
    return mean_relative_drop([paper_change(cell) for cell in cells])
