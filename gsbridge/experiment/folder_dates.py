"""Dates of result folders, which a copy renews."""

from __future__ import annotations

import base64
import json
import os
from pathlib import Path

_STAMP = ".snakemake_timestamp"
"""File in each folder that a job made, whose date is the folder's for snakemake."""


def restore_folder_dates(working: Path) -> list[str]:
    """Date folders that jobs made to when they were made, so that a copy of finished results reruns nothing.

    Of files, snakemake compares the contents where the dates speak for a rerun. Of folders it compares the date of a stamp
    alone, which a copy renews. The record of the job knows when the stamp was written. Nothing but a job writes it,
    so that its date tells no more than the record does.

    Args:
        working: Folder in which snakemake works: results and records lie below it.

    Returns:
        Folders that were dated back, as their records name them.
    """
    out = []
    for record in (working / ".snakemake" / "metadata").rglob("*"):
        if not record.is_file():
            continue
        try:
            # Long names are split over folders, which begin with a sign of their own.
            parts = record.relative_to(working / ".snakemake" / "metadata").parts
            name = base64.urlsafe_b64decode("".join(part.removeprefix("@") for part in parts)).decode()
            stamp = working / name / _STAMP
            if not stamp.is_file():
                continue
            end = json.loads(record.read_text(encoding="utf-8"))["endtime"]
        except (OSError, ValueError, KeyError):
            # A record that snakemake will not read either.
            continue
        if end is not None and abs(stamp.stat().st_mtime - end) > 1e-3:
            os.utime(stamp, (end, end))
            out.append(name)
    return sorted(out)
