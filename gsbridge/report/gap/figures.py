"""Figures of a gap report: residuals before and after on the same axes, the gap of each channel, the map of residuals."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from gsbridge.gap.diagnosis.wording import channel_name
from gsbridge.geometry import Array

BEFORE, AFTER, NOISE = "#c2660c", "#1f6f8b", "#8a96a3"
"""Colours of the model as it was, of the explanation, and of the noise, on all figures."""

SHOWN = 3
"""Number of channels whose residuals are drawn over time: those with the largest gap."""

ROWS = 14
"""Most channels in the map and in the figure of all channels; those with the largest gap are shown."""

UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m", "tool": "m"}
"""Units of channels, by kind."""

SLIDING_UNITS = {"position": "m", "velocity": "m/s", "effort": "N"}
"""Units of channels of joints that slide."""

_INK, _SOFT = "#1d2733", "#5b6b7b"
_HEAT = LinearSegmentedColormap.from_list("gap", ["#f3f6f9", "#f5d9ad", "#d9822b", "#8c2f08"])
PLAIN: dict[Any, Any] = {
    "font.size": 10.5,
    "axes.edgecolor": "#c4ccd5",
    "axes.labelcolor": _SOFT,
    "xtick.color": _SOFT,
    "ytick.color": _SOFT,
    "text.color": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
"""Look of the axes of all these figures."""


def data_uri(figure: Figure) -> str:
    """Encode a figure as a PNG data URI for a page, and close it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=140, format="png", metadata={"Software": None})
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def channel_units(about: Mapping[str, Any]) -> dict[str, str]:
    """Units of channels: by kind, and by name for joints that slide, which `records.json` lists."""
    return UNITS | {f"{kind}.{joint}": unit for joint in about.get("sliding", ()) for kind, unit in SLIDING_UNITS.items()}


def largest(values: Mapping[str, float], count: int) -> list[str]:
    """The `count` channels with the largest values, in the order of `values`."""
    kept = sorted(values, key=lambda name: -values[name])[:count]
    return [name for name in values if name in kept]


def draw_residuals(
    series: Mapping[str, Array], role: str, channels: Sequence[str], units: Mapping[str, str] | None = None
) -> str:
    """Draw residuals of one record over time, before and after on the same axes, in units of the noise.

    Args:
        series: `{role}/time` [T], `/before` and, where something was fitted, `/after` [T, C], `/sigma` [C]; see
            `gsbridge.gap.workflow`.
        role: Record.
        channels: Names of the columns.
        units: Unit of each kind of channel, or of a channel alone, for the right axis.

    Returns:
        A PNG as data URI.
    """
    units = units or UNITS
    before, after = series[f"{role}/before"], series.get(f"{role}/after")
    sizes = {name: float(np.sqrt((before[:, k] ** 2).mean())) for k, name in enumerate(channels)}
    chosen = largest(sizes, SHOWN)
    time = series[f"{role}/time"]
    with plt.rc_context(PLAIN):
        figure, axes = plt.subplots(
            len(chosen), 1, figsize=(11, 1.2 + 1.75 * len(chosen)), sharex=True, squeeze=False, layout="constrained"
        )
        for axis, name in zip(axes[:, 0], chosen, strict=True):
            column = channels.index(name)
            axis.axhspan(-2, 2, color=NOISE, alpha=0.22, linewidth=0, label="noise (± 2 standard deviations)")
            axis.plot(time, before[:, column], color=BEFORE, linewidth=1.1, label="before: measured less model")
            if after is not None:
                axis.plot(time, after[:, column], color=AFTER, linewidth=1.1, label="after: measured less explanation")
            axis.set_title(channel_name(name), loc="left", fontsize=11, fontweight="bold")
            axis.set_ylabel("× noise")
            axis.margins(x=0.005)
            sigma = float(series[f"{role}/sigma"][column])
            beside = axis.secondary_yaxis("right", functions=(lambda y, s=sigma: y * s, lambda y, s=sigma: y / s))
            beside.set_ylabel(units.get(name, units.get(name.split(".")[0], "")))
            beside.spines["right"].set_visible(False)
        axes[-1, 0].set_xlabel("time, s")
        lines, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside upper center", ncols=3, frameon=False)
        return data_uri(figure)


def draw_channels(channels: Mapping[str, tuple[float, float]], explained: bool) -> str:
    """Draw the root mean square residual of each channel before and after, against the noise.

    Args:
        channels: Residual before and after by channel, in units of the noise.
        explained: Whether something was fitted, so that there are residuals after it.
    """
    names = largest({name: max(pair) for name, pair in channels.items()}, ROWS)
    with plt.rc_context(PLAIN):
        figure, axis = plt.subplots(figsize=(11, 0.95 + 0.36 * len(names)), layout="constrained")
        for row, name in enumerate(names):
            a, b = (max(value, 0.5) for value in channels[name])
            if explained:
                axis.plot([a, b], [row, row], color="#c4ccd5", linewidth=2.5, zorder=1, solid_capstyle="round")
                axis.scatter([b], [row], s=52, color=AFTER, zorder=3, label="after" if row == 0 else None)
            axis.scatter([a], [row], s=52, color=BEFORE, zorder=2, label="before" if row == 0 else None)
        axis.axvline(1.0, color=NOISE, linewidth=1.4, linestyle=(0, (4, 3)), label="noise alone")
        axis.set_yticks(range(len(names)), [channel_name(name) for name in names])
        axis.set_ylim(len(names) - 0.5, -0.5)
        _log_ticks(axis, max(max(channels[name]) for name in names))
        axis.set_xlabel("root mean square residual, × noise")
        axis.spines["left"].set_visible(False)
        axis.tick_params(axis="y", length=0, labelcolor=_INK)
        figure.legend(loc="outside upper center", ncols=3, frameon=False)
        return data_uri(figure)


def _log_ticks(axis: Any, top: float) -> None:
    """Make the x axis logarithmic, in multiples of the noise, with readable numbers."""
    axis.set_xscale("log")
    top = max(top * 1.25, 2.2)
    axis.set_xlim(0.45, top)
    ticks = [tick for tick in (0.5, 1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000, 1e4, 1e5) if tick <= top]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()


def draw_residual_map(before: Mapping[str, Any], after: Mapping[str, Any] | None) -> str:
    """Draw the map of residuals, channels by phase and state, and below it the map that the explanation leaves.

    Args:
        before: The map, as `gsbridge.gap.diagnosis.residual_map.ResidualMap.record` gives it.
        after: The map with the best explanation; None where there is none.
    """
    maps = [(title, found) for title, found in (("before", before), ("after", after)) if found is not None]
    values = np.array(before["values"], dtype=float)
    peaks = {name: float(np.nanmax(row, initial=0.0)) for name, row in zip(before["channels"], values, strict=True)}
    rows = [before["channels"].index(name) for name in largest(peaks, ROWS)]
    groups = before["groups"]
    columns = [column for names in groups.values() for column in names]
    norm = LogNorm(1.0, max(np.nanmax(values, initial=1.0), 3.0))
    with plt.rc_context({**PLAIN, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure, axes = plt.subplots(
            len(maps),
            1,
            figsize=(11, 1.3 + len(maps) * (0.45 + 0.34 * len(rows))),
            squeeze=False,
            sharex=True,
            layout="constrained",
        )
        for axis, (title, found) in zip(axes[:, 0], maps, strict=True):
            shown, marked = np.array(found["values"], dtype=float)[rows], np.array(found["marked"], dtype=bool)[rows]
            place = 0
            for name, members in groups.items():
                edges = np.arange(place, place + len(members) + 1) + 0.35 * list(groups).index(name)
                part = slice(place, place + len(members))
                axis.pcolormesh(
                    edges, np.arange(len(rows) + 1), np.clip(shown[:, part], 1.0, None), norm=norm, cmap=_HEAT,
                    edgecolors="white", linewidth=1.5,
                )  # fmt: skip
                for row in range(len(rows)):
                    for column in range(part.start, part.stop):
                        _cell(axis, edges[column - place] + 0.5, row + 0.5, shown[row, column], marked[row, column], norm)
                place += len(members)
            axis.set_yticks(np.arange(len(rows)) + 0.5, [channel_name(found["channels"][row]) for row in rows])
            axis.set_ylim(len(rows), 0)
            axis.tick_params(length=0, labelcolor=_INK)
            axis.set_title(title, loc="left", fontsize=11, fontweight="bold")
        shifts = [0.35 * k for k, members in enumerate(groups.values()) for _ in members]
        axes[-1, 0].set_xticks(
            np.arange(len(columns)) + 0.5 + np.array(shifts), columns, rotation=35, ha="right", rotation_mode="anchor"
        )
        place = 0
        for k, (name, members) in enumerate(groups.items()):
            axes[0, 0].text(
                place + 0.35 * k + len(members) / 2,
                -0.12,
                name,
                ha="center",
                va="bottom",
                fontsize=9.5,
                color=_SOFT,
                clip_on=False,
            )
            place += len(members)
        return data_uri(figure)


def _cell(axis: Any, x: float, y: float, value: float, marked: bool, norm: LogNorm) -> None:
    """Write the number of a cell, bold where noise alone does not explain it."""
    if not np.isfinite(value):
        axis.text(x, y, "·", ha="center", va="center", color=_SOFT, fontsize=9)
        return
    text = f"{value:.1f}" if value < 10 else f"{value:.0f}"
    dark = float(norm(max(value, 1.0))) > 0.6
    axis.text(
        x, y, text, ha="center", va="center", fontsize=9, color="white" if dark else _INK if marked else _SOFT,
        fontweight="bold" if marked else "normal",
    )  # fmt: skip


PATHS = 6
"""Number of throws whose paths are drawn."""

MEASURED = "#1d2733"

_BINS = 40
"""Number of time bins in which distances are averaged."""

_BAND = (0.1, 0.9)
"""Quantiles of the throws' distances at the two edges of a band."""


def draw_throws(series: Mapping[str, Array], role: str, floor: float | None, names: Sequence[str]) -> str:
    """Draw distances over time, and some throws seen from above.

    Args:
        series: `{role}/throw` (its number), `/time` (s) and `/before` (m) [N], `/position` and `/nominal_position` (m) [N, 3],
            and `/explained_position` and `/after` where something was fitted; see `gsbridge.gap.contact.workflow`.
        role: `fit`, `select` or `verify`: the throws that are drawn.
        floor: Distance that noise and chaos alone explain, mean over throws, mm; None where it is not known.
        names: Names of the throws in the user's file.

    Returns:
        A PNG as data URI.
    """
    with plt.rc_context(PLAIN):
        figure = plt.figure(figsize=(11, 7.6), layout="constrained")
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 1.15]).ravel()
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
        _draw_paths(below.subplots(2, PATHS // 2), series, role, names)
        below.suptitle("Seen from above: throws from small to large distance, in metres", x=0.01, ha="left", fontsize=11)
        return data_uri(figure)


def _spread(axis: Axes, time: Array, distance: Array, colour: str, text: str) -> None:
    """Draw the mean distance over time, and the band in which most throws lie."""
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


def _draw_paths(axes: Array, series: Mapping[str, Array], role: str, names: Sequence[str]) -> None:
    """Draw the paths of some throws, picked evenly in the order of their mean distance before."""
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
        axis.set_title(f"throw {names[throw]}: {1e3 * sizes[throw]:.3g} mm before", fontsize=9.5, loc="left")
        axis.tick_params(labelsize=8)
        axis.locator_params(nbins=4)
        axis.margins(0.12)
    for axis in axes.ravel()[len(chosen) :]:
        axis.set_axis_off()
    axes.ravel()[0].plot([], [], color=MEASURED, linestyle=(0, (4, 2)), label="measured")
    axes.ravel()[0].legend(frameon=False, fontsize=9, loc="best")


def draw_each(before: Array, after: Array | None, floor: float | None) -> str:
    """Draw the mean distance of every throw before and after, sorted by the distance before.

    Args:
        before: Mean distance of each throw before, mm. [N].
        after: The same with the explanation, mm; None where nothing was fitted. [N].
        floor: Distance that noise and chaos alone explain, mean over throws, mm; None where it is not known.
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
