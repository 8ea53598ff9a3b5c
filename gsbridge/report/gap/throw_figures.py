"""Figures of a gap report about throws: their paths, distances over time before and after, the distance of every throw."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from gsbridge.geometry import Array
from gsbridge.report.gap.figures import AFTER, BEFORE, NOISE, PLAIN, data_uri

PATHS = 6
"""Throws whose paths are drawn."""

MEASURED = "#1d2733"

_BINS = 40
"""Steps of time in which distances are summed up."""

_BAND = (0.1, 0.9)
"""Shares of the throws between which a band lies."""


def draw_throws(series: Mapping[str, Array], role: str, floor: float | None) -> str:
    """Distances over time, and some throws seen from above.

    Args:
        series: `{role}/throw`, `/time`, `/position`, `/nominal_position`, `/before`, and `/explained_position`, `/after` where
            something was fitted; see `gsbridge.gap.contact.workflow`.
        role: Whose throws.
        floor: What noise and chaos explain, mean over throws, mm; None where it is not known.

    Returns:
        A PNG as data URI.
    """
    with plt.rc_context(PLAIN):
        figure = plt.figure(figsize=(11, 7.6), layout="constrained")
        above, below = figure.subfigures(2, 1, height_ratios=[1.0, 1.15])
        axis = above.subplots()
        if floor is not None:
            axis.axhspan(0, floor, color=NOISE, alpha=0.22, linewidth=0, label="what noise and chaos explain, on average")
        for when, colour, text in (
            ("before", BEFORE, "before: model as it was"),
            ("after", AFTER, "after: with the explanation"),
        ):
            if f"{role}/{when}" in series:
                _spread(axis, series[f"{role}/time"], 1e3 * series[f"{role}/{when}"], colour, text)
        axis.set_ylabel("distance to what was measured, mm")
        axis.set_xlabel("time since the throw's first sample, s")
        axis.margins(x=0.005)
        axis.set_ylim(bottom=0)
        above.legend(loc="outside upper center", ncols=3, frameon=False)
        _draw_paths(below.subplots(2, PATHS // 2), series, role)
        below.suptitle("Seen from above: throws from small to large distance, in metres", x=0.01, ha="left", fontsize=11)
        return data_uri(figure)


def _spread(axis: Axes, time: Array, distance: Array, colour: str, text: str) -> None:
    """Mean distance over time, and the band in which most throws lie."""
    edges = np.linspace(0.0, float(time.max()) + 1e-9, _BINS + 1)
    place = np.digitize(time, edges) - 1
    rows = [distance[place == k] for k in range(_BINS)]
    there = np.array([len(row) > 0 for row in rows])
    middle = 0.5 * (edges[:-1] + edges[1:])[there]
    low, mean, high = (
        np.array([function(row) for row in rows if len(row)])
        for function in (lambda row: np.quantile(row, _BAND[0]), np.mean, lambda row: np.quantile(row, _BAND[1]))
    )
    axis.fill_between(middle, low, high, color=colour, alpha=0.16, linewidth=0)
    axis.plot(middle, mean, color=colour, linewidth=2.0, label=text)


def _draw_paths(axes: Array, series: Mapping[str, Array], role: str) -> None:
    """Paths of some throws, spread evenly over the order of their distances before."""
    number = series[f"{role}/throw"].astype(int)
    sizes = np.bincount(number, weights=series[f"{role}/before"]) / np.bincount(number)
    order = np.argsort(sizes)
    chosen = order[np.linspace(0, len(order) - 1, min(PATHS, len(order))).round().astype(int)]
    ways = (("nominal_position", BEFORE, "-"), ("explained_position", AFTER, "-"), ("position", MEASURED, (0, (4, 2))))
    for axis, throw in zip(axes.ravel(), chosen, strict=False):
        rows = number == throw
        for name, colour, style in ways:
            path = series.get(f"{role}/{name}")
            if path is not None:
                axis.plot(path[rows, 0], path[rows, 1], color=colour, linestyle=style, linewidth=1.8)
                axis.scatter(*path[rows, :2][-1], color=colour, s=22, zorder=3)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_title(f"throw {throw + 1}: {1e3 * sizes[throw]:.3g} mm before", fontsize=9.5, loc="left")
        axis.tick_params(labelsize=8)
        axis.locator_params(nbins=4)
        axis.margins(0.12)
    for axis in axes.ravel()[len(chosen) :]:
        axis.set_axis_off()
    axes.ravel()[0].plot([], [], color=MEASURED, linestyle=(0, (4, 2)), label="measured")
    axes.ravel()[0].legend(frameon=False, fontsize=9, loc="best")


def draw_each(before: Array, after: Array | None, floor: float | None) -> str:
    """Mean distance of every throw before and after, sorted by the distance before.

    Args:
        before: mm. [N].
        after: mm; None where nothing was fitted. [N].
        floor: What noise and chaos explain, mean over throws, mm.
    """
    order = np.argsort(before)
    place = np.arange(1, len(order) + 1)
    with plt.rc_context(PLAIN):
        figure, axis = plt.subplots(figsize=(11, 3.3), layout="constrained")
        axis.scatter(place, before[order], s=14, color=BEFORE, label="before")
        if after is not None:
            axis.scatter(place, after[order], s=14, color=AFTER, label="after")
        if floor is not None:
            axis.axhline(
                floor, color=NOISE, linewidth=1.4, linestyle=(0, (4, 3)), label="what noise and chaos explain, on average"
            )
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_ylabel("mean distance of a throw, mm")
        axis.set_xlabel("throws, from small to large distance before")
        axis.margins(x=0.01)
        figure.legend(loc="outside upper center", ncols=3, frameon=False)
        return data_uri(figure)
