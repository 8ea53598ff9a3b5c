"""Split of residual images by scale, by colour, and into a common and a per-view part, each with its own variance.

The errors of splats are not white noise: if the colour of a table is a little off, it is off everywhere and in every view. An
image is split into means over blocks of increasing size and the remainders between successive sizes. These parts are
orthogonal; so are brightness and two colour differences, and the mean over views and the deviations from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array

BLOCKS = (2, 4, 8, 16, 32, 64)
"""Edges of the blocks, in compared pixels; each block holds four of the next smaller ones."""

LEVELS = len(BLOCKS) + 1

_COLOURS = np.array([[2, 3, -1], [2, 0, 2], [2, -3, -1]], np.float32) / np.sqrt(np.array([12, 18, 6], np.float32))
"""Orthonormal transform from red, green, blue to brightness, red minus blue, and green minus both."""

_SCATTER = 0.15
"""Relative standard deviation of a part's size between two sets of views, which differ in places and times."""

_PRIOR = 4.0
"""Weight of the prior for the variance of a part, in independent numbers; see `LayerSpread.learn`."""


def block_means(values: Array) -> tuple[list[Array], list[Array]]:
    """Return the means over blocks of each size, starting with the pixels themselves, and the pixel counts of the blocks.

    Images are padded to whole blocks; the padding does not count. [N, h, w, C] -> [N, h / edge, w / edge, C] each.
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
    """Return the sums of squares of the orthogonal parts of images, the finest first, by channel. [LEVELS, C]."""
    means, counts = block_means(values)
    whole = [(count * mean.astype(np.float64) ** 2).sum(axis=(0, 1, 2)) for mean, count in zip(means, counts, strict=True)]
    return np.stack([*(fine - rough for fine, rough in zip(whole, whole[1:], strict=False)), whole[-1]])


def weighed(values: Array, weights: Array) -> Array:
    """Multiply the orthogonal parts of images by weights. [N, h, w, C].

    Args:
        values: Images. [N, h, w, C].
        weights: Weight of each part, the finest first, by channel. [LEVELS, C].
    """
    means, _ = block_means(values)
    weights = np.asarray(weights, np.float32)
    out = means[-1] * (weights[-1] - weights[-2])
    for level in range(LEVELS - 2, -1, -1):
        out = np.repeat(np.repeat(out, 2, axis=1), 2, axis=2)
        out = out + means[level] * (weights[level] - weights[level - 1] if level else weights[0])
    return np.asarray(out[:, : values.shape[1], : values.shape[2]])


def numbers_of(height: int, width: int) -> Array:
    """Return the number of independent values in each part of one colour of one image. [LEVELS]."""
    blocks = [-(-height // edge) * -(-width // edge) for edge in (1, *BLOCKS)]
    return np.array([*(fine - rough for fine, rough in zip(blocks, blocks[1:], strict=False)), blocks[-1]], np.float64)


@dataclass(frozen=True)
class LayerSpread:
    """Variances of the parts of residuals whose pixels have a variance of about one.

    Args:
        own: Variance of the per-view part, by scale and colour. [LEVELS, 3].
        shared: Variance of the part that all views have in common, by scale and colour. [LEVELS, 3].
        counts: Number of independent values from which `shared` was learnt. [LEVELS].
        pool: The residuals from which all this was learnt. [K, h, w, 3].
    """

    own: Array
    shared: Array
    counts: Array
    pool: Array

    @classmethod
    def learn(cls, folds: Sequence[Array]) -> LayerSpread:
        """Learn the variances of the parts.

        The prior of `own` is the overall per-view variance; the prior of the common part is `own`.

        Args:
            folds: Residuals of held-out groups of views, 0 where nothing is compared; like views of another day, each group
                took no part in learning the corrections that were applied to it. [K, h, w, 3] each.
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
        # The mean over views also contains a share of the per-view parts, which is subtracted here.
        return cls(own, np.maximum(mean - own, 0.0) / size, mean_count, np.concatenate(folds))

    def whitened(self, table: Array, views: int | None = None) -> Array:
        """Scale the parts of residuals to a variance of one. [N, h, w, 3].

        Args:
            table: Residuals, 0 where nothing is compared. [N, h, w, 3].
            views: Number of views that have the common part; None for the number of residuals.
        """
        apart, common = _split(table)
        shared = self.own + (views or len(table)) * self.shared
        return _turned_back(weighed(apart, 1.0 / np.sqrt(self.own)) + weighed(common, 1.0 / np.sqrt(shared)))

    def replicate(self, mask: Array, rng: np.random.Generator) -> Array:
        """Draw whitened residuals of views in which nothing has changed. [N, h, w, 3].

        Residuals are drawn from `pool` with random signs. Their per-view part is rescaled at random by `_SCATTER`, and their
        common part also by the uncertainty with which its variance was learnt.

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
    """Transform brightness and colour differences back to red, green and blue. [N, h, w, 3]."""
    return np.asarray(table @ _COLOURS.T, np.float32)


def _split(table: Array) -> tuple[Array, Array]:
    """Split into per-view and common part, in brightness and colour differences. [N, h, w, 3], [1, h, w, 3]."""
    turned = np.asarray(table @ _COLOURS, np.float32)
    common = turned.mean(axis=0, keepdims=True)
    return turned - common, common
