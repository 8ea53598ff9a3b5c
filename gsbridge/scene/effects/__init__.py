"""The catalogue of image effects: every module of this package that defines one adds it."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from gsbridge.effects.parameter import entries_of
from gsbridge.errors import InputError
from gsbridge.scene.effects.base import ImageEffect


@functools.cache
def catalogue() -> Mapping[str, ImageEffect]:
    """All image effects by name."""
    return entries_of(__name__, __path__, ImageEffect)


def effect_of(name: str, source: str = "model") -> ImageEffect:
    """An image effect by name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in catalogue():
        raise InputError(source, f"the image effect '{name}' is unknown", f"Use one of: {', '.join(catalogue())}")
    return catalogue()[name]
