"""Trials as CSV files: what a world's trials, or a user's own on a robot, say of a policy."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.tasks.outcome import Failure
from gsbridge.tasks.poses import PER_QUADRANT, POSE_SETS, QUADRANTS

REQUIRED = ("pose_set", "index", "success")
COLUMNS = (
    *("pose_set", "index", "quadrant", "x", "y", "yaw"),
    *("success", "success_tolerant", "failure", "steps", "clipped", "refused"),
)
"""Of the trials of a policy; trials on a robot need the `REQUIRED` ones only."""

POSES = PER_QUADRANT * len(QUADRANTS)
STRICT_WORLD = "sim"
"""The world in which excess contact is a failure. Source: RL-GSBridge, experiments (pick and place)."""

_WORDS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
_REMEDY = "Write one row per trial below the header `pose_set,index,success`"


@dataclass(frozen=True)
class Trials:
    """Trials of one policy in one world.

    Args:
        pose_set: `fixed` or `unseen`. str [N].
        index: Number of the start pose in its set, 0 to 31. int [N].
        quadrant: Of the start pose, 1 to 4. int [N].
        success: By all rules of the task. bool [N].
        success_tolerant: Excess contact forgiven. bool [N].
        failure: Word of `Failure`; `none` for a success, empty where the reason was not written down. str [N].
    """

    pose_set: Array
    index: Array
    quadrant: Array
    success: Array
    success_tolerant: Array
    failure: Array

    def __len__(self) -> int:
        return len(self.index)

    def of(self, pose_set: str) -> Trials:
        """Those of one set of start poses."""
        rows = self.pose_set == pose_set
        return Trials(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def judged(self, world: str) -> Array:
        """Successes as the paper counts them: excess contact is a failure in simulation only. bool [N]."""
        return self.success if world == STRICT_WORLD else self.success_tolerant


def read_trials(path: str | Path) -> Trials:
    """Read the trials of one policy in one world.

    Args:
        path: CSV with the columns `COLUMNS`, or with `REQUIRED` alone; further columns are left aside. Yes and no may be
            written as true and false, 1 and 0, or yes and no. Without `success_tolerant` no excess contact was forgiven;
            without `quadrant` it is that of the pose's index.

    Raises:
        InputError: A column is missing, a value makes no sense, a start pose stands twice, or there is no trial.
    """
    rows = [{name.strip(): value.strip() for name, value in row.items()} for row in read_rows(path)]
    if not rows:
        raise InputError(path, "there is no trial in it", _REMEDY)
    missing = [name for name in REQUIRED if name not in rows[0]]
    if missing:
        raise InputError(path, f"the columns {', '.join(missing)} are missing", _REMEDY)
    # Behind the header, the first line of data is the file's second.
    trials = [_trial(path, line, row) for line, row in enumerate(rows, 2)]
    counts = Counter((trial["pose_set"], trial["index"]) for trial in trials)
    twice = [f"{pose_set} {index}" for (pose_set, index), count in counts.items() if count > 1]
    if twice:
        shown = ", ".join(twice[:4]) + (f" and {len(twice) - 4} more" if len(twice) > 4 else "")
        raise InputError(path, f"start poses stand twice: {shown}", "Keep one trial of each start pose")
    return Trials(**{name: np.array([trial[name] for trial in trials]) for name in Trials.__dataclass_fields__})


def _trial(path: str | Path, line: int, row: Row) -> dict[str, Any]:
    """One trial, checked."""

    def wrong(name: str, remedy: str) -> InputError:
        return InputError(path, f"line {line}: {name} is {row.get(name, '')!r}", remedy)

    def whole(name: str, lowest: int, highest: int) -> int:
        try:
            value = float(row[name])
        except ValueError:
            value = math.nan
        if not (lowest <= value <= highest and value == int(value)):
            raise wrong(name, f"Give a whole number from {lowest} to {highest}")
        return int(value)

    def yes(name: str) -> bool:
        if row[name].lower() not in _WORDS:
            raise wrong(name, "Write true or false")
        return _WORDS[row[name].lower()]

    if row["pose_set"] not in POSE_SETS:
        raise wrong("pose_set", f"Use one of {', '.join(POSE_SETS)}")
    index, success = whole("index", 0, POSES - 1), yes("success")
    tolerant = yes("success_tolerant") if row.get("success_tolerant") else success
    if success and not tolerant:
        raise wrong("success_tolerant", "A success stays one when excess contact is forgiven")
    failure = row.get("failure", "")
    if failure not in ("", *Failure) or (success and failure not in ("", Failure.NONE)):
        raise wrong("failure", f"Use a word of {', '.join(Failure)}, and none for a success")
    return {
        "pose_set": row["pose_set"],
        "index": index,
        "quadrant": whole("quadrant", 1, len(QUADRANTS)) if row.get("quadrant") else QUADRANTS[index // PER_QUADRANT],
        "success": success,
        "success_tolerant": tolerant,
        "failure": Failure.NONE.value if success else failure,
    }
