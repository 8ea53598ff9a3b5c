"""Time stamps that scatter about a steady clock, because a logger stamps each sample after a different delay, and breaks."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import SHORTEST, Record
from gsbridge.geometry import Array

_RAGGED = 0.03
"""Smallest scatter of stamps about a steady clock, as a share of its period, for which the clock may replace the stamps."""

_SMOOTHER = 0.7
"""The steady clock replaces the stamps if the motion's roughness on it is below this multiple of that on the stamps."""

_ASTRAY = 0.06
"""Range in which the clock's rate is searched, around that of the median time between samples, as a share of it."""

_FIRST = 4000
"""Number of samples in the first estimate of the period; each further estimate doubles it until all samples are used."""

_FEWEST = 50
"""Smallest number of samples between two breaks from which a steady clock is found."""

_HOLE, _BREAK = 10, 0.25
"""Time without a sample, in periods and in s (the longer one counts), that breaks the log: commands are unknown in between."""

PAUSE = 60.0
"""Time without a sample, s, that breaks even the log of a mechanism that nothing drives; pauses between runs are shorter."""


def unbroken(record: Record, source: str | Path, pause: float = 0.0) -> tuple[Record, str]:
    """Return the longest part of a record without a break; commands are unknown during a break.

    Args:
        record: The record as it was logged.
        source: Its file, for messages.
        pause: Time without a sample that is no break yet, s.

    Returns:
        The record or its longest part, and a sentence about what was left out; empty if there is no break.

    Raises:
        InputError: Every part is too short.
    """
    breaks = np.flatnonzero(np.diff(record.time) > max(_HOLE * record.period, _BREAK, pause)) + 1
    if not len(breaks):
        return record, ""
    edges = [0, *breaks.tolist(), len(record.time)]
    first, end = max(zip(edges[:-1], edges[1:], strict=True), key=lambda part: record.time[part[1] - 1] - record.time[part[0]])
    begins, ends = float(record.time[first]), float(record.time[end - 1])
    longest = float(np.diff(record.time).max())
    if ends - begins < SHORTEST:
        raise InputError(
            source, f"the log breaks off for up to {longest:.3g} s, and no part between lasts {SHORTEST:g} s",
            "Log again, without breaks",
        )  # fmt: skip
    part = f"{begins:.4g} to {ends:.4g} s"
    return record.part(first, end, part), f"it breaks off for up to {longest:.3g} s: only {part} was taken"


def steadied(record: Record) -> tuple[Record, float | None]:
    """Put a record on a steady clock if its stamps scatter about one and the motion is much smoother by that clock.

    Samples may be missing: the others keep their ticks. The record stays unchanged if the motion does not decide, or if the
    sampling really was as uneven as the stamps say.

    Args:
        record: The record as it was logged.

    Returns:
        The record, and the standard deviation of its stamps about the clock, s; None if the record stays unchanged.
    """
    steady = _steady_clock(record.time)
    if steady is None:
        return record, None
    moved = [record.measured[kind] for kind in ("position", "tool") if kind in record.measured]
    rough = [sum(_roughness(clock, values) for values in moved) for clock in (record.time, steady)]
    if not rough[1] < _SMOOTHER * rough[0]:
        return record, None
    return replace(record, time=steady - steady[0]), float((record.time - steady).std())


def _steady_clock(time: Array) -> Array | None:
    """Return the nearest tick of a steady clock for each stamp; None if no clock fits, or the stamps lie on one. [T] -> [T].

    The clock's period is the one at which the phases of the stamps agree best, as in the periodogram of a point process.
    """
    steps = np.diff(time)
    first = float(np.median(steps))
    # Rates are told apart the finer, the longer the part lasts: a pause in it would only add rates to try.
    holes = np.flatnonzero(steps > max(_HOLE * first, _BREAK)) + 1
    edges = [0, *holes.tolist(), len(time)]
    low, high = max(itertools.pairwise(edges), key=lambda ends: ends[1] - ends[0])
    part = time[low : min(high, low + _FIRST)]
    if len(holes) and len(part) < _FEWEST:
        return None
    span = max(float(part[-1] - part[0]), first)
    rates = np.arange((1.0 - _ASTRAY) / first, (1.0 + _ASTRAY) / first, 0.25 / span)
    agree = [abs(np.exp(2j * np.pi * rate * part).mean()) for rate in rates]
    period = 1.0 / float(rates[int(np.argmax(agree))])
    begin = period * float(np.angle(np.exp(2j * np.pi * part / period).mean())) / (2.0 * np.pi)
    high = low + len(part)
    while True:
        ticks = np.round((time[low:high] - begin) / period)
        period, begin = (float(value) for value in np.polyfit(ticks, time[low:high], 1))
        if high - low == len(time):
            break
        low, high = max(0, 2 * low - high), min(2 * high - low, len(time))
    if (np.diff(ticks) < 1.0).any() or np.std(time - begin - period * ticks) < _RAGGED * period:
        return None
    return np.asarray(begin + period * ticks, dtype=np.float64)


def _roughness(time: Array, values: Array) -> float:
    """Return the mean distance of samples from the cubic through their four neighbours. [T], [T, N].

    Each distance is divided by the factor by which interpolation raises the noise of one sample.
    """
    near = [time[0:-4], time[1:-3], time[3:-1], time[4:]]
    at = time[2:-2]
    shares = []
    for k, own in enumerate(near):
        others = [other for j, other in enumerate(near) if j != k]
        shares.append(np.prod([(at - other) / (own - other) for other in others], axis=0))
    weights = np.stack(shares)
    told = sum(w[:, None] * row for w, row in zip(weights, (values[0:-4], values[1:-3], values[3:-1], values[4:]), strict=True))
    apart = np.abs(values[2:-2] - told) / np.sqrt(1.0 + (weights**2).sum(axis=0))[:, None]
    return float(apart.mean())
