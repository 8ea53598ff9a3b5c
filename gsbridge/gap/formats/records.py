"""Records of commands and measurements in SI units, checked before anything is computed from them."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.gap.formats.branches import unwrapped
from gsbridge.gap.formats.columns import Columns, read_table
from gsbridge.gap.formats.quantum import quantum_of
from gsbridge.gap.formats.units import SLIDING
from gsbridge.geometry import Array

SHORTEST = 2.0
"""Shortest accepted record of a driven mechanism, s: a shorter one has too little excitation to tell effects apart."""

COMMANDS = {"command": "angle", "command_velocity": "angular speed", "feedforward": "torque"}
"""Kinds of command columns, each per joint, and their dimension at a joint that turns. In torque mode `command` is a torque."""

MEASURED = {"position": "angle", "velocity": "angular speed", "effort": "torque"}
"""Kinds of measured columns, each per joint."""

TOOL = "tool"
"""Kind of the measured position of one link in the base frame, m; its columns are `AXES` instead of joints."""

AXES = ("x", "y", "z")

_DEGREES = 180 / np.pi
_MILLIMETRES = 1e3


@dataclass(frozen=True)
class Record:
    """Commands and measurements of one log.

    Args:
        name: Name for messages and reports.
        time: Times of the samples, s, rising, from 0. [T].
        joints: Names of the mechanism's joints.
        commands: Commands by kind. Each [T, N].
        measured: Measurements by kind. Each [T, N]; `tool` [T, 3].
        sigma: Standard deviation of the noise of one sample, by kind, if it is known. Each [N].
        quantum: Quantisation step, by kind; 0 if there is none. Each [N].
        tolerance: Deviation that need not be explained, by kind: the one that the user states, and the one by which repeats
            of a motion differ beyond the noise. Each [N].
        digest: SHA-256 of the file, or of the arrays.
        torque_commands: Whether `command` is a torque.
        sliding: Names of the joints that slide; their values are in metres and newtons.
        held: Largest distance from zero, rad or m, of joints that are logged but that the model holds at zero.
        cut: Sentence about the part of the log that was left out while reading; empty if all of it was taken.
        unmatched: Columns that the case names and the file lacks; see `gsbridge.gap.formats.columns.Columns.unmatched`.
    """

    name: str
    time: Array
    joints: tuple[str, ...]
    commands: Mapping[str, Array]
    measured: Mapping[str, Array]
    sigma: Mapping[str, Array] = field(default_factory=dict)
    quantum: Mapping[str, Array] = field(default_factory=dict)
    digest: str = ""
    torque_commands: bool = False
    tolerance: Mapping[str, Array] = field(default_factory=dict)
    sliding: tuple[str, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    cut: str = ""
    unmatched: Mapping[str, str] = field(default_factory=dict)

    def label(self, kind: str, number: int) -> str:
        """Return the name of a channel: `position.joint`, or `tool.x`."""
        return f"{kind}.{AXES[number] if kind == TOOL else self.joints[number]}"

    @property
    def duration(self) -> float:
        """Length of the record, s."""
        return float(self.time[-1])

    @property
    def period(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.time)))

    def with_measured(self, measured: Mapping[str, Array]) -> Record:
        """Return a copy of the record with other measurements, by kind. [T, N] each."""
        return replace(self, measured=dict(measured))

    def part(self, first: int, end: int, name: str) -> Record:
        """Return a part of the record, whose time starts from 0 again.

        Args:
            first: First sample of the part.
            end: The sample after its last one.
            name: Name of the part, put in brackets after the record's name.
        """
        rows = slice(first, end)
        return replace(
            self,
            name=f"{self.name} ({name})",
            time=self.time[rows] - self.time[first],
            commands={kind: values[rows] for kind, values in self.commands.items()},
            measured={kind: values[rows] for kind, values in self.measured.items()},
        )

    def content_digest(self) -> str:
        """Return the SHA-256 of times and commands: all that a simulation depends on, apart from the initial state."""
        total = hashlib.sha256(np.ascontiguousarray(self.time).tobytes())
        for kind in sorted(self.commands):
            total.update(kind.encode() + np.ascontiguousarray(self.commands[kind]).tobytes())
        return total.hexdigest()


@dataclass(frozen=True)
class Layout:
    """Names of a file's columns, and their units.

    Args:
        joints: Joints of the mechanism, named as in its description.
        torque_mode: Whether the commands are torques.
        columns: Maps our name of a column to the file's, e.g. `position.axis` to `enc_1 [deg]`; other columns have our name.
        units: Maps our name of a column, or only its kind, to its unit; for files whose headers state no units.
        torque_per_ampere: Gain of efforts logged in amperes, by joint, N m/A; N/A at a joint that slides.
        sliding: Names of the joints that slide instead of turning.
        held: Maps further joints of the mechanism, which the model holds at zero, to whether they slide.
    """

    joints: tuple[str, ...]
    torque_mode: bool = False
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    torque_per_ampere: Mapping[str, float] = field(default_factory=dict)
    sliding: tuple[str, ...] = ()
    held: Mapping[str, bool] = field(default_factory=dict)


def read_record(path: str | Path, layout: Layout) -> Record:
    """Read a record from CSV (header `name [unit]`) or Parquet.

    Raises:
        InputError: The file cannot be read, a column or unit is missing, a value is not a number, the clock runs backwards, the
            record is too short, or angles are in degrees although radians are stated.
    """
    path = Path(path)
    table, data = read_table(path, "record")
    return record_of(table, path, layout, digest=hashlib.sha256(data).hexdigest())


def record_of(table: pd.DataFrame, path: Path, layout: Layout, *, digest: str, headers: bool = True) -> Record:
    """Make a record from a table with our column names, or with those that the layout maps to ours.

    Args:
        table: One row per sample.
        path: The file that it comes from, for the record's name and for error messages.
        layout: Names and units of the columns.
        digest: SHA-256 of the file.
        headers: Whether the file is a table whose headers can state units.

    Raises:
        InputError: For the reasons listed at `read_record`.
    """
    columns = Columns(table, path, layout.columns, layout.units, layout.torque_per_ampere, headers)
    time = columns.need("time", "time")
    commands, measured = {}, {}
    for kind, dimension in COMMANDS.items():
        dimension = "torque" if layout.torque_mode and kind == "command" else dimension
        found = _per_joint(kind, dimension, layout.joints, columns, layout.sliding)
        if found is not None:
            commands[kind] = found
    for kind, dimension in MEASURED.items():
        found = _per_joint(kind, dimension, layout.joints, columns, layout.sliding)
        if found is not None:
            measured[kind] = found
    tool = _per_joint(TOOL, "length", AXES, columns)
    if tool is not None:
        measured[TOOL] = tool
    elif "position" not in measured:
        columns.need(f"position.{layout.joints[0]}", "angle")
    record = Record(
        path.stem, time - time[0], layout.joints, commands, measured, digest=digest, torque_commands=layout.torque_mode,
        sliding=layout.sliding, held=_held(columns, layout.held), unmatched=columns.unmatched(),
    )  # fmt: skip
    check_clock(record, path)
    check_degrees(record, path)
    # Steps come from the angles as logged: a turn is not a whole number of steps, so unwrapping breaks the grid.
    return replace(_unwrapped(record), quantum={kind: quantum_of(values) for kind, values in measured.items()})


def _unwrapped(record: Record) -> Record:
    """Remove jumps by a full turn from joints that turn; see `gsbridge.gap.formats.branches.unwrapped`."""
    measured, commands = dict(record.measured), dict(record.commands)
    angles = [(measured, "position")] + ([] if record.torque_commands else [(commands, "command")])
    columns = {kind: part[kind].copy() for part, kind in angles if kind in part}
    for k, joint in enumerate(record.joints):
        if joint not in record.sliding:
            told = [columns[kind][:, k] if kind in columns else None for kind in ("position", "command")]
            for kind, values in zip(("position", "command"), unwrapped(record.time, *told), strict=True):
                if values is not None:
                    columns[kind][:, k] = values
    for part, kind in angles:
        if kind in columns:
            part[kind] = columns[kind]
    return replace(record, measured=measured, commands=commands)


def _held(columns: Columns, joints: Mapping[str, bool]) -> dict[str, float]:
    """Return the largest distance of joints from zero, rad or m; skip joints that are not logged, or without a unit."""
    out = {}
    for joint, slides in joints.items():
        with contextlib.suppress(InputError):
            values = columns.get(f"position.{joint}", "length" if slides else "angle")
            if values is not None:
                out[joint] = float(np.abs(values).max())
    return out


def _per_joint(
    kind: str, dimension: str, joints: Sequence[str], columns: Columns, sliding: Collection[str] = ()
) -> Array | None:
    """Return the columns `kind.joint` of all joints, or None if there are no columns of that kind. [T, N].

    Args:
        kind: First part of the columns' names, such as `position`.
        dimension: Dimension of the values of joints that turn, such as `angle`.
        joints: Names of all joints.
        columns: Columns of the file.
        sliding: Names of the joints that slide.
    """
    found = {joint: columns.get(f"{kind}.{joint}", SLIDING[dimension] if joint in sliding else dimension) for joint in joints}
    if all(values is None for values in found.values()):
        return None
    stated = []
    for joint, values in found.items():
        if values is None:
            raise InputError(
                columns.source,
                f"there are '{kind}' columns, but no '{kind}.{joint}'",
                f"Name it '{kind}.{joint} [unit]', in the file or under 'columns' in the case; "
                f"if it was not logged, leave out all '{kind}' columns, or the joint from 'joints' of the model",
            )
        stated.append(values)
    return np.stack(stated, axis=1)


def check_clock(record: Record, source: str | Path) -> None:
    """Refuse times that do not rise, times in an unlikely unit, and records of a mechanism that are too short.

    Raises:
        InputError: The times do not rise or seem to be in another unit, or the record is too short.
    """
    steps = np.diff(record.time)
    if len(steps) < 10:
        raise InputError(source, f"the record has {len(record.time)} rows", "A record needs many; log at 50 Hz or more")
    refuse_backwards(record.time, source, "data row {row}", still=True)
    # No logger samples faster or slower than this, so the times must be in another unit.
    if not 1e-5 < record.period < 1.0:
        raise InputError(
            source, f"there are {record.period:.3g} s between two samples: the times look like another unit",
            "State the unit of the times, e.g. [ms]",
        )  # fmt: skip
    if record.duration < SHORTEST:
        why = f" ({record.cut})" if record.cut else ""
        raise InputError(source, f"the record lasts {record.duration:.3g} s{why}", f"Log at least {SHORTEST:g} s of motion")


def refuse_backwards(time: Array, source: str | Path, place: str, *, still: bool = False) -> None:
    """Refuse times that run backwards.

    Args:
        time: Times, s. [T].
        source: Their file, for messages.
        place: Words for the place of the fault, with `{row}` for its row number, for messages.
        still: Whether a clock that stands still is refused, too.

    Raises:
        InputError: The times run backwards.
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0 if still else steps < 0)
    if len(back):
        row = int(back[0])
        # Rows in the wrong order are only a few periods apart. After a larger step back the clock was reset: sorting would then
        # mix two stretches of the log.
        anew = -steps[row] > 10 * np.median(np.abs(steps))
        does = f"runs backwards by {-steps[row]:.3g} s" if steps[row] else "stands still"
        raise InputError(
            source, f"the clock {does} at {place.format(row=row + 2)}",
            "It was set anew: cut the log there, and give the longer part" if anew
            else "Sort the log by its source's time stamps, and drop rows that were logged twice",
        )  # fmt: skip


def check_degrees(record: Record, source: str | Path, limits: Array | None = None) -> None:
    """Refuse degrees where radians are stated, and millimetres where metres are stated, or the reverse.

    Channels that must agree reveal the unit: the slope of speeds against the derivative of positions, the slope of commands
    against positions, and the range of positions against the joints' limits.

    Args:
        record: The record.
        source: File of the record.
        limits: Lower and upper limits of the joints, rad or m. [N, 2].

    Raises:
        InputError: Angles are evidently in another unit than stated.
    """
    position = record.measured.get("position")
    if position is None:
        return
    for k, joint in enumerate(record.joints):
        slides = joint in record.sliding
        wrong, right, times, unit = (
            ("millimetres", "metres", _MILLIMETRES, "m") if slides else ("degrees", "radians", _DEGREES, "rad")
        )
        units = ("[mm]", "[mm/s]") if slides else ("[deg]", "[deg/s]")
        pairs = {}
        if "velocity" in record.measured:
            # Differences over 0.05 s, so that the noise of the positions does not hide the slope.
            stride = max(1, int(0.05 / record.period))
            rate = (position[stride:, k] - position[:-stride, k]) / (record.time[stride:] - record.time[:-stride])
            pairs["velocity"] = (record.measured["velocity"][stride // 2 : stride // 2 + len(rate), k], rate)
        if "command" in record.commands and not record.torque_commands:
            pairs["command"] = (record.commands["command"][:, k], position[:, k])
        for kind, (values, against) in pairs.items():
            slope = _slope(values, against)
            for factor, text in ((times, wrong), (1 / times, f"{right} where the positions are {wrong}")):
                if slope is not None and abs(np.log(slope / factor)) < 0.35:
                    raise InputError(
                        source, f"joint '{joint}': '{kind}' is {slope:.3g} times what the positions say: it looks like {text}",
                        f"State the unit that was logged, e.g. {units[0]} or {units[1]}",
                    )  # fmt: skip
        if limits is not None and np.isfinite(limits[k]).all() and limits[k, 1] > limits[k, 0]:
            reach = np.abs(position[:, k]).max()
            if reach > 1.5 * np.abs(limits[k]).max() and reach / times <= np.abs(limits[k]).max():
                raise InputError(
                    source, f"joint '{joint}' is logged up to {reach:.3g} {unit}, its limit is "
                    f"{np.abs(limits[k]).max():.3g} {unit}: it looks like {wrong}",
                    f"State the unit that was logged, e.g. {units[0]}, or correct the limit",
                )  # fmt: skip


def doubtful_degrees(record: Record, limits: Array | None = None) -> list[str]:
    """Return questions to the user about joints whose angles may be in degrees although radians are stated.

    They concern joints without limits that move through more than two turns. Such a joint may well turn many times, so the
    record alone cannot decide.

    Args:
        record: The record.
        limits: Lower and upper limits of the joints, rad; None if they are not known. [N, 2].
    """
    position = record.measured.get("position")
    if position is None:
        return []
    out = []
    for k, joint in enumerate(record.joints):
        if joint in record.sliding:
            continue
        bounded = limits is not None and np.isfinite(limits[k]).all() and limits[k, 1] > limits[k, 0]
        reach = float(np.ptp(position[:, k]))
        if not bounded and reach > 4 * np.pi:
            out.append(f"joint '{joint}' has no limit and moves through {reach:.3g} rad: if these are degrees, state [deg]")
    return out


def _slope(values: Array, against: Array) -> float | None:
    """Return the absolute slope of `values` against `against` if they are closely correlated, else None. Both [T]."""
    a, b = values - values.mean(), against - against.mean()
    if b.std() < 1e-6 or a.std() == 0 or abs(np.mean(a * b)) < 0.8 * a.std() * b.std():
        return None
    return float(abs(np.mean(a * b)) / b.var())
