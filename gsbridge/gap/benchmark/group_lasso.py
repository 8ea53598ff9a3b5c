"""Group lasso over signatures, cross-validated over stretches of time: which candidates' signatures make up a residual.

Source: Yuan and Lin, Journal of the Royal Statistical Society B 68, 2006; Beck and Teboulle, SIAM Journal on Imaging Sciences
2, 2009.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.geometry import Array

FOLDS = 8
"""Stretches of time, each of which is predicted from the others once."""

_LEVELS, _SMALLEST = 16, 1e-3
"""Number of weights of the penalty that are tried, and the smallest as a share of that which leaves nothing."""

_ROUNDS = 200
"""Most steps of the descent for one weight; it begins where the one before ended."""

_STILL = 1e-4
"""Largest change of a coefficient, in shares of the largest, at which the descent ends."""


def group_lasso(columns: Array, groups: Sequence[Sequence[int]], residual: Array) -> Array:
    """Coefficients of the columns, with the weight of the penalty chosen by cross-validation.

    The weight is the largest whose error of prediction lies within one standard error of the least (Breiman's rule), which
    keeps fewer groups than the least itself.

    Args:
        columns: Signatures side by side, in units of the noise. [T, C, S].
        groups: Numbers of the columns of each candidate.
        residual: What they shall explain, in the same units. [T, C].

    Returns:
        Coefficients [S]; those of groups that were left out are zero.
    """
    owners = np.empty(columns.shape[-1], dtype=int)
    for number, group in enumerate(groups):
        owners[list(group)] = number
    lengths = np.sqrt(np.maximum((columns**2).sum(axis=(0, 1)), 1e-300))
    pieces = np.array_split(np.arange(len(residual)), FOLDS)
    scaled = columns / lengths
    parts = [scaled[piece].reshape(-1, len(lengths)) for piece in pieces]
    grams = np.stack([part.T @ part for part in parts])
    along = np.stack([part.T @ residual[piece].ravel() for part, piece in zip(parts, pieces, strict=True)])
    squares = np.array([(residual[piece] ** 2).sum() for piece in pieces])
    roots = np.sqrt(np.bincount(owners))
    largest = float((_lengths(along.sum(axis=0), owners) / roots).max())
    weights = largest * np.geomspace(1.0, _SMALLEST, _LEVELS)
    errors = np.empty((FOLDS, _LEVELS))
    for fold in range(FOLDS):
        path = _path(grams.sum(axis=0) - grams[fold], along.sum(axis=0) - along[fold], owners, roots, weights)
        errors[fold] = squares[fold] - 2 * path @ along[fold] + np.einsum("ws,sr,wr->w", path, grams[fold], path)
    mean, spread = errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(FOLDS)
    least = int(np.argmin(mean))
    chosen = int(np.argmax(mean <= mean[least] + spread[least]))
    found = _path(grams.sum(axis=0), along.sum(axis=0), owners, roots, weights[: chosen + 1])[-1]
    return np.asarray(found / lengths)


def _lengths(values: Array, owners: Array) -> Array:
    """Length of each group's part of a vector. [S] -> [G]."""
    return np.sqrt(np.bincount(owners, values**2))


def _path(gram: Array, along: Array, owners: Array, roots: Array, weights: Array) -> Array:
    """Coefficients for every weight, by accelerated proximal steps, each from where the one before ended. [W, S]."""
    step = 1.0 / float(np.linalg.eigvalsh(gram)[-1])
    now, out = np.zeros(len(along)), []
    for weight in weights:
        ahead, pace = now, 1.0
        for _ in range(_ROUNDS):
            moved = ahead + step * (along - gram @ ahead)
            kept = np.maximum(1.0 - step * weight * roots / np.maximum(_lengths(moved, owners), 1e-300), 0.0)
            new = moved * kept[owners]
            faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace**2))
            ahead = new + (pace - 1.0) / faster * (new - now)
            still = np.abs(new - now).max() <= _STILL * max(np.abs(new).max(), 1e-300)
            now, pace = new, faster
            if still:
                break
        out.append(now)
    return np.stack(out)
