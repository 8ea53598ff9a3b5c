"""Closing the loop of pictures: successes before, under a changed camera, and after, with what the finding cost."""

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
class SightFiles:
    """What the table is made of.

    Args:
        cell: Task, object, background, seed.
        plan: `variant` and `world` of each row.
        worlds: Photographed worlds; the first is the reference.
        trials: Trials of each row.
        trainings: `training.json` of the policies.
        photos: Records of the photos of each world.
        findings: `findings.json` of each world.
    """

    cell: Mapping[str, Any]
    plan: Sequence[Mapping[str, str]]
    worlds: Sequence[str]
    trials: Sequence[str | Path]
    trainings: Sequence[str | Path]
    photos: Sequence[str | Path]
    findings: Sequence[str | Path]


def write_sight_loop(files: SightFiles, rows_csv: str | Path, page: str | Path, figure: str | Path) -> None:
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
    found = {world: read_json(path) for world, path in zip(files.worlds, files.findings, strict=True)}
    lines = [
        "# Closing the loop: the camera",
        "",
        markdown(rows_table(files.cell, rows)),
        "",
        "## What was found",
        "",
        *(f"- {world}: **{item['verdict']}**. {item['sentence']}" for world, item in found.items()),
        "",
        "## The price",
        "",
        *_price(files, found),
        "",
    ]
    with atomic_file(page) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")


def _price(files: SightFiles, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Photos, pictures and minutes."""
    counts = [int(field_of(path, "views")) for path in files.photos]
    out = [f"- {counts[0]} photos on the first day; later {', '.join(f'{n} in {w}' for w, n in _later(files, counts))}."]
    out += [
        f"- {world}: {item['simulations']['case']} sets of expected photos, {item['seconds']:.0f} s."
        for world, item in found.items()
    ]
    new = {entry["variant"] for entry in files.plan} - {
        entry["variant"] for entry in files.plan if entry["world"] == files.worlds[0]
    }
    for path in files.trainings:
        variant = Path(path).parts[-3]
        if variant in new:
            minutes = sum(field_of(path, "cpu_seconds").values()) / 60
            out.append(f"- {variant}: a training of {field_of(path, 'steps')} steps, {minutes:.0f} minutes of processor time.")
    return out


def _later(files: SightFiles, counts: Sequence[int]) -> list[tuple[str, int]]:
    return list(zip(files.worlds[1:], counts[1:], strict=True))
