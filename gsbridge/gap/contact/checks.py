"""Throws that contradict themselves or gravity: units, axes and clocks that are others than stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.contact.starts import parabolas, starts_of
from gsbridge.gap.contact.throws import Throws
from gsbridge.geometry import Array, rotation_from_quat

SLOWEST = 0.05
"""Longest time between two samples, s: contact is over before."""

_APART = 3.0
"""Factor by which logged speeds may differ from those of the poses."""

_DEGREES = 180.0 / np.pi


def check_throws(throws: Throws, gravity: float, source: str | Path) -> None:
    """Refuse throws whose clock, lengths, axes or speeds are evidently others than stated.

    Args:
        throws: Throws.
        gravity: m/s2.
        source: Their file, for messages.

    Raises:
        InputError: The log contradicts what its case states.
    """
    check_clock(throws, source)
    check_fall(throws, gravity, source)
    check_speeds(throws, source)


def check_clock(throws: Throws, source: str | Path) -> None:
    """Refuse samples that are too rare to show a contact.

    Raises:
        InputError: Samples are too rare; the message names the unit if times look like milliseconds or finer.
    """
    step = float(np.median(np.concatenate([np.diff(throw.time) for throw in throws.items])))
    if step <= SLOWEST:
        return
    for factor, unit in ((1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds")):
        if 1e-4 < step * factor <= SLOWEST:
            raise InputError(
                source, f"there are {step:.4g} s between two samples: the times look like {unit}", "State the unit of the times"
            )
    raise InputError(source, f"there are {step:.3g} s between two samples", "Log at 50 Hz or more")


def check_fall(throws: Throws, gravity: float, source: str | Path) -> None:
    """Refuse logs whose lengths or axes are evidently others than stated: in flight a body falls along -z by what gravity says.

    Args:
        throws: Throws; those that slide from the start say nothing and pass.
        gravity: m/s2.
        source: Their file, for messages.

    Raises:
        InputError: The log contradicts gravity.
    """
    fall = -np.median([parabolas(throw).acceleration for throw in throws.items], axis=0)
    along = int(np.abs(fall).argmax())
    for factor, unit in ((1e3, "millimetres"), (1e2, "centimetres")):
        if 0.7 < np.abs(fall[along]) / (factor * gravity) < 1.4:
            raise InputError(
                source, f"bodies fall by {np.abs(fall[along]):.4g} m/s2: the positions look like {unit}",
                "State the unit that was logged, e.g. [mm]",
            )  # fmt: skip
    if 0.7 < np.abs(fall[along]) / gravity < 1.4 and (along != 2 or fall[2] < 0):
        name = f"{'+' if fall[along] < 0 else '-'}{'xyz'[along]}"
        raise InputError(source, f"bodies fall along {name}, not along -z", "Turn positions and attitudes so that z is up")


def check_speeds(throws: Throws, source: str | Path) -> None:
    """Refuse logged start speeds that are many times those of the poses, or stand in the body's own axes.

    Raises:
        InputError: Speeds contradict the poses.
    """
    if any(throw.velocity is None or throw.spin is None for throw in throws.items):
        return
    fits = [parabolas(throw) for throw in throws.items]
    starts, _ = starts_of(throws)
    seen = (np.stack([fit.speed for fit in fits]), np.stack([fit.spin for fit in fits]))
    # Speeds of the poses are as good as this; what is slower than that says nothing.
    spreads = [
        float(np.median([gain * np.sqrt(squares) for gain, squares in rows]))
        for rows in ([(fit.gain, fit.squares[0]) for fit in fits], [(fit.turning, fit.squares[1]) for fit in fits])
    ]
    units = (("velocity", "millimetres per second", 1e3), ("angular_velocity", "degrees per second", _DEGREES))
    for (name, unit, factor), logged, of_poses, spread in zip(
        units, (starts.velocity, starts.spin), seen, spreads, strict=True
    ):
        size = _size(of_poses)
        ratio = _size(logged) / max(size, 1e-12)
        if size <= 10.0 * spread + 1e-9 or 1.0 / _APART < ratio < _APART:
            continue
        looks = f": it looks like {unit}" if 0.7 < ratio / factor < 1.4 else ""
        raise InputError(
            source, f"'{name}' is {ratio:.3g} times what the poses move by{looks}", "State its unit, or leave it out"
        )
    turned = np.einsum("nij,nj->ni", rotation_from_quat(starts.quat), starts.spin)
    apart, other = _size(starts.spin - seen[1]), _size(turned - seen[1])
    if _size(seen[1]) > 10.0 * spreads[1] + 1e-9 and apart > 0.3 * _size(seen[1]) and other < 0.5 * apart:
        raise InputError(
            source, "'angular_velocity' stands in the body's own axes", "Turn it into the axes of the log, or leave it out"
        )


def _size(rows: Array) -> float:
    """Median length. [N, 3]."""
    return float(np.median(np.linalg.norm(rows, axis=1)))
