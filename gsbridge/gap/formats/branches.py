"""Angles of encoders that begin anew after a turn: a joint cannot jump by one between two samples."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from gsbridge.geometry import Array

TURN = 2.0 * np.pi

_FASTEST = 30.0
"""Speed, rad/s, up to which a joint may move: what a jump is off a turn must be such a motion."""

_AROUND = 10
"""Samples to either side of a jump whose steps tell how the angle moves there."""

_STEADY = (3.0, 0.01)
"""What a jump may be off a turn: multiple of the largest step around it, and what an encoder at rest may flicker by, rad."""

_REACH = 1.02 * TURN
"""Largest range of angles, rad, that begin anew after a turn, with room for noise."""

_NEAR = 0.5
"""Distance of positions from commands, rad, up to which they are the same but for whole turns."""


def unwrapped(time: Array, position: Array | None, command: Array | None) -> tuple[Array | None, Array | None]:
    """Positions and commands of one joint without jumps by a turn, both counted from the same turn.

    A command that jumps is believed unless the position follows it without the jump. Where both differ by whole turns alone,
    all the time and while they move, the position is moved to the command, which is given in the model's angles.

    Args:
        time: Times of the samples, s. [T].
        position: Measured angles, rad; None where there are none. [T].
        command: Commanded angles, rad; None where there are none. [T].
    """
    wraps = False
    if position is not None:
        turns = _turns(time, position)
        wraps = bool(turns.any())
        position = position + TURN * turns
    if position is not None and command is not None:
        turns = _turns(time, command)
        other = command + TURN * turns
        if turns.any() and _apart(position, other) < min(_NEAR, _apart(position, command)):
            command, wraps = other, True
        away = position - command
        whole = TURN * round(float(np.median(away)) / TURN)
        moves = min(np.ptp(position), np.ptp(command)) > _NEAR
        off = np.median(np.abs(away - whole)) if wraps else np.max(np.abs(away - whole))
        if whole != 0.0 and off < _NEAR and (wraps or moves):
            position = position - whole
    return position, command


def _turns(time: Array, angles: Array) -> Array:
    """Whole turns that have to be added to angles so that they do not jump; zeros for angles that no encoder wraps. [T]."""
    steps, periods = np.diff(angles), np.diff(time)
    if np.ptp(angles) > _REACH or not (np.abs(steps) > 0.5 * TURN).any():
        return np.zeros(len(angles))
    # A step of a command may be long, too; but what is left of a turn goes on as the angle did before and does after.
    off = np.abs(np.abs(steps) - TURN)
    usual = maximum_filter1d(np.where(np.abs(steps) > 0.5 * TURN, 0.0, np.abs(steps)), 2 * _AROUND + 1, mode="nearest")
    most = np.minimum(np.minimum(0.25 * TURN, _FASTEST * periods), _STEADY[0] * usual + _STEADY[1])
    return np.concatenate([[0.0], np.cumsum(np.where(off <= most, -np.sign(steps), 0.0))])


def _apart(position: Array, command: Array) -> float:
    """Root mean square of the distance between two series but for whole turns between them."""
    away = position - command
    away = away - TURN * np.round(np.median(away) / TURN)
    return float(np.sqrt(np.mean(away**2)))
