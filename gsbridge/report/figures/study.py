"""The study: ways of learning compared at equal environment steps, with a good controller and with one that is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.environment.biased import teacher_name
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.result_paths import CellPaths, cell_of, seed_of
from gsbridge.report.tables.rows import write_rows
from gsbridge.report.tables.severity_rows import INSIDE
from gsbridge.report.tables.statistics import lead_interval, mean_interval, mean_rate
from gsbridge.report.tables.success_rows import read_trials, tallies_in, tallies_text

IMITATION = ("bc", "dagger")
"""Algorithms that only imitate the controller."""

EXACT = "exact"
"""Name of the controller without an offset, the right teacher; see `teacher_name`."""

COLUMNS = (
    *("task", "object", "background", "variant", "algo", "teacher", "seeds", "steps", "trials", "successes"),
    *("success_rate", "ci95_low", "ci95_high", "seed_low", "seed_high", "controller_success_rate", "cpu_min", "by_training"),
)
"""`seed_low`, `seed_high`: smallest and largest rate of a single seed. `controller_success_rate`: success of the controller
that the variant learned from, on the trainings' own start poses; empty for `sac`. `cpu_min`: mean CPU minutes of a training."""


def write_study(trainings: Sequence[str | Path], trials: Sequence[str | Path], rows_csv: str | Path, page: str | Path) -> None:
    """Write the rows of the study and a page in Markdown.

    Args:
        trainings: `training.json` of every variant and seed.
        trials: Trials in simulation of the same policies, in the same order; start poses inside the training square count.
        rows_csv: The rows.
        page: The page.

    Raises:
        InputError: A file is damaged, or policies of one study had unequal numbers of steps.
    """
    groups: dict[CellPaths, list[dict[str, Any]]] = {}
    for training, table in zip(trainings, trials, strict=True):
        cell, rest = cell_of(training, "policies")
        groups.setdefault(cell, []).append(_policy(training, table, seed_of(rest[0], training)))
    rows = [_row(cell, policies) for cell, policies in groups.items()]
    steps = {row["steps"] for row in rows}
    # A training ends with the episode in which it reaches its steps, so that the numbers differ slightly.
    if max(steps) > 1.05 * min(steps):
        raise InputError(
            rows_csv, f"the policies had {min(steps)} to {max(steps)} steps", "Give all variants of the study stop_after: 0"
        )
    write_rows(rows_csv, COLUMNS, rows)
    with atomic_file(page) as temporary:
        temporary.write_text(f"# Study\n\n{verdict(rows)}\n\n{markdown(_table(rows))}\n", encoding="utf-8")


def _policy(training: str | Path, table: str | Path, seed: int) -> dict[str, Any]:
    record, trials = read_json(training), read_trials(table)
    inside = trials.judged("sim")[np.isin(trials.pose_set, INSIDE)]
    try:
        return {
            "seed": seed,
            "algo": record["algo"],
            "teacher": teacher_name([float(value) for value in record["controller_offset"]]),
            "steps": int(record["steps"]),
            "controller": record["controller_success"],
            "cpu_s": sum(record["cpu_seconds"].values()),
            "trials": len(inside),
            "successes": int(inside.sum()),
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(training, f"the record of the training is damaged ({error!r})", "Train the policy again") from error


def _row(cell: CellPaths, policies: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Make the row of one variant, counting the trials of all seeds together."""
    count = sum(policy["trials"] for policy in policies)
    good = sum(policy["successes"] for policy in policies)
    rates = [policy["successes"] / policy["trials"] for policy in policies]
    known = [float(policy["controller"]) for policy in policies if policy["controller"] is not None]
    tallies = [(policy["successes"], policy["trials"]) for policy in policies]
    low, high = mean_interval([tallies])
    return {
        **{name: getattr(cell, name) for name in ("task", "object", "background", "variant")},
        "algo": policies[0]["algo"],
        "teacher": policies[0]["teacher"],
        "seeds": len(policies),
        "steps": max(policy["steps"] for policy in policies),
        "trials": count,
        "successes": good,
        "success_rate": good / count,
        "ci95_low": low,
        "ci95_high": high,
        "seed_low": min(rates),
        "seed_high": max(rates),
        "controller_success_rate": sum(known) / len(known) if known else None,
        "cpu_min": sum(policy["cpu_s"] for policy in policies) / len(policies) / 60,
        "by_training": tallies_text(tallies),
    }


def verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    """State whether SACwB beats the better of two imitations, in a sentence each for the right teacher and the wrong ones."""
    said = []
    for wrong in (False, True):
        taught = [pair for teacher, pair in rivals(rows).items() if (teacher != EXACT) == wrong]
        if taught:
            sides = [[tallies_in(row["by_training"]) for row in side] for side in zip(*taught, strict=True)]
            lead, (low, high) = 100 * (mean_rate(sides[0]) - mean_rate(sides[1])), lead_interval(*sides)
            beats = "beats" if low > 0 else "loses to" if high < 0 else "is not told apart from"
            who = f"{len(taught)} wrong teachers" if wrong else "the right teacher"
            said.append(
                f"With {who}, SACwB **{beats}** the better of behaviour cloning and DAgger: {lead:+.1f} points"
                f" ({100 * low:.1f} to {100 * high:.1f}), ahead with {sum(better(pair) for pair in taught)} of {len(taught)}."
            )
    return "\n\n".join(said).replace("-", "−") or "Nothing is compared: no teacher taught SACwB and both imitations."


def rivals(rows: Sequence[Mapping[str, Any]]) -> dict[str, tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Pair the rows of SACwB and of the better imitation, by teacher; only teachers from which all three learned count."""
    taught: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        taught.setdefault(row["teacher"], {})[row["algo"]] = row
    return {
        teacher: (by["sacwb"], max((by[algo] for algo in IMITATION), key=lambda row: float(row["success_rate"])))
        for teacher, by in taught.items()
        if {"sacwb", *IMITATION} <= set(by)
    }


def better(pair: tuple[Mapping[str, Any], Mapping[str, Any]]) -> bool:
    """Whether the first of two rows succeeds more often."""
    return float(pair[0]["success_rate"]) > float(pair[1]["success_rate"])


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    """The rows for print."""
    first = rows[0]
    body = tuple(
        (
            row["variant"],
            row["algo"],
            row["teacher"],
            "" if row["controller_success_rate"] is None else f"{row['controller_success_rate']:.0%}",
            f"{row['successes']}/{row['trials']}",
            f"{row['success_rate']:.1%} ({row['ci95_low']:.1%} to {row['ci95_high']:.1%})",
            f"{row['seed_low']:.0%} to {row['seed_high']:.0%}",
            f"{row['cpu_min']:.1f}",
        )
        for row in rows
    )
    return Table(
        title=f"Ways of learning, {first['task']}: {first['object']} on {first['background']}, {first['steps']} steps",
        columns=(
            "variant",
            "algorithm",
            "teacher",
            "its success",
            "successes",
            "rate (95 %)",
            "seeds",
            "CPU min",
        ),
        rows=body,
        notes=(
            "Trials in simulation from start poses inside the training square. Controllers are tried on the trainings' own"
            " start poses.",
        ),
    )
