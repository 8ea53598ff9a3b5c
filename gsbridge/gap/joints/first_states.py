"""Estimates of the states from which stretches of a record are replayed, from its measurements alone."""

from __future__ import annotations

import numpy as np

from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.replay import Span, State
from gsbridge.gap.joints.noise import white_noise
from gsbridge.geometry import Array

_WINDOW = 0.06
"""Length of the window of samples from which a state is estimated, s."""

_LEAST = 3
"""Samples on either side in the window, however far apart they are."""

_HOLE = 3.0
"""Step of time between samples, in periods, beyond which a record has a hole; steps within the window are none."""

_ORDER = 8
"""Order of the difference from which the noise is estimated: at ten samples per swing, a lower one holds motion."""

_FEWEST = 3
"""Samples without a hole between them from which on a state is estimated from these alone."""

HIGHEST = 7
"""Highest degree of the polynomial from which the start of a replay without feedback is estimated."""

_MISSED = 2.0
"""What a polynomial leaves, in units of the noise, beyond which one of a higher degree is tried."""


def state_at(record: Record, row: int, highest: int = 2) -> State:
    """Estimate positions and speeds of the joints at a sample by a polynomial through the samples around it.

    It is a parabola, which suffices where feedback soon corrects the start. Where samples are far apart, a parabola may leave
    more than noise; the polynomial is then the one of the lowest degree that does not.

    Args:
        record: Measured positions, and speeds if there are any.
        row: Number of the sample.
        highest: Highest degree of the polynomial.

    Returns:
        Positions, rad or m, and speeds, rad/s or m/s. [N], [N].
    """
    noise, (begin, end) = _position_noise(record), _around(record, row)
    state, rough = np.zeros((2, len(noise))), np.ones(len(noise), bool)
    for degree in range(2, highest + 1):
        first, last = _window(record, row, (begin, end), max(_LEAST, (degree + 2) // 2))
        if degree > max(2, last - first - 2) or not rough.any():
            break
        fit, left = _fitted(record, row, (first, last), degree)
        state[:, rough] = fit[:2, rough]
        rough &= left > _MISSED * noise
    return state[0], state[1]


def runs_of(record: Record) -> list[Span]:
    """Return the first sample of each run of samples without a hole between them, and the one behind its last."""
    holes = np.flatnonzero(np.diff(record.time) > max(_HOLE * record.period, _WINDOW)) + 1
    edges = [0, *(int(hole) for hole in holes), len(record.time)]
    return list(zip(edges[:-1], edges[1:], strict=True))


def lonely(record: Record) -> Array:
    """Mark samples between holes that are too few to estimate a state from. [T] bool."""
    out = np.zeros(len(record.time), bool)
    for begin, end in runs_of(record):
        out[begin:end] = end - begin < _FEWEST
    return out


def _around(record: Record, row: int) -> Span:
    """Choose the run of samples that holds `row`; with too few samples, those of its neighbours are taken, too."""
    begin, end = next((begin, end) for begin, end in runs_of(record) if begin <= row < end)
    return (begin, end) if end - begin >= _FEWEST else (max(0, begin - _FEWEST), end + _FEWEST)


def _window(record: Record, row: int, run: Span, least: int) -> Span:
    """Choose the samples from which the state at `row` is estimated, at least `least` on either side within the run."""
    begin, end = run[0], min(run[1], len(record.time))
    reach = max(least, round(_WINDOW / record.period / 2))
    first, last, whole = max(begin, row - reach), min(end, row + reach + 1), 2 * least + 1
    if last - first < whole:
        first, last = (begin, min(end, begin + whole)) if row - begin < end - row else (max(begin, end - whole), end)
    return first, last


def _fitted(record: Record, row: int, window: Span, degree: int) -> tuple[Array, Array]:
    """Fit a polynomial of the time from `row` to the samples of a window.

    Returns:
        Its coefficients [degree + 1, N], and the standard deviation of the positions about it, rad or m. [N].
    """
    first, last = window
    time, position = record.time[first:last] - record.time[row], record.measured["position"][first:last]
    rows, values = np.stack([time**power for power in range(degree + 1)], axis=1), position
    if "velocity" in record.measured:
        # Fit positions and speeds together, each weighted by its noise.
        weight = _spread(position) / np.maximum(_spread(record.measured["velocity"][first:last]), 1e-12)
        weight = np.clip(weight, 1e-6, record.period * 10).mean()
        slopes = np.stack([power * time ** max(power - 1, 0) for power in range(degree + 1)], axis=1)
        rows = np.concatenate([rows, weight * slopes])
        values = np.concatenate([values, weight * record.measured["velocity"][first:last]])
    fit = np.linalg.lstsq(rows, values, rcond=None)[0]
    left = ((position - rows[: last - first] @ fit) ** 2).sum(axis=0)
    return fit, np.sqrt(left / max(last - first - degree - 1, 1))


def _spread(values: Array) -> Array:
    """Compute the scatter of second differences, at least a billionth; ones where there are too few samples. [T, N] -> [N]."""
    return np.maximum(np.std(np.diff(values, 2, axis=0), axis=0), 1e-9) if len(values) > _FEWEST else np.ones(values.shape[1])


def _position_noise(record: Record) -> Array:
    """Estimate the noise of the measured positions, rad or m, at least the stated noise and the rounding. [N]."""
    found = white_noise(record.measured["position"], _ORDER)
    rounding = record.quantum.get("position", np.zeros(len(record.joints))) / np.sqrt(12.0)
    return np.maximum.reduce([found, rounding, record.sigma.get("position", 0.0 * rounding)])
