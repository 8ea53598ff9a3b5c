"""Seals: a number that seeds a scored split of its own, whose cases nobody can have seen before they are scored."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json

VARIABLE = "GSBRIDGE_SEAL"
"""Environment variable that holds the seal. Seals above 10 000 are for scoring and are not used while code is developed."""


def seal_of(environment: Mapping[str, str]) -> int | None:
    """The seal; None if none is set.

    Raises:
        InputError: The variable holds no whole number.
    """
    text = environment.get(VARIABLE, "").strip()
    if not text:
        return None
    if not text.isdecimal():
        raise InputError(VARIABLE, f"'{text}' is no seal", "Set it to a whole number, e.g. 4711")
    return int(text)


def record_seal(folder: str | Path, seal: int, parts: Mapping[str, Mapping[str, Any]]) -> Path:
    """Record what a seal was scored with; parts that were scored earlier under the same seal are not overwritten.

    Args:
        folder: Gets `{seal}.json`.
        seal: The seal.
        parts: By part of the benchmark: `code` (digest of the code), `commit`, and `figures`. Two entries may be written by
            hand: `note` tells what became known about a score later; `apart` tells how its cases differ from those of today's
            benchmark, so that the two are not added up.

    Returns:
        The file.
    """
    path = Path(folder) / f"{seal}.json"
    known: dict[str, Any] = read_json(path)["parts"] if path.exists() else {}
    write_json(path, {"seal": seal, "parts": {**parts, **known}})
    return path


def read_seals(folder: str | Path) -> list[dict[str, Any]]:
    """All seals that were ever scored, in the order of their numbers.

    Raises:
        InputError: A file is damaged.
    """
    found = [read_json(path) for path in sorted(Path(folder).glob("*.json"), key=lambda path: (len(path.stem), path.stem))]
    for content in found:
        if not {"seal", "parts"} <= set(content):
            raise InputError(folder, "a file holds no seal", "Restore it from the repository")
    return found
