"""Sensitivities of a replay to its initial state, time step and commands; made once per mechanism and commands."""

from __future__ import annotations

import functools
import hashlib
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from gsbridge.digests import code_digest
from gsbridge.files import atomic_file
from gsbridge.gap.formats.records import TOOL, Record
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.replay import Mechanism, Span, State
from gsbridge.geometry import Array

KINDS = ("position", "velocity", "effort", TOOL)

FINE = 4
"""Factor by which the time step is divided to measure its error."""

_PARTS = 8
"""Number of parts into which the time between two logged commands is divided to follow a curve through them."""

_ANGLE, _SPEED = 1e-4, 1e-3
"""Steps of the finite differences by the initial state: rad or m, and rad/s or m/s."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of a nominal replay.

    Args:
        nudges: Derivatives by the position and speed of each joint at the start, SI units. [2 N, T, kinds, N]; with a tool the
            last axis has at least three columns, and unused entries are not-a-number.
        stepping: Change by a finer time step. Engines differ by about as much, since each takes speeds or positions at the
            beginning or at the end of a step. [T, kinds, N].
        curving: Change if commands ran along a curve instead of the lines by which the model joins them: they may have been
            sent more often than they were logged. Zero where the model holds commands. [T, kinds, N].
        made: Simulations that making it took; 0 if it was read from a file.
    """

    nudges: Array
    stepping: Array
    curving: Array
    made: int


def start_states(mechanism: Mechanism, record: Record, spans: Sequence[Span], measured: Sequence[State]) -> list[State]:
    """Choose the states at which derivatives are taken.

    Under position feedback these are the commanded states, which records of equal commands share; otherwise the measured ones.

    Args:
        mechanism: The mechanism.
        record: Commands and measurements.
        spans: Stretches of the record.
        measured: Measured state of the joints at the beginning of each stretch.

    Returns:
        State of the joints at the beginning of each stretch.
    """
    if not mechanism.system.controller.closed_loop or "command" not in record.commands:
        return list(measured)
    command = record.commands["command"]
    speed = np.gradient(command, record.time, axis=0)
    return [(command[first].copy(), speed[first].copy()) for first, _ in spans]


@functools.cache
def _edition() -> str:
    """Return a digest of the code that makes a sensitivity, so that no outdated one is read."""
    return code_digest(__name__)


def sensitivity_of(
    mechanism: Mechanism, record: Record, spans: Sequence[Span], measured: Sequence[State], folder: str | Path | None = None
) -> Sensitivity:
    """Return the sensitivity of a record, read from `folder` if an equal one was made before.

    Args:
        mechanism: The mechanism that replays the record.
        record: Commands and measurements.
        spans: Stretches of the record.
        measured: Measured state of the joints at the beginning of each stretch.
        folder: Where sensitivities are kept; nothing is kept when None.
    """
    states = start_states(mechanism, record, spans, measured)
    if folder is None:
        return _make(mechanism, record, spans, states)
    which = TOOL if TOOL in record.measured else ""
    key = hashlib.sha256(f"frame{_edition()}{mechanism.system.digest()}{record.content_digest()}{list(spans)}{which}".encode())
    for q, v in states:
        key.update(q.tobytes() + v.tobytes())
    path = Path(folder) / f"{key.hexdigest()[:32]}.npz"
    if path.exists():
        try:
            with np.load(path) as data:
                return Sensitivity(data["nudges"], data["stepping"], data["curving"], 0)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            path.unlink()
    frame = _make(mechanism, record, spans, states)
    mechanism.shared += frame.made
    # Round a fresh one to the precision of the file, so that findings do not depend on whether it was read.
    names = ("nudges", "stepping", "curving")
    arrays: dict[str, Any] = {name: getattr(frame, name).astype(np.float32) for name in names}
    frame = replace(frame, **arrays)
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **arrays)
    return frame


def _laid(outputs: Mapping[str, Array]) -> Array:
    """Put the outputs of a replay side by side. [T, kinds, columns]."""
    kinds = [kind for kind in KINDS if kind in outputs]
    wide = max(outputs[kind].shape[1] for kind in kinds)
    table = np.full((len(outputs[kinds[0]]), len(kinds), wide), np.nan)
    for row, kind in enumerate(kinds):
        table[:, row, : outputs[kind].shape[1]] = outputs[kind]
    return table


def _make(mechanism: Mechanism, record: Record, spans: Sequence[Span], states: list[State]) -> Sensitivity:
    begin, count, setup = mechanism.runs, len(record.joints), apply_effects(mechanism, ())

    def run(who: Mechanism, begins: list[State]) -> Array:
        out = who.run(record, apply_effects(who, ()) if who is not mechanism else setup, spans, begins)
        return _laid(out)

    plain, nudges = run(mechanism, states), []
    unit = np.eye(2 * count)
    for row in unit:
        size = _ANGLE if row[:count].any() else _SPEED
        moved = [(q + size * row[:count], v + size * row[count:]) for q, v in states]
        nudges.append((run(mechanism, moved) - plain) / size)
    fine = Mechanism(replace(mechanism.system, physics_rate=FINE * mechanism.system.physics_rate))
    stepping = run(fine, states) - plain
    mechanism.runs += fine.runs
    curving = np.zeros_like(plain)
    if mechanism.system.controller.between == "line" and record.commands:
        followed = mechanism.run(_followed(record), setup, [(_PARTS * a, _PARTS * (b - 1) + 1) for a, b in spans], states)
        curving = _laid(followed)[::_PARTS] - plain
    return Sensitivity(np.stack(nudges), stepping, curving, mechanism.runs - begin)


def _followed(record: Record) -> Record:
    """Resample a record's commands along a cubic spline through the logged ones."""
    time, share = record.time, np.arange(_PARTS) / _PARTS
    dense = np.append((time[:-1, None] + np.diff(time)[:, None] * share).ravel(), time[-1])
    commands = {kind: CubicSpline(time, values)(dense) for kind, values in record.commands.items()}
    return replace(record, time=dense, commands=commands)
