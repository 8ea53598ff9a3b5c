"""Success of every cell at a glance: each world's rate with its interval, the paper's values as hollow marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from gsbridge.configuration.renderers import trained_on
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.tables.counts import Counts, pose_sets_in, read_counts, worlds_in
from gsbridge.report.tables.paper import PAPER_POSE_SETS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.success import MIRROR, POSE_TITLES, cell_title
from gsbridge.report.tables.success_rows import COLUMNS, ROBOT, STRICT_WORLD, cell_order

COLOURS = {STRICT_WORLD: "#1f6f8b", MIRROR: "#c2571a", ROBOT: "#2c7a4b"}
PAPER_COLOUR = "#7a5a1e"


def write_success_figure(rows_csv: Sequence[str | Path], out: str | Path) -> None:
    """Draw simulation, mirror and robot of each cell, a panel for each set of start poses.

    Args:
        rows_csv: Rows of the success tables; a row that stands in two of them counts once.
        out: Picture (PNG, PDF or SVG).

    Raises:
        InputError: A file is damaged, or there is no row.
    """
    counts = read_counts([row for path in rows_csv for row in read_rows(path, COLUMNS)])
    counts = {key: count for key, count in counts.items() if key[1] in COLOURS}
    if not counts:
        raise InputError(out, "there is no trial to show", "Name a cell in the configuration")
    cells = sorted({cell for cell, _, _ in counts}, key=lambda cell: (cell.renderer != "gs", *cell_order(cell)))
    pose_sets = pose_sets_in(counts)
    figure, axes = plt.subplots(
        1, len(pose_sets), figsize=(2.6 + 4.3 * len(pose_sets), 0.42 * len(cells) + 1.3), squeeze=False, sharey=True,
        layout="constrained",
    )  # fmt: skip
    for axis, pose_set in zip(axes[0], pose_sets, strict=True):
        _draw(axis, cells, counts, pose_set)
    axes[0, 0].set_yticks(range(len(cells)), [cell_title(cell) + trained_on(cell.renderer) for cell in cells])
    axes[0, 0].invert_yaxis()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    # matplotlib lists lines, the paper's marks, before error bars, which are ours; ours come first here.
    order = sorted(range(len(labels)), key=lambda index: labels[index].startswith("paper"))
    handles, labels = [handles[index] for index in order], [labels[index] for index in order]
    legend_above(figure, handles, labels)
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
    plt.close(figure)


def _draw(axis: Axes, cells: Sequence[CellPaths], counts: Counts, pose_set: str) -> None:
    """Fill the panel of one set of start poses."""
    worlds = worlds_in(counts)
    for index, world in enumerate(worlds):
        place = 0.26 * (index - (len(worlds) - 1) / 2)
        found = [
            (row + place, counts[cell, world, pose_set]) for row, cell in enumerate(cells) if (cell, world, pose_set) in counts
        ]
        rates = [100 * count.rate for _, count in found]
        low = [100 * (count.rate - count.interval[0]) for _, count in found]
        high = [100 * (count.interval[1] - count.rate) for _, count in found]
        rows = [row for row, _ in found]
        axis.errorbar(rates, rows, xerr=(low, high), fmt="o", color=COLOURS[world], markersize=5, linewidth=1.6, label=world)
        paper = [
            (row + place, 100 * PAPER_SUCCESS[cell].rate(world))
            for row, cell in enumerate(cells)
            if cell in PAPER_SUCCESS and pose_set in PAPER_POSE_SETS
        ]
        if paper and world in (STRICT_WORLD, MIRROR):
            label = "paper's sim" if world == STRICT_WORLD else "paper's robot"
            marker = "D" if world == STRICT_WORLD else "s"
            values = [value for _, value in paper], [row for row, _ in paper]
            axis.plot(*values, marker, color=PAPER_COLOUR, markersize=5, markerfacecolor="none", label=label, zorder=4)
    for row in range(0, len(cells), 2):
        axis.axhspan(row - 0.5, row + 0.5, color="#f3f6f9", zorder=0)
    axis.set_ylim(-0.5, len(cells) - 0.5)
    axis.set_xlim(0, 102)
    axis.set_xlabel(f"success / %, {POSE_TITLES[pose_set]}")
    axis.grid(axis="x", color="#dde3ea", linewidth=0.8)
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.tick_params(axis="y", length=0)
