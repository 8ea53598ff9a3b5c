"""Degree of the spherical harmonics of colours that a number of photos determines."""

from __future__ import annotations

from gsbridge.splats.harmonics import TERMS

SEEN = 0.5
"""Share of the photos all round an opaque thing that see a place of its surface: those on its side."""


def degree_of_photos(photos: int) -> int:
    """Return the largest degree of which a place of the surface has no more coefficients than photos that see it.

    A larger degree would fit the training photos and make up what others show.

    Args:
        photos: Number of training photos.
    """
    return max(degree for degree, terms in enumerate(TERMS) if degree == 0 or 1 + terms <= SEEN * photos)
