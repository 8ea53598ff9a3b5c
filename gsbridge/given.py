"""Files that the user gives and no stage makes: what is wrong with them is mended where they come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json


def read_given_json(path: str | Path, remedy: str) -> dict[str, Any]:
    """Read a JSON object that the user gives.

    Args:
        path: The file.
        remedy: What the user can do where it is missing or no JSON object.

    Raises:
        InputError: It is.
    """
    try:
        return read_json(path)
    except InputError as error:
        raise InputError(error.source, error.problem, remedy) from error
