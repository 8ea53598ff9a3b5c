"""Success of the baseline controller against severity: rows as CSV, and a table with a column for each world.

Columns of the rows:

| column | content |
|---|---|
| `who` | `controller` |
| `task`, `object`, `background` | what was to be done, and where |
| `world`, `seed`, `look`, `physics` | name, seed and severities of the world |
| `trials`, `success` | counts; excess contact is forgiven, as in every world but the simulated one |
| `rate`, `low`, `high` | share of successes, and Wilson's 95 % interval |
| `steps` | median of the steps of all trials |
| `failures` | reasons of the failed trials with their counts, most frequent first |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.rows import write_rows
from gsbridge.statistics import wilson_interval

COLUMNS = (
    *("who", "task", "object", "background", "world", "seed", "look", "physics"),
    *("trials", "success", "rate", "low", "high", "steps", "failures"),
)

_NOTES = (
    "Successes of trials, excess contact forgiven, with Wilson's 95 % interval; below, the median of the steps.",
    "A column is a world; its severities of look and physics stand in its head (docs/mirror.md).",
)


def write_severity(rows_csv: str | Path, page: str | Path, sources: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Write the rows and the page.

    Args:
        rows_csv: CSV of the rows; see the module for its columns.
        page: Markdown file with the table.
        sources: Entries of `SeverityStudy.controller`.

    Returns:
        The rows.

    Raises:
        InputError: A file of trials is missing or damaged, or there is none.
    """
    if not sources:
        raise InputError("config: study.severity.worlds", "no world is named", "Name worlds of different severity")
    rows = [_row(source) for source in sources]
    write_rows(rows_csv, COLUMNS, rows)
    with atomic_file(page) as temporary:
        temporary.write_text(f"# Success against severity\n\n{markdown(_table(rows))}", encoding="utf-8")
    return rows


def _row(source: Mapping[str, Any]) -> dict[str, Any]:
    """One row, from the record of a controller's trials."""
    path = Path(source["file"])
    try:
        found = [(bool(t["success_tolerant"]), str(t["failure"]), int(t["steps"])) for t in read_json(path)["trials"]]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"the trials are damaged ({error})", "Delete the file and run the rule again") from error
    if not found:
        raise InputError(path, "it holds no trials", "Delete the file and run the rule again")
    success = sum(good for good, _, _ in found)
    low, high = wilson_interval(success, len(found))
    lost = Counter(failure for good, failure, _ in found if not good)
    return {
        **{key: value for key, value in source.items() if key != "file"},
        "trials": len(found),
        "success": success,
        "rate": success / len(found),
        "low": low,
        "high": high,
        "steps": float(np.median([steps for _, _, steps in found])),
        "failures": ", ".join(f"{name} {count}" for name, count in sorted(lost.items(), key=lambda item: (-item[1], item[0]))),
    }


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Lay the rows out with one line per controller (`who`) and one column per world."""
    worlds = list(dict.fromkeys((row["world"], row["look"], row["physics"]) for row in rows))
    lines: dict[str, dict[str, str]] = {}
    for row in rows:
        share = f"{row['success']}/{row['trials']} ({100 * row['low']:.0f} to {100 * row['high']:.0f} %)"
        lines.setdefault(row["who"], {})[row["world"]] = f"{share}; {row['steps']:.0f}"
    first = rows[0]
    return Table(
        f"{first['task'].replace('_', ' ').capitalize()}: {first['object']} on {first['background']}".replace("_", " "),
        ("who", *(f"{world}: look {look}, physics {physics}" for world, look, physics in worlds)),
        tuple((name, *(cells.get(world, "") for world, _, _ in worlds)) for name, cells in lines.items()),
        _NOTES,
    )
