"""Storage of throws between the rules of the workflow: one file, with all throws of a role one after another."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gsbridge.files import atomic_file
from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.geometry import Array
from gsbridge.reading import refusing

_SAMPLES = ("time", "position", "quat")
"""Fields with a row per sample."""

_FIRST = ("velocity", "spin")
"""Fields with a row per throw; not-a-number if they were not logged."""


def save_throws(path: str | Path, throws: Mapping[str, Throws]) -> None:
    """Write throws to a file, atomically.

    Args:
        path: The file (`.npz`).
        throws: Throws by role.
    """
    arrays: dict[str, Array] = {}
    plain = {}
    for role, found in throws.items():
        plain[role] = {"names": [item.name for item in found.items], "digest": found.digest, "name": found.name}
        arrays[f"{role}/counts"] = np.array([len(item.time) for item in found.items])
        for key in _SAMPLES:
            arrays[f"{role}/{key}"] = np.concatenate([getattr(item, key) for item in found.items])
        for key in _FIRST:
            rows = [getattr(item, key) for item in found.items]
            arrays[f"{role}/{key}"] = np.stack([np.full(3, np.nan) if row is None else row for row in rows])
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, plain=json.dumps(plain), **arrays)  # type: ignore[arg-type]


def load_throws(path: str | Path) -> dict[str, Throws]:
    """Read back the throws that `save_throws` wrote, by role.

    Raises:
        InputError: The file is missing or damaged.
    """
    with refusing(path, "the stored throws cannot be read", "Delete the file and run the rule again"), np.load(path) as data:
        return {role: _throws(role, about, data) for role, about in json.loads(str(data["plain"])).items()}


def _throws(role: str, about: Mapping[str, object], data: Mapping[str, Array]) -> Throws:
    """Build the throws of one role."""
    edges = np.cumsum(data[f"{role}/counts"])[:-1]
    columns = [np.split(data[f"{role}/{key}"], edges) for key in _SAMPLES]
    first = [[None if np.isnan(row).any() else row for row in data[f"{role}/{key}"]] for key in _FIRST]
    names = about["names"]
    items = tuple(Throw(name, *rest) for name, *rest in zip(names, *columns, *first, strict=True))  # type: ignore[call-overload]
    return Throws(items, str(about["digest"]), str(about["name"]))
