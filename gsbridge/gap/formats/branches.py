"""Unwrapping of encoder angles that jump by a full turn: a joint cannot turn that far between two samples."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from gsbridge.geometry import Array

TURN = 2.0 * np.pi

_FASTEST = 30.0
"""Largest plausible joint speed, rad/s: the difference of a jump from a full turn must not exceed the motion at this speed."""

_AROUND = 10
"""Number of samples on either side of a jump whose steps show how fast the angle moves there."""

_STEADY = (3.0, 0.01)
"""Largest difference of a jump from a full turn: this multiple of the largest step around it, plus encoder flicker, rad."""

_REACH = 1.02 * TURN
"""Largest range, rad, of angles that an encoder wraps to one turn, with room for noise."""

_NEAR = 0.5
"""Distance of positions from commands, rad, below which they count as equal up to whole turns; also the least motion, rad."""


def unwrapped(time: Array, position: Array | None, command: Array | None) -> tuple[Array | None, Array | None]:
    """Remove jumps by a full turn from positions and commands of one joint, and count both from the same turn.

    A command's jump is kept unless the position follows the command better without it. If position and command always differ
    by the same whole turns, and they move or were wrapped, the position is shifted to the command, which is in the model's
    angles.

    Args:
        time: Times of the samples, s. [T].
        position: Measured angles, rad; None if there are none. [T].
        command: Commanded angles, rad; None if there are none. [T].

    Returns:
        Positions and commands, rad. [T] each, or None.
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
    """Return the whole turns to add to angles so that they do not jump; zeros if the angles do not look wrapped. [T]."""
    steps, periods = np.diff(angles), np.diff(time)
    if np.ptp(angles) > _REACH or not (np.abs(steps) > 0.5 * TURN).any():
        return np.zeros(len(angles))
    # A step of a command may be as long as a jump. In a true jump, what is left beyond the turn continues the motion around it.
    off = np.abs(np.abs(steps) - TURN)
    usual = maximum_filter1d(np.where(np.abs(steps) > 0.5 * TURN, 0.0, np.abs(steps)), 2 * _AROUND + 1, mode="nearest")
    most = np.minimum(np.minimum(0.25 * TURN, _FASTEST * periods), _STEADY[0] * usual + _STEADY[1])
    return np.concatenate([[0.0], np.cumsum(np.where(off <= most, -np.sign(steps), 0.0))])


def _apart(position: Array, command: Array) -> float:
    """Return the root mean square distance between two series up to whole turns, rad. [T], [T]."""
    away = position - command
    away = away - TURN * np.round(np.median(away) / TURN)
    return float(np.sqrt(np.mean(away**2)))
