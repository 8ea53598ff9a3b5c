"""Storage of records between the rules of the workflow: one file with every field of every record."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import atomic_file
from gsbridge.gap.formats.records import Record
from gsbridge.geometry import Array
from gsbridge.reading import refusing


def save_records(path: str | Path, records: Mapping[str, Record]) -> None:
    """Write records to a file, atomically.

    Args:
        path: The file (`.npz`).
        records: Records by role.
    """
    arrays: dict[str, Any] = {}
    plain: dict[str, dict[str, Any]] = {}
    for role, record in records.items():
        plain[role] = {}
        for item in fields(record):
            value = getattr(record, item.name)
            if isinstance(value, np.ndarray):
                arrays[f"{role}/{item.name}"] = value
            elif isinstance(value, Mapping) and any(isinstance(part, np.ndarray) for part in value.values()):
                # A mapping that contains arrays; its plain values are stored as arrays, too.
                plain[role][item.name] = {"order": list(value)}
                arrays |= {f"{role}/{item.name}/{key}": np.asarray(part) for key, part in value.items()}
            else:
                plain[role][item.name] = {"value": dict(value) if isinstance(value, Mapping) else value}
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, plain=json.dumps(plain), **arrays)


def load_records(path: str | Path) -> dict[str, Record]:
    """Read back the records that `save_records` wrote, by role.

    Raises:
        InputError: The file is missing or damaged.
    """
    with refusing(path, "the stored records cannot be read", "Delete the file and run the rule again"), np.load(path) as data:
        plain = json.loads(str(data["plain"]))
        return {role: _record(role, values, data) for role, values in plain.items()}


def _record(role: str, plain: Mapping[str, Any], data: Mapping[str, Array]) -> Record:
    """Build one record from its plain fields and its arrays."""
    values: dict[str, Any] = {}
    for item in fields(Record):
        stored = plain.get(item.name)
        if stored is None:
            values[item.name] = data[f"{role}/{item.name}"]
        elif "order" in stored:
            values[item.name] = {key: data[f"{role}/{item.name}/{key}"] for key in stored["order"]}
        else:
            # JSON stores tuples as lists.
            values[item.name] = tuple(stored["value"]) if isinstance(stored["value"], list) else stored["value"]
    return Record(**values)
