"""What a path below `results/` says."""

from __future__ import annotations

from pathlib import Path

from gsbridge.errors import InputError


def _scenes_folder(path: str | Path) -> tuple[tuple[str, ...], int]:
    """Parts of a path, and the place of the last `scenes` folder among them.

    Raises:
        InputError: The path has no `scenes` folder.
    """
    parts = Path(path).parts
    found = [index for index, part in enumerate(parts[:-2]) if part == "scenes"]
    if not found:
        raise InputError(path, "the scene cannot be told from this path", "Keep the record below scenes/<scene>/")
    return parts, found[-1]


def scene_of(path: str | Path) -> str:
    """Scene that a file below `scenes/{scene}/` belongs to.

    Raises:
        InputError: The path has no `scenes` folder.
    """
    parts, index = _scenes_folder(path)
    return parts[index + 1]


def is_main_run(path: str | Path) -> bool:
    """True below `scenes/{scene}/splats/`, False below `scenes/{scene}/comparison/`.

    Raises:
        InputError: The path has no `scenes` folder.
    """
    parts, index = _scenes_folder(path)
    return parts[index + 2] != "comparison"
