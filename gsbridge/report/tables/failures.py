"""How trials ended: successes and failures by reason and by quadrant of the start pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.configuration.renderers import TITLES
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.rows import Row, write_rows
from gsbridge.report.tables.success import cell_title
from gsbridge.report.tables.success_rows import CELL_COLUMNS, ReadTrials, cell_in, read_trial_files, row_order
from gsbridge.tasks.outcome import Failure
from gsbridge.tasks.poses import POSE_SETS, QUADRANTS

UNKNOWN = "unknown"
COLUMNS = (*CELL_COLUMNS, "world", "pose_set", "outcome", "count", *(f"quadrant_{quadrant}" for quadrant in QUADRANTS))
"""`outcome` is `none` for a success, a word of `Failure`, or `unknown` where no reason was recorded; the outcomes of a cell,
world and set of poses add up to its trials."""

ORDER = (*Failure, UNKNOWN)
QUADRANT_TITLES = ("far right", "far left", "near right", "near left")


def failure_rows(files: Sequence[ReadTrials]) -> list[dict[str, Any]]:
    """Make one row per outcome that occurred, counting the trials of all seeds together."""
    counts: dict[tuple[Any, ...], Any] = {}
    for file in files:
        success = file.trials.judged(file.world)
        outcome = np.where(success, Failure.NONE.value, np.where(file.trials.failure == "", UNKNOWN, file.trials.failure))
        for pose_set, word, quadrant in zip(file.trials.pose_set, outcome, file.trials.quadrant, strict=True):
            found = counts.setdefault((file.cell, file.world, str(pose_set), str(word)), np.zeros(len(QUADRANTS), int))
            found[QUADRANTS.index(int(quadrant))] += 1
    rows = [
        {
            **{name: getattr(cell, name) for name in CELL_COLUMNS},
            "world": world,
            "pose_set": pose_set,
            "outcome": word,
            "count": int(found.sum()),
            **{f"quadrant_{quadrant}": int(count) for quadrant, count in zip(QUADRANTS, found, strict=True)},
        }
        for (cell, world, pose_set, word), found in counts.items()
    ]
    return sorted(rows, key=lambda row: (*row_order(row), ORDER.index(row["outcome"])))


def write_failure_rows(out_csv: str | Path, paths: Sequence[str | Path], **more: Any) -> None:
    """Write `rows/failures.csv`.

    Args:
        out_csv: File to write.
        paths: Tables of trials, as `read_trial_files` takes them.
        **more: Further arguments of `read_trial_files`.
    """
    write_rows(out_csv, COLUMNS, failure_rows(read_trial_files(paths, **more)))


def failures_table(rows: Sequence[Row]) -> Table | None:
    """Failures of each cell and world by reason, all sets of start poses together; None without rows.

    Args:
        rows: Rows of `failures.csv`.
    """
    if not rows:
        return None
    words = [word for word in ORDER if word != Failure.NONE and any(row["outcome"] == word for row in rows)]
    groups: dict[tuple[Any, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((cell_in(row), row["world"]), []).append(row)
    body, clean = [], 0
    for (cell, world), found in groups.items():
        failed = [row for row in found if row["outcome"] != Failure.NONE]
        clean += not failed
        if failed:
            trained = TITLES.get(cell.renderer, cell.renderer)
            body.append((cell_title(cell), trained, world, *_counts(found, failed, words)))
    body.append(("all", "", "", *_counts(rows, [row for row in rows if row["outcome"] != Failure.NONE], words)))
    columns = ("cell", "trained on", "world", "trials", "failed", *QUADRANT_TITLES, *(word.replace("_", " ") for word in words))
    sets = sorted({row["pose_set"] for row in rows}, key=POSE_SETS.index)
    if not words:
        body, columns = [("all", str(sum(int(row["count"]) for row in rows)), "0")], ("cell", "trials", "failed")
    notes = [f"Start poses: {' and '.join(sets)}." + ("" if words else " No trial failed.")]
    if words:
        notes[0] += " Far right to near left: failures by the quadrant of the table that the object starts in."
        if clean:
            notes.append(f"{clean} pairs of a cell and a world have no failure and are left out.")
    return Table("Failures by reason", columns, tuple(body), tuple(notes))


def _counts(rows: Sequence[Row], failed: Sequence[Row], words: Sequence[str]) -> list[str]:
    """Count trials, failures, failures by quadrant and failures by reason."""
    by_word = [sum(int(row["count"]) for row in failed if row["outcome"] == word) for word in words]
    by_quadrant = [sum(int(row[f"quadrant_{quadrant}"]) for row in failed) for quadrant in QUADRANTS]
    return [
        str(sum(int(row["count"]) for row in rows)),
        str(sum(by_word)),
        *map(str, by_quadrant),
        *map(str, by_word),
    ]
