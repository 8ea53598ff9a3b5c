"""How a replay moves with its initial state and with the step of time: made once per mechanism and commands, like the bank."""

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
"""Factor by which the step is divided to see what it does."""

_PARTS = 8
"""Parts of the time between two logged commands in which a curve through them is followed."""

_ANGLE, _SPEED = 1e-4, 1e-3
"""Changes of the initial state, rad and rad/s."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of a nominal replay.

    Args:
        nudges: By position and speed of each joint at the start, in SI units. [2 N, T, kinds, N]; with a tool the last axis has
            at least three columns, and what is not there is not-a-number.
        stepping: What a finer step changes. Engines differ by about as much, since each takes speeds or positions at the
            beginning or at the end of a step. [T, kinds, N].
        curving: What it changes if commands that the model joins by lines ran along a curve through them: they may have been
            sent more often than they were logged. Zero where they are held. [T, kinds, N].
        made: Simulations spent on it now; 0 where it was read.
    """

    nudges: Array
    stepping: Array
    curving: Array
    made: int


def start_states(mechanism: Mechanism, record: Record, spans: Sequence[Span], measured: Sequence[State]) -> list[State]:
    """States where derivatives are taken: commanded ones under position feedback, as records may share them, else measured.

    Args:
        mechanism: Simulates.
        record: Commands and measurements.
        spans: Stretches of the record.
        measured: State of the joints at the beginning of each stretch, as measured.

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
    """Digest of the code that makes a sensitivity: none that other code made is read."""
    return code_digest(__name__)


def sensitivity_of(
    mechanism: Mechanism, record: Record, spans: Sequence[Span], measured: Sequence[State], folder: str | Path | None = None
) -> Sensitivity:
    """The sensitivity of a record, read from `folder` where an equal one was made before.

    Args:
        mechanism: Simulates.
        record: Commands and measurements.
        spans: Stretches of the record.
        measured: State of the joints at the beginning of each stretch, as measured.
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
    # The precision of a fresh frame is that of one read again, so that findings do not depend on which it was.
    names = ("nudges", "stepping", "curving")
    arrays: dict[str, Any] = {name: getattr(frame, name).astype(np.float32) for name in names}
    frame = replace(frame, **arrays)
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, **arrays)
    return frame


def _laid(outputs: Mapping[str, Array]) -> Array:
    """Outputs of a replay side by side. [T, kinds, columns]."""
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
    """A record whose commands run along a cubic spline through those that were logged."""
    time, share = record.time, np.arange(_PARTS) / _PARTS
    dense = np.append((time[:-1, None] + np.diff(time)[:, None] * share).ravel(), time[-1])
    commands = {kind: CubicSpline(time, values)(dense) for kind, values in record.commands.items()}
    return replace(record, time=dense, commands=commands)
