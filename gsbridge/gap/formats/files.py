"""Files of a case, found before it is read: those that the workflow has to watch, and the case's own file."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.reading import absent, files_below, load_yaml
from gsbridge.robot.mjcf_files import mjcf_files
from gsbridge.robot.urdf import collision_meshes

_NUMBERS = (".csv", ".parquet", ".json", ".jsonl")
_PHOTOS = (".json", ".npz", ".png")


def case_path(name: str, value: str, places: Sequence[str | Path]) -> Path:
    """Find a case's file.

    Args:
        name: Name of the case, for messages.
        value: Configured path of the case's file.
        places: Folders that the path may be relative to, in order of preference.

    Raises:
        InputError: None of the folders contains the file.
    """
    found = [Path(folder) / Path(value).expanduser() for folder in places]
    for path in found:
        if path.is_file():
            return path
    folder = next((path for path in found if path.is_dir()), None)
    problem = f"{folder} is a folder, the case's file is wanted" if folder else absent(found)
    raise InputError(f"config: gap.cases.{name}", problem, "Correct the path of the case; see docs/gap.md")


def case_name(value: str) -> str:
    """Derive a case's name from its file: the file's name, or that of its folder if the file is called `case.yaml`.

    Raises:
        InputError: The derived name does not begin with a letter.
    """
    path = Path(value).expanduser()
    word = path.resolve().parent.name if path.stem == "case" else path.stem
    name = re.sub(r"[^a-z0-9]+", "_", word.lower()).strip("_")
    if not re.match("[a-z]", name):
        raise InputError("config: gap_case", f"'{word}' gives no name", "Call the file or its folder by a word, e.g. axis.yaml")
    return name


def case_files(case: str | Path) -> list[Path]:
    """Return the existing files that a case names, none if the case is damaged.

    They are its model, the model's URDF or MJCF with its meshes, its records and their repeats, and its photos.
    """
    case = Path(case)
    content = case_content(case)
    names = [content.get("model"), *_values(content.get("records"))]
    names += [name for item in _values(content.get("repeats")) for name in (item if isinstance(item, list) else [item])]
    model = case_model(case)
    # The text after '#' names a part of a data set.
    found = [case.parent / name.partition("#")[0] for name in names if isinstance(name, str)]
    urdf = case_content(model).get("urdf")
    if isinstance(urdf, str) and os.path.isfile(model.parent / urdf):
        found += [model.parent / urdf, *collision_meshes(model.parent / urdf)]
    mjcf = case_content(model).get("mjcf")
    if isinstance(mjcf, str) and os.path.isfile(model.parent / mjcf):
        found += [model.parent / mjcf, *mjcf_files(model.parent / mjcf)]
    photos = [case.parent / name for name in _values(content.get("photos")) if isinstance(name, str)]
    return [file for paths, kinds in ((found, _NUMBERS), (photos, _PHOTOS)) for path in paths for file in _inside(path, kinds)]


def case_model(case: str | Path) -> Path:
    """Return the file of the model that a case names, or the case's own file if it names none."""
    case = Path(case)
    name = case_content(case).get("model")
    return case.parent / name if isinstance(name, str) else case


def check_asked_cases(arguments: Iterable[str], cases: Iterable[str]) -> None:
    """Refuse requests for results of a case that is not configured; snakemake would only say that no rule makes them.

    Raises:
        InputError: A result of a case that is not configured is asked for.
    """
    names = sorted(cases)
    for argument in arguments:
        found = re.match(r"(?:\./)?results/(?:gap/([^/]+)/|rerun/gap/([^/]+)\.rrd)", argument)
        name = found and (found[1] or found[2])
        if name and name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f"Did you mean '{near[0]}'? " if near else ""
            raise InputError(
                argument,
                f"'{name}' is no case",
                f"{hint}Name it under gap.cases in config.yaml, or give --config gap_case=FILE. "
                f"Cases: {', '.join(names) or 'none'}",
            )


def case_content(path: str | Path) -> dict[str, object]:
    """Return the top level of a YAML file; empty if it cannot be read, which the stage that reads it reports later."""
    try:
        content = load_yaml(path, "case", "See docs/gap.md")
    except InputError:
        return {}
    return content if isinstance(content, dict) else {}


def _values(content: object) -> list[object]:
    return list(content.values()) if isinstance(content, dict) else []


def _inside(path: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Return a file, or a folder's files of some kinds (a data set, one file per throw, photos); empty if there is none."""
    if os.path.isdir(path):
        return files_below(path, kinds, "data set", "Name the folder of the data set itself")
    return [path] if os.path.isfile(path) else []


def check_contents(contents: Mapping[str, Sequence[str]], scenes: Iterable[str]) -> None:
    """Refuse benchmark photos whose configured content is not a known scene.

    Args:
        contents: Names of scenes, by kind of photos.
        scenes: Names of all known scenes.

    Raises:
        InputError: A name is not that of a scene.
    """
    known = set(scenes)
    for kind, names in contents.items():
        for name in names:
            if name not in known:
                raise InputError(
                    f"config: gap.contents.{kind}", f"there is no scene '{name}'", f"Use {', '.join(sorted(known))}"
                )


def check_own_cases(cases: Iterable[str], own: Iterable[str]) -> None:
    """Refuse cases with a name that the workflow itself uses.

    Args:
        cases: Names of the configured cases.
        own: Names that the workflow uses.

    Raises:
        InputError: A configured case has such a name.
    """
    for name in sorted(set(cases) & set(own)):
        raise InputError("config: gap.cases", f"'{name}' is a case that the workflow makes", "Call yours something else")
