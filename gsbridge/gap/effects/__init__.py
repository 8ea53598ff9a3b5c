"""The catalogue of effects: every module of this package that defines one adds it."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType

from gsbridge.errors import InputError
from gsbridge.gap.effects.base import Effect


@functools.cache
def catalogue() -> Mapping[str, Effect]:
    """All effects by name."""
    found = {}
    for item in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{item.name}")
        for kind in vars(module).values():
            if (
                isinstance(kind, type)
                and issubclass(kind, Effect)
                and kind.__module__ == module.__name__
                and hasattr(kind, "name")
            ):
                found[kind.name] = kind()
    return MappingProxyType(dict(sorted(found.items())))


def effect_of(name: str, source: str = "model") -> Effect:
    """An effect by name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in catalogue():
        raise InputError(source, f"the effect '{name}' is unknown", f"Use one of: {', '.join(catalogue())}")
    return catalogue()[name]
