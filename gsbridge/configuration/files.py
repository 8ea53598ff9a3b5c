"""YAML files as users write them: what YAML itself would pass over is told with its line."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import yaml

from gsbridge.errors import InputError
from gsbridge.reading import YAML_LOADER, refuse_bombs, refuse_depth, refuse_duplicates, refusing

_REMEDY = "Indent with spaces, close brackets, quote special characters"
_STORAGE = "Save it as UTF-8; in Notepad: Save as, Encoding: UTF-8"


def check_files(paths: Iterable[str | Path]) -> None:
    """Refuse configuration files that are no YAML, and those in which one key stands twice: YAML silently keeps the last.

    Args:
        paths: The configuration files in use.

    Raises:
        InputError: A file is not stored as UTF-8, it cannot be parsed (with the line), or a key stands twice in one block.
    """
    for path in paths:
        with refusing(path, "the configuration cannot be read", _REMEDY):
            text = _text(path)
            try:
                refuse_depth(text, Path(path), _REMEDY)
                root = yaml.compose(text, Loader=YAML_LOADER)
                refuse_bombs(root, Path(path), _REMEDY)
            except yaml.YAMLError as error:
                if _is_json(path):
                    continue
                mark = getattr(error, "problem_mark", None)
                place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
                problem = f"{place}{getattr(error, 'problem', None) or str(error).splitlines()[0]}"
                raise InputError(path, problem, _REMEDY) from error
        refuse_duplicates(root, Path(path))


def _text(path: str | Path) -> str:
    """Text of a file; bytes of zero show UTF-16 of an editor that marks it by nothing else."""
    problem = "the configuration cannot be read: it is not stored as UTF-8"
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(path, problem, _STORAGE) from error
    if "\0" in text:
        raise InputError(path, problem, _STORAGE)
    return text


def _is_json(path: str | Path) -> bool:
    """Whether a file is JSON; indented with tabs it is no YAML."""
    try:
        json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError:
        return False
    return True
