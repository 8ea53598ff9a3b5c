"""Checks of throws for units, axes and clocks that differ from the stated ones, by their own motion and by gravity."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.contact.starts import parabolas, starts_of
from gsbridge.gap.contact.throws import Throws
from gsbridge.geometry import Array, rotation_from_quat

SLOWEST = 0.05
"""Longest accepted time between two samples, s: with a longer one, a contact falls between samples."""

_APART = 3.0
"""Factor by which logged speeds may differ from the speeds of the poses."""

_ASTRAY = 0.5
"""Cosine between logged speeds and those of the poses, of the median throw, below which the log's axes are others."""

_DEGREES = 180.0 / np.pi


def check_throws(throws: Throws, gravity: float, source: str | Path) -> None:
    """Refuse throws whose clock, lengths, axes or speeds evidently differ from what is stated.

    Args:
        throws: Throws.
        gravity: Gravity, m/s2.
        source: Their file, for messages.

    Raises:
        InputError: The log contradicts what its case states.
    """
    check_clock(throws, source)
    check_fall(throws, gravity, source)
    check_speeds(throws, source)


def check_clock(throws: Throws, source: str | Path) -> None:
    """Refuse throws that are sampled too slowly to show a contact.

    Raises:
        InputError: Sampling is too slow; the message names the unit if times look like milliseconds or finer.
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
    """Refuse logs with a wrong unit of length or wrong axes: in flight, a body falls along -z with gravity's acceleration.

    Args:
        throws: Throws; they pass unchecked if most bodies slide from the start.
        gravity: Gravity, m/s2.
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
    """Refuse logged start speeds that differ from those of the poses by a large factor, or are given in the body's axes.

    Raises:
        InputError: The speeds contradict the poses.
    """
    if any(throw.velocity is None or throw.spin is None for throw in throws.items):
        return
    fits = [parabolas(throw) for throw in throws.items]
    starts, _ = starts_of(throws)
    seen = (np.stack([fit.speed for fit in fits]), np.stack([fit.spin for fit in fits]))
    # Standard deviations of the poses' speeds; throws that are hardly faster than that cannot be checked.
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
        if size <= 10.0 * spread + 1e-9:
            continue
        if 1.0 / _APART < ratio < _APART:
            if name == "velocity" and _alike(logged, of_poses) < _ASTRAY:
                raise InputError(
                    source,
                    f"'{name}' points elsewhere than the poses move",
                    "Turn it into the axes of the log, or leave it out",
                )
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
    """Return the median length of vectors. [N, 3]."""
    return float(np.median(np.linalg.norm(rows, axis=1)))


def _alike(some: Array, others: Array) -> float:
    """Return the median cosine between vectors. [N, 3], [N, 3]."""
    lengths = np.linalg.norm(some, axis=1) * np.linalg.norm(others, axis=1)
    return float(np.median((some * others).sum(axis=1) / np.maximum(lengths, 1e-12)))
