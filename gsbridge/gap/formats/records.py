"""Records: what was commanded and what was measured, in SI units, checked before anything is computed from it."""

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
"""Shortest record of a driven mechanism, s: less holds too little excitation to tell effects apart."""

COMMANDS = {"command": "angle", "command_velocity": "angular speed", "feedforward": "torque"}
"""Kinds of command columns, each per joint, and their dimension at a joint that turns. In torque mode `command` is a torque."""

MEASURED = {"position": "angle", "velocity": "angular speed", "effort": "torque"}
"""Kinds of measured columns, each per joint."""

TOOL = "tool"
"""Kind of the measured place of one link in the base frame, m; its columns are `AXES` instead of joints."""

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
        sigma: Noise of one sample, by kind, where it is known. Each [N].
        quantum: Step of the digits, by kind, 0 where there is none. Each [N].
        tolerance: Deviation that nobody asks to be explained, by kind: what the user states, and by how much repeats of one
            motion differ beyond the noise. Each [N].
        digest: SHA-256 of the file, or of the arrays.
        torque_commands: Whether `command` is a torque.
        sliding: Those of the joints that slide, whose figures are in metres and newtons.
        held: Joints that are logged, but held at zero in the model: how far from there they get, rad or m.
        cut: What was left out of the log as it was read, in words; empty where all of it was taken.
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

    def label(self, kind: str, number: int) -> str:
        """Name of a channel: `position.joint`, or `tool.x`."""
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
        """A record with these commands and other measurements, by kind. [T, N] each."""
        return replace(self, measured=dict(measured))

    def part(self, first: int, end: int, name: str) -> Record:
        """A part of the record, with a clock of its own.

        Args:
            first: Its first sample.
            end: The sample behind its last.
            name: What it is called, in brackets behind the record's name.
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
        """SHA-256 over the times and commands: what a simulation of this record depends on besides its initial state."""
        total = hashlib.sha256(np.ascontiguousarray(self.time).tobytes())
        for kind in sorted(self.commands):
            total.update(kind.encode() + np.ascontiguousarray(self.commands[kind]).tobytes())
        return total.hexdigest()


@dataclass(frozen=True)
class Layout:
    """Names of a file's columns, and their units.

    Args:
        joints: Joints of the mechanism, as its description names them.
        torque_mode: Whether the commands are torques.
        columns: Our name of a column to that of the file, e.g. `position.axis` to `enc_1 [deg]`; others keep our name.
        units: Our name of a column, or its kind alone, to its unit; for files whose headers state none.
        torque_per_ampere: Gain of efforts logged in amperes by joint, N m/A, at a joint that slides N/A.
        sliding: Those of the joints that slide instead of turning.
        held: Further joints of the mechanism, which the model holds at zero, and whether they slide.
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
            record is too short, or angles are degrees where radians are stated.
    """
    path = Path(path)
    table, data = read_table(path, "record")
    return record_of(table, path, layout, digest=hashlib.sha256(data).hexdigest())


def record_of(table: pd.DataFrame, path: Path, layout: Layout, *, digest: str, headers: bool = True) -> Record:
    """A record from a table with our columns, or with those that the layout names.

    Args:
        table: One row per sample.
        path: Where it comes from, for its name and for errors.
        layout: How its columns are called.
        digest: SHA-256 of the file.
        headers: Whether the file is a table whose headers can state units.

    Raises:
        InputError: As `read_record`.
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
        sliding=layout.sliding, held=_held(columns, layout.held),
    )  # fmt: skip
    check_clock(record, path)
    check_degrees(record, path)
    # By the digits as they were logged: a turn is no whole number of steps.
    return replace(_unwrapped(record), quantum={kind: quantum_of(values) for kind, values in measured.items()})


def _unwrapped(record: Record) -> Record:
    """A record whose joints that turn do not jump by a turn; see `gsbridge.gap.formats.branches.unwrapped`."""
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
    """How far the joints of `joints` get from zero, rad or m; those that are not logged, or not with a unit, are left out."""
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
    """Columns `kind.joint` of all joints, or None if there is none of the kind.

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
    """Refuse times that do not rise, and records of a mechanism that are too short.

    Raises:
        InputError: The times do not rise, or the record is too short.
    """
    steps = np.diff(record.time)
    if len(steps) < 10:
        raise InputError(source, f"the record has {len(record.time)} rows", "A record needs many; log at 50 Hz or more")
    refuse_backwards(record.time, source, "data row {row}", still=True)
    # Stamps of a faster or slower clock than any logger has are those of another unit.
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
        place: Where the clock runs backwards, with `{row}` for the number of its row, for messages.
        still: Whether a clock that stands still is refused, too.

    Raises:
        InputError: The times run backwards.
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0 if still else steps < 0)
    if len(back):
        row = int(back[0])
        # Rows in disorder lie a few periods apart; a clock that was set anew must not be sorted into what came before.
        anew = -steps[row] > 10 * np.median(np.abs(steps))
        does = f"runs backwards by {-steps[row]:.3g} s" if steps[row] else "stands still"
        raise InputError(
            source, f"the clock {does} at {place.format(row=row + 2)}",
            "It was set anew: cut the log there, and give the longer part" if anew
            else "Sort the log by its source's time stamps, and drop rows that were logged twice",
        )  # fmt: skip


def check_degrees(record: Record, source: str | Path, limits: Array | None = None) -> None:
    """Refuse angles that are evidently degrees although radians are stated, or the reverse; of joints that slide, millimetres.

    The slope of one channel against another that must agree tells it: speeds against the derivative of positions, positions
    against commands, and positions against the joints' limits.

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
            # Coarse differences: noise of the positions must not hide the slope.
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
    """Joints whose angles may be degrees although radians are stated, and nothing in the record tells: what to ask the user.

    A joint without limits may well turn many times; one that swings by more than two turns is worth a question.

    Args:
        record: The record.
        limits: Lower and upper limits of the joints, rad. [N, 2].
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
    """Slope of two series that follow each other closely, None for others."""
    a, b = values - values.mean(), against - against.mean()
    if b.std() < 1e-6 or a.std() == 0 or abs(np.mean(a * b)) < 0.8 * a.std() * b.std():
        return None
    return float(abs(np.mean(a * b)) / b.var())
