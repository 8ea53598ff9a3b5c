"""Dates of results, restored after a copy, an archive or a wrong clock has changed them."""

from __future__ import annotations

import base64
import json
import os
import time
from pathlib import Path

_STAMP = ".snakemake_timestamp"
"""File in each folder that a job made, whose date is the folder's for snakemake."""


def restore_dates(working: Path) -> list[str]:
    """Give results the dates at which they were made, so that a copy of finished results reruns nothing.

    Where dates ask for a rerun, snakemake compares the contents of files, but for a folder it compares only the date of a
    stamp file inside it. Only a job writes this stamp, and the record of the job says when it ended, so the stamp takes that
    date. A file that is older than the end of its job came from an archive that rounds dates, or from a machine whose clock
    was behind. It takes the date of the record; otherwise it would seem older than the folders that it was made from. A file
    that is younger may have been edited and keeps its date. No date is set later than now, even where another machine's clock
    was ahead: snakemake refuses outputs that are older than their inputs.

    Args:
        working: Folder in which snakemake works: results and records lie below it.

    Returns:
        Results whose date was changed, as their records name them.
    """
    out, latest, now = [], 0.0, time.time()
    for record in (working / ".snakemake" / "metadata").rglob("*"):
        if not record.is_file():
            continue
        try:
            # Snakemake splits a long name over folders, and marks these with a leading `@`.
            parts = record.relative_to(working / ".snakemake" / "metadata").parts
            name = base64.urlsafe_b64decode("".join(part.removeprefix("@") for part in parts)).decode()
            folder = (working / name).is_dir()
            dated = working / name / _STAMP if folder else working / name
            end, date = json.loads(record.read_text(encoding="utf-8"))["endtime"], dated.stat().st_mtime
            latest = max(latest, end or 0.0)
            wanted = _wanted(date, end, now, folder)
            if abs(wanted - date) > 1e-3:
                os.utime(dated, (wanted, wanted))
                out.append(name)
        except (OSError, ValueError, KeyError):
            # The result is gone or may not be written, or it is a record that snakemake will not read either.
            continue
    _date_measurements(working, latest)
    return sorted(out)


def _wanted(date: float, end: float | None, now: float, folder: bool) -> float:
    """Date that a result should have, s since 1970.

    Args:
        date: Date that the result has, s.
        end: When its job ended, s, as the record says; None if the record does not say.
        now: The present, s.
        folder: Whether the result is a folder; only a job changes the date of its stamp.
    """
    if end is None or end > now:
        return min(date, now)
    return end if folder else min(max(date, end), now)


def _date_measurements(working: Path, latest: float) -> None:
    """Give benchmarks, which have no record, the date at which the last job ended: a job is as old as its oldest output."""
    for path in (working / "results" / "benchmarks").rglob("*.jsonl"):
        try:
            if path.stat().st_mtime < latest:
                os.utime(path, (latest, latest))
        except OSError:
            continue
