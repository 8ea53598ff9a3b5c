"""Residual pictures split by detail, by colour, and by what all views share, so that each part has a spread of its own.

What splats lack is no white noise: a table whose colour is a little off is off everywhere, and in every view. A picture is cut
into the means over ever larger blocks of pixels and what each leaves; these parts are orthogonal, and so are brightness and two
differences of colours, and the mean over views and what is left of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array

BLOCKS = (2, 4, 8, 16, 32, 64)
"""Edges of the blocks, pixels as compared; each holds four of those before it."""

LEVELS = len(BLOCKS) + 1

_COLOURS = np.array([[2, 3, -1], [2, 0, 2], [2, -3, -1]], np.float32) / np.sqrt(np.array([12, 18, 6], np.float32))
"""From red, green, blue to brightness, red less blue, and green less both. Orthonormal."""

_SCATTER = 0.15
"""Relative difference of the size of a part between two sets of views of one thing, which see other places and moments."""

_PRIOR = 4.0
"""Weight of what is assumed of the variance of a part, in independent numbers: that it is the variance of its pixels."""


def block_means(values: Array) -> tuple[list[Array], list[Array]]:
    """Means over blocks of each size, the pixels themselves first, and of how many pixels each is the mean.

    Pictures are filled up to whole blocks with zeros, which do not count. [N, h, w, C] -> [N, h / edge, w / edge, C] each.
    """
    edge = BLOCKS[-1]
    _, height, width, _ = values.shape
    fill = [(0, 0), (0, -height % edge), (0, -width % edge), (0, 0)]
    sums, counts = [np.pad(values, fill)], [np.pad(np.ones((1, height, width, 1), np.float32), fill)]
    for _ in BLOCKS:
        for part in (sums, counts):
            rows = part[-1][:, 0::2] + part[-1][:, 1::2]
            part.append(rows[:, :, 0::2] + rows[:, :, 1::2])
    return [total / np.maximum(count, 1.0) for total, count in zip(sums, counts, strict=True)], counts


def energies(values: Array) -> Array:
    """Sums of squares of the orthogonal parts of pictures, the finest first, by channel. [LEVELS, C]."""
    means, counts = block_means(values)
    whole = [(count * mean.astype(np.float64) ** 2).sum(axis=(0, 1, 2)) for mean, count in zip(means, counts, strict=True)]
    return np.stack([*(fine - rough for fine, rough in zip(whole, whole[1:], strict=False)), whole[-1]])


def weighed(values: Array, weights: Array) -> Array:
    """Pictures whose orthogonal parts are multiplied by weights. [N, h, w, C].

    Args:
        values: Pictures. [N, h, w, C].
        weights: Factor of each part, the finest first, by channel. [LEVELS, C].
    """
    means, _ = block_means(values)
    weights = np.asarray(weights, np.float32)
    out = means[-1] * (weights[-1] - weights[-2])
    for level in range(LEVELS - 2, -1, -1):
        out = np.repeat(np.repeat(out, 2, axis=1), 2, axis=2)
        out = out + means[level] * (weights[level] - weights[level - 1] if level else weights[0])
    return np.asarray(out[:, : values.shape[1], : values.shape[2]])


def numbers_of(height: int, width: int) -> Array:
    """Independent numbers of each part of one colour of one picture. [LEVELS]."""
    blocks = [-(-height // edge) * -(-width // edge) for edge in (1, *BLOCKS)]
    return np.array([*(fine - rough for fine, rough in zip(blocks, blocks[1:], strict=False)), blocks[-1]], np.float64)


@dataclass(frozen=True)
class LayerSpread:
    """Variances of the parts of residuals whose pixels have a variance of about one.

    Args:
        own: Variance of what differs from view to view, by level of detail and colour. [LEVELS, 3].
        shared: Variance of what all views have in common, likewise. [LEVELS, 3].
        counts: Numbers from which `shared` was learnt. [LEVELS].
        pool: The residuals that it was learnt from. [K, h, w, 3].
    """

    own: Array
    shared: Array
    counts: Array
    pool: Array

    @classmethod
    def learn(cls, folds: Sequence[Array]) -> LayerSpread:
        """Measure the parts.

        Args:
            folds: Residuals of groups of views, 0 where nothing is compared; each group is as views of another day, of which
                nothing was learnt. [K, h, w, 3] each.
        """
        _, height, width, _ = folds[0].shape
        numbers = numbers_of(height, width)
        own, mean = np.zeros((LEVELS, 3)), np.zeros((LEVELS, 3))
        own_count, mean_count, size = np.zeros(LEVELS), np.zeros(LEVELS), 0.0
        for fold in folds:
            filled = float((fold != 0).any(axis=-1).mean())
            apart, common = _split(fold)
            own += energies(apart)
            mean += len(fold) * energies(common)
            own_count += (len(fold) - 1) * filled * numbers
            mean_count += filled * numbers
            size += len(fold) / len(folds)
        prior = own.sum() / (3.0 * own_count.sum())
        own = (own + _PRIOR * prior) / (own_count + _PRIOR)[:, None]
        mean = (mean + _PRIOR * own) / (mean_count + _PRIOR)[:, None]
        # The mean of many views has its own share of each, and what does not become less with their number.
        return cls(own, np.maximum(mean - own, 0.0) / size, mean_count, np.concatenate(folds))

    def whitened(self, table: Array, views: int | None = None) -> Array:
        """Residuals whose parts all have a variance of one. [N, h, w, 3].

        Args:
            table: Residuals, 0 where nothing is compared. [N, h, w, 3].
            views: Number of views that share what is common; as many as there are when None.
        """
        apart, common = _split(table)
        shared = self.own + (views or len(table)) * self.shared
        return _turned_back(weighed(apart, 1.0 / np.sqrt(self.own)) + weighed(common, 1.0 / np.sqrt(shared)))

    def replicate(self, mask: Array, rng: np.random.Generator) -> Array:
        """Whitened residuals of views on which nothing has changed. [N, h, w, 3].

        What views have for themselves is that of views it was learnt from, with random signs, and as large as in another set of
        views; what they share is as wrong as it may have been learnt.

        Args:
            mask: Pixels that are compared. [N, h, w, 1].
            rng: Random numbers.
        """
        drawn = self.pool[rng.integers(len(self.pool), size=len(mask))]
        apart, common = _split(drawn * mask * rng.choice(np.array((-1.0, 1.0), np.float32), (len(mask), 1, 1, 1)))
        loose = np.sqrt(self.counts / np.maximum(rng.chisquare(np.maximum(self.counts, 1.0), (3, LEVELS)), 1e-6)).T
        scale = np.exp(_SCATTER * rng.standard_normal((LEVELS, 1))) / np.sqrt(self.own)
        return _turned_back(weighed(apart, scale) + weighed(common, scale * loose))


def _turned_back(table: Array) -> Array:
    """From brightness and differences of colours to red, green and blue. [N, h, w, 3]."""
    return np.asarray(table @ _COLOURS.T, np.float32)


def _split(table: Array) -> tuple[Array, Array]:
    """What each view has for itself, and what all have in common, in brightness and colours. [N, h, w, 3], [1, h, w, 3]."""
    turned = np.asarray(table @ _COLOURS, np.float32)
    common = turned.mean(axis=0, keepdims=True)
    return turned - common, common
