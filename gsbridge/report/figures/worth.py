"""Figures of success against severity by renderer, and of graded policies' success in each world against simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsbridge.configuration.renderers import TITLES
from gsbridge.files import atomic_file
from gsbridge.report.figures.learning_curves import COLOURS
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.tables.severity_rows import (
    INSIDE,
    OUTSIDE,
    Tallies,
    graded_pairs,
    graded_rates,
    read_severity_rows,
    severity_label,
    tallies_of,
    worlds_of,
)
from gsbridge.report.tables.statistics import mean_interval, mean_rate

_SETS = {"start poses inside the training square": INSIDE, "outside": OUTSIDE}
_WAYS = {"default": "varied colours", "no_jitter": "colours as they are"}


def write_worth_figure(rows_csv: str | Path, out: str | Path) -> None:
    """Draw mean success over the cells against the worlds' severity, with 95 % intervals.

    There is a panel for each variant and group of start poses.

    Args:
        rows_csv: `rows/worth.csv`.
        out: Picture.

    Raises:
        InputError: The rows are damaged, or there are none.
    """
    rows = read_severity_rows(rows_csv)
    worlds = worlds_of(rows)
    sets = {title: found for title, names in _SETS.items() if (found := tallies_of(rows, names))}
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    size = (1.2 + 4.0 * len(variants), 0.8 + 3.0 * len(sets))
    figure, axes = plt.subplots(
        len(sets), len(variants), figsize=size, squeeze=False, sharex=True, sharey=True, layout="constrained"
    )
    for line, (title, tallies) in zip(axes, sets.items(), strict=True):
        for axis, variant in zip(line, variants, strict=True):
            _draw(axis, tallies, worlds, variant)
        line[0].set_ylabel(f"success / %\n{title}")
    for axis, variant in zip(axes[0], variants, strict=True):
        axis.set_title(_WAYS.get(variant, variant), fontsize=10)
    # A single panel may lack a renderer, so the legend is collected over all panels.
    shown = {label: handle for axis in axes.flat for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    legend_above(figure, list(shown.values()), list(shown))
    _save(figure, out)


def _draw(axis: Axes, tallies: Tallies, worlds: Mapping[str, tuple[str, str]], variant: str) -> None:
    """Draw the success of one variant, a line for each renderer."""
    names = [name for name in TITLES if any(key[:2] == (name, variant) for key in tallies)]
    for number, name in enumerate(names):
        found = [(place, tallies[key]) for place, world in enumerate(worlds) if (key := (name, variant, world)) in tallies]
        # Side by side, so that intervals do not hide each other.
        places = [place + 0.08 * (number - (len(names) - 1) / 2) for place, _ in found]
        rates = [100 * mean_rate(cells.values()) for _, cells in found]
        between = [mean_interval(cells.values()) for _, cells in found]
        # The interval comes from redrawn trials, so that rounding may leave the rate just outside it.
        below = [max(0.0, rate - 100 * low) for rate, (low, _) in zip(rates, between, strict=True)]
        above = [max(0.0, 100 * high - rate) for rate, (_, high) in zip(rates, between, strict=True)]
        axis.errorbar(
            places, rates, yerr=(below, above), fmt="o-", color=COLOURS[name], markersize=4, linewidth=1.4, label=TITLES[name]
        )
    axis.set_xticks(range(len(worlds)), [severity_label(severity) for severity in worlds.values()])
    axis.set_ylim(-3, 103)
    axis.set_xlabel("severity")
    _plain(axis)


def write_graded_figure(rows_csv: str | Path, out: str | Path) -> None:
    """Draw the success of graded policies in each world against that in simulation, a panel for each world.

    Args:
        rows_csv: `rows/graded.csv`.
        out: Picture.

    Raises:
        InputError: The rows are damaged, or there are none.
    """
    rows = read_severity_rows(rows_csv)
    rates, worlds = graded_rates(rows), worlds_of(rows)
    figure, axes = plt.subplots(
        1, len(worlds), figsize=(0.8 + 2.4 * len(worlds), 3.0), squeeze=False, sharey=True, layout="constrained"
    )
    for axis, (world, severity) in zip(axes[0], worlds.items(), strict=True):
        _draw_pairs(axis, *graded_pairs(rates, world))
        axis.set_title(f"severity {severity_label(severity)}", fontsize=10)
        axis.set_xlabel("success in simulation / %")
    axes[0, 0].set_ylabel("success there / %")
    _save(figure, out)


def _draw_pairs(axis: Axes, sim: Sequence[float], real: Sequence[float]) -> None:
    axis.plot((0, 100), (0, 100), color="#b8c0c8", linewidth=1.0)
    axis.plot([100 * rate for rate in sim], [100 * rate for rate in real], "o", color=COLOURS["gs"], markersize=5)
    axis.set_xlim(-3, 103)
    axis.set_ylim(-3, 103)
    _plain(axis)


def _plain(axis: Axes) -> None:
    axis.grid(color="#dde3ea", linewidth=0.8)
    axis.spines[["top", "right"]].set_visible(False)


def _save(figure: Figure, out: str | Path) -> None:
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
    plt.close(figure)
