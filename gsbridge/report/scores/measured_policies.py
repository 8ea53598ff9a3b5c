"""Figures of the areas `policies`, `worlds`, `study` and `loops`, gathered from rows under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet. `cells` is the
number of cells behind a figure, `trials` the fewest trials per training of any cell, in one world and set of start poses.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.figures.loop import COLUMNS as LOOP_COLUMNS
from gsbridge.report.figures.study import COLUMNS as STUDY_COLUMNS
from gsbridge.report.figures.study import EXACT, rivals
from gsbridge.report.scores.score import Figure, over_scenes, single, success_rate, write_measured
from gsbridge.report.tables import success_rows as success_table
from gsbridge.report.tables import training as training_table
from gsbridge.report.tables.counts import Counts, Overview, overviews, read_counts
from gsbridge.report.tables.paper import PAPER_GRASPS, PAPER_SCENARIOS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.report.tables.statistics import interval_kind
from gsbridge.report.tables.success import standard_cells
from gsbridge.report.tables.success_rows import STRICT_WORLD, cell_in

GRASPING = "results/rows/grasping.csv"
CONTRAST = "results/rows/renderer_contrast.csv"
PLACING = "results/rows/pick_and_place.csv"
TRAINING = "results/rows/training.csv"
WORLDS = "results/rows/worlds.csv"
TOY = "toy/results/rows/grasping.csv"
WALL_TIMES = "results/benchmarks/wall_times.json"

PLACES = tuple(cell for cell in PAPER_SUCCESS if cell.task == "pick_and_place")
MESHES = tuple(cell for cell in PAPER_SUCCESS if cell.renderer == "mesh")
CORES = 2
"""Largest number of cores on which a wall time counts."""


def _name(cell: CellPaths) -> str:
    return f"{cell.object}+{cell.background}"


def mean_figure(view: Overview, counts: Counts, where: str) -> Figure:
    """Mean success of cells in one world and set of start poses, percent.

    Args:
        view: The cells' rates in that world and set.
        counts: Trials and successes of each cell.
        where: File that the figure comes from.
    """
    low, high = view.interval
    figure = over_scenes({_name(cell): 100 * rate for cell, rate in view.rates.items()}, statistics.fmean, where)
    kind = interval_kind([counts[cell, view.world, view.pose_set].each for cell in view.rates])
    interval = {"interval": [100 * low, 100 * high], "interval_of": kind}
    return {**figure, **interval, **_counted(list(view.rates), counts, view)}


def drop_figure(view: Overview, counts: Counts, cells: Sequence[CellPaths], where: str) -> Figure | None:
    """Mean relative drop of cells from simulation to a world, percent; None where no cell has one.

    Args:
        view: The cells' changes in that world and set of start poses.
        counts: Trials and successes of each cell.
        cells: Cells to take the mean over.
        where: File that the figure comes from.
    """
    found = {cell: value for cell, value in view.changes.items() if cell in cells}
    if not found:
        return None
    drops = {_name(cell): -100 * value for cell, value in found.items()}
    return {**over_scenes(drops, statistics.fmean, where), **_counted(list(found), counts, view)}


def _counted(cells: Sequence[CellPaths], counts: Counts, view: Overview) -> dict[str, int]:
    """Count the cells, trials per training and seeds behind a figure."""
    found = [counts[cell, view.world, view.pose_set] for cell in cells]
    sim = [counts[cell, STRICT_WORLD, view.pose_set] for cell in cells if (cell, STRICT_WORLD, view.pose_set) in counts]
    seeds = min(count.seeds for count in found)
    trials = min(count.trials // count.seeds for count in [*found, *sim])
    return {"cells": len(cells), "trials": trials, "seeds": seeds}


def success_figures(grasping: Sequence[Row], contrast: Sequence[Row], placing: Sequence[Row]) -> dict[str, Figure]:
    """Make the figures of the success tables.

    Args:
        grasping: Rows of the table of grasps.
        contrast: Rows of the table of renderers compared.
        placing: Rows of the table of pick and place.

    Returns:
        `grasp_{world}_{poses}` and `place_{world}_{poses}`, mean success of the paper's cells; outside simulation also
        `drop_six_…` and `drop_eight_…`, mean relative drops over its six scenario cells and over all eight, and
        `rl_sim_drop_…`, the same of policies trained on a mesh. Percent.
    """
    out: dict[str, Figure | None] = {}
    for short, rows, cells, where in (("grasp", grasping, PAPER_GRASPS, GRASPING), ("place", placing, PLACES, PLACING)):
        counts = read_counts(rows)
        for view in overviews(counts, cells):
            name = f"{view.world}_{view.pose_set}"
            out[f"{short}_{name}"] = mean_figure(view, counts, where)
            if short == "grasp":
                out[f"drop_six_{name}"] = drop_figure(view, counts, PAPER_SCENARIOS, where)
                out[f"drop_eight_{name}"] = drop_figure(view, counts, PAPER_GRASPS, where)
    counts = read_counts(contrast)
    for view in overviews(counts, MESHES):
        out[f"rl_sim_drop_{view.world}_{view.pose_set}"] = drop_figure(view, counts, MESHES, CONTRAST)
    return {name: figure for name, figure in out.items() if figure is not None}


def training_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Make the figures of what trainings took: CPU minutes until 95 % success in an evaluation, and memory.

    Args:
        rows: Rows of `training.csv`.

    Returns:
        `training_cpu_max`, min, of the slowest of the paper's grasp cells of which every seed reached 95 %; and
        `replay_memory_max`, MB.
    """
    minutes: dict[str, list[str]] = {}
    memory: dict[str, float] = {}
    for row in rows:
        cell = cell_in(row)
        if cell in PAPER_GRASPS:
            minutes.setdefault(_name(cell), []).append(row["cpu_min_to_95"])
        if row["replay_mb"]:
            name = f"{cell.task} {_name(cell)} {cell.renderer} {cell.variant}"
            memory[name] = max(float(row["replay_mb"]), memory.get(name, 0.0))
    reached = {name: max(map(float, texts)) for name, texts in minutes.items() if all(texts)}
    out = {}
    if reached:
        seeds = min(len(minutes[name]) for name in reached)
        count = {"seeds": seeds, "cells at 95 %": len(reached)}
        out["training_cpu_max"] = over_scenes(reached, max, TRAINING, **count)
    if memory:
        figure = over_scenes(memory, max, TRAINING)
        # The values are nearly equal for all policies, so that a table of them would say nothing.
        out["replay_memory_max"] = {name: value for name, value in figure.items() if name != "by_scene"}
    return out


def toy_figures(grasping: Sequence[Row]) -> dict[str, Figure]:
    """Success of the toy's policies in simulation, from the worst cell and set of start poses, percent."""
    counts, cells = read_counts(grasping), standard_cells(grasping, "grasp")
    found = [count for (cell, world, _), count in counts.items() if world == STRICT_WORLD and cell in cells]
    if not found:
        return {}
    worst = min(found, key=lambda count: count.rate)
    return {"toy_sim_success": success_rate(worst.successes, worst.trials, TOY, n=len(found), trials=worst.trials)}


def wall_time_figures(times: Mapping[str, Mapping[str, Any]]) -> dict[str, Figure]:
    """Wall times of whole runs, on no more than two cores.

    Args:
        times: {`make_tables`, `make_toy`: {wall_s, cores}}, as `benchmarks/wall_time.py` writes them.

    Returns:
        `make_tables_wall`, hours; `make_toy_wall`, minutes.
    """
    units = {"make_tables": 3600.0, "make_toy": 60.0}
    return {
        f"{name}_wall": single(float(entry["wall_s"]) / units[name], 1, WALL_TIMES)
        for name, entry in times.items()
        if name in units and int(entry["cores"]) <= CORES
    }


def write_policy_figures(
    out: str | Path,
    *,
    grasping: str | Path | None = None,
    renderer_contrast: str | Path | None = None,
    pick_and_place: str | Path | None = None,
    training: str | Path | None = None,
    toy: str | Path | None = None,
    wall_times: str | Path | None = None,
    preset: str | None = None,
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        grasping, renderer_contrast, pick_and_place, training: Rows of the tables; None for tables that were not made.
        toy: `rows/grasping.csv` of a toy run; None where it was not run.
        wall_times: Output of `benchmarks/wall_time.py`; None where it was not run.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """

    def rows(path: str | Path | None, columns: Sequence[str] = success_table.COLUMNS) -> list[Row]:
        return [] if path is None else read_rows(path, columns)

    def gather() -> dict[str, Figure]:
        return {
            **success_figures(rows(grasping), rows(renderer_contrast), rows(pick_and_place)),
            **training_figures(rows(training, training_table.COLUMNS)),
            **toy_figures(rows(toy)),
            **({} if wall_times is None else wall_time_figures(read_json(wall_times))),
        }

    write_measured(out, preset, gather, damaged="rows about the policies are")


def write_world_figures(out: str | Path, rows_csv: str | Path, preset: str) -> None:
    """Gather the figures of the area `worlds`, policies in further worlds, and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        rows_csv: `rows/worlds.csv`: all cells that were trained on splats.
        preset: Preset that ran.

    Raises:
        InputError: The rows are damaged.
    """
    rows = read_rows(rows_csv, success_table.COLUMNS)

    def gather() -> dict[str, Figure]:
        return {name: {**figure, "where": WORLDS} for name, figure in success_figures(rows, [], rows).items()}

    write_measured(out, preset, gather, damaged="rows about the policies are", source=rows_csv)


STUDY = "results/rows/study.csv"


def study_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Make the figures of SACwB's leads, percentage points of success.

    Args:
        rows: Rows of `study.csv`.

    Returns:
        `study_lead_min`: smallest lead over the controller that SACwB learned from, the exact controller included;
        `study_imitation_good` and `study_imitation_biased`: lead over the better of behaviour cloning and DAgger that learned
        from the same controller, for the exact controller and as the mean over the biased ones.
    """
    out: dict[str, Figure] = {}
    taught = [row for row in rows if row["algo"] == "sacwb" and row["controller_success_rate"]]
    leads = {row["teacher"]: 100 * (float(row["success_rate"]) - float(row["controller_success_rate"])) for row in taught}
    for name, wrong in (("good", False), ("biased", True)):
        pairs = {teacher: pair for teacher, pair in rivals(rows).items() if (teacher != EXACT) == wrong}
        if pairs:
            rates = {teacher: [float(row["success_rate"]) for row in pair] for teacher, pair in pairs.items()}
            won = {teacher: 100 * (ours - best) for teacher, (ours, best) in rates.items()}
            least = min(int(row["seeds"]) for pair in pairs.values() for row in pair)
            out[f"study_imitation_{name}"] = {**over_scenes(won, statistics.fmean, STUDY), "seeds": least}
    if EXACT in leads and len(leads) > 1:
        low, high = min(leads.values()), max(leads.values())
        seeds = min(int(row["seeds"]) for row in taught)
        out["study_lead_min"] = {**single(low, len(leads), STUDY, [low, high], "all controllers"), "seeds": seeds}
    return out


def write_study_figures(out: str | Path, rows_csv: str | Path, preset: str) -> None:
    """Gather the figures of the area `study` and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        rows_csv: `rows/study.csv`.
        preset: Preset that ran.

    Raises:
        InputError: The rows are damaged.
    """
    rows = read_rows(rows_csv, STUDY_COLUMNS)
    write_measured(out, preset, lambda: study_figures(rows), damaged="rows of the study are", source=rows_csv)


def loop_figures(rows: Sequence[Row], loops: Sequence[Mapping[str, str]], where: str) -> dict[str, Figure]:
    """Success of a policy before and after its world changed, and of the policy that was trained anew.

    Args:
        rows: Rows of a closed loop.
        loops: Of each loop the world `reference`, the changed `world`, and the policies `before` and `after`; `after` is empty
            where none was trained anew.
        where: File that the figures come from.

    Returns:
        `loop_{world}_before`, `loop_{world}_changed` and `loop_{world}_after`, percent.
    """
    found = {(row["variant"], row["world"]): row for row in rows}
    out: dict[str, Figure] = {}
    for loop in loops:
        places = {
            "before": (loop["before"], loop["reference"]),
            "changed": (loop["before"], loop["world"]),
            "after": (loop["after"], loop["world"]),
        }
        for name, place in places.items():
            if place in found:
                good, trials = int(found[place]["successes"]), int(found[place]["trials"])
                out[f"loop_{loop['world']}_{name}"] = success_rate(good, trials, where)
    return out


def write_loop_figures(
    out: str | Path, tables: Mapping[str, str | Path], loops: Sequence[Mapping[str, str]], preset: str
) -> None:
    """Gather the figures of the area `loops` and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        tables: CSV files of rows, by name.
        loops: Loops as `loop_figures` takes them, each with the name `table` of its rows.
        preset: Preset that ran.

    Raises:
        InputError: Rows are damaged.
    """
    figures: dict[str, Figure] = {}
    for name, path in tables.items():
        try:
            mine = [loop for loop in loops if loop["table"] == name]
            figures |= loop_figures(read_rows(path, LOOP_COLUMNS), mine, f"results/rows/{name}.csv")
        except (KeyError, ValueError) as error:
            raise InputError(path, f"rows of the loop are damaged ({error!r})", "Delete them and run again") from error
    write_json(out, {"preset": preset, "figures": figures})
