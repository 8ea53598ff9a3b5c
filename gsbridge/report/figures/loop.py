"""Closing the loop: successes before the world changed, in the changed world, and after training anew, with the cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.rows import write_rows
from gsbridge.report.tables.severity_rows import INSIDE
from gsbridge.report.tables.statistics import lead_interval, mean_interval
from gsbridge.report.tables.success_rows import STRICT_WORLD, read_trials

COLUMNS = (
    *("task", "object", "background", "variant", "world", "trials", "successes", "success_rate", "ci95_low", "ci95_high"),
    *("training_steps", "trainings", "successes_each"),
)
"""`training_steps`: mean environment steps that the policies learned from; `successes_each`: successes of each training,
separated by blanks."""


def loop_rows(
    cell: Mapping[str, Any],
    plan: Sequence[Mapping[str, str]],
    trials: Sequence[str | Path],
    trainings: Sequence[str | Path],
) -> list[dict[str, Any]]:
    """Make a row with the success of each policy in each world.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        trials: Tables of trials: those of the first row, one per training, then those of the next.
        trainings: `training.json` of all policies.

    Raises:
        InputError: A file is missing or damaged.
    """
    steps: dict[str, list[int]] = {}
    for path in trainings:
        steps.setdefault(Path(path).parts[-3], []).append(int(field_of(path, "steps")))
    count = len(trials) // len(plan)
    return [_row(cell, entry, trials[count * k : count * (k + 1)], steps) for k, entry in enumerate(plan)]


def field_of(path: str | Path, name: str) -> Any:
    """Read a field of a record."""
    content = read_json(path)
    if name not in content:
        raise InputError(path, f"it has no '{name}'", "Run the rule that makes it again")
    return content[name]


def _row(
    cell: Mapping[str, Any], plan: Mapping[str, str], paths: Sequence[str | Path], steps: Mapping[str, Sequence[int]]
) -> dict[str, Any]:
    """Make the row of one variant in one world."""
    tables = [read_trials(path) for path in paths]
    judged = [trials.judged(plan["world"])[np.isin(trials.pose_set, INSIDE)] for trials in tables]
    tallies = [(int(good.sum()), len(good)) for good in judged]
    good, tried = (sum(part) for part in zip(*tallies, strict=True))
    low, high = mean_interval([tallies])
    return {
        **{name: cell[name] for name in ("task", "object", "background")},
        "variant": plan["variant"],
        "world": plan["world"],
        "trials": tried,
        "successes": good,
        "success_rate": good / tried,
        "ci95_low": low,
        "ci95_high": high,
        "training_steps": round(sum(steps[plan["variant"]]) / len(steps[plan["variant"]])),
        "trainings": len(tallies),
        "successes_each": " ".join(str(part) for part, _ in tallies),
    }


def worth(rows: Sequence[Mapping[str, Any]], comparison: Mapping[str, Any]) -> str:
    """State what a diagnosis is worth beyond its controls, in one sentence.

    Args:
        rows: Rows of the table.
        comparison: `world`, the `variant` that learned with what the diagnosis named, and its `controls`.
    """
    world, variant, controls = (comparison[key] for key in ("world", "variant", "controls"))
    found = {row["variant"]: row for row in rows if row["world"] == world}
    mine = found[variant]
    if not controls:
        return (
            f"In {world}, {mine['successes']} of {mine['trials']} trials succeed with what the diagnosis named; no control was"
            " trained, so that it is not known what the diagnosis is worth beyond what else might have helped."
        )
    best = max((found[name] for name in controls), key=lambda row: row["success_rate"])
    # Trainings of two variants have nothing in common, so the two sides are independent samples.
    low, high = lead_interval([_tallies(mine)], [_tallies(best)])
    return (
        f"In {world}, {mine['successes']} of {mine['trials']} trials succeed with what the diagnosis named ({variant},"
        f" trainings: {mine['trainings']}), and {best['successes']} of {best['trials']} with the best of {len(controls)}"
        f" controls ({best['variant']}, trainings: {best['trainings']}): beyond its controls the diagnosis is worth"
        f" {100 * (mine['success_rate'] - best['success_rate']):+.0f} points (95 %: {100 * low:+.0f} to {100 * high:+.0f})."
    )


def _tallies(row: Mapping[str, Any]) -> list[tuple[int, int]]:
    """Successes and trials of each training of a row."""
    return [(int(good), row["trials"] // row["trainings"]) for good in row["successes_each"].split()]


def rows_table(cell: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Table:
    """Lay out the rows as a table for people."""
    return Table(
        title=f"Closing the loop, {cell['task']}: {cell['object']} on {cell['background']}".replace("_", " "),
        columns=("policy", "world", "successes", "rate (95 %)", "learned from"),
        rows=tuple(
            (
                row["variant"],
                row["world"],
                f"{row['successes']}/{row['trials']}",
                f"{row['success_rate']:.1%} ({row['ci95_low']:.1%} to {row['ci95_high']:.1%})",
                f"{row['training_steps']} steps" + (f", {row['trainings']} times" if row["trainings"] > 1 else ""),
            )
            for row in rows
        ),
        notes=(
            f"Trainings of each way of learning: {rows[0]['trainings']}, from seed {cell['seed']} on; intervals count them."
            f" Start poses inside the training square. {STRICT_WORLD} is the simulation.",
        ),
    )


def draw_rows(rows: Sequence[Mapping[str, Any]], out: str | Path) -> None:
    """Draw a bar with its interval for each row."""
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


@dataclass(frozen=True)
class LoopFiles:
    """Files and plan that a loop's page is made of.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        trials: Trials of each row, see `loop_rows`.
        trainings: `training.json` of the policies, before and after.
        logged: `trials.json` of the logged worlds.
        calibration: `calibration.json`.
        findings: `findings.json` of the reference and of the changed world.
        amendment: `amendment.json`.
        comparisons: What the page compares, see `worth`.
    """

    cell: Mapping[str, Any]
    plan: Sequence[Mapping[str, str]]
    trials: Sequence[str | Path]
    trainings: Sequence[str | Path]
    logged: Sequence[str | Path]
    calibration: str | Path
    findings: Sequence[str | Path]
    amendment: str | Path
    comparisons: Sequence[Mapping[str, Any]] = ()


def write_loop(files: LoopFiles, rows_csv: str | Path, page: str | Path, figure: str | Path) -> None:
    """Write the rows, a page in Markdown and a figure.

    Args:
        files: Files and plan that they are made of.
        rows_csv: The rows.
        page: The page.
        figure: The picture.

    Raises:
        InputError: A file is missing or damaged.
    """
    reference, changed = (read_json(path) for path in files.findings)
    calibration, amendment = read_json(files.calibration), read_json(files.amendment)
    found = [
        f"- The world in which the policy works, against the simulation: **{_told(reference)}**. {reference['sentence']}",
        f"- Calibrated there, the residual on a record that was not fitted falls from {calibration['before']['verify']:.3g} to"
        f" {calibration['after']['verify']:.3g} times the noise of the sensors; the commands take"
        f" {1e3 * calibration['delay']:.1f} ms.",
        f"- The changed world, against the calibrated arm: **{_told(changed)}**. {changed['sentence']}",
        *(f"- Left out: {reason}." for reason in amendment["reasons"]),
    ]
    _write(files, (rows_csv, page, figure), "the arm", found, _price(files, calibration, (reference, changed)))


_QUESTION = (
    "Reality changes after a policy was trained; what the diagnosis names is put into the simulation, and a policy that learns "
    "there is tried again. Each line is one policy in one world: before the change, after it, and with the amended simulation."
)


def _told(findings: Mapping[str, Any]) -> str:
    """A verdict in words."""
    return str(findings["verdict"]).replace("_", " ")


def _write(
    files: LoopFiles | PictureLoopFiles, out: tuple[str | Path, ...], what: str, found: Sequence[str], price: Sequence[str]
) -> None:
    """Write rows, page and figure of one loop."""
    rows_csv, page, figure = out
    rows = loop_rows(files.cell, files.plan, files.trials, files.trainings)
    write_rows(rows_csv, COLUMNS, rows)
    draw_rows(rows, figure)
    said = [part for comparison in files.comparisons for part in (worth(rows, comparison), "")]
    lines = [
        f"# Closing the loop: {what}",
        "",
        _QUESTION,
        "",
        *said,
        markdown(rows_table(files.cell, rows)),
        "",
        "## What was found",
        "",
        *found,
    ]
    with atomic_file(page) as temporary:
        temporary.write_text("\n".join([*lines, "", "## The price", "", *price, ""]), encoding="utf-8")


def _price(files: LoopFiles, calibration: Mapping[str, Any], findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """State what the loop cost: records, simulations and minutes."""
    logged = [trial for path in files.logged for trial in field_of(path, "trials")]
    failed = sum(not trial["success"] for trial in logged)
    seconds = sum(trial["seconds"] for trial in logged)
    bank = sum(item["simulations"]["bank"] for item in findings)
    case = sum(item["simulations"]["case"] for item in findings)
    minutes = (calibration["seconds"] + sum(item["seconds"] for item in findings)) / 60
    variant = files.comparisons[0]["variant"] if files.comparisons else Path(files.trainings[-1]).parts[-3]
    last = next(path for path in files.trainings if Path(path).parts[-3] == variant)
    training = sum(field_of(last, "cpu_seconds").values()) / 60
    return [
        f"- {len(logged)} records of {seconds:.0f} s together, {failed} of them of failed trials.",
        f"- {calibration['simulations']} simulations of the arm to calibrate, {bank} for the banks of two cases, {case} for"
        f" their diagnosis: {minutes:.0f} minutes.",
        f"- A new training of {field_of(last, 'steps')} steps: {training:.0f} minutes of processor time.",
    ]


@dataclass(frozen=True)
class PictureLoopFiles:
    """Files and plan that a loop's page is made of.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        worlds: Photographed worlds; the first is the reference.
        trials: Trials of each row, see `loop_rows`.
        trainings: `training.json` of the policies.
        photos: Records of the photos of each world.
        findings: `findings.json` of each world.
        comparisons: What the page compares, see `worth`.
    """

    cell: Mapping[str, Any]
    plan: Sequence[Mapping[str, str]]
    worlds: Sequence[str]
    trials: Sequence[str | Path]
    trainings: Sequence[str | Path]
    photos: Sequence[str | Path]
    findings: Sequence[str | Path]
    comparisons: Sequence[Mapping[str, Any]] = ()


def write_picture_loop(files: PictureLoopFiles, rows_csv: str | Path, page: str | Path, figure: str | Path) -> None:
    """Write the rows, a page in Markdown and a figure.

    Args:
        files: Files and plan that they are made of.
        rows_csv: The rows.
        page: The page.
        figure: The picture.

    Raises:
        InputError: A file is missing or damaged.
    """
    found = {world: read_json(path) for world, path in zip(files.worlds, files.findings, strict=True)}
    said = [f"- {world}: **{_told(item)}**. {item['sentence']}" for world, item in found.items()]
    _write(files, (rows_csv, page, figure), "the camera", said, _photo_price(files, found))


def _photo_price(files: PictureLoopFiles, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """State what the loop cost: photos, expected photos and minutes."""
    counts = [int(field_of(path, "views")) for path in files.photos]
    out = [f"- {counts[0]} photos on the first day; later {', '.join(f'{n} in {w}' for w, n in _later(files, counts))}."]
    out += [
        f"- {world}: {item['simulations']['case']} sets of expected photos, {item['seconds']:.0f} s."
        for world, item in found.items()
    ]
    new = {entry["variant"] for entry in files.plan} - {
        entry["variant"] for entry in files.plan if entry["world"] == files.worlds[0]
    }
    told: set[str] = set()
    for path in files.trainings:
        variant = Path(path).parts[-3]
        if variant in new - told:
            told.add(variant)
            minutes = sum(field_of(path, "cpu_seconds").values()) / 60
            out.append(f"- {variant}: a training of {field_of(path, 'steps')} steps, {minutes:.0f} minutes of processor time.")
    return out


def _later(files: PictureLoopFiles, counts: Sequence[int]) -> list[tuple[str, int]]:
    return list(zip(files.worlds[1:], counts[1:], strict=True))
