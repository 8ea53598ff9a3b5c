"""Rows of a table as plain CSV files: strings in, strings out, the same bytes for the same numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import atomic_file

Row = dict[str, str]


def cell(value: Any, digits: int = 4) -> str:
    """Format one value: empty for None, NaN and infinity, floats rounded to `digits`, booleans as `true` or `false`."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.{digits}f}" if math.isfinite(value) else ""
    return str(value)


def number(text: str) -> float | None:
    """Number of a cell; None where the cell is empty."""
    return float(text) if text.strip() else None


def write_rows(path: str | Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a CSV file with a header, whole or not at all.

    Args:
        path: The file.
        columns: Names and order of the columns.
        rows: One mapping per row; a missing column stays empty, an unknown one is an error.
    """
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(columns), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: cell(value) for name, value in row.items()})


def read_rows(path: str | Path, columns: Sequence[str] = ()) -> list[Row]:
    """Read a CSV file with a header.

    Args:
        path: The file.
        columns: Columns that must be there.

    Raises:
        InputError: The file is missing, is no text, or lacks a column.
    """
    try:
        # Some spreadsheets write a byte-order mark first; `utf-8-sig` skips it where there is one.
        with Path(path).open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            names = reader.fieldnames or []
            rows = [{name: value or "" for name, value in row.items() if name is not None} for row in reader]
    except FileNotFoundError as error:
        raise InputError(path, "the rows do not exist", "Run the rule that makes them") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"this is no CSV file ({error})", "Delete it and run the rule again") from error
    missing = [name for name in columns if name not in names]
    if missing:
        raise InputError(path, f"the columns {', '.join(missing)} are missing", "Delete it and run the rule again")
    return rows
