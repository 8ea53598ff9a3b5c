"""Angles of encoders that begin anew after a turn: a joint cannot jump by one between two samples."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

TURN = 2.0 * np.pi

_ABOUT = (0.75 * TURN, 1.25 * TURN)
"""Sizes of a jump between two samples, rad, that may be a turn and what the joint moved meanwhile."""

_FASTEST = 30.0
"""Speed, rad/s, up to which a real joint may have made such a jump itself; only slow logs come near it."""

_REACH = 1.02 * TURN
"""Largest range of angles, rad, that begin anew after a turn, with room for noise."""

_NEAR = 0.5
"""Distance of positions from commands, rad, up to which they are the same but for whole turns."""


def unwrapped(time: Array, position: Array | None, command: Array | None) -> tuple[Array | None, Array | None]:
    """Positions and commands of one joint without jumps by a turn, both counted from the same turn.

    A command that jumps is believed where the position goes the long way with it. Where both differ by whole turns alone, the
    position is moved to the command, which is given in the model's angles.

    Args:
        time: Times of the samples, s. [T].
        position: Measured angles, rad; None where there are none. [T].
        command: Commanded angles, rad; None where there are none. [T].
    """
    wraps = all(angles is None or np.ptp(angles) <= _REACH for angles in (position, command))
    if position is not None:
        turns = _turns(time, position)
        wraps = wraps or bool(turns.any())
        position = position + TURN * turns
    if command is not None:
        turns = _turns(time, command)
        other = command + TURN * turns
        if turns.any() and (position is None or _apart(position, other) < _apart(position, command)):
            command, wraps = other, True
    if position is not None and command is not None and wraps:
        away = float(np.median(position - command))
        if abs(away) > _NEAR and abs(away - TURN * round(away / TURN)) < _NEAR:
            position = position - TURN * round(away / TURN)
    return position, command


def _turns(time: Array, angles: Array) -> Array:
    """Whole turns that have to be added to angles so that they do not jump; zeros for angles that no encoder wraps. [T]."""
    steps, periods = np.diff(angles), np.diff(time)
    jumps = (np.abs(steps) > _ABOUT[0]) & (np.abs(steps) < _ABOUT[1]) & (np.abs(steps) > _FASTEST * periods)
    if np.ptp(angles) > _REACH or not jumps.any():
        return np.zeros(len(angles))
    return np.concatenate([[0.0], np.cumsum(np.where(jumps, -np.sign(steps), 0.0))])


def _apart(position: Array, command: Array) -> float:
    """Root mean square of the distance between two series but for whole turns between them."""
    away = position - command
    away = away - TURN * np.round(np.median(away) / TURN)
    return float(np.sqrt(np.mean(away**2)))
