"""Closing the loop: successes before, in the changed world, and after, with what the finding cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsbridge.files import atomic_file, read_json
from gsbridge.report.figures.loop_rows import COLUMNS, draw_rows, field_of, loop_rows, rows_table
from gsbridge.report.tables.formats import markdown
from gsbridge.report.tables.rows import write_rows


@dataclass(frozen=True)
class LoopFiles:
    """What the table is made of.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        trials: Trials of each row.
        trainings: `training.json` of the policies, before and after.
        logged: `trials.json` of the logged worlds.
        calibration: `calibration.json`.
        findings: `findings.json` of the reference and of the changed world.
        amendment: `amendment.json`.
    """

    cell: Mapping[str, Any]
    plan: Sequence[Mapping[str, str]]
    trials: Sequence[str | Path]
    trainings: Sequence[str | Path]
    logged: Sequence[str | Path]
    calibration: str | Path
    findings: Sequence[str | Path]
    amendment: str | Path


def write_loop(files: LoopFiles, rows_csv: str | Path, page: str | Path, figure: str | Path) -> None:
    """Write the rows, a page in Markdown and a figure.

    Args:
        files: What they are made of.
        rows_csv: The rows.
        page: The page.
        figure: The picture.

    Raises:
        InputError: A file is missing or damaged.
    """
    rows = loop_rows(files.cell, files.plan, files.trials, files.trainings)
    write_rows(rows_csv, COLUMNS, rows)
    draw_rows(rows, figure)
    with atomic_file(page) as temporary:
        temporary.write_text(_page(files, rows), encoding="utf-8")


def _page(files: LoopFiles, rows: Sequence[Mapping[str, Any]]) -> str:
    """The page."""
    table = rows_table(files.cell, rows)
    reference, changed = (read_json(path) for path in files.findings)
    calibration, amendment = read_json(files.calibration), read_json(files.amendment)
    lines = [
        "# Closing the loop: the arm",
        "",
        markdown(table),
        "",
        "## What was found",
        "",
        f"- The world in which the policy works, against the simulation: **{reference['verdict']}**. {reference['sentence']}",
        f"- Calibrated there, the residual on a record that was not fitted falls from {calibration['before']['verify']:.3g} to"
        f" {calibration['after']['verify']:.3g} times the noise of the sensors; the commands take"
        f" {1e3 * calibration['delay']:.1f} ms.",
        f"- The changed world, against the calibrated arm: **{changed['verdict']}**. {changed['sentence']}",
        *(f"- Left out: {reason}." for reason in amendment["reasons"]),
        "",
        "## The price",
        "",
        *_price(files, calibration, (reference, changed)),
        "",
    ]
    return "\n".join(lines)


def _price(files: LoopFiles, calibration: Mapping[str, Any], findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Records, simulations and minutes."""
    logged = [trial for path in files.logged for trial in field_of(path, "trials")]
    failed = sum(not trial["success"] for trial in logged)
    seconds = sum(trial["seconds"] for trial in logged)
    bank = sum(item["simulations"]["bank"] for item in findings)
    case = sum(item["simulations"]["case"] for item in findings)
    minutes = (calibration["seconds"] + sum(item["seconds"] for item in findings)) / 60
    training = sum(field_of(files.trainings[-1], "cpu_seconds").values()) / 60
    return [
        f"- {len(logged)} records of {seconds:.0f} s together, {failed} of them of failed trials.",
        f"- {calibration['simulations']} simulations of the arm to calibrate, {bank} for the banks of two cases, {case} for"
        f" their diagnosis: {minutes:.0f} minutes.",
        f"- A new training of {field_of(files.trainings[-1], 'steps')} steps: {training:.0f} minutes of processor time.",
    ]
