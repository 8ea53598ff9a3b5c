"""The success tables for print: counts with intervals, simulation beside the other worlds, the paper's values beside ours."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence

from gsbridge.configuration.renderers import TITLES
from gsbridge.report.tables.counts import Count, change, overviews, p_of_change, pose_sets_in, read_counts, worlds_in
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.paper import PAPER_GRASPS, PAPER_POSE_SETS, PAPER_SCENARIOS, PAPER_SUCCESS, PAPER_SUCCESS_NOTE
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row
from gsbridge.report.tables.statistics import (
    mean_relative_drop,
    relative_change,
)
from gsbridge.report.tables.success_rows import ROBOT, STRICT_WORLD, cell_in, cells_in


def standard_cells(rows: Sequence[Row], task: str, renderer: str = "gs") -> list[CellPaths]:
    """Cells of a task that were trained the paper's way on one renderer's pictures, in the rows' order.

    Args:
        rows: Rows of a table of success.
        task, renderer: Name of the task, and renderer of the pictures that the policies learned from.
    """
    cells = dict.fromkeys(map(cell_in, rows))
    return [cell for cell in cells if (cell.task, cell.renderer, cell.variant) == (task, renderer, "default")]


def paper_mean(cells: Sequence[CellPaths], world: str) -> float | None:
    """Mean of the paper's success rates over cells, 0..1; None unless the paper has all of them."""
    known = [PAPER_SUCCESS[cell].rate(world) for cell in cells if cell in PAPER_SUCCESS]
    return statistics.fmean(known) if known and len(known) == len(cells) else None


def paper_change(cell: CellPaths) -> float | None:
    """The paper's relative change of a cell from its simulation to its robot; None where it has not tried the cell."""
    paper = PAPER_SUCCESS.get(cell)
    return None if paper is None else relative_change(paper.rate(STRICT_WORLD), paper.rate(ROBOT))


def paper_drop(cells: Sequence[CellPaths] = PAPER_SCENARIOS) -> float | None:
    """The paper's mean relative drop over cells; None unless the paper has all of them."""
    return mean_relative_drop([paper_change(cell) for cell in cells])


DASH = "–"
MIRROR = "mirror"
POSE_TITLES = {
    "fixed": "fixed start poses",
    "unseen": "unseen start poses",
    "outside": "start poses outside the training square",
}

COUNT_NOTE = (
    "Successes / trials, success rate, and its 95 % interval: Wilson's for one training; for several, whose trials count "
    "together, the widest of a hierarchical bootstrap's over trainings, then starts, Student's of their rates, and Wilson's."
)
CHANGE_NOTE = (
    "Change: (mirror − sim) / sim, the paper's relative change. p: Fisher's exact test that both worlds have the same success "
    "rate, two-sided."
)
MEAN_NOTE = (
    "Interval: 95 %, the widest of a bootstrap's over trainings and starts, Student's, and Wilson's. Drop: mean of the cells' "
    "relative drops from simulation, a gain counting against it. r: Pearson's correlation of the cells' rates with those in "
    "simulation; MMRV: mean maximum rank violation (SIMPLER), 0 is best. Both say little where all rates are high."
)


def percent(share: float | None, digits: int = 1, *, signed: bool = False) -> str:
    """Format a share in percent with a true minus sign; None becomes a dash.

    Args:
        share: 1 is 100 %; negative for a drop; None for no value.
        digits: Digits behind the point.
        signed: Whether a positive share gets a plus sign.
    """
    if share is None:
        return DASH
    # Shares of 32 trials often end in 5. Halves are rounded away from zero, as by hand, and not to the even digit.
    size = math.floor(abs(100 * share) * 10**digits + 0.5 + 1e-9) / 10**digits
    sign = "" if size == 0 else "−" if share < 0 else "+" if signed else ""
    return f"{sign}{size:.{digits}f} %"


def counted(count: Count | None) -> str:
    """Format a count with its rate and interval, such as `31/32 96.9 % [84 … 99]`; None becomes a dash."""
    if count is None:
        return DASH
    low, high = count.interval
    rate = percent(count.rate).replace("100.0", "100")
    return f"{count.successes}/{count.trials} {rate} [{100 * low:.0f} … {100 * high:.0f}]"


def p_text(value: float | None) -> str:
    """Format a p-value with two decimals, or more where it is small; None becomes a dash."""
    if value is None:
        return DASH
    return f"{value:.2f}" if value >= 0.095 else f"{value:.3f}" if value >= 0.001 else f"{value:.0e}"


def cell_title(cell: CellPaths) -> str:
    """Name a cell, such as `cake on foam pad`, with its variant unless that is the paper's."""
    text = f"{cell.object} on {cell.background}".replace("_", " ")
    return text if cell.variant == "default" else f"{text} ({cell.variant})"


def success_table(
    rows: Sequence[Row], pose_set: str, *, title: str, other: str = MIRROR, renderers: bool = False
) -> Table | None:
    """Cells in simulation and in another world, from one set of start poses; None without rows.

    Args:
        rows: Rows of a success table.
        pose_set: Name of the set.
        title: Caption.
        other: The other world; unless it is the mirror, only cells that were tried there are shown.
        renderers: Add a column that says what drew the pictures of each cell's training.
    """
    mine = [row for row in rows if row["pose_set"] == pose_set and row["world"] in (STRICT_WORLD, other)]
    counts = read_counts(mine)
    cells = [cell for cell in cells_in(mine) if other == MIRROR or (cell, other, pose_set) in counts]
    if not cells:
        return None
    compared = any(world == other for _, world, _ in counts)
    worlds = (STRICT_WORLD, other) if compared else (STRICT_WORLD,)
    paper = pose_set in PAPER_POSE_SETS and any(cell in PAPER_SUCCESS for cell in cells)
    several = any(count.seeds > 1 for count in counts.values())
    status = _status(mine)
    columns = ["cell", *(["trained on"] if renderers else []), *worlds, *(["change", "p"] if compared else [])]
    columns += [*(["paper's sim → robot", "paper's change"] if paper else []), *(["seeds"] if several else []), "status"]
    body = []
    for cell in cells:
        line = [cell_title(cell), *([TITLES.get(cell.renderer, cell.renderer)] if renderers else [])]
        line += [counted(counts.get((cell, world, pose_set))) for world in worlds]
        if compared:
            line.append(percent(change(counts, cell, other, pose_set), signed=True))
            line.append(p_text(p_of_change(counts, cell, other, pose_set)))
        if paper:
            known = PAPER_SUCCESS.get(cell)
            rates = f"{percent(known.rate(STRICT_WORLD))} → {percent(known.rate(ROBOT))}" if known else DASH
            line += [rates.replace(" % →", " →"), percent(paper_change(cell), signed=True)]
        if several:
            seeds = sorted({count.seeds for (owner, _, _), count in counts.items() if owner == cell})
            line.append("–".join(map(str, dict.fromkeys((seeds[0], seeds[-1])))))
        body.append((*line, status[cell]))
    return Table(title, tuple(columns), tuple(body), status=tuple(status[cell] for cell in cells))


def _status(rows: Sequence[Row]) -> dict[CellPaths, str]:
    """Worst status of each cell's rows."""
    out: dict[CellPaths, str] = {}
    for row in rows:
        cell = cell_in(row)
        out[cell] = "degraded" if "degraded" in (row["status"], out.get(cell)) else row["status"]
    return out


def summary_table(rows: Sequence[Row], task: str, *, title: str) -> Table | None:
    """Means over the cells of a task; None for fewer than two cells.

    Args:
        rows: Rows of a success table; only policies trained on splats in the paper's way count.
        task: Task whose cells count.
        title: Caption.
    """
    cells, counts = standard_cells(rows, task), read_counts(rows)
    if len(cells) < 2:
        return None
    columns: tuple[str, ...] = ("start poses", "world", "cells", "mean success", "of all trials", "paper's mean")
    columns += ("drop, all cells", "drop, the paper's six", "r", "MMRV")
    body = []
    for view in overviews(counts, cells):
        drop, _ = view.drop()
        six, count = view.drop(PAPER_SCENARIOS)
        complete = count == len(PAPER_SCENARIOS)
        low, high = view.interval
        body.append(
            (
                view.pose_set,
                view.world,
                str(len(view.rates)),
                f"{percent(view.mean)} [{100 * low:.1f} … {100 * high:.1f}]",
                f"{view.total.successes}/{view.total.trials}",
                percent(paper_mean(list(view.rates), view.world) if view.pose_set in PAPER_POSE_SETS else None),
                percent(drop),
                percent(six) if complete or six is None else f"{percent(six)} ({count} of {len(PAPER_SCENARIOS)})",
                DASH if view.correlation is None else f"{view.correlation:.2f}".replace("-", "−"),
                DASH if view.violation is None else f"{view.violation:.3f}",
            )
        )
    paper = f"The paper's mean drop: {percent(paper_drop())} over its six scenario cells"
    paper += f", {percent(paper_drop(PAPER_GRASPS))} over all eight."
    known = any(cell in PAPER_SUCCESS for cell in cells)
    return Table(title, columns, tuple(body), (MEAN_NOTE, *([paper] if known else [])))


def mirrors_table(rows: Sequence[Row], *, title: str) -> Table | None:
    """The same policies in all mirrors, each with its own shape, light and physics; None for fewer than two mirrors."""
    counts = read_counts(rows)
    worlds = [world for world in worlds_in(counts) if world.split("_")[0] == MIRROR]
    if len(worlds) < 2:
        return None
    body = []
    for cell in cells_in(rows):
        for pose_set in pose_sets_in(counts):
            found = [counts.get((cell, world, pose_set)) for world in (STRICT_WORLD, *worlds)]
            if any(found[1:]):
                name = cell_title(cell) if cell.renderer == "gs" else f"{cell_title(cell)}, {cell.renderer}"
                body.append((name, pose_set, *map(counted, found)))
    return Table(title, ("cell", "start poses", STRICT_WORLD, *worlds), tuple(body))


def success_tables(named: Mapping[str, Sequence[Row]]) -> dict[str, list[Table]]:
    """Make all printed tables, by the name of their rows.

    Args:
        named: Rows of `grasping`, `renderer_contrast` and `pick_and_place`, or some of them.
    """
    out: dict[str, list[Table]] = {}
    for name, rows in named.items():
        renderers = name == "renderer_contrast"
        head = {
            "grasping": "Grasping",
            "renderer_contrast": "Trained on splats or on a mesh",
            "pick_and_place": "Pick and place",
        }[name]
        task = "pick_and_place" if name == "pick_and_place" else "grasp"
        found = [
            summary_table(rows, task, title=f"{head}: means over the cells") if name == "grasping" else None,
            *(
                success_table(rows, pose_set, title=f"{head}, {POSE_TITLES[pose_set]}", renderers=renderers)
                for pose_set in POSE_TITLES
            ),
            mirrors_table(rows, title=f"{head}: the same policies in further mirrors"),
            *(
                success_table(rows, pose_set, title=f"{head} on the robot, {words}", other=ROBOT, renderers=renderers)
                for pose_set, words in POSE_TITLES.items()
            ),
        ]
        tables = [table for table in found if table is not None]
        out[name] = [_noted(table, index, tables, name, rows) for index, table in enumerate(tables)]
    return out


def _noted(table: Table, index: int, tables: Sequence[Table], name: str, rows: Sequence[Row]) -> Table:
    """Add the notes that hold for all tables to the last one; return any other table unchanged."""
    if index < len(tables) - 1:
        return table
    notes = [COUNT_NOTE, CHANGE_NOTE]
    if name == "pick_and_place":
        notes.append(_contact_note(rows))
    if any(row["paper_success_rate"] for row in rows):
        notes.append(PAPER_SUCCESS_NOTE)
    return Table(table.title, table.columns, table.rows, (*table.notes, *notes), table.best, table.status)


def _contact_note(rows: Sequence[Row]) -> str:
    """State how many successes depend on the rule about excess contact."""
    parts = [
        f"{row['world']} {row['pose_set']} {row['successes_strict']} and {row['successes_tolerant']} of {row['trials']}"
        for row in rows
        if row["successes_strict"] != row["successes_tolerant"]
    ]
    text = "Excess contact while placing is a failure in simulation only, as in the paper."
    if not parts:
        return f"{text} No trial hangs on it."
    return f"{text} Successes with the rule and without it: {'; '.join(parts)}."
