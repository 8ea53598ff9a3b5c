"""Columns of a table that a user brings, in SI units: which is which, what its unit is, and whether it holds numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.gap.formats.units import HEADER, factor_to_si, split_header
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

LARGEST_TABLE = 2 * 2**30
"""Largest size of a file, bytes: a day of seven joints at 100 Hz as text."""

_LISTED = 14
"""Columns that a message names."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_EXAMPLE = "time [s],NAME [UNIT], and so on"


def read_table(path: Path, what: str) -> tuple[pd.DataFrame, bytes]:
    """A table from CSV (header `name [unit]`) or Parquet, and the file's bytes.

    Args:
        path: The file.
        what: What it holds, for the message: `record`, `throws`.

    Raises:
        InputError: The file cannot be read, is no table, or has no header line; or two columns have the same name.
    """
    regular_file(path, what, "Check the path in the case", LARGEST_TABLE)
    with refusing(path, "this is no table", "Give CSV with a header line, or Parquet"):
        data = path.read_bytes()
        if path.suffix == ".parquet":
            table = pd.read_parquet(path)
        else:
            _check_header(path)
            table = pd.read_csv(path)
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if any(mark in str(header) for header in table.columns):
            raise InputError(
                path, f"its columns are separated by {name}", "Separate them with commas, and write decimals with a point"
            )
    return table, data


def _check_header(path: Path) -> None:
    """Refuse a CSV file that begins with numbers, and one in which two columns have the same name: one would be lost."""
    headers = [str(header) for header in pd.read_csv(path, header=None, nrows=1, dtype=str).iloc[0].dropna()]
    words = [word for header in headers for word in re.split(r"[;\s]+", header) if word]
    if words and all(_NUMBER.fullmatch(word) for word in words):
        raise InputError(
            path, "it has no header line: its first line holds numbers", f"Write the columns' names there: {_EXAMPLE}"
        )
    names = [split_header(header)[0] for header in headers]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(path, f"the column '{twice}' stands twice", "Keep one of them, or give the other another name")


@dataclass(frozen=True)
class Columns:
    """Columns of one table by our names.

    Args:
        table: One row per sample.
        source: File of the table, for messages.
        names: Our name of a column to that of the file; others keep our name.
        units: Our name of a column, or its kind alone, to its unit; for files whose headers state none.
        gains: N m (of joints that slide: N) per ampere by joint, for efforts in amperes.
        headers: Whether the file is a table with headers that can be written; others leave units to the case.
    """

    table: pd.DataFrame
    source: Path
    names: Mapping[str, str]
    units: Mapping[str, str]
    gains: Mapping[str, float] = field(default_factory=dict)
    headers: bool = True

    def get(self, ours: str, dimension: str) -> Array | None:
        """Values in SI units; None where there is no such column. [T].

        Args:
            ours: Our name.
            dimension: A key of `gsbridge.gap.formats.units.FACTORS`.

        Raises:
            InputError: The unit is missing or unknown, or a value is no number.
        """
        headers = self._headers()
        theirs, unit = split_header(self.names.get(ours, ours))
        if theirs not in headers:
            return None
        beside = unit if unit is not None else self.units.get(ours, self.units.get(ours.split(".")[0]))
        stated = split_header(headers[theirs])[1]
        if stated is not None and beside is not None and stated.replace(" ", "") != beside.replace(" ", ""):
            raise InputError(
                self.source, f"the header states [{stated}] for the column '{theirs}', the case [{beside}]",
                "Keep the one that was logged",
            )  # fmt: skip
        stated = stated if stated is not None else beside
        values = pd.to_numeric(self.table[headers[theirs]], errors="coerce").to_numpy(dtype=np.float64)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise InputError(
                self.source, f"the column '{theirs}' holds no number in data row {bad[0] + 1} ({len(bad)} such rows)",
                "Remove or mend these rows; gaps in time are allowed",
            )  # fmt: skip
        kind, _, joint = ours.partition(".")
        where = HEADER if self.headers else f"State it in the case, as 'units: {{{kind}: ...}}'"
        return values * factor_to_si(stated, dimension, self.source, theirs, self.gains.get(joint), where)

    def need(self, ours: str, dimension: str) -> Array:
        """`get` of a column that must be there. [T].

        Raises:
            InputError: It is missing, or as `get`.
        """
        found = self.get(ours, dimension)
        if found is None:
            theirs = split_header(self.names.get(ours, ours))[0]
            shown = ", ".join(list(self._headers())[:_LISTED])
            raise InputError(self.source, f"the column '{theirs}' is missing", f"It has: {shown}. Name yours under 'columns'")
        return found

    def _headers(self) -> dict[str, str]:
        """Headers by the names in them."""
        return {split_header(str(header))[0]: str(header) for header in self.table.columns}
