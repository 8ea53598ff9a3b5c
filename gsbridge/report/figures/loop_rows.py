"""Rows of a closed loop, policies before and after something changed, with their table and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.statistics import wilson_interval
from gsbridge.report.tables.trials import STRICT_WORLD, read_trials

COLUMNS = (
    *("task", "object", "background", "variant", "world", "trials", "successes", "success_rate", "ci95_low", "ci95_high"),
    "training_steps",
)
"""`training_steps`: environment steps that the policy learned from."""


def loop_rows(
    cell: Mapping[str, Any],
    plan: Sequence[Mapping[str, str]],
    trials: Sequence[str | Path],
    trainings: Sequence[str | Path],
) -> list[dict[str, Any]]:
    """Success of each policy in each world.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        trials: Trials of each row.
        trainings: `training.json` of the policies.

    Raises:
        InputError: A file is missing or damaged.
    """
    steps = {Path(path).parts[-3]: int(field_of(path, "steps")) for path in trainings}
    return [_row(cell, entry, path, steps) for entry, path in zip(plan, trials, strict=True)]


def field_of(path: str | Path, name: str) -> Any:
    """A field of a record."""
    content = read_json(path)
    if name not in content:
        raise InputError(path, f"it has no '{name}'", "Run the rule that makes it again")
    return content[name]


def _row(cell: Mapping[str, Any], plan: Mapping[str, str], path: str | Path, steps: Mapping[str, int]) -> dict[str, Any]:
    """One policy in one world."""
    trials = read_trials(path)
    good = trials.judged(plan["world"])
    low, high = wilson_interval(int(good.sum()), len(trials))
    return {
        **{name: cell[name] for name in ("task", "object", "background")},
        "variant": plan["variant"],
        "world": plan["world"],
        "trials": len(trials),
        "successes": int(good.sum()),
        "success_rate": float(good.mean()),
        "ci95_low": low,
        "ci95_high": high,
        "training_steps": steps[plan["variant"]],
    }


def rows_table(cell: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Table:
    """The rows as a table for people."""
    return Table(
        title=f"Closing the loop, {cell['task']}: {cell['object']} on {cell['background']}",
        columns=("policy", "world", "successes", "rate (95 %)", "learned from"),
        rows=tuple(
            (
                row["variant"],
                row["world"],
                f"{row['successes']}/{row['trials']}",
                f"{row['success_rate']:.1%} ({row['ci95_low']:.1%} to {row['ci95_high']:.1%})",
                f"{row['training_steps']} steps",
            )
            for row in rows
        ),
        notes=(f"One policy each, seed {cell['seed']}. Both sets of start poses. {STRICT_WORLD} is the simulation.",),
    )


def draw_rows(rows: Sequence[Mapping[str, Any]], out: str | Path) -> None:
    """A bar and its interval for each row."""
    figure, axis = plt.subplots(figsize=(7.0, 0.45 * len(rows) + 1.1), layout="constrained")
    rates = [row["success_rate"] for row in rows]
    errors = [
        [rate - row["ci95_low"] for rate, row in zip(rates, rows, strict=True)],
        [row["ci95_high"] - rate for rate, row in zip(rates, rows, strict=True)],
    ]
    axis.barh(range(len(rows)), rates, xerr=errors, color="#1f6f8b", ecolor="#555555", height=0.6, capsize=3)
    labels = [f"{row['variant']} in {row['world']} ({row['successes']}/{row['trials']})" for row in rows]
    axis.set_yticks(range(len(rows)), labels)
    axis.invert_yaxis()
    axis.set_xlim(0, 1.05)
    axis.set_xlabel("success rate, 95 % interval")
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130)
    plt.close(figure)
