"""Figures of the areas `severity` and `worth`, gathered from rows under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet. The name of a
figure ends with the severity, which is the same for look and physics. `n` is the number of trials behind a figure, of both
sides together for a lead; `cells` is the number of cells, `seeds` the fewest trainings of any cell, `trials` the fewest trials
of any training. Unless a name says `outside`, both sets of start poses inside the training square count together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from scipy import stats

from gsbridge.configuration.renderers import TITLES
from gsbridge.report.scores.measured_policies import MESHES, PLACES
from gsbridge.report.scores.score import Figure, single, write_measured
from gsbridge.report.tables.paper import PAPER_GRASPS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.report.tables.severity_rows import (
    COLUMNS,
    OUTSIDE,
    Cells,
    Lead,
    Tallies,
    by_severity,
    graded_pairs,
    graded_rates,
    lead_over_best_mesh,
    tallies_of,
    worlds_of,
)
from gsbridge.report.tables.statistics import (
    WIDEST,
    interval_kind,
    mean_interval,
    mean_maximum_rank_violation,
    mean_rate,
    pearson,
)
from gsbridge.report.tables.success_rows import STRICT_WORLD
from gsbridge.report.tables.worth import ONE_COLOUR

SEVERITY = "results/rows/severity.csv"
WORTH = "results/rows/worth.csv"
GRADED = "results/rows/graded.csv"

KINDS: Mapping[str, Sequence[CellPaths]] = {"grasp": PAPER_GRASPS, "place": PLACES, "mesh": MESHES}
"""Policies whose mean is a figure: trained on splats to grasp, trained on splats to pick and place, trained on a mesh."""

VARIANTS = {"jitter": "default", "no_jitter": "no_jitter"}
"""Variants with varied colours and without, by the names that figures use."""


def severity_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Mean success of the policies of the tables at each severity, percent, beside simulation.

    Args:
        rows: Rows of `severity.csv`.

    Returns:
        `severity_{kind}_{level}` and `severity_{kind}_outside_{level}` with the kinds of `KINDS`.
    """
    out: dict[str, Figure] = {}
    for suffix, tallies in (("", tallies_of(by_severity(rows))), ("_outside", tallies_of(by_severity(rows), OUTSIDE))):
        for kind, policies in KINDS.items():
            for level in _levels(rows):
                cells = _cells(tallies, policies, level)
                if cells:
                    beside = {"the same in simulation": _percents(_cells(tallies, policies, STRICT_WORLD))}
                    out[f"severity_{kind}{suffix}_{level}"] = {**mean_figure(cells, SEVERITY), "beside": beside}
    return out


def _levels(rows: Sequence[Row]) -> list[str]:
    """Severities of those worlds of the rows whose look and physics have the same severity."""
    return list(dict.fromkeys(look for look, physics in worlds_of(rows).values() if look == physics))


def _cells(tallies: Tallies, policies: Sequence[CellPaths], world: str) -> Cells:
    """Successes and trials, by cell, of those `policies` that were tried in a world."""
    places = {policy: (policy.task, policy.object, policy.background) for policy in policies}
    groups = {policy: tallies.get((policy.renderer, policy.variant, world), {}) for policy in policies}
    return {places[policy]: cells[places[policy]] for policy, cells in groups.items() if places[policy] in cells}


def _percents(cells: Cells) -> dict[str, float]:
    """Success of each cell, percent, by `{task}/{object}+{background}`."""
    return {f"{task}/{item}+{background}": 100 * mean_rate([cell]) for (task, item, background), cell in cells.items()}


def mean_figure(cells: Cells, where: str) -> Figure:
    """Mean success over cells, percent, each counting the same.

    Args:
        cells: Successes and trials of each training, by cell.
        where: File that the successes come from.
    """
    interval = [100 * limit for limit in mean_interval(cells.values())]
    figure = single(100 * mean_rate(cells.values()), _trials(cells), where, interval, interval_kind(cells.values()))
    return {**figure, "by_scene": _percents(cells), **_counted(cells)}


def lead_figure(lead: Lead, where: str, ours: str, theirs: str) -> Figure:
    """Make the figure of a lead over the same cells, points.

    Args:
        lead: The lead.
        where: File that the lead comes from.
        ours, theirs: Titles of the two sides.
    """
    figure = single(
        100 * lead.value, _trials(lead.ours) + _trials(lead.theirs), where, [100 * limit for limit in lead.interval], WIDEST
    )
    sides = {ours: _percents(lead.ours), theirs: _percents(lead.theirs)}
    by_cell = {name: sides[ours][name] - sides[theirs][name] for name in sides[ours]}
    counted = {name: min(_counted(side)[name] for side in (lead.ours, lead.theirs)) for name in _counted(lead.ours)}
    return {**figure, "by_scene": by_cell, "beside": sides, **counted}


def _trials(cells: Cells) -> int:
    return sum(tried for cell in cells.values() for _, tried in cell)


def _counted(cells: Cells) -> dict[str, int]:
    """Count the cells, trainings and trials behind a figure."""
    fewest = min(tried for cell in cells.values() for _, tried in cell)
    return {"cells": len(cells), "trials": fewest, "seeds": min(len(cell) for cell in cells.values())}


def worth_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Make the figures of what splats are worth at each severity.

    Args:
        rows: Rows of `worth.csv`.

    Returns:
        With and without `jitter`: `worth_lead_one_colour_{variant}_{level}`, lead of splats over the mesh in one colour,
            points; `worth_lead_best_mesh_{variant}_{level}`, lead of splats over the best mesh, points;
            `worth_splats_{variant}_{level}` and `worth_splats_{variant}_outside_{level}`, success of splats, percent.
    """
    inside, outside = tallies_of(by_severity(rows)), tallies_of(by_severity(rows), OUTSIDE)
    out: dict[str, Figure] = {}
    for name, variant in VARIANTS.items():
        for level in _levels(rows):
            splats = inside.get(("gs", variant, level), {})
            one_colour = Lead.over_common_cells(splats, inside.get((ONE_COLOUR, variant, level), {}))
            if one_colour is not None:
                figure = lead_figure(one_colour, WORTH, "success of splats", "success of the mesh in one colour")
                out[f"worth_lead_one_colour_{name}_{level}"] = figure
            if best := lead_over_best_mesh(inside, variant, level):
                figure = lead_figure(best[1], WORTH, "success of splats", f"success of the best mesh ({TITLES[best[0]]})")
                out[f"worth_lead_best_mesh_{name}_{level}"] = figure
            if splats:
                out[f"worth_splats_{name}_{level}"] = mean_figure(splats, WORTH)
            if beyond := outside.get(("gs", variant, level), {}):
                out[f"worth_splats_{name}_outside_{level}"] = mean_figure(beyond, WORTH)
    return out


def graded_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Make the figures of how well simulation foretells each severity, over policies from poor to good.

    Args:
        rows: Rows of `graded.csv`.

    Returns:
        `graded_r_{level}`, Pearson's correlation; `graded_mmrv_{level}`, the mean maximum rank violation, a share of success;
        `graded_spread`, the difference of the best and the worst success in simulation, points, whose interval is those two.
    """
    rates = graded_rates(by_severity(rows))
    out: dict[str, Figure] = {}
    for level in _levels(rows):
        sim, real = graded_pairs(rates, level)
        if not sim:
            continue
        count = {"policies": len(sim), "points of spread": round(100 * (max(sim) - min(sim)))}
        r, interval, violation = pearson(sim, real), None, mean_maximum_rank_violation(sim, real)
        if r is not None:
            if len(sim) > 3:
                interval = list(stats.pearsonr(sim, real).confidence_interval(0.95))
            out[f"graded_r_{level}"] = {**single(r, len(sim), GRADED, interval, "95 % (Fisher's z)"), **count}
        if violation is not None:
            out[f"graded_mmrv_{level}"] = {**single(violation, len(sim), GRADED), **count}
    if known := [100 * found[STRICT_WORLD] for found in rates.values() if STRICT_WORLD in found]:
        span = [min(known), max(known)]
        figure = single(
            span[1] - span[0], len(known), GRADED, span, "success of the worst and of the best policy in simulation"
        )
        out["graded_spread"] = {**figure, "policies": len(known)}
    return out


def write_severity_figures(out: str | Path, rows_csv: str | Path | None, preset: str) -> None:
    """Gather the figures of the area `severity` and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        rows_csv: `rows/severity.csv`; None where no policy is tried.
        preset: Preset that ran.

    Raises:
        InputError: The rows are damaged.
    """
    rows = [] if rows_csv is None else read_rows(rows_csv, COLUMNS)
    damaged = "rows about the policies at different severities are"
    write_measured(out, preset, lambda: severity_figures(rows), damaged=damaged, source=rows_csv)


def write_worth_figures(
    out: str | Path, *, worth: str | Path | None = None, graded: str | Path | None = None, preset: str
) -> None:
    """Gather the figures of the area `worth` and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        worth, graded: `rows/worth.csv` and `rows/graded.csv`; None where that comparison is not made.
        preset: Preset that ran.

    Raises:
        InputError: Rows are damaged.
    """

    def rows(path: str | Path | None) -> list[Row]:
        return [] if path is None else read_rows(path, COLUMNS)

    def gather() -> dict[str, Figure]:
        return {**worth_figures(rows(worth)), **graded_figures(rows(graded))}

    write_measured(out, preset, gather, damaged="rows about what splats are worth are")
