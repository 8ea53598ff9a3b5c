"""Lenses that photos were taken with, as far as their EXIF data tell."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import PIL.Image

SAME_LENS = 0.02
"""Focal lengths that differ by less, relatively, are of one lens: cameras round what they write."""

_EXIF = 0x8769
_LENS_TAGS = (0x920A, 0xA404, 0xA405, 0xA20E, 0xA20F, 0xA210)
"""Focal length, digital zoom, focal length in 35 mm film, and the focal plane's resolution: together they give the pixels."""
_MODEL = 0x0110


def focal_lengths(paths: Sequence[Path]) -> list[float | None]:
    """Focal length of each photo by its EXIF data, px at its full size; None where they give none.

    A phone changes its lens by itself, close to a thing or as it is zoomed, and photos of two lenses are of one size.

    Args:
        paths: Photos.
    """
    from gsbridge.photogrammetry.colmap import exif_focal_px

    # COLMAP knows how wide the sensors of cameras are, but decodes the whole photo: once for each kind is enough.
    known: dict[object, float | None] = {}
    out = []
    for path in paths:
        key = _written_by(path)
        if key not in known:
            known[key] = exif_focal_px(path)
        out.append(known[key])
    return out


def _written_by(path: Path) -> object:
    """All that decides the focal length of a photo; the path where its header cannot be read."""
    with contextlib.suppress(OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError), PIL.Image.open(path) as image:
        exif = image.getexif()
        more = exif.get_ifd(_EXIF)
        return (max(image.size), str(exif.get(_MODEL)), *(str(more.get(tag)) for tag in _LENS_TAGS))
    return path


def by_lens(focals: Sequence[float | None]) -> list[float | None]:
    """Give focal lengths that are nearly the same one value, the first that occurs, so that photos of a lens share a camera.

    Args:
        focals: Focal length of each photo, px at one longer side; None where unknown.
    """
    found: list[float] = []
    out: list[float | None] = []
    for focal in focals:
        same = None if focal is None else next((one for one in found if abs(one - focal) <= SAME_LENS * one), None)
        if focal is not None and same is None:
            found.append(focal)
            same = focal
        out.append(same)
    return out
