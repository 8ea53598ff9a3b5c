"""Files that the user gives: no stage can make them again, so the caller says what the user can do about a fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json


def read_given_json(path: str | Path, remedy: str) -> dict[str, Any]:
    """Read a JSON object that the user gives.

    Args:
        path: The file.
        remedy: What the user can do about a file that cannot be used.

    Raises:
        InputError: The file is missing, too large, or no JSON object.
    """
    try:
        return read_json(path)
    except InputError as error:
        raise InputError(error.source, error.problem, remedy) from error
