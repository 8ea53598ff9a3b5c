"""A case's or a model's YAML file, read with one clear sentence for whatever is wrong with it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from gsbridge.configuration.files import check_files
from gsbridge.errors import InputError
from gsbridge.reading import load_yaml


def read_yaml(path: str | Path, what: str, page: str) -> Any:
    """Content of a YAML file.

    Args:
        path: The file.
        what: What it is, for the message: `case`, `model`.
        page: Documentation that shows how it should look.

    Raises:
        InputError: The file cannot be read, is no YAML (with the line), or a key stands twice in one block.
    """
    content = load_yaml(path, what, f"Check the path, or see how {page} writes it")
    check_files([path])
    return content


def read_case_file(path: str | Path, page: str, measured: str, known: Collection[str]) -> Mapping[str, Any]:
    """Content of a case: a model and what was measured.

    Args:
        path: The file.
        page: Documentation that shows how it should look.
        measured: Key of the section that names what was measured.
        known: All keys that a case may have.

    Raises:
        InputError: The file cannot be read, 'model' or the section is missing, or a key is unknown.
    """
    content = read_yaml(path, "case", page)
    for key in content if isinstance(content, Mapping) else ():
        if key not in known:
            raise InputError(path, f"the key '{key}' is unknown", f"Use only: {', '.join(known)}")
    if not isinstance(content, Mapping) or "model" not in content or measured not in content:
        raise InputError(path, f"a case needs 'model' and '{measured}'", f"See {page}")
    if not isinstance(content[measured], Mapping):
        raise InputError(
            path, f"'{measured}' does not name a file for each role", f"Write '{measured}: {{ROLE: FILE}}'; see {page}"
        )
    return content
