"""Photos laid onto the table as another photo sees it, and the median of such layers.

The layers stay 8-bit; each has a lookup table of colours that contains its gain. The median of one layer comes from a
histogram, and the median across layers from one kernel. This is faster than floats and gives the same values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.masks.flatness import table_homography

MARGIN_PX = 3
"""Pixels this near to a mask may show the object, so they are no evidence of the table."""
_GAIN_PIXELS = 50
"""Pixels that two photos must share before one takes the other's exposure."""
_LEVELS = np.arange(256, dtype=np.float32) / 255
"""sRGB value, 0..1, of each 8-bit level of a photo."""


@dataclass(frozen=True)
class Layers:
    """Photos laid onto the table as one photo sees it.

    Args:
        shown: Grey levels of each channel of the laid photos. [L, h, w, 3] uint8.
        bare: Where the laid photos show the table. [L, h, w] bool.
        colours: sRGB 0..1 of each level and channel, corrected to the viewing photo's exposure. [L, 256, 3] float32.
    """

    shown: Array
    bare: Array
    colours: Array


def disc(radius: int) -> Array:
    """Round structuring element."""
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def free_of(mask: Array) -> Array:
    """1 where a photo surely does not show the object, else 0. [h, w] bool -> [h, w] float32."""
    return 1.0 - grown(mask, MARGIN_PX).astype(np.float32)


def grown(mask: Array, radius: int) -> Array:
    """Dilate a mask by a disc of `radius` px, only where it can grow, as large discs are slow. [h, w] bool -> [h, w] bool."""
    out = np.zeros(mask.shape, bool)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if len(rows) == 0:
        return out
    part = np.s_[max(0, rows[0] - radius) : rows[-1] + radius + 1, max(0, columns[0] - radius) : columns[-1] + radius + 1]
    out[part] = cv2.dilate(mask[part].astype(np.uint8), disc(radius)) > 0
    return out


def lay_on_table(
    index: int,
    others: Sequence[int],
    photos: Sequence[Array | None],
    free: Sequence[Array],
    cameras: Sequence[Camera],
    poses: Sequence[Array],
    away: Array,
) -> Layers:
    """Lay photos onto the plane z = 0 as photo `index` sees it.

    Args:
        index: Number of the photo whose view is used.
        others: Numbers of the photos that are laid onto the table.
        photos: RGB; those of `index` and `others` must not be None. [h, w, 3] uint8 each.
        free: See `free_of`, of the photos' sizes. [h, w] float32 each.
        cameras: Pinholes of the photos.
        poses: `cam_from_table`. [4, 4] each.
        away: Pixels of photo `index` that do not show the object; exposures are compared there. [h, w] bool.
    """
    own = photos[index]
    assert own is not None
    shown = np.empty((len(others), *own.shape), np.uint8)
    bare = np.empty(shown.shape[:3], bool)
    colours = np.repeat(np.repeat(_LEVELS[None, :, None], 3, axis=2), len(others), axis=0)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    for layer, other in enumerate(others):
        source = photos[other]
        assert source is not None
        onto = table_homography(cameras[index], poses[index], cameras[other], poses[other])
        cv2.warpPerspective(source, onto, own.shape[1::-1], dst=shown[layer], flags=flags)
        np.greater(cv2.warpPerspective(free[other], onto, own.shape[1::-1], flags=flags), 0.999, out=bare[layer])
        both = bare[layer] & away
        if np.count_nonzero(both) >= _GAIN_PIXELS:
            colours[layer] *= median_colour(own, both) / np.maximum(median_colour(shown[layer], both), 1e-3)
    return Layers(shown, bare, colours)


def median_colour(photo: Array, where: Array) -> Array:
    """Median of each channel, sRGB 0..1, over the pixels that count. [h, w, 3] uint8, [h, w] bool -> [3] float32."""
    mask = where.view(np.uint8)
    counts = [cv2.calcHist([photo], [channel], mask, [256], [0, 256]).ravel() for channel in range(3)]
    below = np.cumsum(np.stack(counts, axis=1).astype(np.int64), axis=0)
    total = int(below[-1, 0])
    low, high = ((below <= rank).sum(0) for rank in ((total - 1) // 2, total // 2))
    return (_LEVELS[low] + _LEVELS[high]) / 2


def median_layer(layers: Layers, where: Array, fallback: Array, needed: int) -> tuple[Array, Array]:
    """Median colour of the layers at pixels where enough of them show the table.

    Args:
        layers: At least one.
        where: Pixels to look at. [h, w] bool.
        fallback: Colours elsewhere, 0..1. [h, w, 3] float32.
        needed: Layers that must show a pixel, at least one.

    Returns:
        Colours [h, w, 3] float32, and where they are a median [h, w] bool.
    """
    table, known = fallback.copy(), np.zeros(where.shape, bool)
    _medians(layers.shown, layers.bare, layers.colours, where, needed, table, known)
    return table, known


@njit(nogil=True)
def _medians(shown: Array, bare: Array, colours: Array, where: Array, needed: int, table: Array, known: Array) -> None:
    """See `median_layer`. [L, h, w, 3], [L, h, w], [L, 256, 3], [h, w] -> [h, w, 3], [h, w] bool."""
    held = np.empty(len(shown), np.float32)
    chosen = np.empty(len(shown), np.int64)
    for row in range(where.shape[0]):
        for column in range(where.shape[1]):
            if not where[row, column]:
                continue
            count = 0
            for layer in range(len(shown)):
                if bare[layer, row, column]:
                    chosen[count] = layer
                    count += 1
            if count < needed:
                continue
            known[row, column] = True
            for channel in range(3):
                for index in range(count):
                    layer = chosen[index]
                    value = colours[layer, shown[layer, row, column, channel], channel]
                    slot = index
                    while slot > 0 and held[slot - 1] > value:
                        held[slot] = held[slot - 1]
                        slot -= 1
                    held[slot] = value
                table[row, column, channel] = np.float32(0.5) * (held[(count - 1) // 2] + held[count // 2])
