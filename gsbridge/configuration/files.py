"""YAML files as users write them: what YAML itself would pass over is told with its line."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import yaml

from gsbridge.errors import InputError
from gsbridge.reading import YAML_LOADER, refuse_bombs, refuse_depth, refuse_duplicates, refusing

_REMEDY = "Indent with spaces, close brackets, quote special characters"


def check_files(paths: Iterable[str | Path]) -> None:
    """Refuse configuration files that are no YAML, and those in which one key stands twice: YAML silently keeps the last.

    Args:
        paths: The configuration files in use.

    Raises:
        InputError: A file cannot be parsed, with the line, or a key stands twice in one block.
    """
    for path in paths:
        with refusing(path, "the configuration cannot be read", _REMEDY):
            text = Path(path).read_text(encoding="utf-8")
            try:
                refuse_depth(text, Path(path), _REMEDY)
                root = yaml.compose(text, Loader=YAML_LOADER)
                refuse_bombs(root, Path(path), _REMEDY)
            except yaml.YAMLError as error:
                if _is_json(path):
                    continue
                mark = getattr(error, "problem_mark", None)
                place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
                problem = f"{place}{getattr(error, 'problem', None) or error}"
                raise InputError(path, problem, _REMEDY) from error
        refuse_duplicates(root, Path(path))


def _is_json(path: str | Path) -> bool:
    """Whether a file is JSON; indented with tabs it is no YAML."""
    try:
        json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError:
        return False
    return True
