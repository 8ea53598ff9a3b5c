"""One colour model of object and table for all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from gsbridge.geometry import Array

_BINS = (16, 32, 32)
_CLEAR = 1.6
"""Logarithm of the odds, table against object, above which a colour is clearly the table's: five to one."""


@dataclass(frozen=True)
class SharedColours:
    """How much more often a colour lies outside the object than on it.

    Args:
        odds: Logarithm of the odds per Lab bin. [16, 32, 32].
    """

    odds: Array

    @classmethod
    def learn(cls, photos: Sequence[Array], fronts: Sequence[Array], backs: Sequence[Array]) -> SharedColours:
        """Count colours over all views, each view with the same weight.

        Args:
            photos: RGB, 8-bit, the part round the object. [h, w, 3] each.
            fronts, backs: True where a photo surely shows the object, and the table. [h, w] bool each.
        """
        front, back = np.zeros(_BINS), np.zeros(_BINS)
        for photo, on, off in zip(photos, fronts, backs, strict=True):
            bins = _bins(photo)
            for total, chosen in ((front, on), (back, off)):
                if chosen.any():
                    counts = np.bincount(bins[chosen], minlength=total.size).reshape(_BINS)
                    # A view's vote on a colour saturates: a large wrong patch in one view counts little more than a small one.
                    total += np.minimum(counts / chosen.sum(), 0.02)
        front, back = (ndimage.gaussian_filter(total, 0.7) / max(len(photos), 1) for total in (front, back))
        return cls(np.log((back + 1e-5) / (front + 1e-5)))

    def backness(self, photo: Array) -> Array:
        """Pixels whose surroundings are clearly table-coloured. [h, w, 3] uint8 -> [h, w] bool."""
        odds = self.odds.ravel()[_bins(photo)].astype(np.float32)
        return cv2.blur(odds, (5, 5)) > _CLEAR


def _bins(photo: Array) -> Array:
    """Flat Lab bin of each pixel. [h, w, 3] uint8 -> [h, w]."""
    lab = cv2.cvtColor(photo, cv2.COLOR_RGB2LAB).astype(np.int64)
    return (lab[..., 0] // 16 * _BINS[1] + lab[..., 1] // 8) * _BINS[2] + lab[..., 2] // 8
