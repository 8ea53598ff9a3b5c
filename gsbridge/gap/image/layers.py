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

BLOCKS = (2, 4, 8, 16)
"""Edges of the blocks, pixels as compared; each holds four of those before it."""

LEVELS = len(BLOCKS) + 1

_COLOURS = np.array([[2, 3, -1], [2, 0, 2], [2, -3, -1]], np.float32) / np.sqrt(np.array([12, 18, 6], np.float32))
"""From red, green, blue to brightness, red less blue, and green less both. Orthonormal."""

_PRIOR = 4.0
"""Numbers that the spread of a part is worth before anything is measured: that of its pixels."""


def block_means(values: Array, edge: int) -> Array:
    """Means over blocks, in the shape of the picture; blocks at the right and lower edge may be cut off. [N, h, w, C]."""
    count, height, width, channels = values.shape
    tall, wide = -(-height // edge), -(-width // edge)
    padded = np.zeros((count, tall * edge, wide * edge, channels), values.dtype)
    padded[:, :height, :width] = values
    sums = padded.reshape(count, tall, edge, wide, edge, channels).sum(axis=(2, 4))
    rows, columns = (np.minimum(edge, size - edge * np.arange(-(-size // edge))) for size in (height, width))
    means = sums / np.multiply.outer(rows, columns)[..., None].astype(values.dtype)
    return np.repeat(np.repeat(means, edge, axis=1), edge, axis=2)[:, :height, :width]


def details(values: Array) -> list[Array]:
    """Orthogonal parts of pictures, the finest first, that add up to them. [N, h, w, C] each."""
    smooth = [values, *(block_means(values, edge) for edge in BLOCKS)]
    return [fine - rough for fine, rough in zip(smooth, smooth[1:], strict=False)] + [smooth[-1]]


def numbers_of(height: int, width: int) -> Array:
    """Independent numbers of each part of one colour of one picture. [LEVELS]."""
    blocks = [-(-height // edge) * -(-width // edge) for edge in (1, *BLOCKS)]
    return np.array([*(fine - rough for fine, rough in zip(blocks, blocks[1:], strict=False)), blocks[-1]], np.float64)


@dataclass(frozen=True)
class LayerSpread:
    """Variances of the parts of residuals whose pixels have a variance of about one.

    Args:
        own: Of what each view has for itself, by detail and colour. [LEVELS, 3].
        shared: Of what every view has in common with the others. [LEVELS, 3].
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
            for level, (one, other) in enumerate(zip(details(apart), details(common), strict=True)):
                own[level] += (one.astype(np.float64) ** 2).sum(axis=(0, 1, 2))
                mean[level] += len(fold) * (other.astype(np.float64) ** 2).sum(axis=(0, 1, 2))
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
            table: Residuals, 0 where nothing is compared.
            views: Number of views that share what is common; as many as there are when None.
        """
        apart, common = _split(table)
        shared = self.own + (views or len(table)) * self.shared
        out = sum(part / np.sqrt(self.own[level]).astype(np.float32) for level, part in enumerate(details(apart)))
        out = out + sum(part / np.sqrt(shared[level]).astype(np.float32) for level, part in enumerate(details(common)))
        return np.asarray(out @ _COLOURS.T, np.float32)

    def replicate(self, mask: Array, rng: np.random.Generator) -> Array:
        """Whitened residuals of views on which nothing has changed. [N, h, w, 3].

        What views have for themselves is that of views it was learnt from, with random signs; what they share is as wrong as it
        may have been learnt.

        Args:
            mask: Pixels that are compared. [N, h, w, 1].
            rng: Random numbers.
        """
        drawn = self.pool[rng.integers(len(self.pool), size=len(mask))]
        apart, common = _split(drawn * mask * rng.choice(np.array((-1.0, 1.0), np.float32), (len(mask), 1, 1, 1)))
        loose = np.sqrt(self.counts / np.maximum(rng.chisquare(np.maximum(self.counts, 1.0), (3, LEVELS)), 1e-6)).T
        scale = (1.0 / np.sqrt(self.own)).astype(np.float32)
        out = sum(part * scale[level] for level, part in enumerate(details(apart)))
        out = out + sum(part * scale[level] * loose[level].astype(np.float32) for level, part in enumerate(details(common)))
        return np.asarray(out @ _COLOURS.T, np.float32)


def _split(table: Array) -> tuple[Array, Array]:
    """What each view has for itself, and what all have in common, in brightness and colours. [N, h, w, 3], [1, h, w, 3]."""
    turned = np.asarray(table @ _COLOURS, np.float32)
    common = turned.mean(axis=0, keepdims=True)
    return turned - common, common
