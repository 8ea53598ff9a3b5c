"""Trials of an arm with a person beside it, who places the object and judges; each trial becomes a row of a CSV file.

The columns are `COLUMNS`; later stages need only `pose_set`, `index` and `success`. Lengths are in m and angles in rad, in the
table frame.
"""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.reading import LARGEST_TEXT, refusing, regular_file
from gsbridge.tasks.outcome import Failure
from gsbridge.tasks.poses import PER_QUADRANT, POSE_SETS, QUADRANTS, pose_set

logger = logging.getLogger("gsbridge")

_ANOTHER = "Name another file for the trials"

COLUMNS = (
    *("pose_set", "index", "quadrant", "x", "y", "yaw"),
    *("success", "success_tolerant", "failure", "steps", "clipped", "refused", "policy"),
)

_DIGITS = 12
"""Digits of a policy's digest by which its rows are known."""

FAILURES = tuple(failure.value for failure in Failure if failure not in (Failure.NONE, Failure.NOT_FINITE))


@dataclass(frozen=True)
class StartPose:
    """A start pose of the object.

    Args:
        pose_set: Name of a set of start poses.
        index: 0 to 31.
        x, y: Middle of the object's footprint, table frame, m.
        yaw: Turn of the object about the vertical from how it lay when it was filmed, rad.
    """

    pose_set: str
    index: int
    x: float
    y: float
    yaw: float

    @property
    def quadrant(self) -> int:
        """Quadrant of the pose, 1 to 4."""
        return QUADRANTS[self.index // PER_QUADRANT]

    def describe(self) -> str:
        """Return the instruction for the person who places the object."""
        turn = np.degrees(self.yaw)
        side = "counterclockwise" if turn >= 0 else "clockwise"
        return (
            f"Pose {self.index} of the set '{self.pose_set}' (quadrant {self.quadrant}): place the object's middle at"
            f" x = {self.x:+.3f} m, y = {self.y:+.3f} m from the middle of the board (x to the right, y up as printed),"
            f" turned by {abs(turn):.0f} degrees {side}, seen from above, from how it lay when it was filmed"
        )


@dataclass(frozen=True)
class Verdict:
    """Judgement of a trial.

    Args:
        success: Whether it succeeded by all rules of the task.
        success_tolerant: Whether it succeeded when excess contact is forgiven.
        failure: Word of `Failure`; empty for a success, or if no reason was given.
    """

    success: bool
    success_tolerant: bool
    failure: str = ""


def start_poses(settings: EnvironmentSettings, name: str, index: str) -> list[StartPose]:
    """Return the start poses that a person asks for.

    Args:
        settings: Settings of the policy's environment.
        name: Name of a set of start poses.
        index: A number, a range such as `0-7`, or `all`.

    Raises:
        InputError: There are no such poses.
    """
    if name not in POSE_SETS:
        raise InputError("pose set", f"'{name}' is unknown", f"Use one of: {', '.join(POSE_SETS)}")
    poses = pose_set(name, settings.region(), settings.pose_seed)
    first, dash, last = ("0", "-", str(len(poses) - 1)) if index == "all" else index.partition("-")
    last = last if dash else first
    # Python refuses to convert numbers of more than some thousand digits.
    numbers = len(index) < 100 and first.isdecimal() and last.isdecimal()
    if not (numbers and int(first) <= int(last) < len(poses)):
        raise InputError("index", f"'{index[:100]}' names no pose", f"Give 0 to {len(poses) - 1}, a range such as 0-7, or all")
    return [StartPose(name, k, *(float(value) for value in poses[k])) for k in range(int(first), int(last) + 1)]


class Person:
    """The person beside the arm, who places objects and judges.

    Args:
        task: `grasp` or `pick_and_place`.
        ask: Shows a question and returns the answer, such as `input`.
        rest: Opens the hand and drives to the rest posture; None if the arm must not move.
    """

    def __init__(self, task: str, ask: Callable[[str], str], rest: Callable[[], None] | None) -> None:
        self.task, self.ask, self.rest = task, ask, rest

    def place(self, pose: StartPose) -> None:
        """Have the object placed, after the hand is emptied and the arm is in its rest posture."""
        if self.rest is not None:
            self.ask("Take what the hand holds. Enter opens it and drives the arm to its rest posture: ")
            self.rest()
        self.ask(f"{pose.describe()}. Then keep clear of the arm; Enter starts the episode: ")

    def over(self) -> bool:
        """Always False: a person ends an episode with Ctrl-C."""
        return False

    def judge(self, log: EpisodeLog) -> Verdict | None:
        """Ask how the trial went; None if it does not count and is to be repeated."""
        goal = "lifted and held" if self.task == "grasp" else "set down on the plate and let go"
        told = f"The episode ended after {log.steps} steps ({log.end.value}). "
        answer = self._choose(f"{told}Was the object {goal}? [y]es, [n]o, [r]epeat, it does not count: ", "ynr")
        if answer == "r":
            return None
        if answer == "n":
            failure = self._word(f"Why not? One of {', '.join(FAILURES)}; Enter if none fits: ")
            return Verdict(False, False, failure)
        if self.task == "grasp":
            return Verdict(True, True)
        pressed = self._choose("Did hand or object press on table or plate while it was carried? [y]es, [n]o: ", "yn")
        return Verdict(False, True, Failure.EXCESS_CONTACT.value) if pressed == "y" else Verdict(True, True)

    def _choose(self, question: str, letters: str) -> str:
        """Ask until the answer begins with one of some letters; return that letter."""
        while True:
            answer = self.ask(question).strip().lower()[:1]
            if answer and answer in letters:
                return answer

    def _word(self, question: str) -> str:
        """Ask until the answer is a word of `FAILURES` or empty; return it."""
        while True:
            answer = self.ask(question).strip().lower()
            if answer in ("", *FAILURES):
                return answer


class TrialFile:
    """A CSV file of trials, one row each, written whole after every trial.

    Args:
        path: The file; it need not exist.
        policy: Digest of the policy's weights.

    Raises:
        InputError: The file is no table of trials, or has trials of another policy.
    """

    def __init__(self, path: str | Path, policy: str) -> None:
        self.path, self.rows, self.policy = Path(path), list[dict[str, Any]](), policy[:_DIGITS]
        with refusing(str(path)[:200], "the table of trials cannot be read", _ANOTHER):
            try:
                self.path.stat()
            except FileNotFoundError:
                return
            regular_file(self.path, "table of trials", _ANOTHER, LARGEST_TEXT)
            with open(self.path, newline="", encoding="utf-8") as file:
                table = csv.DictReader(file)
                self.rows, columns = list(table), table.fieldnames or ()
        if tuple(columns) != COLUMNS:
            raise InputError(self.path, f"its columns are not {', '.join(COLUMNS)}", _ANOTHER)
        for number, row in enumerate(self.rows, start=1):
            named = row["pose_set"] in POSE_SETS and (row["index"] or "").isdecimal() and None not in row.values()
            if None in row or not named:
                raise InputError(self.path, f"its row {number} is no trial", f"Correct the row, or n{_ANOTHER[1:]}")
            if row["policy"] != self.policy:
                raise InputError(
                    self.path,
                    f"its row {number} is a trial of the policy '{row['policy']}', this one is '{self.policy}'",
                    _ANOTHER,
                )

    def holds(self, pose: StartPose) -> bool:
        """Whether the file has a trial from the pose."""
        return any(self._same(row, pose) for row in self.rows)

    def add(self, pose: StartPose, verdict: Verdict, log: EpisodeLog) -> None:
        """Add a trial and write the file; an earlier trial from the same pose is replaced.

        Args:
            pose: Start pose of the object.
            verdict: Judgement of the trial.
            log: Log of the episode.
        """
        row = {
            "pose_set": pose.pose_set,
            "index": pose.index,
            "quadrant": pose.quadrant,
            **{name: repr(getattr(pose, name)) for name in ("x", "y", "yaw")},
            "success": str(verdict.success).lower(),
            "success_tolerant": str(verdict.success_tolerant).lower(),
            "failure": verdict.failure,
            "steps": log.steps,
            "clipped": log.clipped,
            "refused": log.refused,
            "policy": self.policy,
        }
        self.rows = [*(old for old in self.rows if not self._same(old, pose)), row]
        self.rows.sort(key=lambda item: (POSE_SETS.index(item["pose_set"]), int(item["index"])))
        with atomic_file(self.path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            table.writeheader()
            table.writerows(self.rows)

    @staticmethod
    def _same(row: dict[str, object], pose: StartPose) -> bool:
        return (row["pose_set"], str(row["index"])) == (pose.pose_set, str(pose.index))


def still_to_try(poses: Sequence[StartPose], file: TrialFile | None, *, redo: bool) -> list[StartPose]:
    """Return the poses that have no trial yet.

    Args:
        poses: Poses that were asked for.
        file: File with the trials so far; None if there is none.
        redo: Whether poses that have a trial are tried again.

    Raises:
        InputError: Every pose has a trial already.
    """
    if file is None or redo:
        return list(poses)
    left = [pose for pose in poses if not file.holds(pose)]
    if not left:
        raise InputError(file.path, "it holds these trials already", "Give --redo to replace them, or other poses")
    if len(left) < len(poses):
        logger.info("%d of %d poses have a row in %s already", len(poses) - len(left), len(poses), file.path)
    return left
