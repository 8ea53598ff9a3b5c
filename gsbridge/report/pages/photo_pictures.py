"""Photos for pages: small, with the outline of their mask, with rulers where pixels are to be read."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import read_image_u8, read_mask

OUTLINE = (255, 60, 200)
KEEP, DROP = (40, 220, 90), (255, 70, 50)
_RULER = (255, 255, 255)
_LINES = 14
"""Most ruler lines along the longer side."""


def jpeg_uri(image: Array, quality: int = 85) -> str:
    """A picture as a data URI. [H, W, 3] uint8 RGB."""
    data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}"


def masked_photo(photo: str | Path, mask: str | Path | None, longest: int, dim: float = 0.45) -> Array:
    """Draw the outline of a photo's mask, and darken the photo outside it.

    Args:
        photo: File.
        mask: File; None leaves the photo as it is.
        longest: Longest side of the result, px.
        dim: Brightness outside the mask, relative to the photo's.

    Returns:
        [h, w, 3] uint8 RGB.

    Raises:
        InputError: A file cannot be read.
    """
    image = read_image_u8(photo)
    scale = min(1.0, longest / max(image.shape[:2]))
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if mask is None:
        return small
    inside = cv2.resize(read_mask(mask), size, interpolation=cv2.INTER_AREA) > 0.5
    out = np.where(inside[..., None], small, (small * dim).astype(np.uint8))
    rings = cv2.findContours(inside.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(out, rings, -1, OUTLINE, max(1, round(longest / 500)), cv2.LINE_AA)
    return out


def ruled(picture: Array, factor: float, points: Sequence[tuple[float, float, str]] = ()) -> Array:
    """Draw numbered lines at round pixel numbers of the photo, and the points that were already given.

    Args:
        picture: [h, w, 3] uint8 RGB.
        factor: Pixels of the picture per pixel of the photo.
        points: u, v in pixels of the photo, and `keep` or `drop`.

    Returns:
        [h, w, 3] uint8 RGB.
    """
    out = picture.copy()
    height, width = out.shape[:2]
    step = ruler_step(max(height, width) / factor)
    lines = out.copy()
    for at in range(step, int(width / factor) + 1, step):
        cv2.line(lines, (round(at * factor), 0), (round(at * factor), height), _RULER, 1)
    for at in range(step, int(height / factor) + 1, step):
        cv2.line(lines, (0, round(at * factor)), (width, round(at * factor)), _RULER, 1)
    out = cv2.addWeighted(lines, 0.45, out, 0.55, 0)
    for at in range(step, int(width / factor) + 1, step):
        _number(out, str(at), (round(at * factor) + 2, 11))
    for at in range(step, int(height / factor) + 1, step):
        _number(out, str(at), (2, round(at * factor) - 3))
    for u, v, kind in points:
        colour = KEEP if kind == "keep" else DROP
        cv2.drawMarker(out, (round(u * factor), round(v * factor)), colour, cv2.MARKER_CROSS, 16, 2, cv2.LINE_AA)
    return out


def ruler_step(longest: float) -> int:
    """Distance of ruler lines, px: the smallest of 1, 2, 5 times a power of ten with at most `_LINES` lines."""
    power = 1
    while True:
        for digit in (1, 2, 5):
            if longest <= digit * power * _LINES:
                return digit * power
        power *= 10


def _number(picture: Array, text: str, place: tuple[int, int]) -> None:
    """Write small white text with a dark rim into the picture."""
    for colour, width in (((0, 0, 0), 3), (_RULER, 1)):
        cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, width, cv2.LINE_AA)
