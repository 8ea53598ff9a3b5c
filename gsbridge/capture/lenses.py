"""Lenses that photos were taken with, as far as their EXIF data tell."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pi_heif
import PIL.Image

pi_heif.register_heif_opener()

SAME_LENS = 0.02
"""Focal lengths that differ by less, relatively, are of one lens: cameras round what they write."""

_EXIF = 0x8769
_FOCAL_35MM = 0xA405
_MARKS = (0x920A, 0xA404, 0xA434)
"""Focal length in mm, digital zoom, name of the lens: photos in which one differs are of two lenses, whatever their pixels. A
phone that crops its wide lens, close to a thing, may write the other's focal length in 35 mm film."""
_WIDTH = (0x0110, _FOCAL_35MM, 0xA20E, 0xA20F, 0xA210)
"""Model, and what else decides the focal length in pixels."""

_FILM_MM = float(np.hypot(36.0, 24.0))
"""Diagonal of 35 mm film, to which COLMAP relates a focal length in it, as pictures that it cannot decode are related here."""


@dataclass(frozen=True)
class Lens:
    """What photos that may share a camera were taken with.

    Args:
        number: Its place among the lenses of a capture, in the order in which they occur.
        focal: Focal length, px; None where unknown.
    """

    number: int
    focal: float | None


def lenses_of(paths: Sequence[Path], scales: Sequence[float]) -> list[Lens]:
    """The lens of each photo.

    A phone changes its lens by itself, close to a thing or as it is zoomed, and photos of two lenses are of one size.

    Args:
        paths: Photos.
        scales: Factor by which each was made smaller.
    """
    from gsbridge.photogrammetry.colmap import exif_focal_px

    # COLMAP knows how wide the sensors of cameras are, but decodes the whole photo: once for each kind is enough.
    known: dict[object, float | None] = {}
    found: list[tuple[object, Lens]] = []
    out = []
    for path, scale in zip(paths, scales, strict=True):
        marks, kind, film = _written(path)
        if kind not in known:
            known[kind] = exif_focal_px(path) or film
        full = known[kind]
        focal = None if full is None else full * scale
        same = [lens for other, lens in found if other == marks and _alike(lens.focal, focal)]
        if not same:
            same = [Lens(len(found), focal)]
            found.append((marks, same[0]))
        out.append(same[0])
    return out


def _written(path: Path) -> tuple[object, object, float | None]:
    """What tells lenses apart in a photo's header, what decides its focal length, and that by 35 mm film, px, if there."""
    with contextlib.suppress(OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError), PIL.Image.open(path) as image:
        exif = image.getexif()
        more = exif.get_ifd(_EXIF)
        marks = tuple(str(more.get(tag)) for tag in _MARKS)
        kind = (image.size, marks, *(str(exif.get(tag, more.get(tag))) for tag in _WIDTH))
        film = more.get(_FOCAL_35MM)
        return (
            marks,
            kind,
            film / _FILM_MM * float(np.hypot(*image.size)) if isinstance(film, int | float) and film > 0 else None,
        )
    return None, path, None


def _alike(one: float | None, other: float | None) -> bool:
    """Whether two focal lengths are nearly the same, or both unknown."""
    return one == other if one is None or other is None else abs(one - other) <= SAME_LENS * one
