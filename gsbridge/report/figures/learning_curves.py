"""Learning curves: success of each cell's policies against environment steps, one panel per task, object and background."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.tables.result_paths import CellPaths, cell_of
from gsbridge.report.tables.rows import Row, number, read_rows
from gsbridge.report.tables.success import cell_title
from gsbridge.report.tables.success_rows import cell_order

COLOURS = {
    **{"gs": "#1f6f8b", "gs_soft": "#5fa8b8", "mesh": "#c2571a", "mesh_vertex": "#8a6fb0"},
    **{"mesh_shaded": "#e09a5f", "mesh_vertex_shaded": "#b89fd6"},
}
CONTROLLER_COLOUR = "#8592a0"
PER_LINE = 4
LEAST_WIDTH = 5.0
"""Smallest width of the figure, inches: a single panel keeps room for the legend."""
CURVE_COLUMNS = ("step", "success", "controller_success")


def write_learning_curves(curves: Sequence[str | Path], out: str | Path) -> None:
    """Draw the learning curves.

    Args:
        curves: `policies/{cell}/seed{seed}/training.csv`; seeds and renderers of a cell share a panel.
        out: Picture (PNG, PDF or SVG).

    Raises:
        InputError: There is no curve, or one is damaged.
    """
    if not curves:
        raise InputError(out, "there is no learning curve", "Name a cell in the configuration")
    panels: dict[CellPaths, list[tuple[CellPaths, list[Row]]]] = {}
    for path in curves:
        cell, _ = cell_of(path, "policies")
        panels.setdefault(CellPaths(cell.task, cell.object, cell.background), []).append((cell, _read(path)))
    places = sorted(panels, key=cell_order)
    columns = min(PER_LINE, len(places))
    lines = -(-len(places) // columns)
    figure, axes = plt.subplots(
        lines,
        columns,
        figsize=(max(3.1 * columns, LEAST_WIDTH), 2.35 * lines + 0.5),
        squeeze=False,
        sharey=True,
        layout="constrained",
    )
    for axis in axes.flat[len(places) :]:
        axis.axis("off")
    for axis, place in zip(axes.flat, places, strict=False):
        _draw(axis, place, sorted(panels[place], key=lambda item: cell_order(item[0])))
    for axis in axes[:, 0]:
        axis.set_ylabel("success / %")
    for column in range(columns):
        below = [axis for axis in axes[:, column] if axis.axison]
        below[-1].set_xlabel("environment steps / 1000")
    renderers = [renderer for renderer in TITLES if any(c.renderer == renderer for p in panels.values() for c, _ in p)]
    handles = [Line2D([], [], color=COLOURS[r], marker="o", markersize=3, label=f"trained on {TITLES[r]}") for r in renderers]
    handles.append(Line2D([], [], color=CONTROLLER_COLOUR, linestyle="--", label="baseline controller"))
    legend_above(figure, handles, [str(handle.get_label()) for handle in handles])
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
    plt.close(figure)


def _read(path: str | Path) -> list[Row]:
    """Read the rows of a learning curve, and refuse cells that are no numbers."""
    rows = read_rows(path, CURVE_COLUMNS)
    try:
        for row in rows:
            float(row["step"]), float(row["success"]), number(row["controller_success"])
    except ValueError as error:
        raise InputError(path, f"the learning curve is damaged ({error})", "Train the policy again") from error
    if not rows:
        raise InputError(path, "the learning curve is empty", "Train the policy again")
    return rows


def _draw(axis: Axes, place: CellPaths, curves: Sequence[tuple[CellPaths, list[Row]]]) -> None:
    """Fill one panel."""
    for cell, rows in curves:
        steps = [float(row["step"]) / 1000 for row in rows]
        success = [100 * float(row["success"]) for row in rows]
        colour = COLOURS.get(cell.renderer, "#444444")
        style = "-" if cell.variant == "default" else ":"
        axis.plot(steps, success, style, color=colour, marker="o", markersize=3, linewidth=1.5, clip_on=False, zorder=3)
        controller = number(rows[-1]["controller_success"])
        if controller is not None:
            axis.axhline(100 * controller, color=CONTROLLER_COLOUR, linestyle="--", linewidth=1, zorder=1)
    title = cell_title(place)
    axis.set_title(title if place.task == "grasp" else f"{title}: {place.task.replace('_', ' ')}", fontsize=10)
    axis.set_ylim(0, 104)
    axis.set_xlim(left=0)
    axis.set_yticks(range(0, 101, 25))
    axis.grid(color="#e6ebf0", linewidth=0.8)
    axis.spines[["top", "right"]].set_visible(False)
