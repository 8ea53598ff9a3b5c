"""Figures of the blind benchmark: outcomes by size, comparison of methods, confusion matrix, calibration of probabilities."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.report.figures.legend import legend_above
from gsbridge.report.gap.figures import PLAIN, data_uri
from gsbridge.report.scores.risk_coverage import answered, best_measure, risk_at, risk_coverage

OUTCOMES = {
    "right": ("named right", "#2c7a4b"),
    "covered": ("ambiguous, truth inside", "#8fc1a1"),
    "abstained": ("none of the known", "#b9c3cd"),
    "missed": ("not noticed", "#dde3ea"),
    "wrong": ("wrong name", "#b3261e"),
}
"""Legend and colour of each outcome in the stacked bars, from the bottom."""

METHODS = {
    "gsbridge": "gsbridge",
    "largest_change": "fit everything, name the largest change",
    "training_bic": "best training BIC",
    "cosine": "signature cosine alone",
    "sparse": "sparse regression alone",
    "group_lasso": "group lasso, cross-validated",
    "cma_es": "CMA-ES, as many simulations",
    "cma_es_tenfold": "CMA-ES, ten times as many",
}
"""Titles of the methods that name hidden effects."""

TIERS = {
    "t0": "T0: analytic truth",
    "t1": "T1: PyBullet truth",
    "t2": "T2: MuJoCo truth",
    "t3": "T3: real logs",
    "t4": "T4: images",
    "t5": "T5: thrown bodies",
    "t7": "T7: further machines",
}

_ACCENT, _SOFT = "#1f6f8b", "#5b6b7b"

_MARKS = (
    ("o", _ACCENT),
    ("s", "#b08a4f"),
    ("^", "#8a5fa8"),
    ("D", "#c0573d"),
    ("v", "#5d7f3b"),
    ("P", "#6b7280"),
    ("X", "#3f7fbf"),
    ("<", "#a3416f"),
)
_COUNTS = LinearSegmentedColormap.from_list("counts", ["#eaf2f5", "#1f6f8b"])
_WRONG = LinearSegmentedColormap.from_list("wrong", ["#f6dcda", "#b3261e"])


def effect_title(name: str, tier: str) -> str:
    """Title of an effect in a tier; the words of its name where the tier's catalogue does not hold it."""
    effect = IMAGE_EFFECTS.get(name) if tier == "t4" else JOINT_EFFECTS.get(name) or BODY_EFFECTS.get(name)
    return effect.title if effect else name.replace("_", " ")


def tier_title(tier: str) -> str:
    """Title of a tier; its name in capitals where it has none."""
    return TIERS.get(tier, tier.upper())


def draw_sizes(tiers: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw the shares of outcomes by the size of the hidden effect, one panel per tier; a data URI.

    Args:
        tiers: Our scores by tier, with `by_units`.
    """
    with plt.rc_context(PLAIN):
        figure, axes = plt.subplots(
            1, len(tiers), figsize=(3.9 * max(len(tiers), 2), 3.7), squeeze=False, sharey=True, layout="constrained"
        )
        for axis, (tier, scores) in zip(axes[0], tiers.items(), strict=True):
            rows = [row for row in scores["by_units"] if row["right"]["n"]]
            base = np.zeros(len(rows))
            for name, (label, colour) in OUTCOMES.items():
                shares = np.array([100 * (row[name]["value"] or 0.0) for row in rows])
                axis.bar(range(len(rows)), shares, 0.72, base, color=colour, label=label)
                base += shares
            rates = [row["right"] for row in rows]
            middles = [100 * rate["value"] for rate in rates]
            errors = [[m - 100 * r["ci95_low"] for m, r in zip(middles, rates, strict=True)],
                      [100 * r["ci95_high"] - m for m, r in zip(middles, rates, strict=True)]]  # fmt: skip
            axis.errorbar(
                range(len(rows)), middles, np.maximum(errors, 0), fmt="none", ecolor="#1d2733", capsize=3, linewidth=1
            )
            axis.set_xticks(range(len(rows)), [f"{_from(row['units'])}\n(n = {row['right']['n']})" for row in rows])
            axis.set_title(tier_title(tier), loc="left", fontsize=11, fontweight="bold")
            axis.set_xlabel("size, units of the detection limit")
        axes[0, 0].set_ylabel("cases, %")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        legend_above(figure, handles, labels, 10.5)
        return data_uri(figure)


def _from(units: float) -> str:
    """Label a class of sizes by its lower edge."""
    return f"≥ {units:g}" if units else "less"


def draw_methods(tier: str, methods: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw right against wrong names of every method in one tier, as a data URI; the upper left corner is best.

    Args:
        tier: The tier.
        methods: Scores by method.
    """
    with plt.rc_context(PLAIN):
        figure, axis = plt.subplots(figsize=(6.6, 3.9), layout="constrained")
        for number, (method, scores) in enumerate(methods.items()):
            right, wrong = scores["named_right"], scores["named_wrong"]
            if right["value"] is None or wrong["value"] is None:
                continue
            x, y = 100 * wrong["value"], 100 * right["value"]
            reach = [[max(value, 0.0)] for value in (x - 100 * wrong["ci95_low"], 100 * wrong["ci95_high"] - x)]
            rise = [[max(value, 0.0)] for value in (y - 100 * right["ci95_low"], 100 * right["ci95_high"] - y)]
            ours, (mark, colour) = method == "gsbridge", _MARKS[number % len(_MARKS)]
            axis.errorbar(
                x, y, rise, reach, fmt=mark, color=colour, capsize=2, markersize=8 if ours else 6, linewidth=1,
                label=METHODS.get(method, method),
            )  # fmt: skip
        # A legend, because the best methods lie too close together for labels beside them.
        axis.legend(loc="lower left", frameon=False, fontsize=9.5)
        axis.set_xlim(-2, 102)
        axis.set_ylim(-2, 104)
        axis.set_xlabel("wrong names, % of single effects")
        axis.set_ylabel("right names, % at 5 units and more")
        axis.set_title(tier_title(tier), loc="left", fontsize=11, fontweight="bold")
        return data_uri(figure)


def draw_curves(lists: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Draw risk against coverage of every method on the same cases, as a data URI; lower is better.

    Args:
        lists: Cases by method, as `gsbridge.report.scores.risk_coverage` takes them; the first method is this package's own.
    """
    own = answered(next(iter(lists.values())))
    with plt.rc_context(PLAIN):
        figure, axis = plt.subplots(figsize=(6.6, 4.8), layout="constrained")
        for number, (method, rows) in enumerate(lists.items()):
            measure = best_measure(rows, own)
            if measure is None:
                continue
            coverage, risk = risk_coverage(rows, measure)
            ours, (mark, colour) = not number, _MARKS[number % len(_MARKS)]
            axis.plot(
                100 * coverage, 100 * risk, color=colour, label=METHODS.get(method, method),
                marker=mark if len(coverage) == 1 else None, linewidth=2.4 if ours else 1.3, zorder=3 if ours else 2,
            )  # fmt: skip
            at = risk_at(rows, own)
            if ours and at is not None:
                axis.plot(100 * own, 100 * at, "o", color=colour, markersize=8, zorder=4)
        axis.set_xlim(0, 102)
        axis.set_ylim(-2, 102)
        axis.set_xlabel("coverage: cases that are answered, %")
        axis.set_ylabel("risk: wrong among the answers, %")
        # The legend stands above the axes, because curves may run anywhere in them.
        figure.legend(*axis.get_legend_handles_labels(), loc="outside upper left", ncols=2, frameon=False, fontsize=9)
        return data_uri(figure)


def confusion_cells(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], int]:
    """Count cases by hidden effect and answer; ambiguous answers share a column, and so do right effects at another joint."""
    out: dict[tuple[str, str], int] = {}
    for row in rows:
        answer = row["answer"]
        if answer.startswith("one of "):
            answer = "ambiguous"
        elif answer.endswith(" elsewhere"):
            answer = "other joint"
        out[row["hidden"], answer] = out.get((row["hidden"], answer), 0) + row["cases"]
    return out


SILENT = ("ambiguous", "none_of_the_known", "not_attributable", "not_enough_excitation", "no_discrepancy", "other joint")
"""Answers that name no single effect, and right effects at another joint: the last columns of the matrix."""


def _axes(cells: Mapping[tuple[str, str], int]) -> tuple[list[str], list[str]]:
    """Rows and columns of the matrix: right answers on a diagonal, the answers in `SILENT` at the right."""
    hidden = sorted({a for a, _ in cells})
    named = sorted({b for _, b in cells} - set(SILENT))
    columns = [name for name in hidden if name in named] + [name for name in named if name not in hidden]
    return hidden, columns + [name for name in SILENT if any(b == name for _, b in cells)]


def _confusion_size(hidden: Sequence[str], columns: Sequence[str], tier: str) -> tuple[float, float]:
    """Width and height of the matrix with its labels, inches."""
    beside, below = (max((len(effect_title(name, tier)) for name in names), default=0) for names in (hidden, columns))
    return 0.7 + 0.068 * beside + 0.36 * len(columns), 0.6 + 0.068 * below + 0.3 * len(hidden)


def confusion_width(rows: Sequence[Mapping[str, Any]], tier: str) -> float:
    """Width at which the matrix of a tier is shown, rem."""
    return round(6 * _confusion_size(*_axes(confusion_cells(rows)), tier)[0], 1)


def draw_confusion(rows: Sequence[Mapping[str, Any]], tier: str) -> str:
    """Draw the confusion matrix of hidden effects by answers, as a data URI; blue is right or left open, red is wrong.

    Args:
        rows: Rows with `hidden`, `answer` and `cases`.
        tier: Tier that the effects belong to.
    """
    cells = confusion_cells(rows)
    hidden, columns = _axes(cells)
    with plt.rc_context({**PLAIN, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure, axis = plt.subplots(figsize=_confusion_size(hidden, columns, tier), layout="constrained")
        largest = max(cells.values(), default=1)
        for (a, b), count in cells.items():
            row, column = hidden.index(a), columns.index(b)
            wrong = b not in SILENT[:-1] and a != b
            shade = (_WRONG if wrong else _COUNTS)(count / largest)
            axis.add_patch(plt.Rectangle((column, row), 1, 1, facecolor=shade, edgecolor="white"))
            ink = "white" if count / largest > 0.5 else "#1d2733"
            axis.text(column + 0.5, row + 0.5, str(count), ha="center", va="center", fontsize=8.5, color=ink)
        axis.set_xlim(0, max(len(columns), 1))
        axis.set_ylim(max(len(hidden), 1), 0)
        axis.set_xticks(np.arange(len(columns)) + 0.5, [effect_title(name, tier) for name in columns], rotation=90)
        axis.set_yticks(np.arange(len(hidden)) + 0.5, [effect_title(name, tier) for name in hidden])
        axis.tick_params(length=0, labelcolor="#1d2733", labelsize=9)
        axis.set_xlabel("answered")
        axis.set_ylabel("hidden")
        axis.grid(visible=True, color="#eef1f4", linewidth=0.6)
        axis.set_axisbelow(True)
        return data_uri(figure)


def draw_calibration(tiers: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw how often the best explanation is right against the probability stated for it, as a data URI.

    Args:
        tiers: Our scores by tier, with `calibration`.
    """
    colours = itertools.cycle(("#1f6f8b", "#c2660c", "#2c7a4b", "#7a4f9a", "#b03a52", "#6b6f1d", "#4a5a6a"))
    with plt.rc_context(PLAIN):
        figure, axis = plt.subplots(figsize=(4.6, 3.9), layout="constrained")
        axis.plot([0, 1], [0, 1], color="#b9c3cd", linestyle=(0, (4, 3)), linewidth=1.2)
        for colour, (tier, scores) in zip(colours, tiers.items(), strict=False):
            rows = [row for row in scores["calibration"] if row["right"]["n"]]
            x, y = [row["said_mean"] for row in rows], [row["right"]["value"] for row in rows]
            errors = [[b - row["right"]["ci95_low"] for b, row in zip(y, rows, strict=True)],
                      [row["right"]["ci95_high"] - b for b, row in zip(y, rows, strict=True)]]  # fmt: skip
            axis.errorbar(x, y, np.maximum(errors, 0), fmt="o", color=colour, capsize=2, linewidth=1, label=tier_title(tier))
        axis.set_xlim(-0.03, 1.03)
        axis.set_ylim(-0.03, 1.03)
        axis.set_xlabel("probability that was stated")
        axis.set_ylabel("share that was right")
        if len(tiers) > 0:
            axis.legend(frameon=False, loc="upper left", fontsize=9)
        return data_uri(figure)
