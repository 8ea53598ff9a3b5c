"""The rows behind the recorded figures, packed small enough to be kept with the code: trials, findings, renderings, times."""

from __future__ import annotations

import csv
import gzip
import io
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, atomic_file, read_json
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.report.tables.timing import COLUMNS as TIMING_COLUMNS
from gsbridge.report.tables.timing import timing_rows

LARGEST_MB = 20.0
"""Limit of all evidence together, MB: beyond it, a checkout would be mostly evidence."""

_LONGEST = 64
"""Longest list of bare numbers that is kept: longer ones are curves or pictures, and no figure is made of them."""

_LONG_COLUMNS = ("file", "key", "value")


def flattened(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield a record's entries by dotted names, in its order, such as (`methods.gsbridge.list.3.outcome`, `right`).

    Args:
        value: The record, or a part of it.
        key: Name of the part.
    """
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from flattened(part, f"{key}.{name}" if key else str(name))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        if len(value) <= _LONGEST or isinstance(value[0], Mapping):
            for index, part in enumerate(value):
                yield from flattened(part, f"{key}.{index}")
    else:
        yield key, value


def _table(paths: Sequence[str | Path]) -> tuple[Sequence[str], list[Row]]:
    """Make one table of several files: CSV rows with their file's name in front, or records with one row per entry.

    Raises:
        InputError: A file is missing or damaged, or CSV and records are mixed.
    """
    endings = {Path(path).suffix for path in paths}
    if endings == {".json"}:
        entries = ((path, key, value) for path in paths for key, value in flattened(read_json(path)))
        return _LONG_COLUMNS, [{"file": str(path), "key": key, "value": _text(value)} for path, key, value in entries]
    if endings != {".csv"}:
        raise InputError(paths[0], f"evidence of several kinds is mixed ({', '.join(sorted(endings))})", "Give each a name")
    rows = [{"file": str(path), **row} for path in paths for row in read_rows(path)]
    return list(dict.fromkeys(name for row in rows for name in row)) or ["file"], rows


def _text(value: Any) -> str:
    """Format a value for CSV: empty for None, and the shortest number that reads back as the same one."""
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def write_packed(out: str | Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write compressed CSV; equal rows give equal bytes, whenever they are written.

    Args:
        out: File `.csv.gz`.
        columns: Names of the columns, in order.
        rows: Rows; what a row lacks stays empty.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    Path(out).write_bytes(gzip.compress(text.getvalue().encode("utf-8"), 9, mtime=0))


def write_evidence(kinds: Mapping[str, Sequence[str | Path]], out: str | Path) -> None:
    """Pack the rows behind an area's figures: `{kind}.csv.gz` for each kind of files.

    Args:
        kinds: Files of each table by its name: all of them CSV, or all of them records (JSON).
        out: The folder.

    Raises:
        InputError: A file is missing or damaged, or all evidence folders together exceed `LARGEST_MB`.
    """
    with atomic_directory(out) as folder:
        for kind, paths in kinds.items():
            if paths:
                write_packed(folder / f"{kind}.csv.gz", *_table(paths))
        others = [path for path in Path(out).parent.rglob("*.csv.gz") if Path(out) not in path.parents]
        size = sum(path.stat().st_size for path in [*others, *folder.iterdir()]) / 1e6
        if size > LARGEST_MB:
            raise InputError(out, f"the evidence takes {size:.1f} MB of {LARGEST_MB:g}", "Keep fewer rows of it")


def record_area(scores: str | Path, record: str | Path, kinds: Mapping[str, Sequence[str | Path]], out: str | Path) -> None:
    """Keep an area's figures and the rows behind them with the code.

    Args:
        scores: File of the scored figures.
        record: File of the copy that is kept with the code.
        kinds, out: See `write_evidence`.
    """
    write_evidence(kinds, out)
    with atomic_file(record) as temporary:
        shutil.copyfile(scores, temporary)


def write_timings(benchmarks: str | Path, out: str | Path) -> None:
    """Pack what each job took: rule, item, seconds and memory.

    Args:
        benchmarks: Folder of the files that snakemake leaves for each job.
        out: File `.csv.gz`.
    """
    rows = timing_rows(sorted(Path(benchmarks).rglob("*.jsonl")))
    with atomic_file(out) as temporary:
        write_packed(temporary, TIMING_COLUMNS, rows)
