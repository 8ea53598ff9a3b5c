"""The figure of behaviour consistency: paths of the hand in space, what the camera saw, and the distances of all trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from gsbridge.configuration.renderers import TITLES, trained_on
from gsbridge.environment.trial_log import decode
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.figures.paired_trials import SIM, STEP_S, Start, cell_name
from gsbridge.report.tables.result_paths import CellPaths

SHOWN = 8
"""Number of pictures in a strip, and of start poses whose paths are drawn."""
COLOURS = {SIM: "#2466a8", "other": "#d9641e"}
FAILED = "#b3202a"
LOWER, UPPER = np.array([-0.15, 0.115, 0.0]), np.array([0.15, 0.415, 0.28])
"""Corners of the box that is always shown, m: the start region, up to where the hand starts."""
OBJECT: dict[str, Any] = {"color": "#6b6b6b", "marker": "s", "s": 12, "linewidths": 0, "zorder": 1}
CENTIMETRES = FuncFormatter(lambda value, _: f"{100 * value:.0f}")
_FONT: dict[Any, Any] = {"font.size": 9, "font.family": "DejaVu Sans", "axes.linewidth": 0.6}


@dataclass(frozen=True)
class PolicyLine:
    """Trials of one policy, one line of the figure.

    Args:
        cell: What the policy learned.
        starts: Start poses that the line shows.
        distances_mm: Distance between the paths from each start pose, mm. [N].
    """

    cell: CellPaths
    starts: Sequence[Start]
    distances_mm: Array


@dataclass(frozen=True)
class Block:
    """Policies of one cell, one line each; `chosen` numbers the start pose whose pictures each line shows."""

    lines: tuple[PolicyLine, ...]
    chosen: tuple[int, ...]


def write_behaviour_figure(blocks: Sequence[Block], lines: Sequence[PolicyLine], world: str, out: str | Path) -> None:
    """Draw the figure.

    Args:
        blocks: Cells that are shown with paths and pictures.
        lines: All policies, for the panel of distances.
        world: World that simulation is compared with.
        out: PNG, PDF or SVG.
    """
    heights = [2.4 * len(block.lines) + 0.3 for block in blocks] + [0.26 * len(lines) + 1.0]
    with plt.rc_context(_FONT):
        page = plt.figure(figsize=(14.0, sum(heights)), layout="constrained")
        page.set_layout_engine("constrained", w_pad=0.02, h_pad=0.02, wspace=0.0, hspace=0.0)
        parts = page.subfigures(len(heights), 1, squeeze=False, height_ratios=heights).ravel()
        for part, block in zip(parts, blocks, strict=False):
            _draw_block(part, block, world)
        _draw_distances(parts[-1], lines, world)
        with atomic_file(out) as temporary:
            page.savefig(temporary, dpi=150, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
        plt.close(page)


def picked(start: Start, world: str, count: int = SHOWN) -> tuple[list[Array], list[float]]:
    """Decode pictures of a trial at equal shares of its duration, first and last included.

    Args:
        start: Trials from one start pose.
        world: World whose trial is shown.
        count: Number of pictures.

    Returns:
        Pictures, uint8 [H, W, 3] each, and their times, s.
    """
    path = start.trials[world].path
    states = np.linspace(0, len(path) - 1, count).round().astype(int)
    return [decode(path.jpegs[state]) for state in states], [STEP_S * float(state) for state in states]


def spread_starts(starts: Sequence[Start], count: int = SHOWN) -> list[Start]:
    """Choose start poses of the first seed: equally many from each quadrant, spread evenly over its poses."""
    of_seed = [start for start in starts if start.seed == starts[0].seed]
    out = []
    quadrants = sorted({start.quadrant for start in of_seed})
    for quadrant in quadrants:
        here = [start for start in of_seed if start.quadrant == quadrant]
        chosen = np.linspace(0, len(here) - 1, max(1, count // len(quadrants))).round().astype(int)
        out += [here[number] for number in np.unique(chosen)]
    return out


def _draw_block(part: SubFigure, block: Block, world: str) -> None:
    """Draw one cell: for each renderer the paths at the left and two strips at the right."""
    part.suptitle(cell_name(block.lines[0].cell), fontsize=12, fontweight="bold")
    rows = part.subfigures(len(block.lines), 1, squeeze=False).ravel()
    limits = _limits([start for line in block.lines for start in spread_starts(line.starts)], world)
    for row, line, chosen in zip(rows, block.lines, block.chosen, strict=True):
        space, top, strips = row.subfigures(1, 3, width_ratios=(2.8, 2.4, 8.8))
        _draw_space(space, line, world, limits)
        _draw_top(top, line, world, limits)
        _draw_strips(strips, line, line.starts[chosen], float(line.distances_mm[chosen]), world)


def _limits(starts: Sequence[Start], world: str) -> tuple[Array, Array]:
    """Corners of a box round all paths and the area in which objects start, on the table. [3], [3], m."""
    points = np.concatenate([start.trials[name].hand for start in starts for name in (SIM, world)])
    lower, upper = np.minimum(points.min(axis=0), LOWER), np.maximum(points.max(axis=0), UPPER)
    room = np.array([0.01, 0.01, 0.0])
    return lower - room, upper + room


def _draw_space(part: SubFigure, line: PolicyLine, world: str, limits: tuple[Array, Array]) -> None:
    """Draw the paths in space, with the table below them."""
    axes: Axes3D = part.add_subplot(projection="3d", computed_zorder=False)
    starts = spread_starts(line.starts)
    _draw_paths(axes, starts, world, 3)
    for start in starts:
        axes.scatter(*start.pose[:2], 0.0, **OBJECT)
    _dress(axes, *limits)


def _draw_top(part: SubFigure, line: PolicyLine, world: str, limits: tuple[Array, Array]) -> None:
    """Draw the paths as seen from above."""
    axes = part.subplots()
    starts = spread_starts(line.starts)
    for start in starts:
        axes.scatter(start.pose[0], start.pose[1], **OBJECT)
    _draw_paths(axes, starts, world, 2)
    lower, upper = limits
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(0.1))
        axis.set_major_formatter(CENTIMETRES)
    axes.tick_params(labelsize=6.5, length=2, pad=1.5)
    axes.set_xlabel("x", fontsize=7, labelpad=0)
    axes.set_ylabel("y", fontsize=7, labelpad=0)
    axes.set_facecolor("#f6f5f1")
    axes.set_title("from above, cm", fontsize=7.5, pad=2)


def _draw_paths(axes: Axes, starts: Sequence[Start], world: str, dimensions: int) -> None:
    """Draw the paths of both worlds; where they agree, the wide line shows on both sides of the narrow one."""
    for name, width, order in ((SIM, 2.6, 3), (world, 0.9, 4)):
        for start in starts:
            trial = start.trials[name]
            hand = trial.hand[:, :dimensions]
            axes.plot(*hand.T, color=_colour(name), linewidth=width, alpha=0.55 if name == SIM else 1.0, zorder=order)
            if not trial.success:
                mark: dict[str, Any] = {"color": FAILED, "marker": "x", "s": 22, "linewidths": 1.4, "zorder": 6}
                axes.scatter(*hand[-1], **mark)


def _dress(axes: Axes3D, lower: Array, upper: Array) -> None:
    """Set equal scales, draw the table as a plane, and set few ticks in cm."""
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=(lower[2], upper[2]))
    axes.set_box_aspect(upper - lower, zoom=1.25)
    axes.view_init(elev=22, azim=-58)
    x, y = np.meshgrid((lower[0], upper[0]), (lower[1], upper[1]))
    axes.plot_surface(x, y, np.zeros_like(x), color="#eceae4", shade=False, zorder=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MultipleLocator(0.1))
        axis.set_major_formatter(CENTIMETRES)
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color="#dddddd", linewidth=0.4)
    axes.tick_params(labelsize=6.5, pad=-4)
    axes.set_xlabel("x", fontsize=7, labelpad=-12)
    axes.set_ylabel("y", fontsize=7, labelpad=-12)
    axes.set_zlabel("z", fontsize=7, labelpad=-13)
    axes.set_title("in space, cm", fontsize=7.5, pad=0)


def _draw_strips(part: SubFigure, line: PolicyLine, start: Start, distance_mm: float, world: str) -> None:
    """Draw what the camera saw in both worlds from one start pose."""
    axes = part.subplots(2, SHOWN, gridspec_kw={"wspace": 0.02, "hspace": 0.02})
    for row, name in zip(axes, (SIM, world), strict=True):
        pictures, times = picked(start, name)
        for axis, picture, time in zip(row, pictures, times, strict=True):
            axis.imshow(picture, interpolation="bicubic")
            axis.set_xticks([])
            axis.set_yticks([])
            _frame(axis, _colour(name), 1.0)
            axis.text(0.04, 0.04, f"{time:.1f} s", transform=axis.transAxes, fontsize=7, color="white", **_box())
        trial = start.trials[name]
        if not trial.success:
            _frame(row[-1], FAILED, 2.4)
        row[-1].text(
            *(0.96, 0.96, trial.outcome()),
            **{"transform": row[-1].transAxes, "fontsize": 7, "color": "white", "ha": "right", "va": "top", **_box()},
        )
        row[0].set_ylabel(_words(name), color=_colour(name), fontsize=10, fontweight="bold")
    # The texts stay outside the layout: as long as a strip, they would push its pictures apart. The empty title keeps room.
    part.suptitle(" ", fontsize=11)
    above = {"va": "bottom", "in_layout": False}
    name = TITLES.get(line.cell.renderer, line.cell.renderer)
    axes[0][0].text(0.0, 1.06, name, transform=axes[0][0].transAxes, fontsize=10, fontweight="bold", **above)
    summary = _summary(line, start, distance_mm, world)
    axes[0][-1].text(1.0, 1.06, summary, transform=axes[0][-1].transAxes, fontsize=8.5, ha="right", **above)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _colour(world: str) -> str:
    return COLOURS.get(world, COLOURS["other"])


def _frame(axis: Axes, colour: str, width: float) -> None:
    for side in axis.spines.values():
        side.set_edgecolor(colour)
        side.set_linewidth(width)


def _box() -> dict:
    return {"bbox": {"facecolor": "black", "alpha": 0.5, "pad": 1.2, "edgecolor": "none"}}


def _summary(line: PolicyLine, start: Start, distance_mm: float, world: str) -> str:
    count = len(line.starts)
    wins = {name: sum(one.trials[name].success for one in line.starts) for name in (SIM, world)}
    return (
        f"paths apart by {np.median(line.distances_mm):.0f} mm (median), p90 {np.quantile(line.distances_mm, 0.9):.0f} mm"
        f"  ·  success {wins[SIM]}/{count} in sim, {wins[world]}/{count} in {_words(world)}"
        f"  ·  shown: {start.label}, {distance_mm:.0f} mm"
    )


def _draw_distances(part: SubFigure, lines: Sequence[PolicyLine], world: str) -> None:
    """Draw the distances of all trials, one line per policy, medians as bars."""
    axes = part.subplots()
    rng = np.random.default_rng(0)
    for place, line in enumerate(lines):
        wins = np.array([start.trials[world].success for start in line.starts])
        height = place + rng.uniform(-0.22, 0.22, len(wins))
        marks: tuple[tuple[Any, dict[str, Any]], ...] = (
            (wins, {"color": COLOURS["other"]}),
            (~wins, {"color": FAILED, "marker": "x"}),
        )
        for chosen, style in marks:
            axes.scatter(line.distances_mm[chosen], height[chosen], s=11, linewidths=0.8, alpha=0.75, **style)
        median = float(np.median(line.distances_mm))
        axes.plot([median, median], [place - 0.36, place + 0.36], color="black", linewidth=2.0)
    axes.set_yticks(range(len(lines)), [_policy_name(line.cell) for line in lines])
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.grid(axis="x", which="both", color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_xlabel(f"distance of the hand's paths, sim to {_words(world)}, mm")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    handles = [
        Line2D([], [], color=COLOURS[SIM], linewidth=2.6, alpha=0.55, label="path in sim"),
        Line2D([], [], color=COLOURS["other"], linewidth=0.9, label=f"path in {_words(world)}"),
        Line2D([], [], color=OBJECT["color"], marker="s", linestyle="", markersize=4, label="object at the start"),
        Line2D([], [], color=COLOURS["other"], marker="o", linestyle="", markersize=4, label="one start pose"),
        Line2D([], [], color=FAILED, marker="x", linestyle="", markersize=5, label="failure"),
        Line2D([], [], color="black", marker="|", linestyle="", markersize=10, markeredgewidth=2, label="median"),
    ]
    legend_above(part, handles, [str(handle.get_label()) for handle in handles], 8)


def _policy_name(cell: CellPaths) -> str:
    task = "" if cell.task == "grasp" else f"{cell.task.replace('_', ' ')}, "
    return task + cell_name(cell) + trained_on(cell.renderer) + ("" if cell.variant == "default" else f", {cell.variant}")
