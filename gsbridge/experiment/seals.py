"""Seals: one number draws a scored split of its own, so that nobody has looked at it before it is scored."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json

VARIABLE = "GSBRIDGE_SEAL"
"""Variable of the environment that holds the seal. Those above 10 000 are for scoring, not used while code changes."""


def seal_of(environment: Mapping[str, str]) -> int | None:
    """The seal; None where none is set.

    Raises:
        InputError: It is no number.
    """
    text = environment.get(VARIABLE, "").strip()
    if not text:
        return None
    if not text.isdecimal():
        raise InputError(VARIABLE, f"'{text}' is no seal", "Set it to a whole number, e.g. 4711")
    return int(text)


def record_seal(folder: str | Path, seal: int, parts: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write down what a seal was scored with; what was scored before under the same seal stays as it was.

    Args:
        folder: Gets `{seal}.json`.
        seal: The seal.
        parts: By part of the benchmark: `code` (digest of the code), `commit`, and `figures`. A `note`, written by hand, may
            tell what became known about a score later, and `apart` how its cases differ from those of the benchmark today, with
            which they are then not added up.

    Returns:
        The file.
    """
    path = Path(folder) / f"{seal}.json"
    known: dict[str, Any] = read_json(path)["parts"] if path.exists() else {}
    write_json(path, {"seal": seal, "parts": {**parts, **known}})
    return path


def read_seals(folder: str | Path) -> list[dict[str, Any]]:
    """All seals that were ever scored, in their order.

    Raises:
        InputError: A file is damaged.
    """
    found = [read_json(path) for path in sorted(Path(folder).glob("*.json"), key=lambda path: (len(path.stem), path.stem))]
    for content in found:
        if not {"seal", "parts"} <= set(content):
            raise InputError(folder, "a file holds no seal", "Restore it from the repository")
    return found
