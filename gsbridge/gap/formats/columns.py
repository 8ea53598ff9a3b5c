"""Columns of a table that a user brings, in SI units: which is which, what its unit is, and whether it holds numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from gsbridge.errors import InputError
from gsbridge.gap.formats.units import CURRENTS, HEADER, factor_to_si, split_header
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

LARGEST_TABLE = 2 * 2**30
"""Largest size of a file, bytes: a day of seven joints at 100 Hz as text."""

MOST_VALUES = 250_000_000
"""Rows times columns of a Parquet file that are read: a day of seven joints at 100 Hz has 200 million, which take 2 GB."""

_COMPRESSED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
"""First bytes of files that gzip, zip, bzip2, xz and zstd have packed."""

_LARGEST = 1e30
"""Numbers from here on, SI, measure nothing, and their squares would soon be endless."""

_LISTED = 14
"""Columns that a message names."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_EXAMPLE = "time [s],NAME [UNIT], and so on"

_SHOWN = 40
"""Characters of a damaged value or line that a message shows."""

_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
"""What separates columns in files that are no CSV with commas."""

_ABOVE = "The first line has to be the header: remove what stands above it"

_UNEVEN = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
"""What pandas says of a line that is longer than those before."""


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
        if path.suffix.lower() == ".parquet":
            check_parquet(path)
            table = pd.read_parquet(path)
        else:
            table = _read_csv(path, data)
    if not len(table):
        raise InputError(path, "it has a header and no rows", "Copy the file again, or log again")
    return table, data


def check_parquet(path: Path) -> None:
    """Look at what a Parquet file says of itself before its content is read: a few bytes can stand for billions of rows.

    Raises:
        InputError: It holds more than `MOST_VALUES` values, or two of its columns have the same name.
    """
    with pq.ParquetFile(path) as file:
        rows, columns, names = file.metadata.num_rows, file.metadata.num_columns, file.schema_arrow.names
    if rows * max(columns, 1) > MOST_VALUES:
        raise InputError(
            path, f"it holds {rows} rows of {columns} columns; at most {MOST_VALUES} values are read",
            "Keep the columns of the joints, and cut the log into parts",
        )  # fmt: skip
    _refuse_twice(path, names)


def _read_csv(path: Path, data: bytes) -> pd.DataFrame:
    """A table from CSV.

    Raises:
        InputError: It is compressed or not UTF-8, does not begin with its header, has a name in it twice, or other separators
            than commas.
    """
    if data.startswith(_COMPRESSED):
        raise InputError(path, "it is compressed", f"Unpack {path.name} first, and name the CSV or Parquet file that was in it")
    first, second = [*data[:65536].decode("utf-8", errors="replace").splitlines(), "", ""][:2]
    first = first.strip()
    if first.startswith(("#", "%", "//")):
        way = "Write the header without a mark before it" if "," in first else "Remove the lines above the header"
        raise InputError(path, f"it begins with a comment: {first[:_SHOWN]}", way)
    try:
        _check_header(path)
        for mark in ";\t":
            # Rows with decimal commas have more commas than the header, of which pandas would speak.
            if 0 < first.count(mark) == second.count(mark):
                raise _separated(path, mark)
        table = pd.read_csv(path, compression=None)
    except UnicodeDecodeError as error:
        raise InputError(path, "its text is not in UTF-8", "Save it as UTF-8; for degrees write [deg]") from error
    except pd.errors.ParserError as error:
        uneven = _UNEVEN.search(str(error))
        if uneven is None:
            raise
        raise InputError(
            path, f"line {uneven[2]} has {uneven[3]} values, those above it {uneven[1]}",
            _ABOVE if int(uneven[1]) == 1 else "Mend that line",
        ) from error  # fmt: skip
    headers = [str(header) for header in table.columns]
    if not isinstance(table.index, pd.RangeIndex):
        # pandas takes what is too much for the names of the rows, which moves every value into another column.
        raise InputError(
            path, f"its first line names {len(headers)}, its rows have {table.index.nlevels + len(headers)} values",
            _ABOVE if len(headers) == 1 else "Write decimals with a point, and no comma behind the last value",
        )  # fmt: skip
    for mark in _SEPARATORS:
        # Names and units may hold blanks.
        if any(mark in header for header in headers) if mark in ";\t" else len(headers) == 1 and headers[0].count(mark) > 1:
            raise _separated(path, mark)
    return table


def _separated(path: Path, mark: str) -> InputError:
    """The error about columns that are separated by something else than commas."""
    return InputError(
        path, f"its columns are separated by {_SEPARATORS[mark]}", "Separate them with commas, and write decimals with a point"
    )


def _check_header(path: Path) -> None:
    """Refuse a CSV file that begins with numbers, and one in which two columns have the same name: one would be lost."""
    headers = [str(header) for header in pd.read_csv(path, header=None, nrows=1, dtype=str, compression=None).iloc[0].dropna()]
    words = [word for header in headers for word in re.split(r"[;\s]+", header) if word]
    if words and all(_NUMBER.fullmatch(word) for word in words):
        raise InputError(
            path, "it has no header line: its first line holds numbers", f"Write the columns' names there: {_EXAMPLE}"
        )
    _refuse_twice(path, headers)


def _refuse_twice(path: Path, headers: Iterable[str]) -> None:
    """Refuse a table in which two columns have the same name: one would be lost."""
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
            held = self.table[headers[theirs]].iloc[bad[0]]
            what = f" but '{held[:_SHOWN]}'" if isinstance(held, str) and held.strip() else ""
            raise InputError(
                self.source,
                f"the column '{theirs}' holds no number in data row {bad[0] + 1}{what} ({len(bad)} such rows)",
                _way_to_mend(held, ours == "time", int(bad[0])),
            )
        kind, _, joint = ours.partition(".")
        if kind == "effort" and joint in self.gains and stated is not None and stated not in CURRENTS:
            raise InputError(
                self.source, f"the effort '{theirs}' is in [{stated}], and 'torque_per_ampere' is stated for it",
                "Leave the gain out, or state [A] if it is a current",
            )  # fmt: skip
        where = HEADER if self.headers else f"State it in the case, as 'units: {{{kind}: ...}}'"
        with np.errstate(over="ignore"):
            values = values * factor_to_si(stated, dimension, self.source, theirs, self.gains.get(joint), where)
        large = np.flatnonzero(~(np.abs(values) < _LARGEST))
        if len(large):
            raise InputError(
                self.source, f"the column '{theirs}' holds {values[large[0]]:.3g} in data row {large[0] + 1}, beyond measure",
                "Mend or remove such rows",
            )  # fmt: skip
        return values

    def need(self, ours: str, dimension: str) -> Array:
        """`get` of a column that must be there. [T].

        Raises:
            InputError: It is missing, or as `get`.
        """
        found = self.get(ours, dimension)
        if found is None:
            theirs = split_header(self.names.get(ours, ours))[0]
            shown = ", ".join(list(self._headers())[:_LISTED])
            raise InputError(
                self.source, f"the column '{theirs}' is missing",
                f"It has: {shown}. Write its header as '{ours} [unit]', or name yours in the case: columns: {{{ours}: YOURS}}",
            )  # fmt: skip
        return found

    def _headers(self) -> dict[str, str]:
        """Headers by the names in them."""
        return {split_header(str(header))[0]: str(header) for header in self.table.columns}


def _way_to_mend(held: object, clock: bool, row: int) -> str:
    """What to do about a value that is no number.

    Args:
        held: The value.
        clock: Whether it is a time.
        row: Its row, from 0.
    """
    text = held.strip() if isinstance(held, str) else ""
    if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", text):
        return "Write decimals with a point"
    if clock and ":" in text:
        return "Write times as seconds since the first sample, not as dates"
    if row == 0 and text.strip("[]()")[:1].isalpha():
        return "Units stand in the header, as 'name [unit]': remove the row of units"
    return "Remove or mend these rows; a few may be missing"
