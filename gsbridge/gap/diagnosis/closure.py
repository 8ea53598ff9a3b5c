"""How much of a gap an explanation closes, with the noise taken into account."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

_LENGTHS = (1, 16)
"""Lengths, in samples, of the blocks over which a closure is judged."""

_MOMENTS = 25
"""Number of equal parts into which a record is split to find those in which something else happened."""

_LEFT_OUT = 5
"""How many of those parts, the ones with the largest residual, are ignored."""

_SHOWN = 0.5
"""Share of a gap's squares that must lie in the moving samples before a closure may be judged from motion alone."""

_STRETCHES = 3
"""Stretches of motion that suffice to judge a closure (there, back, once more); each lasts a longest block or more."""

_ALLOWED = 0.02
"""Largest share of a gap's squares that may be attributed to chance in the noise when a closure is judged."""


def block_means(residual: Array, scale: int) -> Array:
    """Average over blocks, times the root of the block length so that white noise keeps its size. [T, C] -> [T // scale, C]."""
    rows = len(residual) // scale
    return residual[: rows * scale].reshape(rows, scale, residual.shape[1]).sum(axis=1) / np.sqrt(scale)


def closed(before: Array, after: Array, share: float) -> float:
    """Return the share of a gap that is closed, the smaller of two: over samples and, if the gap is slow, over block means.

    One standard deviation of the noise's sum of squares, but at most `_ALLOWED` of the gap's squares, is attributed to chance.
    Otherwise noise would hide that a large gap is closed. Block means have less noise than samples, so they show a slow
    residual that the noise of the samples hides.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: Whitened residual with it. [T, C].
        share: Mean square of noise alone.
    """
    out: list[float] = []
    whole = 0.0
    for scale in _LENGTHS:
        sums = [float((block_means(residual, scale) ** 2).sum()) for residual in (before, after)]
        count = block_means(before, scale).size
        gap = max(sums[0] - share * count, 1e-9)
        whole = max(whole, gap)
        if gap < 0.5 * whole:
            continue
        left = sums[1] - share * count - min(np.sqrt(2.0 * count), _ALLOWED * gap)
        out.append(1.0 - float(np.sqrt(max(left, 0.0) / gap)))
    return min(out)


def closed_at_most_times(before: Array, after: Array, share: float) -> float:
    """Return `closed`, ignoring the fifth of the record with the largest residual (contacts, pushes), if that is larger.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: Whitened residual with it. [T, C].
        share: Mean square of noise alone.
    """
    length = len(after) // _MOMENTS
    if length == 0:
        return closed(before, after, share)
    left = (after[: _MOMENTS * length].astype(np.float64) ** 2).sum(axis=1).reshape(_MOMENTS, length).sum(axis=1)
    kept = np.ones(len(after), bool)
    for moment in np.argsort(left)[-_LEFT_OUT:]:
        kept[moment * length : (moment + 1) * length] = False
    return max(closed(before, after, share), closed(before[kept], after[kept], share))


def closed_beside_rest(before: Array, after: Array, share: float, rests: Array, echoes: Array | None = None) -> float:
    """Return `closed`, or the larger value over motion alone if the explanation does not increase the residual at rest.

    The law of dry friction only bounds the force that holds a resting joint, and real joints creep at rest. The position from
    which the next motion starts is therefore uncertain, too, until the controller has corrected it. Motion alone may decide,
    however long a record rests, if it has several stretches and contains most of the gap; so the closure of an effect that
    acts only at rest is still judged at rest.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: Whitened residual with it. [T, C].
        share: Mean square of noise alone.
        rests: Samples in which friction of the explanation holds a joint. [T] bool.
        echoes: Samples after a rest in which the controller still corrects the position; None for no such samples. [T] bool.
    """
    whole = closed(before, after, share)
    if not rests.any() or (after[rests] ** 2).sum() > (before[rests] ** 2).sum():
        return whole
    moving = [~rests] if echoes is None else [~rests, ~(rests | echoes)]
    return max([whole, *(closed(before[kept], after[kept], share) for kept in moving if _tells(before, share, kept))])


def stretches(mask: Array) -> Array:
    """Return the first sample of each run of true samples and the one after its last. [T] bool -> [runs, 2]."""
    return np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0)).reshape(-1, 2)


def _tells(before: Array, share: float, kept: Array) -> bool:
    """Whether the samples `kept` contain most of a gap and several stretches that are long enough to be judged. [T, C], [T]."""
    long = np.diff(stretches(kept)) >= _LENGTHS[-1]
    beyond = (before.astype(np.float64) ** 2 - share).sum(axis=1)
    return int(long.sum()) >= _STRETCHES and float(beyond[kept].sum()) >= _SHOWN * float(beyond.sum())


def beyond_noise(chi2: float, floor: float) -> float:
    """Return the norm of a residual beyond the noise, from its chi squared and that of a perfect model (`floor`)."""
    return float(np.sqrt(max(chi2 - floor, 0.0)))
