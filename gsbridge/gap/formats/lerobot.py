"""LeRobot data sets, versions 2 and 3: episodes as Parquet below `data/`, described by `meta/info.json`.

Version 2 has one file per episode, version 3 several episodes per file; both mark every row with its episode. Features are
vectors whose elements are named in `info.json`. Their units are not stored, so a case has to state them.

Source: https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and the files of published data sets.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.gap.formats.columns import check_parquet
from gsbridge.given import read_given_json
from gsbridge.reading import refusing

KINDS = {
    "observation.state": "position",
    "observation.velocity": "velocity",
    "observation.effort": "effort",
    "action": "command",
}
"""Features with one number per joint, and our kinds of columns for them."""

_ABOUT_ROWS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""Features that identify the rows instead of measuring something."""

_ENDINGS = (".pos", ".position")


def read_lerobot(folder: Path, part: str, joints: tuple[str, ...]) -> tuple[pd.DataFrame, str]:
    """Read one episode as a table.

    Args:
        folder: Folder of the data set.
        part: Number of the episode; may be empty if there is only one.
        joints: Names of the mechanism's joints.

    Returns:
        A table and the SHA-256 of its content. Its columns are `time [s]`; every element of a numeric feature as
        `feature.element`; and `position.joint`, `velocity.joint`, `effort.joint` and `command.joint` for elements that are
        named like joints.

    Raises:
        InputError: The folder is not a LeRobot data set, its version is unknown, or the episode is missing.
    """
    if not (folder / "meta/info.json").is_file():
        raise InputError(folder, "this folder is no LeRobot data set: meta/info.json is missing", "Name its top folder")
    with refusing(folder, "the data set is damaged", "Copy or download it again"):
        return _read(folder, part, joints)


def _read(folder: Path, part: str, joints: tuple[str, ...]) -> tuple[pd.DataFrame, str]:
    """Do the work of `read_lerobot`, which turns any exception from here into a one-line error."""
    info = read_given_json(folder / "meta/info.json", "Copy or download the data set again")
    version = str(info.get("codebase_version", ""))
    if version.lstrip("v").split(".")[0] not in ("2", "3"):
        raise InputError(folder, f"data sets of version '{version}' are not known", "Convert it with LeRobot to v2 or v3")
    features = {
        name: item for name, item in (info.get("features") or {}).items() if name not in _ABOUT_ROWS and _is_vector(item)
    }
    files = sorted(file for file in (folder / "data").rglob("*.parquet") if file.is_file())
    if not files or not features:
        raise InputError(folder, "the data set holds no numbers", "Give one with data/**/*.parquet and numeric features")
    rows = _rows(folder, files, part, list(features), info)
    columns = {"time [s]": rows["timestamp"].to_numpy(dtype=np.float64).ravel()}
    for name, item in features.items():
        if name not in rows:
            continue
        values = np.stack([np.atleast_1d(np.asarray(row, dtype=np.float64)) for row in rows[name]])
        for element, column in zip(_elements(name, item, values.shape[1]), values.T, strict=True):
            columns[f"{name}.{element}"] = column
            joint = next((element.removesuffix(end) for end in _ENDINGS if element.endswith(end)), element)
            if name in KINDS and joint in joints:
                columns[f"{KINDS[name]}.{joint}"] = column
    table = pd.DataFrame(columns)
    digest = hashlib.sha256(str(list(table.columns)).encode() + np.ascontiguousarray(table.to_numpy()).tobytes())
    return table, digest.hexdigest()


def _is_vector(feature: Mapping[str, Any]) -> bool:
    """Whether a feature is a number or a vector of numbers."""
    return str(feature.get("dtype", "")).startswith(("float", "int")) and len(feature.get("shape") or []) == 1


def _elements(name: str, feature: Mapping[str, Any], count: int) -> list[str]:
    """Return the names of a feature's elements, or their numbers if they have no names."""
    names = feature.get("names")
    if isinstance(names, Mapping):
        # Grouped, e.g. {"motors": [...]}.
        names = [element for group in names.values() for element in (group if isinstance(group, list) else [group])]
    if not isinstance(names, list) or len(names) != count:
        return [str(number) for number in range(count)]
    return [str(element) for element in names]


def _rows(folder: Path, files: list[Path], part: str, features: list[str], info: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of one episode in the order of the sorted files."""
    total = int(info.get("total_episodes", 1))
    if part and not part.isdecimal():
        raise InputError(f"{folder}#{part}", f"'{part}' is no number of an episode", f"Write {folder.name}#0, for example")
    if not part and total > 1:
        raise InputError(folder, f"the data set has {total} episodes", f"Say which one: {folder.name}#0, for example")
    wanted = int(part or 0)
    found = []
    for file in files:
        with refusing(file, "it cannot be read", "Copy the data set again"):
            check_parquet(file)
            table = pd.read_parquet(file, filters=[("episode_index", "==", wanted)])
        if len(table):
            found.append(table[[name for name in ("timestamp", *features) if name in table]])
    if not found:
        raise InputError(f"{folder}#{part}", f"there is no episode {wanted}", f"Use 0 to {total - 1}")
    rows = pd.concat(found, ignore_index=True)
    if "timestamp" not in rows:
        raise InputError(folder, "its rows have no time stamps", "Convert it with LeRobot again")
    return rows
