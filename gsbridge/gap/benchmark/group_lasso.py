"""Group lasso of a residual on candidates' signatures, cross-validated over stretches of time.

Source: Yuan and Lin, Journal of the Royal Statistical Society B 68, 2006; Beck and Teboulle, SIAM Journal on Imaging Sciences
2, 2009.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.geometry import Array

FOLDS = 8
"""Number of folds of the cross-validation, each a stretch of time."""

_LEVELS, _SMALLEST = 16, 1e-3
"""Number of penalty weights, and the smallest as a share of the weight at which all coefficients are zero."""

_ROUNDS = 200
"""Largest number of descent steps for one weight; each descent starts from the previous weight's solution."""

_STILL = 1e-4
"""Largest change of a coefficient, relative to the largest coefficient, at which a descent ends."""


def group_lasso(columns: Array, groups: Sequence[Sequence[int]], residual: Array) -> Array:
    """Return the coefficients of the columns, with the penalty weight chosen by cross-validation.

    The weight is the largest one whose prediction error is within one standard error of the smallest error (Breiman's rule),
    which keeps fewer groups than the weight of smallest error.

    Args:
        columns: Signatures, in units of the noise. [T, C, S].
        groups: Column numbers of each candidate.
        residual: Residual to explain, in the same units. [T, C].

    Returns:
        Coefficients; those of dropped groups are zero. [S].
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
    """Return the Euclidean length of each group's part of a vector. [S] -> [G]."""
    return np.sqrt(np.bincount(owners, values**2))


def _path(gram: Array, along: Array, owners: Array, roots: Array, weights: Array) -> Array:
    """Solve for every weight by accelerated proximal gradient descent, each from the previous solution. [W, S]."""
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
