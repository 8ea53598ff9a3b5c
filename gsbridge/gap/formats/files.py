"""Files of a case, found before it is read: what the workflow has to watch, and where a case may lie."""

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
    """A case's file.

    Args:
        name: Name of the case.
        value: Path of the case's file as it is configured.
        places: Folders it may be relative to, in this order.

    Raises:
        InputError: It is in none of them.
    """
    found = [Path(folder) / Path(value).expanduser() for folder in places]
    for path in found:
        if path.is_file():
            return path
    folder = next((path for path in found if path.is_dir()), None)
    problem = f"{folder} is a folder, the case's file is wanted" if folder else absent(found)
    raise InputError(f"config: gap.cases.{name}", problem, "Correct the path of the case; see docs/gap.md")


def case_name(value: str) -> str:
    """Name of a case that is given by its file alone: the file's, or its folder's where that is called `case.yaml`.

    Raises:
        InputError: No letters are left.
    """
    path = Path(value).expanduser()
    word = path.resolve().parent.name if path.stem == "case" else path.stem
    name = re.sub(r"[^a-z0-9]+", "_", word.lower()).strip("_")
    if not re.match("[a-z]", name):
        raise InputError("config: gap_case", f"'{word}' gives no name", "Call the file or its folder by a word, e.g. axis.yaml")
    return name


def case_files(case: str | Path) -> list[Path]:
    """Files that a case names and that are there: its model, the model's URDF and its meshes, its records and
    their repeats, or its photos.

    A damaged case names none.
    """
    case = Path(case)
    content = case_content(case)
    names = [content.get("model"), *_values(content.get("records"))]
    names += [name for item in _values(content.get("repeats")) for name in (item if isinstance(item, list) else [item])]
    model = case_model(case)
    # What stands behind '#' is a part of a data set.
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
    """The model that a case names; the case itself where it names none."""
    case = Path(case)
    name = case_content(case).get("model")
    return case.parent / name if isinstance(name, str) else case


def check_asked_cases(arguments: Iterable[str], cases: Iterable[str]) -> None:
    """Refuse results of a case that is not configured; snakemake would only say that no rule makes them.

    Raises:
        InputError: A result of another case is asked for.
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
    """Top level of a YAML file; empty where it cannot be read, which the reading stage will say."""
    try:
        content = load_yaml(path, "case", "See docs/gap.md")
    except InputError:
        return {}
    return content if isinstance(content, dict) else {}


def _values(content: object) -> list[object]:
    return list(content.values()) if isinstance(content, dict) else []


def _inside(path: Path, kinds: tuple[str, ...]) -> list[Path]:
    """A file, or the files of some kinds in a folder (a data set, one file per throw, photos); nothing where there is none."""
    if os.path.isdir(path):
        return files_below(path, kinds, "data set", "Name the folder of the data set itself")
    return [path] if os.path.isfile(path) else []


def check_contents(contents: Mapping[str, Sequence[str]], scenes: Iterable[str]) -> None:
    """Refuse contents of the benchmark's photos that are no scenes.

    Raises:
        InputError: One is none.
    """
    known = set(scenes)
    for kind, names in contents.items():
        for name in names:
            if name not in known:
                raise InputError(
                    f"config: gap.contents.{kind}", f"there is no scene '{name}'", f"Use {', '.join(sorted(known))}"
                )


def check_own_cases(cases: Iterable[str], own: Iterable[str]) -> None:
    """Refuse cases that bear a name of the workflow's own.

    Raises:
        InputError: One does.
    """
    for name in sorted(set(cases) & set(own)):
        raise InputError("config: gap.cases", f"'{name}' is a case that the workflow makes", "Call yours something else")
