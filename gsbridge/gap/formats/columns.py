"""Columns of a user's table in SI units: finds a column by name, converts its unit, and checks its values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
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
"""Largest size of a file that is read, bytes: a day of seven joints at 100 Hz as text."""

MOST_VALUES = 250_000_000
"""Largest number of values (rows times columns) that are read from a Parquet file.

A day of seven joints at 100 Hz has 200 million, which take 2 GB.
"""

_COMPRESSED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
"""First bytes of files compressed by gzip, zip, bzip2, xz and zstd."""

_LARGEST = 1e30
"""Size, in SI units, from which on a value is refused: it cannot be a measurement, and its powers soon overflow."""

_LISTED = 14
"""Largest number of columns that a message lists."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_EXAMPLE = "time [s],NAME [UNIT], and so on"

_SHOWN = 40
"""Largest number of characters of a damaged value or line that a message shows."""

_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
"""Separators of files that are not comma-separated, and their names for messages."""

_ABOVE = "The first line has to be the header: remove what stands above it"

_UNEVEN = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
"""Error message of pandas about a line with more values than the lines before it."""


def read_table(path: Path, what: str) -> tuple[pd.DataFrame, bytes]:
    """Read a table from CSV (header `name [unit]`) or Parquet; return it and the file's bytes.

    Args:
        path: The file.
        what: Word for its content, for messages: `record`, `throws`.

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
    """Check a Parquet file's metadata before its content is read: a small file can expand to billions of rows.

    Raises:
        InputError: It contains more than `MOST_VALUES` values, or two of its columns have the same name.
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
    """Read a table from CSV.

    Raises:
        InputError: The file is compressed, is not UTF-8, does not begin with its header, names two columns alike, or is not
            separated by commas.
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
            # Check this before pandas reads: with decimal commas it would complain about surplus commas instead.
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
        # pandas takes surplus values for row names, which shifts every value into another column.
        raise InputError(
            path, f"its first line names {len(headers)}, its rows have {table.index.nlevels + len(headers)} values",
            _ABOVE if len(headers) == 1 else "Write decimals with a point, and no comma behind the last value",
        )  # fmt: skip
    for mark in _SEPARATORS:
        # Names and units may contain blanks and bars, so these count as separators only if the header is a single column.
        if any(mark in header for header in headers) if mark in ";\t" else len(headers) == 1 and headers[0].count(mark) > 1:
            raise _separated(path, mark)
    return table


def _separated(path: Path, mark: str) -> InputError:
    """Return the error about columns that are not separated by commas."""
    return InputError(
        path, f"its columns are separated by {_SEPARATORS[mark]}", "Separate them with commas, and write decimals with a point"
    )


def _check_header(path: Path) -> None:
    """Refuse a CSV file that begins with numbers, or in which two columns have the same name: one would be lost."""
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


def refuse_unmatched(names: Mapping[str, str], found: Sequence[Mapping[str, str]], source: str | Path) -> None:
    """Refuse a case that names a column which none of its files has: a slip would turn into a wrong diagnosis.

    Args:
        names: Maps our name of a column to the files'.
        found: Result of `Columns.unmatched` for each file.
        source: The case, for messages.

    Raises:
        InputError: A named column is in no file.
    """
    for ours, theirs in names.items():
        if found and all(ours in missing for missing in found):
            raise InputError(
                source,
                f"no record has the column '{theirs}', which the case names for '{ours}'",
                f"They have: {found[0][ours]}",
            )


def refuse_shared(names: Mapping[str, str], source: str | Path) -> None:
    """Refuse a case that reads two of our columns from one of the log's.

    Args:
        names: Maps our name of a column to the log's.
        source: The case, for messages.

    Raises:
        InputError: Two of our names have one column.
    """
    theirs = [split_header(name)[0] for name in names.values()]
    twice = next((name for name in theirs if theirs.count(name) > 1), None)
    if twice is not None:
        ours = [key for key, name in zip(names, theirs, strict=True) if name == twice]
        raise InputError(
            source, f"'{ours[0]}' and '{ours[1]}' are both read from '{twice}'", "Name a column of its own for each"
        )


@dataclass(frozen=True)
class Columns:
    """Columns of one table by our names.

    Args:
        table: One row per sample.
        source: File of the table, for messages.
        names: Maps our name of a column to the file's; other columns have our name.
        units: Maps our name of a column, or only its kind, to its unit; for files whose headers state no units.
        gains: N m per ampere by joint (N per ampere for joints that slide), for efforts in amperes.
        headers: Whether units can be written into the file's headers; if not, the case has to state them.
    """

    table: pd.DataFrame
    source: Path
    names: Mapping[str, str]
    units: Mapping[str, str]
    gains: Mapping[str, float] = field(default_factory=dict)
    headers: bool = True

    def get(self, ours: str, dimension: str, rows: Array | None = None) -> Array | None:
        """Return a column's values in SI units, or None if there is no such column. [T].

        Args:
            ours: Our name of the column.
            dimension: A key of `gsbridge.gap.formats.units.FACTORS`.
            rows: Rows that are read and returned, from 0; None for all. [T].

        Raises:
            InputError: The unit is missing, unknown or stated twice differently, or a value is not a number or far too large.
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
        column = self.table[headers[theirs]] if rows is None else self.table[headers[theirs]].iloc[rows]
        rows = np.arange(len(column)) if rows is None else rows
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64)
        bad = rows[~np.isfinite(values)]
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
                self.source,
                f"the column '{theirs}' holds {values[large[0]]:.3g} in data row {rows[large[0]] + 1}, beyond measure",
                "Mend or remove such rows",
            )  # fmt: skip
        return values

    def unmatched(self) -> dict[str, str]:
        """Return the columns that the case names and the table lacks: ours, and what it has instead, for a message."""
        headers = self._headers()
        shown = ", ".join(list(headers)[:_LISTED])
        return {ours: shown for ours, name in self.names.items() if split_header(name)[0] not in headers}

    def need(self, ours: str, dimension: str) -> Array:
        """Return a column's values in SI units as `get` does, but refuse a missing column. [T].

        Raises:
            InputError: The column is missing, or for the reasons listed at `get`.
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
        """Map the names in the headers to the whole headers."""
        return {split_header(str(header))[0]: str(header) for header in self.table.columns}


def _way_to_mend(held: object, clock: bool, row: int) -> str:
    """Return advice about a value that is not a number.

    Args:
        held: The value.
        clock: Whether its column holds times.
        row: Its data row, from 0.
    """
    text = held.strip() if isinstance(held, str) else ""
    if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", text):
        return "Write decimals with a point"
    if clock and ":" in text:
        return "Write times as seconds since the first sample, not as dates"
    if row == 0 and text.strip("[]()")[:1].isalpha():
        return "Units stand in the header, as 'name [unit]': remove the row of units"
    return "Remove or mend these rows; a few may be missing"
