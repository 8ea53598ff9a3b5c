"""Variance of the noise of photos, measured in flat areas, where neither edges nor displacements of the image disturb it."""

from __future__ import annotations

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
        fine = np.stack([cv2.filter2D(image, -1, _SECOND, borderType=cv2.BORDER_REPLICATE) for image in pictures])
        out = np.full((*self.counts.shape, 3), np.nan)
        for n, k in np.argwhere(self.counts >= ENOUGH):
            # A compromise between robust and efficient: drop values beyond three deviations, as estimated by the median.
            square = fine[n].reshape(-1, 3)[self._places[n, k]].astype(np.float64) ** 2
            rough = 2.198 * np.median(square, axis=0)
            inside = square <= 9.0 * rough
            out[n, k] = (square * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / 0.9733
        return np.maximum(out, LEAST * 0.1)

    def deviations(self) -> Array:
        """Return standard deviations of the log of measured variances; infinite where there are too few pixels. [N, L]."""
        return np.where(self.counts >= ENOUGH, np.sqrt(2.0 * _OVERLAP / np.maximum(self.counts, 1)), np.inf)
