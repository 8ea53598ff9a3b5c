"""Quantisation steps of logged values: the steps of an encoder, or those of the digits in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.geometry import Array

_LEVELS = 20
"""Number of levels from which on it cannot be chance that all distances between them are whole multiples of one step."""

_PASSED, _PASSES, _MANY = 8, 5, 12
"""Limits for the encoder's levels that a resampled series passes.

A level counts if it is held for at most `_PASSED` samples: a mechanism that moves from rest to rest stays longer at each rest,
and its rests may lie a round angle apart. `_PASSES` such levels determine the step. `_MANY` are needed if all levels together
have a step, too, because a rational ratio of sampling rates (small integers) also makes a grid between the encoder's levels.
"""

_OFF = 0.05
"""Largest distance from a whole number of steps, in steps."""

_SHARED = 2
"""Smallest number of levels that show that a log has the quantisation step of another log."""


def quantum_of(values: Array) -> Array:
    """Return the quantisation step of each column, 0 for values that are not visibly quantised. [T, N] -> [N].

    A short record of a fine encoder hardly ever shows a level twice, but all its levels lie whole steps apart. In a resampled
    log, values lie between the encoder's levels, perhaps rounded to the digits of the file. The levels that such a log holds
    for only a few samples are still those of the encoder.
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
    """Share quantisation steps between logs of the same sensors; return the steps of each log, by kind.

    A log that hardly moves shows no step, but its levels may lie on the grid of another log. A log whose levels do not lie on
    another log's grid keeps its own step, or none: a log with few digits says nothing about the others.

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
    """Return the largest of other logs' steps on whose grid a series lies, or else its own step. [T]."""
    held, best = np.unique(_held(column, len(column))), own
    for other, step in others:
        origin = _held(other, len(other))
        if step > best and len(held) >= _SHARED and len(origin) and _on_grid(held - origin[0], step):
            best = float(step)
    return best


def _held(column: Array, longest: int) -> Array:
    """Return the levels that a series holds for at least two and at most `longest` samples. [T] -> [L]."""
    ends = np.flatnonzero(np.diff(column) != 0.0)
    first, last = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(column) - 1]])
    length = last - first + 1
    return column[first[(length >= 2) & (length <= longest)]]


def _step_of(levels: Array) -> float:
    """Return the step of which all distances between neighbouring, sorted levels are whole multiples; 0 if there is none.

    The smallest distance gives a first estimate, and each larger one refines it, since each is known to few digits only.
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
    """Whether a step is a power of ten and so may come from the number of digits in the file."""
    exponent = np.log10(step)
    return bool(abs(exponent - np.round(exponent)) < 1e-3)
