"""Steps in which an encoder counts, and a file writes its digits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.geometry import Array

_LEVELS = 20
"""Levels from which on it is no chance that all of them lie whole steps apart."""
_HELD_LEVELS, _FINE = 5, 0.02
"""Levels at which a resampled series stays, at least, to tell its step, and the largest step as a share of its whole range: a
mechanism that goes from rest to rest also stays at its few postures, which may lie a round angle apart."""


def quantum_of(values: Array) -> Array:
    """Step of the digits of each column, 0 where values are not visibly quantised. [T, N] -> [N].

    A short record of a fine encoder hardly ever shows a level twice, but all its levels lie whole steps apart. Where a log was
    brought to other times, or what it shows was smoothed, values lie between the encoder's levels, perhaps with a step of the
    digits that were written; those at which it stays for two samples are levels of the encoder.
    """
    out = np.zeros(values.shape[1])
    for k, column in enumerate(values.T):
        levels = np.unique(column)
        if 2 < len(levels) < 0.9 * len(column) or len(levels) >= _LEVELS:
            out[k] = _step_of(levels)
        held = np.unique(column[1:][column[1:] == column[:-1]])
        if len(held) >= _HELD_LEVELS and (step := _step_of(held)) < _FINE * np.ptp(column):
            out[k] = max(out[k], step)
    return out


def _step_of(levels: Array) -> float:
    """Smallest distance of levels, in order, if all others are whole multiples of it; 0 if not."""
    steps = np.diff(levels)
    multiples = steps / steps.min()
    return float(steps.min()) if np.abs(multiples - np.round(multiples)).max() < 0.05 else 0.0


def largest_steps(logs: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Steps of the sensors that wrote several logs: of a log that hardly moves, few levels are seen.

    Args:
        logs: Steps of each log by kind, as `quantum_of` finds them. [N] each.

    Returns:
        The largest of each, by kind. [N] each.
    """
    kinds = set[str]().union(*logs)
    return {kind: np.max([log[kind] for log in logs if kind in log], axis=0) for kind in sorted(kinds)}
