"""Recording of a training: its learning curve, every figure over environment steps."""

from __future__ import annotations

import csv
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.policy.curve import COLUMNS, Row
from gsbridge.report.recordings.recording import figures_text, recording


def read_curve(path: str | Path) -> list[Row]:
    """Rows of a learning curve; None where a figure is unknown.

    Raises:
        InputError: The file is missing, damaged or empty.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise ValueError("its columns are not those of a learning curve")
            rows = [{name: float(value) if value else None for name, value in row.items()} for row in reader]
    except (OSError, TypeError, ValueError) as error:
        raise InputError(path, f"the learning curve cannot be read ({error})", "Train the policy again") from error
    if not rows:
        raise InputError(path, "the learning curve has no rows", "Train the policy again")
    return rows


GROUPS = {
    "success": ("success", "success_q1", "success_q2", "success_q3", "success_q4", "training_success", "controller_success"),
    "value": ("q_start", "return_start", "target_mean", "target_max", "advantage", "critic_loss"),
    "actor": ("imitation_loss", "position_loss", "entropy", "surprise_max"),
    "schedule": ("actor_share", "imitated_share", "lambda", "alpha", "alarm"),
    "seconds": tuple(name for name in COLUMNS if name.startswith("cpu_")),
}
"""Columns of the curve that share a plot, by the plot's name."""

_FIGURES = ("algo", "success", "retest_success", "controller_success", "steps", "updates", "target_alarms", "replay_mb", "seed")


def record_training(curve: str | Path, record: str | Path, name: str, out: str | Path) -> None:
    """Record the learning curve of one policy.

    Args:
        curve: `training.csv`.
        record: Record of the stage.
        name: Name of the policy.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    rows, summary = read_curve(curve), read_json(record)
    plots = [rrb.TimeSeriesView(origin=group, name=group) for group in GROUPS]
    layout = rrb.Horizontal(rrb.Grid(*plots), rrb.TextDocumentView(origin="summary"), column_shares=[4, 1])
    with recording(out, "training", name, layout) as stream:
        stream.log("summary", rr.TextDocument(figures_text(summary, _FIGURES), media_type="text/markdown"), static=True)
        for row in rows:
            stream.set_time("step", sequence=int(row["step"] or 0))
            for group, columns in GROUPS.items():
                for column in columns:
                    value = row[column]
                    if value is not None:
                        stream.log(f"{group}/{column}", rr.Scalars(value))
