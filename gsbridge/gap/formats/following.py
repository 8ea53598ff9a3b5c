"""Checks of columns against each other: whether positions follow commands, and whether speeds are differenced positions."""

from __future__ import annotations

from math import comb
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import Record
from gsbridge.geometry import Array

_MOVES = 0.02
"""Standard deviation of a command or a position, rad or m, above which a joint counts as moving."""

_AGAINST, _APART, _TOGETHER = -0.8, 0.3, 0.95
"""Correlations of a position with a command: opposed below the first, unrelated below the second, following above the third."""

_STRIDE, _STEPS = 0.05, 4.0
"""Time over which positions are compared with speeds, in s and in steps between samples (the longer one counts): neither noise
nor an uneven clock hides the motion then."""

_FAST = 0.2
"""Speed, rad/s or m/s, that no drive shows as 0: its resolution is finer."""

_ALIKE = 0.8
"""Correlation of the distances by speeds and by positions from which on their ratio counts."""

_RATIO = 2.0
"""Factor by which these distances may differ: a filter takes something off, a unit much more."""

_RPM = 30.0 / np.pi
"""Revolutions per minute of 1 rad/s."""

_ORDER = 4
"""Order of the differences that remove the motion of a channel and leave its noise."""

_EQUAL = 0.05
"""Largest distance between logged speeds and differenced positions, in units of the noise of the latter, to count as equal."""


def differenced(record: Record) -> bool:
    """Whether the speeds of all joints are forward, backward or central differences of the logged positions.

    Such speeds carry no information of their own. Speeds from a sensor have noise of their own, and so do those that a drive
    computes from its encoder at a faster rate than the log's.
    """
    if "position" not in record.measured or "velocity" not in record.measured:
        return False
    position, speed = record.measured["position"], record.measured["velocity"][1:-1]
    steps = np.diff(position, axis=0) / np.diff(record.time)[:, None]
    even = np.diff(position, axis=0) / record.period
    across = [np.gradient(position, place, axis=0)[1:-1] for place in (record.time, record.period)]
    known = np.stack([*across, *(part for rates in (steps, even) for part in (rates[:-1], rates[1:]))])
    noise = np.sqrt((np.diff(known, _ORDER, axis=1) ** 2).mean(axis=1) / comb(2 * _ORDER, _ORDER))
    apart = np.sqrt(((speed - known) ** 2).mean(axis=1))
    return bool((apart <= _EQUAL * noise).any(axis=0).all() and speed.any())


def check_following(record: Record, source: str | Path) -> None:
    """Refuse positions that move against their commands, or that follow the commands of another joint.

    Args:
        record: The record; it passes unchecked without positions or without position commands.
        source: File of the record.

    Raises:
        InputError: A sign is wrong, or the columns are in the wrong order.
    """
    if "position" not in record.measured or "command" not in record.commands or record.torque_commands:
        return
    command, position = record.commands["command"], record.measured["position"]
    moved = [k for k in range(len(record.joints)) if command[:, k].std() > _MOVES and position[:, k].std() > _MOVES]
    alike = _correlations(command, position)
    for k in moved:
        joint = record.joints[k]
        if alike[k, k] < _AGAINST:
            raise InputError(
                source, f"joint '{joint}' moves against its command (correlation {alike[k, k]:.2f})",
                f"Turn the sign of 'position.{joint}' or of 'command.{joint}': of the one that counts otherwise than the model",
            )  # fmt: skip
        other = max(moved, key=lambda j: alike[j, k])
        if alike[k, k] < _APART and alike[other, k] > _TOGETHER and alike[other, other] < _APART:
            raise InputError(
                source, f"'position.{joint}' follows 'command.{record.joints[other]}', not its own command",
                "The columns are in another order than their names say: name them anew",
            )  # fmt: skip


def check_velocity(record: Record, source: str | Path) -> None:
    """Refuse speeds that contradict the positions of the same columns: their sign, a unit, or a column that nobody fills.

    Args:
        record: The record; measured speeds are compared with positions, commanded speeds with commanded positions.
        source: File of the record.

    Raises:
        InputError: A joint's speeds run against its positions, stand still while it moves, or differ by a large factor.
    """
    pairs = [("velocity", record.measured.get("velocity"), "position", record.measured.get("position"))]
    if not record.torque_commands:
        pairs.append(("command_velocity", record.commands.get("command_velocity"), "command", record.commands.get("command")))
    time = record.time
    # Over several steps of an uneven log, since a single one may be as long as the motion's own times.
    span = max(_STRIDE, _STEPS * float(np.quantile(np.diff(time), 0.95)))
    first = np.flatnonzero(time + span <= time[-1])
    last = np.searchsorted(time, time[first] + span)
    for kind, speeds, other, places in pairs:
        if speeds is None or places is None or len(first) < 2:
            continue
        # Distances, not rates: of a fast motion, differences take something off, and sums of speeds take off as much.
        way = np.concatenate(
            [np.zeros((1, speeds.shape[1])), np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(time)[:, None], axis=0)]
        )
        said, seen = way[last] - way[first], places[last] - places[first]
        alike = np.diag(_correlations(said, seen))
        for k, joint in enumerate(record.joints):
            if places[:, k].std() <= _MOVES or seen[:, k].std() <= _MOVES * span:
                continue
            fast = np.quantile(np.abs(seen[:, k]), 0.95) > _FAST * span
            if kind == "velocity" and fast and not speeds[:, k].any():
                raise InputError(
                    source, f"'velocity.{joint}' is 0 in every row, while the joint moves",
                    "Leave out all 'velocity' columns if speeds were not measured",
                )  # fmt: skip
            if alike[k] < -_ALIKE:
                raise InputError(
                    source, f"'{kind}.{joint}' runs against '{other}.{joint}' (correlation {alike[k]:.2f})",
                    f"Turn the sign of the one that counts otherwise than the model, or leave out all '{kind}' columns",
                )  # fmt: skip
            ratio = float(said[:, k].std() / seen[:, k].std())
            if alike[k] > _ALIKE and not 1.0 / _RATIO < ratio < _RATIO:
                looks = ": it looks like revolutions per minute" if 0.9 < ratio / _RPM < 1.1 else ""
                raise InputError(
                    source, f"'{kind}.{joint}' is {ratio:.3g} times what '{other}.{joint}' moves by{looks}",
                    f"State it in rad/s or deg/s (m/s where the joint slides), or leave out all '{kind}' columns",
                )  # fmt: skip


def _correlations(some: Array, others: Array) -> Array:
    """Correlate each column of `some` with each of `others`; constant columns give 0. [T, N], [T, N] -> [N, N]."""
    rows = [values - values.mean(axis=0) for values in (some, others)]
    rows = [values / np.maximum(np.linalg.norm(values, axis=0), 1e-12) for values in rows]
    return rows[0].T @ rows[1]
