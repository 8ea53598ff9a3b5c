"""A case's or a model's YAML file, read with one clear sentence for whatever is wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from gsbridge.configuration.files import check_files
from gsbridge.errors import InputError


def read_yaml(path: str | Path, what: str, page: str) -> Any:
    """Content of a YAML file.

    Args:
        path: The file.
        what: What it is, for the message: `case`, `model`.
        page: Documentation that shows how it should look.

    Raises:
        InputError: The file cannot be read, is no YAML (with the line), or a key stands twice in one block.
    """
    try:
        check_files([path])
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, f"the {what} cannot be read", "Check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(path, f"this is not valid YAML ({error})", f"Correct it after {page}") from error
