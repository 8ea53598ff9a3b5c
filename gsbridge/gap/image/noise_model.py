"""Variance of the noise of photos, measured in flat areas, where neither edges nor displacements of the image disturb it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from gsbridge.geometry import Array

LEVELS = 5
"""Number of classes of brightness in which noise is measured."""

ENOUGH = 20
"""Smallest number of pixels that a class needs for a measurement of noise."""

LEAST = (0.3 / 255.0) ** 2
"""Smallest variance, about that of the rounding to 8 bits."""

_SECOND = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]], np.float32) / 6.0
"""Filter that removes slopes and edges but keeps the variance of white noise (Immerkaer, CVIU 64(2), 1996)."""

_SPAN = 16
"""Edge of the squares that are taken to be independent, px: the blocks in which JPEG stores colours of halved size."""

_GROUPS = 12
"""Number of groups of such squares that are left out in turn."""

_STEP = 1.0 / 6.0 / 255.0
"""Step of filtered photos of 8 bits."""

_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
"""Its multiples, modulo 1, fill an interval evenly."""

_OVERLAP = float((cv2.filter2D(np.pad(_SECOND, 4), -1, _SECOND, borderType=cv2.BORDER_CONSTANT) ** 2).sum())
"""Number of pixels per independent value of the filtered noise: the sum of its squared correlations."""


def slopes_of(pictures: Array) -> Array:
    """Return squared slopes of encoded images per pixel, averaged over colours and neighbours. [N, H, W, 3] -> [N, H, W]."""
    out = []
    for picture in pictures:
        across = cv2.Scharr(picture, cv2.CV_32F, 1, 0, scale=1 / 32.0)
        down = cv2.Scharr(picture, cv2.CV_32F, 0, 1, scale=1 / 32.0)
        out.append(cv2.blur((across**2 + down**2).mean(axis=-1), (3, 3)))
    return np.stack(out)


def _robust(values: Array) -> Array:
    """Return the variance of filtered noise without its outliers. [P, 3] -> [3]."""
    # A compromise between robust and efficient: drop values beyond three deviations, as estimated by the median. In photos with
    # little noise many values are equal, by their 8 bits, and the median would jump: each is spread over its step.
    spread = _STEP * (np.arange(len(values)) * _GOLDEN % 1.0 - 0.5)
    inside = values**2 <= 9.0 * 2.198 * np.median(np.abs(values + spread[:, None]), axis=0) ** 2
    out: Array = (values**2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / 0.9733
    return out


@dataclass(frozen=True)
class SharedNoise:
    """What the noise of a pixel shares with others, as compression, denoising and demosaicing leave it.

    Args:
        pixels: Factor by which the variance of a measured noise variance exceeds that for independent pixels, 1 at the least.
        colours: Correlation of the colours' measured noise variances. [3, 3].
    """

    pixels: float
    colours: Array


@dataclass(frozen=True)
class Flats:
    """Flat areas of photos, by classes of brightness.

    Args:
        masks: Pixels of every class in every photo. [N, L, H, W] bool.
        levels: Mean encoded level of each class, by colour. [N, L, 3].
        counts: Number of pixels in each class. [N, L].
    """

    masks: Array
    levels: Array
    counts: Array

    @classmethod
    def of(cls, pictures: Array, slopes: Array, covered: Array) -> Flats:
        """Take the covered pixels whose slope is at most the median, and split them into classes at quantiles of brightness.

        Args:
            pictures: Photos, 0..1. [N, H, W, 3].
            slopes: From `slopes_of`. [N, H, W].
            covered: Pixels to use. [N, H, W] bool.
        """
        grey = pictures.mean(axis=-1)
        flat = (slopes <= np.median(slopes)) & covered
        flat[:, [0, -1], :] = flat[:, :, [0, -1]] = False
        edges = np.quantile(grey[flat], np.linspace(0, 1, LEVELS + 1)[1:-1]) if flat.any() else np.zeros(LEVELS - 1)
        kind = np.digitize(grey, edges)
        masks = np.stack([flat & (kind == k) for k in range(LEVELS)], axis=1)
        counts = masks.sum(axis=(2, 3))
        levels = np.einsum("nlhw,nhwc->nlc", masks.astype(np.float32), pictures) / np.maximum(counts, 1)[..., None]
        return cls(masks, levels.astype(np.float64), counts)

    @cached_property
    def _places(self) -> dict[tuple[int, int], Array]:
        """Flat pixel indices of every photo and class with enough pixels; cached, since a fit asks for noise at every step."""
        return {(int(n), int(k)): np.flatnonzero(self.masks[n, k]) for n, k in np.argwhere(self.counts >= ENOUGH)}

    def variances(self, pictures: Array) -> Array:
        """Return robust estimates of the noise variance in every class. [N, H, W, 3] -> [N, L, 3]."""
        out = np.full((*self.counts.shape, 3), np.nan)
        for place, values in self._filtered(pictures):
            out[place] = _robust(values)
        return np.maximum(out, LEAST * 0.1)

    def _filtered(self, pictures: Array) -> Iterator[tuple[tuple[int, int], Array]]:
        """Yield the filtered noise of every photo and class, [P, 3]."""
        fine = [cv2.filter2D(image, -1, _SECOND, borderType=cv2.BORDER_REPLICATE) for image in pictures]
        for (n, k), places in self._places.items():
            yield (n, k), fine[n].reshape(-1, 3)[places].astype(np.float64)

    def shared(self, apart: Array) -> SharedNoise:
        """Measure what neighbours and colours share of the noise, by leaving out parts of the photos in turn.

        Args:
            apart: Difference of repeated photos. [N, H, W, 3].

        Source: the delete-a-group jackknife, Shao and Tu, The Jackknife and Bootstrap, 1995.
        """
        width = apart.shape[2]
        wide = -(-width // _SPAN)
        found, expected = np.zeros((3, 3)), 0.0
        for place, values in self._filtered(apart.astype(np.float32)):
            squares = self._places[place] // width // _SPAN * wide + self._places[place] % width // _SPAN
            group = np.unique(squares, return_inverse=True)[1] % _GROUPS
            if group.max() == 0:
                continue  # All of it lies in one square: it has no parts.
            logs = np.log([np.maximum(_robust(values[group != j]), 0.1 * LEAST) for j in range(group.max() + 1)])
            off = logs - logs.mean(axis=0)
            found += (len(logs) - 1.0) / len(logs) * off.T @ off
            expected += 2.0 * _OVERLAP / len(values)
        size = np.sqrt(np.maximum(np.diag(found), 1e-30))
        # A little of the identity keeps the matrix positive definite where colours are copies of each other.
        colours = (1.0 - 1e-6) * found / np.outer(size, size)
        np.fill_diagonal(colours, 1.0)
        return SharedNoise(max(1.0, float(np.diag(found).max()) / max(expected, 1e-30)), colours)

    def deviations(self) -> Array:
        """Return standard deviations of the log of measured variances; infinite where there are too few pixels. [N, L]."""
        return np.where(self.counts >= ENOUGH, np.sqrt(2.0 * _OVERLAP / np.maximum(self.counts, 1)), np.inf)
