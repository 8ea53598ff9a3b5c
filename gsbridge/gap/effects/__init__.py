"""The catalogue of effects: every module of this package that defines one adds it."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from gsbridge.catalogue import entries_of
from gsbridge.errors import InputError
from gsbridge.gap.effects.base import Effect


@functools.cache
def catalogue() -> Mapping[str, Effect]:
    """All effects by name."""
    return entries_of(__name__, __path__, Effect)


def effect_of(name: str, source: str = "model") -> Effect:
    """An effect by name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in catalogue():
        raise InputError(source, f"the effect '{name}' is unknown", f"Use one of: {', '.join(catalogue())}")
    return catalogue()[name]
