"""The lenses that photos were taken with, according to their EXIF data."""

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
"""Focal lengths with a smaller relative difference come from one lens: cameras round the values that they write."""

_EXIF = 0x8769
_FOCAL_35MM = 0xA405
_MARKS = (0x920A, 0xA404, 0xA434)
"""EXIF tags of focal length in mm, digital zoom and name of the lens. If any of them differs, photos come from two lenses, even
if their focal length in 35 mm film is the same: a phone that crops its wide lens, close to an object, may write that of the
other lens."""
_WIDTH = (0x0110, _FOCAL_35MM, 0xA20E, 0xA20F, 0xA210)
"""EXIF tags of the camera's model and of the other values that determine the focal length in pixels."""

_FILM_MM = float(np.hypot(36.0, 24.0))
"""Diagonal of 35 mm film, mm. COLMAP converts focal lengths in 35 mm film by it; photos that COLMAP cannot decode are converted
in the same way here."""


@dataclass(frozen=True)
class Lens:
    """A lens, whose photos may share a camera.

    Args:
        number: Number of the lens in a capture, in the order in which lenses occur.
        focal: Focal length, px; None if unknown.
    """

    number: int
    focal: float | None


def lenses_of(paths: Sequence[Path], scales: Sequence[float]) -> list[Lens]:
    """Find the lens of each photo.

    A phone switches lenses by itself, close to an object or when zoomed, and photos of both lenses have the same size.

    Args:
        paths: Photos.
        scales: Scale of each photo relative to its file, 1 or less.
    """
    from gsbridge.photogrammetry.colmap import exif_focal_px

    # COLMAP knows the sensor widths of cameras, but decodes the whole photo, so it is asked only once for each kind of photo.
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
    """From a photo's header: values that tell lenses apart; values that determine the focal length; that by 35 mm film, px."""
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
