"""Throws (many short records of the poses of one body, in SI units), checked before anything is computed from them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.gap.formats.columns import Columns, read_table, refuse_unmatched
from gsbridge.geometry import Array

FEWEST = 8
"""Smallest number of throws in a role: with fewer, a bootstrap over throws says nothing."""

SHORTEST = 0.1
"""Shortest accepted throw, s."""

_ROWS = 10
"""Smallest number of samples in a throw."""

_UNIT_NORM = 0.05
"""Largest accepted difference of a quaternion's length from 1."""

_AXES = "xyz"

COLUMNS = (
    *("time", "throw"),
    *(f"position.{axis}" for axis in _AXES),
    *(f"orientation.{axis}" for axis in "w" + _AXES),
    *(f"{kind}.{axis}" for kind in ("velocity", "angular_velocity") for axis in _AXES),
)
"""Our names of the columns of throws; the speeds are optional."""


@dataclass(frozen=True)
class Throw:
    """One throw.

    Args:
        name: Name for messages.
        time: Times of the samples, s, rising, from 0. [T].
        position: Position of the body frame's origin in the log's frame, m; z is up. [T, 3].
        quat: Attitude of the body frame in the log's frame, wxyz. [T, 4].
        velocity: Velocity at the first sample, log's frame, m/s; None if it was not logged. [3].
        spin: Angular velocity at the first sample, log's frame, rad/s; None if it was not logged. [3].
    """

    name: str
    time: Array
    position: Array
    quat: Array
    velocity: Array | None = None
    spin: Array | None = None

    @property
    def duration(self) -> float:
        """Length of the throw, s."""
        return float(self.time[-1])


@dataclass(frozen=True)
class Throws:
    """Throws of one body.

    Args:
        items: The throws.
        digest: SHA-256 of the files, or of the arrays.
        name: Name for reports.
    """

    items: tuple[Throw, ...]
    digest: str = field(default="")
    name: str = ""

    def __len__(self) -> int:
        return len(self.items)

    def part(self, first: int, last: int) -> Throws:
        """Return the throws from `first` up to, but without, `last`."""
        return Throws(self.items[first:last], self.digest, self.name)

    def chosen(self, numbers: Sequence[int]) -> Throws:
        """Return the throws with these numbers, counted from 0."""
        return Throws(tuple(self.items[number] for number in numbers), self.digest, self.name)

    def content_digest(self) -> str:
        """Return the SHA-256 of times and poses."""
        total = hashlib.sha256()
        for throw in self.items:
            for values in (throw.time, throw.position, throw.quat):
                total.update(np.ascontiguousarray(values).tobytes())
        return total.hexdigest()


def read_throws(path: str | Path, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None) -> Throws:
    """Read throws from a CSV or Parquet file with a column `throw`, or from a folder with one file per throw.

    Args:
        path: File or folder.
        columns: Maps our name of a column to the files'; other columns have our names.
        units: Maps our name of a column, or only its kind, to its unit; for files whose headers state no units.

    Raises:
        InputError: The files cannot be read, a column or unit is missing, a value is not a number, times do not rise, a
            quaternion is not of unit length, or a throw is too short.
    """
    path = Path(path)
    files = [path]
    if os.path.isdir(path):
        files = sorted((item for item in path.iterdir() if item.suffix.lower() in (".csv", ".parquet")), key=_natural)
    if not files:
        raise InputError(
            path, "the folder holds no CSV or Parquet file", "One file per throw, or one file with a column 'throw'"
        )
    digest, items, unmatched = hashlib.sha256(), [], []
    for file in files:
        table, data = read_table(file, "throws")
        digest.update(data)
        read = Columns(table, file, columns or {}, units or {})
        unmatched.append(read.unmatched())
        items += _throws_of(read, alone=os.path.isdir(path))
    refuse_unmatched(columns or {}, unmatched, path)
    return Throws(tuple(items), digest.hexdigest(), path.stem)


def _natural(path: Path) -> tuple[int, str]:
    """Return a sort key for file names that puts 2 before 10."""
    digits = "".join(character for character in path.stem if character.isdecimal())
    return (int(digits) if digits else -1, path.name)


def _throws_of(columns: Columns, *, alone: bool) -> list[Throw]:
    """Read all throws of one file; `alone` says that the file is a single throw."""
    source = columns.source
    time = columns.need("time", "time")
    number = None if alone else columns.need("throw", "number")
    names = [source.stem] if number is None else list(dict.fromkeys(number.tolist()))
    places = [np.arange(len(time)) if number is None else np.flatnonzero(number == name) for name in names]

    def at_start(kind: str, dimension: str) -> Array | None:
        """Return the values in the first row of each throw, which alone count and may be the only ones. [N, 3]."""
        first = np.array([rows[0] for rows in places])
        found = [columns.get(f"{kind}.{name}", dimension, first) for name in _AXES]
        present = [values for values in found if values is not None]
        if present and len(present) < len(found):
            raise InputError(source, f"'{kind}' lacks a component", f"Give {kind}.{{{','.join(_AXES)}}}, or none")
        return np.stack(present, axis=1) if present else None

    position = np.stack([columns.need(f"position.{name}", "length") for name in _AXES], axis=1)
    quat = np.stack([columns.need(f"orientation.{name}", "number") for name in "w" + _AXES], axis=1)
    velocity, spin = at_start("velocity", "speed"), at_start("angular_velocity", "angular speed")
    lengths = np.linalg.norm(quat, axis=1)
    worst = int(np.abs(lengths - 1.0).argmax())
    if abs(lengths[worst] - 1.0) > _UNIT_NORM:
        raise InputError(
            source, f"the quaternion of data row {worst + 1} has the length {lengths[worst]:.3g}",
            "Log unit quaternions, orientation.w first",
        )  # fmt: skip
    out = []
    for place, (name, rows) in enumerate(zip(names, places, strict=True)):
        title = name if isinstance(name, str) else f"{name:g}"
        _check_clock(time[rows], source, title)
        out.append(
            Throw(
                title,
                time[rows] - time[rows[0]],
                position[rows],
                quat[rows] / lengths[rows, None],
                None if velocity is None else velocity[place],
                None if spin is None else spin[place],
            )
        )
    return out


def _check_clock(time: Array, source: Path, name: str) -> None:
    """Refuse times that do not rise, and throws that are too short."""
    if len(time) < _ROWS or time[-1] - time[0] < SHORTEST:
        raise InputError(
            source, f"throw {name} has {len(time)} rows in {time[-1] - time[0]:.3g} s",
            f"A throw needs {_ROWS} rows and {SHORTEST:g} s; log at 50 Hz or more",
        )  # fmt: skip
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        raise InputError(
            source, f"throw {name}: the clock runs backwards or stands still behind its row {int(back[0]) + 1}",
            "Sort rows by time; rows of one throw share its number",
        )  # fmt: skip


def _numbers(throws: Throws) -> list[int]:
    """Return a number for each throw: its name if all names are different numbers, otherwise its index."""
    own = [str(throw.name) for throw in throws.items]
    different = len(set(own)) == len(own) and all(name.isdecimal() for name in own)
    return [int(name) for name in own] if different else list(range(len(own)))


def write_throws(path: str | Path, throws: Throws) -> None:
    """Write throws as one CSV file in the layout that `read_throws` reads.

    All rows of a throw repeat the speeds of its first sample, since only the first row is read. Throws keep their names as
    numbers if all names are different numbers; otherwise they are numbered from 0.
    """
    frames = []
    for number, throw in zip(_numbers(throws), throws.items, strict=True):
        table = {"throw": np.full(len(throw.time), number), "time [s]": throw.time}
        table |= {f"position.{axis} [m]": throw.position[:, k] for k, axis in enumerate(_AXES)}
        table |= {f"orientation.{axis}": throw.quat[:, k] for k, axis in enumerate("w" + _AXES)}
        for kind, unit, values in (("velocity", "m/s", throw.velocity), ("angular_velocity", "rad/s", throw.spin)):
            if values is not None:
                table |= {f"{kind}.{axis} [{unit}]": values[k] for k, axis in enumerate(_AXES)}
        frames.append(pd.DataFrame(table))
    pd.concat(frames).to_csv(path, index=False)
