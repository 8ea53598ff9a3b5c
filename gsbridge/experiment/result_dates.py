"""Dates of results, restored after a copy, an archive, a wrong clock or a job that made them again as they were.

Snakemake goes by dates. Results that are the same as before keep their date, so that nothing after them is made again where
the code of a stage was changed, but not what it makes.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from gsbridge.files import atomic_file

_STAMP = ".snakemake_timestamp"
"""File in each folder that a job made, whose date is the folder's for snakemake."""

_KNOWN = Path(".snakemake/contents_of_results.json")
"""File that keeps, of each result, the end of the job that made it last, its date, and a digest of its content."""

_EDITED = 1.0
"""Time after the end of a job from which on a younger file counts as edited, s."""


class _Result(NamedTuple):
    """A file or folder that a job has made.

    Args:
        path: The result.
        dated: File whose date is that of the result for snakemake.
        end: When the job ended, s since 1970; None if the record does not say.
        inputs: Inputs of the job, as its record names them.
    """

    path: Path
    dated: Path
    end: float | None
    inputs: tuple[str, ...]

    @property
    def folder(self) -> bool:
        return self.dated != self.path


class _Known(NamedTuple):
    """Facts about a result as it was at an earlier call."""

    end: float
    date: float
    digest: str


def restore_dates(working: Path) -> list[str]:
    """Give results the dates at which they were made, so that a copy of finished results reruns nothing.

    Where dates ask for a rerun, snakemake compares the contents of files, but for a folder it compares only the date of a
    stamp file inside it. Only a job writes this stamp, and the record of the job says when it ended, so the stamp takes that
    date. A file that is older than the end of its job came from an archive that rounds dates, or from a machine whose clock
    was behind. It takes the date of the record; otherwise it would seem older than the folders that it was made from. A file
    that is younger may have been edited and keeps its date. No date is set later than now, even where another machine's clock
    was ahead: snakemake refuses outputs that are older than their inputs.

    A result that a later job has made again, byte for byte, takes the date that it had before, unless one of the job's inputs
    is younger than that.

    Args:
        working: Folder in which snakemake works: results and records lie below it.

    Returns:
        Results whose date was changed, as their records name them.
    """
    now, results = time.time(), dict(_results(working))
    wanted = _wanted_dates(working, results, now)
    out = []
    for name, date in wanted.items():
        dated = results[name].dated
        try:
            if abs(date - dated.stat().st_mtime) > 1e-3:
                os.utime(dated, (date, date))
                out.append(name)
        except OSError:
            # The result may not be written.
            continue
    _date_measurements(working, max((result.end or 0.0 for result in results.values()), default=0.0))
    return sorted(out)


def _results(working: Path) -> Iterator[tuple[str, _Result]]:
    """Yield what jobs have made and is still there, by the names in their records."""
    for record in (working / ".snakemake" / "metadata").rglob("*"):
        if not record.is_file():
            continue
        try:
            # Snakemake splits a long name over folders, and marks these with a leading `@`.
            parts = record.relative_to(working / ".snakemake" / "metadata").parts
            name = base64.urlsafe_b64decode("".join(part.removeprefix("@") for part in parts)).decode()
            content = json.loads(record.read_text(encoding="utf-8"))
            path = working / name
            dated = path / _STAMP if path.is_dir() else path
            dated.stat()
            yield name, _Result(path, dated, content["endtime"], tuple(content.get("input") or ()))
        except (OSError, ValueError, KeyError):
            # The result is gone, or it is a record that snakemake will not read either.
            continue


def _wanted_dates(working: Path, results: Mapping[str, _Result], now: float) -> dict[str, float]:
    """Dates that results should have, s since 1970, by name."""
    known, fresh = _read_known(working), dict[str, _Known]()
    out: dict[str, float] = {}

    def date_of(name: str) -> float:
        """Date that a file or folder should have; results of jobs take theirs after those of the job's inputs."""
        if name in out:
            return out[name]
        result = results.get(name)
        if result is None:
            try:
                return (working / name).stat().st_mtime
            except OSError:
                return now
        date = result.dated.stat().st_mtime
        out[name] = _wanted(date, result.end, now, result.folder)
        if result.end is None or result.end > now or (not result.folder and date > result.end + _EDITED):
            return out[name]
        before = known.get(name)
        try:
            digest = before.digest if before is not None and before.end == result.end else _digest(result.path)
        except OSError:
            # It may not be read, or goes away meanwhile.
            return out[name]
        if before is not None and before.digest == digest and all(date_of(one) <= before.date for one in result.inputs):
            out[name] = before.date
        fresh[name] = _Known(result.end, out[name], digest)
        return out[name]

    for name in results:
        date_of(name)
    if fresh != known:
        _write_known(working, fresh)
    return out


def _digest(path: Path) -> str:
    """Digest of the content of a file, or of all files of a folder and their names."""
    made = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file() and file.name != _STAMP:
            made.update(f"{file.relative_to(path)}\0".encode())
            with file.open("rb") as content:
                made.update(hashlib.file_digest(content, "sha256").digest())
    return made.hexdigest()[:32]


def _read_known(working: Path) -> dict[str, _Known]:
    """Read what earlier calls knew; nothing where that is missing or damaged, so that results keep their new dates."""
    try:
        content = json.loads((working / _KNOWN).read_text(encoding="utf-8"))
        return {name: _Known(float(end), float(date), str(digest)) for name, (end, date, digest) in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _write_known(working: Path, known: Mapping[str, _Known]) -> None:
    """Write what later calls should know. If that cannot be written, results keep their new dates next time."""
    try:
        with atomic_file(working / _KNOWN) as temporary:
            temporary.write_text(json.dumps(known), encoding="utf-8")
    except OSError:
        return


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
