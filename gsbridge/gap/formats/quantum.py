"""Steps in which an encoder counts, and a file writes its digits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.geometry import Array

_LEVELS = 20
"""Levels from which on it is no chance that all of them lie whole steps apart."""

_PASSED, _PASSES, _MANY = 8, 5, 12
"""Most samples for which a level is held that a resampled series passes; fewest such levels that tell its step, and where
all levels have a step, too, for times whose rates are as small numbers make a grid between the encoder's. A mechanism that goes
from rest to rest stays longer at each, and its rests may lie a round angle apart."""

_OFF = 0.05
"""Largest distance of a level from its whole number of steps, in steps."""

_SHARED = 2
"""Fewest levels of a log that show that it counts in another log's steps."""


def quantum_of(values: Array) -> Array:
    """Step of the digits of each column, 0 where values are not visibly quantised. [T, N] -> [N].

    A short record of a fine encoder hardly ever shows a level twice, but all its levels lie whole steps apart. Where a log was
    brought to other times, values lie between the encoder's levels, perhaps with a step of the digits that were written; those
    at which it stays for a few samples in passing are levels of the encoder.
    """
    out = np.zeros(values.shape[1])
    for k, column in enumerate(values.T):
        levels = np.unique(column)
        if 2 < len(levels) < 0.9 * len(column) or len(levels) >= _LEVELS:
            out[k] = _step_of(levels)
        passed = np.unique(_held(column, _PASSED))
        if len(passed) >= (_MANY if out[k] and not _decimal(out[k]) else _PASSES):
            out[k] = max(out[k], _step_of(passed))
    return out


def shared_steps(logs: Sequence[Mapping[str, Array]], steps: Sequence[Mapping[str, Array]]) -> list[dict[str, Array]]:
    """Steps of several logs of the same sensors: one that hardly moves shows none, but its levels may be those of another.

    Logs that count otherwise, or do not count at all, keep what they show: one that was written with few digits says nothing of
    the others.

    Args:
        logs: Channels of each log, by kind. [T, N] each.
        steps: Their steps, as `quantum_of` finds them. [N] each.
    """
    out = [{kind: values.copy() for kind, values in found.items()} for found in steps]
    for mine, log, own in zip(out, logs, steps, strict=True):
        for kind, values in own.items():
            for k, step in enumerate(values):
                if not step or _decimal(step):
                    others = [(o[kind][:, k], s[kind][k]) for o, s in zip(logs, steps, strict=True) if kind in s]
                    mine[kind][k] = _shown_by(log[kind][:, k], float(step), others)
    return out


def _shown_by(column: Array, own: float, others: Sequence[tuple[Array, float]]) -> float:
    """Largest of other logs' steps in which a series counts, or else its own."""
    held, best = np.unique(_held(column, len(column))), own
    for other, step in others:
        origin = _held(other, len(other))
        if step > best and len(held) >= _SHARED and len(origin) and _on_grid(held - origin[0], step):
            best = float(step)
    return best


def _held(column: Array, longest: int) -> Array:
    """Levels at which a series stays for two samples or more, up to `longest`. [T] -> [L]."""
    ends = np.flatnonzero(np.diff(column) != 0.0)
    first, last = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(column) - 1]])
    length = last - first + 1
    return column[first[(length >= 2) & (length <= longest)]]


def _step_of(levels: Array) -> float:
    """Step of which the distances of levels, in order, are whole multiples; 0 if there is none.

    The step is told ever better by the distances so far, the smallest first, as each is written with few digits.
    """
    gaps = np.sort(np.diff(levels))
    total, count = 0.0, 0.0
    step = float(gaps[0])
    for gap in gaps:
        number = np.round(gap / step)
        if abs(gap - number * step) > _OFF * step:
            return 0.0
        total, count = total + float(gap), count + float(number)
        step = total / count
    return step


def _on_grid(distances: Array, step: float) -> bool:
    """Whether all distances are whole multiples of a step."""
    return bool((np.abs(distances / step - np.round(distances / step)) <= _OFF).all())


def _decimal(step: float) -> bool:
    """Whether a step is a power of ten: that of the digits of a file, in whatever unit it was written in, or in none."""
    exponent = np.log10(step)
    return bool(abs(exponent - np.round(exponent)) < 1e-3)
