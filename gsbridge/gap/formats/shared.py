"""Records that share a motion: effects would be judged on the data to which they were fitted."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from gsbridge.gap.formats.records import Record
from gsbridge.geometry import Array

_WINDOW = 8
"""Places in a row by which a stretch of motion is recognised: a single one may well come twice, at a coarse encoder."""

_SHARED = 0.5
"""Share of a record that may lie in another one, or have its commands, before the user is warned."""


def shared_motion(records: Mapping[str, Record]) -> list[str]:
    """Warn, in words, of records that are the same, overlap, or were driven by the same commands.

    Args:
        records: Records by role.
    """
    out = []
    for (first, one), (second, other) in itertools.combinations(records.items(), 2):
        if _same(one, other):
            out.append(f"'{first}' and '{second}' are one and the same record, so that it proves nothing: log another motion")
        elif (share := _overlap(one, other)) > _SHARED:
            out.append(f"{100 * share:.0f} % of the shorter of '{first}' and '{second}' lies in the other: log another motion")
        elif _same_commands(one, other):
            out.append(f"'{first}' and '{second}' have the same commands, so that it proves little: log another motion")
    return out


def _same(one: Record, other: Record) -> bool:
    """Whether commands, times and measurements are equal."""
    return (
        one.content_digest() == other.content_digest()
        and one.measured.keys() == other.measured.keys()
        and all(np.array_equal(one.measured[kind], other.measured[kind]) for kind in one.measured)
    )


def _overlap(one: Record, other: Record) -> float:
    """Return the share of the moving stretches of one record that the other has, too; of the one with fewer of them."""
    few, many = sorted((_stretches(one), _stretches(other)), key=len)
    (keys, counts), (others, known) = (np.unique(found, return_counts=True) for found in (few, many))
    _, mine, theirs = np.intersect1d(keys, others, assume_unique=True, return_indices=True)
    return float(np.minimum(counts[mine], known[theirs]).sum()) / max(len(few), 1)


def _stretches(record: Record) -> Array:
    """Return a number for each stretch of `_WINDOW` different places in a row: of the places and of how long each was held.

    A coarse encoder shows the same places in every motion, but not for the same times. Equal stretches have equal numbers, and
    other stretches have others, but for a chance of one in 10^19. [S] uint64.
    """
    kind = "position" if "position" in record.measured else sorted(record.measured)[0]
    values = np.ascontiguousarray(record.measured[kind], dtype=np.float64)
    begins = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(values, axis=0)).max(axis=1) > 0.0) + 1])
    held = np.diff(np.append(begins, len(values))).astype(np.uint64)
    places = _mixed(values[begins].view(np.uint64))
    count = max(len(begins) - _WINDOW + 1, 0)
    # How long the first and the last place were held depends on where a record was cut.
    rows = [places[first : first + count] for first in range(_WINDOW)]
    rows += [held[first : first + count] for first in range(1, _WINDOW - 1)]
    return _mixed(np.stack(rows, axis=1))


def _mixed(rows: Array) -> Array:
    """Return a well-mixed number for each row. uint64 [T, N] -> [T].

    Source: Steele, Lea and Flood, Fast splittable pseudorandom number generators, 2014 (the finaliser of SplitMix64).
    """
    out = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        out = out * np.uint64(0x9E3779B97F4A7C15) + column
        out = (out ^ (out >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        out = (out ^ (out >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        out ^= out >> np.uint64(31)
    return out


def _same_commands(one: Record, other: Record) -> bool:
    """Whether one and the same motion is commanded, over most of the longer record."""
    a, b = one.commands.get("command"), other.commands.get("command")
    if a is None or b is None:
        return False
    count = min(len(a), len(b))
    enough = count >= (1.0 - _SHARED) * max(len(a), len(b))
    return bool(enough and np.array_equal(a[:count], b[:count]) and np.ptp(a[:count], axis=0).any())
