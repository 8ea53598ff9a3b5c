"""Catalogues of effects: what a parameter is, and how the files of a package become entries."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Args:
        name: As in model files.
        unit: SI.
        low: Smallest value that makes sense.
        high: Largest.
        typical: A size at which to begin looking.
        amplitude: Whether the effect vanishes as this goes to zero with the other amplitudes; others are shapes.
        meaning: In words.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    amplitude: bool
    meaning: str


def entries_of(package: str, path: Iterable[str], base: type) -> Mapping[str, Any]:
    """One object of every class that a package's modules define on some base and give a name, by name.

    Args:
        package: Name of the package.
        path: Its `__path__`.
        base: What entries derive from.
    """
    found = {}
    for item in pkgutil.iter_modules(path):
        module = importlib.import_module(f"{package}.{item.name}")
        for kind in vars(module).values():
            if (
                isinstance(kind, type)
                and issubclass(kind, base)
                and kind.__module__ == module.__name__
                and hasattr(kind, "name")
            ):
                found[kind.name] = kind()
    return MappingProxyType(dict(sorted(found.items())))
