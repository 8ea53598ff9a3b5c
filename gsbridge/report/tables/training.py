"""What trainings took and reached: one row per policy, from its record and its learning curve."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.result_paths import cell_of, seed_of
from gsbridge.report.tables.rows import Row, number, read_rows, write_rows
from gsbridge.report.tables.success import DASH, cell_title, percent
from gsbridge.report.tables.success_rows import CELL_COLUMNS, cell_in, cell_order

PARTS = ("environment", "act", "update", "evaluate")
CURVE_COLUMNS = ("step", "success", *(f"cpu_{part}_s" for part in PARTS))
"""Columns that are read from a learning curve."""

ENOUGH = 0.95
"""Success rate in an evaluation from which on a policy counts as trained, 0..1."""

COLUMNS = (
    *(*CELL_COLUMNS, "seed", "steps", "best_success", "retest_success", "controller_success"),
    *(*(f"cpu_{part}_min" for part in PARTS), "cpu_min", "steps_to_95", "cpu_min_to_95", "replay_mb"),
    *("frames_per_second", "status", "reasons"),
)
"""`cpu_*_min`: CPU minutes of the whole training, by what they were spent on; drawing the pictures is part of `environment`.
`cpu_min_to_95`: CPU minutes, evaluations included, until the first evaluation with at least 95 % success. `retest_success`:
success of the chosen weights from start poses other than those they were chosen on. `frames_per_second`: environment steps,
each with its picture, per second of acting and learning, evaluations aside; empty for trainings that did not record it."""


def training_row(training_json: str | Path, curve_csv: str | Path) -> dict[str, Any]:
    """Row of one policy.

    Args:
        training_json: `policies/{cell}/seed{seed}/training.json`.
        curve_csv: `training.csv` beside it.

    Raises:
        InputError: A file is damaged or stands in another folder.
    """
    cell, rest = cell_of(training_json, "policies")
    record = read_json(training_json)
    curve = read_rows(curve_csv, CURVE_COLUMNS)
    try:
        cpu = [sum(number(row[f"cpu_{part}_s"]) or 0.0 for part in PARTS) / 60 for row in curve]
        enough = [k for k, row in enumerate(curve) if (number(row["success"]) or 0.0) >= ENOUGH]
        last = {part: (number(curve[-1][f"cpu_{part}_s"]) or 0.0) / 60 if curve else None for part in PARTS}
        return {
            **{name: getattr(cell, name) for name in CELL_COLUMNS},
            "seed": seed_of(rest[0], training_json),
            "steps": record.get("steps"),
            "best_success": _known(record.get("success")),
            **{f"{name}_success": _known(record.get(f"{name}_success")) for name in ("retest", "controller")},
            **{f"cpu_{part}_min": minutes for part, minutes in last.items()},
            "cpu_min": cpu[-1] if cpu else None,
            "steps_to_95": int(float(curve[enough[0]]["step"])) if enough else None,
            "cpu_min_to_95": cpu[enough[0]] if enough else None,
            "replay_mb": _known(record.get("replay_mb")),
            "frames_per_second": _known(record.get("frames_per_second")),
            "status": record.get("status", "pass"),
            "reasons": "; ".join(record.get("reasons", [])),
        }
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            training_json, f"the policy's record or its learning curve is damaged ({error})", "Train the policy again"
        ) from error


def _known(value: Any) -> float | None:
    return None if value is None else float(value)


def write_training_rows(policies: Sequence[str | Path], curves: Sequence[str | Path], out_csv: str | Path) -> None:
    """Write `rows/training.csv`.

    Args:
        policies: `training.json` of each policy.
        curves: `training.csv` of each, in the same order.
        out_csv: The rows.
    """
    rows = [training_row(policy, curve) for policy, curve in zip(policies, curves, strict=True)]
    write_rows(out_csv, COLUMNS, sorted(rows, key=lambda row: (*cell_order(cell_in(row)), row["seed"])))


def training_table(rows: Sequence[Row]) -> Table | None:
    """What each training took and reached, for print; None without rows."""
    if not rows:
        return None
    body = []
    for row in rows:
        cell = cell_in(row)
        body.append(
            (
                cell_title(cell),
                TITLES.get(cell.renderer, cell.renderer),
                row["seed"],
                row["steps"] or DASH,
                *(percent(number(row[f"{name}_success"]), 0) for name in ("best", "retest", "controller")),
                _minutes(row["cpu_min"]),
                *(_minutes(row[f"cpu_{part}_min"]) for part in PARTS),
                _minutes(row["cpu_min_to_95"]),
                f"{float(row['replay_mb']):.0f}" if row["replay_mb"] else DASH,
                f"{float(row['frames_per_second']):.0f}" if row["frames_per_second"] else DASH,
                row["status"],
            )
        )
    columns: tuple[str, ...] = ("cell", "trained on", "seed", "steps", "best", "retest", "controller")
    columns += ("CPU min", "of it simulate", "act", "learn", "evaluate", "CPU min to 95 %", "replay MB", "frames/s", "status")
    notes = (
        "Best: success in the evaluation that chose the weights; retest: the same weights from other random start poses; "
        "controller: the simple controller that the policy began from.",
        "CPU minutes are those of one thread, without further environments' own processes, split into simulating (physics and "
        "drawing pictures), acting, learning and evaluating. To 95 %: until the first evaluation with so much success. Replay: "
        "memory for past steps. Frames per second: steps with their pictures, while acting and learning.",
    )
    return Table("Training", columns, tuple(body), notes, status=tuple(row["status"] for row in rows))


def _minutes(text: str) -> str:
    return f"{float(text):.1f}" if text else DASH
