"""Scene, cell and seed that a path below `results/` belongs to."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class CellPaths:
    """Task, scenes and way of training of a policy: one point of the experiment, without its seed.

    Args:
        task: `grasp` or `pick_and_place`.
        object, background: Scenes.
        renderer: What drew the pictures of its training, for example `gs` (splats) or `mesh`.
        variant: Way of training; `default` is the paper's.
    """

    task: str
    object: str
    background: str
    renderer: str = "gs"
    variant: str = "default"


def cell_of(path: str | Path, folder: str) -> tuple[CellPaths, tuple[str, ...]]:
    """Cell that a file below `{folder}/{task}/{object}+{background}/{renderer}/{variant}/` belongs to.

    Args:
        path: The file.
        folder: `policies` or `trials`.

    Returns:
        The cell, and the parts of the path behind it.

    Raises:
        InputError: The path does not have this form.
    """
    parts = Path(path).parts
    found = [index for index, part in enumerate(parts[:-5]) if part == folder]
    task, pair, renderer, variant = parts[found[-1] + 1 :][:4] if found else ("", "", "", "")
    if pair.count("+") != 1:
        rule = f"{folder}/<task>/<object>+<background>/<renderer>/<variant>/"
        raise InputError(path, "the cell cannot be told from this path", f"Keep the file below {rule}")
    item, _, background = pair.partition("+")
    return CellPaths(task, item, background, renderer, variant), parts[found[-1] + 5 :]


def seed_of(name: str, path: str | Path) -> int:
    """Read the number from a name `seed{number}`, with or without a file ending.

    Raises:
        InputError: The name does not have this form.
    """
    number = name.removeprefix("seed").split(".")[0]
    if not (name.startswith("seed") and number.isdigit()):
        raise InputError(path, f"{name!r} names no seed", "Name it seed<number>")
    return int(number)
