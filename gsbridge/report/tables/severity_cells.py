"""Page on the success of the tables' policies at different severities, cell by cell, beside simulation.

Its rows come from `severity_rows`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.experiment.policies import PolicyFiles
from gsbridge.files import atomic_file
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.severity_rows import (
    OUTSIDE,
    Cells,
    Lead,
    Place,
    Tallies,
    by_severity,
    doubts,
    read_severity_rows,
    resting,
    severity_label,
    tallies_of,
    worlds_of,
)
from gsbridge.report.tables.statistics import mean_interval, mean_rate
from gsbridge.report.tables.success_rows import STRICT_WORLD
from gsbridge.statistics import Tally

_QUESTION = (
    "Every policy of the tables, tried once more where the day is worse. It learned in simulation, from pictures drawn with "
    "splats or, for comparison, with a mesh, and saw none of these worlds before. They are mirrors, path-traced stand-ins for "
    "reality; severity, 0 to 4, is how bad a day they have: at 2 an ordinary lab with gloss, clutter, motion blur, another "
    "lamp, friction and latency, at 3 more of all that and a wrapper of the object's colours on the table (docs/mirror.md). "
    "A cell of a table is the share of trials that succeed, its 95 % interval, and successes of trials."
)

_ABOUT = (
    "Excess contact while placing is a failure in simulation and forgiven elsewhere, as in every table. A mean counts each "
    "cell the same. The interval of one training of one cell is Wilson's; other intervals are the "
    "widest of a hierarchical bootstrap's (trainings are drawn anew with replacement, then the starts of each), Student's of "
    "the trainings' rates, and Wilson's of as many trials. A difference to simulation is in points; "
    "its starts are the same on both sides, which is not used."
)


def write_cells_page(rows_csv: str | Path, page: str | Path) -> None:
    """Write success by cell and severity, with intervals, against simulation.

    Args:
        rows_csv: `rows/severity.csv`.
        page: Markdown.

    Raises:
        InputError: The rows are damaged, there are none, or all of them are of simulation.
    """
    rows = read_severity_rows(rows_csv)
    worlds = worlds_of(rows)
    if not worlds:
        raise InputError(rows_csv, "no policy was tried in a world of some severity", "Name one in study.severity.worlds")
    levels = list(dict.fromkeys(map(severity_label, worlds.values())))
    inside, outside = (tallies_of(by_severity(rows), *sets) for sets in ((), (OUTSIDE,)))
    found = [_means_table(inside, levels), _cells_table(inside, levels, "Start poses inside the training square")]
    if outside:
        found.append(_cells_table(outside, levels, "Start poses outside the training square"))
    lines = ["# The policies of the tables on worse days", "", _QUESTION, "", resting(rows), ""]
    with atomic_file(page) as temporary:
        text = "\n".join([*lines, *map(markdown, found), _ABOUT, *doubts(rows)])
        temporary.write_text(text + "\n", encoding="utf-8")


def _head(levels: Sequence[str]) -> tuple[str, ...]:
    return "simulation", *(f"severity {level}" for level in levels)


def _share(cells: Cells) -> str:
    """Mean success of cells with its interval and the counts behind it; empty text for no cells."""
    if not cells:
        return ""
    low, high = mean_interval(cells.values())
    every = [tally for cell in cells.values() for tally in cell]
    counted = f"{sum(good for good, _ in every)}/{sum(tried for _, tried in every)}"
    return f"{100 * mean_rate(cells.values()):.0f} % ({100 * low:.0f} to {100 * high:.0f}; {counted})"


def _means_table(tallies: Tallies, levels: Sequence[str]) -> Table:
    """Lay out one line per task, renderer and variant: means over its cells, and differences to simulation."""
    kinds: dict[tuple[str, str, str], dict[str, dict[Place, list[Tally]]]] = {}
    for (renderer, variant, world), cells in tallies.items():
        for place, tally in cells.items():
            kinds.setdefault((place[0], renderer, variant), {}).setdefault(world, {})[place] = tally
    lines = []
    for (task, renderer, variant), worlds in kinds.items():
        trained = f"{task.replace('_', ' ')}, {TITLES[renderer]}" + (f", {variant}" if variant != "default" else "")
        count = len({place for cells in worlds.values() for place in cells})
        shares = (_share(worlds.get(world, {})) for world in (STRICT_WORLD, *levels))
        changes = (_change(worlds, level) for level in levels)
        lines.append((trained, str(count), *shares, *changes))
    columns = ("policies", "cells", *_head(levels), *(f"severity {level} − simulation" for level in levels))
    return Table("Means over the cells, start poses inside the training square", columns, tuple(lines))


def _change(worlds: Mapping[str, Cells], level: str) -> str:
    """Difference to simulation over the cells that were tried in both, in points."""
    lead = Lead.over_common_cells(worlds.get(level, {}), worlds.get(STRICT_WORLD, {}))
    if lead is None:
        return ""
    low, high = lead.interval
    return f"{100 * lead.value:+.0f} ({100 * low:+.0f} to {100 * high:+.0f})".replace("-", "−")


def _cells_table(tallies: Tallies, levels: Sequence[str], title: str) -> Table:
    """Lay out one line per policy."""
    named = dict.fromkeys((place, *group[:2]) for group, cells in tallies.items() for place in cells)
    lines = []
    for place, renderer, variant in named:
        worlds = [tallies.get((renderer, variant, world), {}) for world in (STRICT_WORLD, *levels)]
        shares = (_share({place: cells[place]} if place in cells else {}) for cells in worlds)
        lines.append((PolicyFiles(*place, renderer, variant).title, *shares))
    return Table(title, ("policy", *_head(levels)), tuple(lines))
