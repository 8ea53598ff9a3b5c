"""How much of a gap an explanation closes, as far as noise tells."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

_LENGTHS = (1, 16)
"""Samples of the blocks over which a closure is judged."""

_MOMENTS = 25
"""Parts of a record among which those are sought in which something else happened."""

_LEFT_OUT = 5
"""Largest number of those parts that are left out."""

_SHOWN = 0.5
"""Share of a gap's squares that must show in motion if motion alone is to tell a closure."""

_STRETCHES = 3
"""Stretches of motion, each as long as the longest block, that tell a closure: there and back, and once more."""

_ALLOWED = 0.02
"""Share of a gap's squares that may be left to noise where a closure is judged."""


def block_means(residual: Array, scale: int) -> Array:
    """Means over blocks, times the root of their length, so that white noise keeps its size. [T, C] -> [T // scale, C]."""
    rows = len(residual) // scale
    return residual[: rows * scale].reshape(rows, scale, -1).sum(axis=1) / np.sqrt(scale)


def closed(before: Array, after: Array, share: float) -> float:
    """Share of a gap that is closed: of the samples themselves and, if the gap is slow, of means over blocks, the lesser one.

    One spread of the noise's squares is allowed, which hides that a large gap is closed; of a small gap it is much. Means have
    less noise, so that they show what is left of a slow motion where the samples hide it.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: With it. [T, C].
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
    """`closed`, ignoring the fifth of the record in which most is left: an arm that touched something, a push.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: With it. [T, C].
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
    """`closed`, or the same over the motion alone, if an explanation leaves no more at rest than there was without it.

    Between two bounds, the law of dry friction says nothing about the force that holds a resting joint, and real joints creep
    there. The place from which the next motion begins is therefore uncertain, too, until the controller has corrected it. The
    motion decides however long a record rests, provided that it has several stretches and shows most of the gap; an effect
    that acts at rest alone is not hidden by this.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: With it. [T, C].
        share: Mean square of noise alone.
        rests: Samples in which friction of the explanation holds something. [T].
        echoes: Samples after a rest in which the controller still corrects the place; None for no such samples. [T].
    """
    whole = closed(before, after, share)
    if not rests.any() or (after[rests] ** 2).sum() > (before[rests] ** 2).sum():
        return whole
    moving = [~rests] if echoes is None else [~rests, ~(rests | echoes)]
    return max([whole, *(closed(before[kept], after[kept], share) for kept in moving if _tells(before, share, kept))])


def stretches(mask: Array) -> Array:
    """First sample of each run of true samples, and the one behind its last. [T] bool -> [runs, 2]."""
    return np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0)).reshape(-1, 2)


def _tells(before: Array, share: float, kept: Array) -> bool:
    """Whether samples hold most of a gap, in several stretches of which each is long enough to be judged. [T, C], [T]."""
    long = np.diff(stretches(kept)) >= _LENGTHS[-1]
    beyond = (before.astype(np.float64) ** 2 - share).sum(axis=1)
    return int(long.sum()) >= _STRETCHES and float(beyond[kept].sum()) >= _SHOWN * float(beyond.sum())


def beyond_noise(chi2: float, floor: float) -> float:
    """Length of a residual beyond the noise, from its chi squared and that of a perfect model."""
    return float(np.sqrt(max(chi2 - floor, 0.0)))
