"""The record of one episode of a driven arm: a table of its steps, a summary, and the pictures that the policy saw."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.environment.proprioception import Reached
from gsbridge.files import atomic_file, write_stage
from gsbridge.geometry import Array
from gsbridge.policy.format import ACTION_NAMES
from gsbridge.policy.safety import End

COLUMNS = (
    *("step", "time_s"),
    *("tool_x", "tool_y", "tool_z", "tool_yaw", "aperture"),
    *(f"action_{name}" for name in ACTION_NAMES),
    *("command_x", "command_y", "command_z", "command_yaw", "command_aperture"),
    *("late_s", "refused"),
)
"""Table frame, m, rad. `time_s` is the time of the arm's measurement since the first step; `late_s` how late the step was."""


@dataclass
class EpisodeLog:
    """Log of an episode. The runner fills it step by step, so that it exists after an error, too.

    Args:
        dry_run: Whether no commands were given.
        rows: One per step, in the order of `COLUMNS`.
        pictures: Pictures that the policy saw, uint8 [H, W, 3] each; empty unless they are kept.
        keep_pictures: Whether pictures are kept.
        end: Why the episode ended.
        overruns: Number of steps that were late.
        worst_late_s: Largest delay of a step, s.
        clipped: Number of commands cut to the workspace.
        saturated: Number of actions with an entry outside -1..1.
        refused: Number of commands that the arm refused.
        error: Type and message of the error that ended the episode; empty without one.
    """

    dry_run: bool = False
    keep_pictures: bool = False
    rows: list[list[float]] = field(default_factory=list)
    pictures: list[Array] = field(default_factory=list)
    end: End = End.ERROR
    overruns: int = 0
    worst_late_s: float = 0.0
    clipped: int = 0
    saturated: int = 0
    refused: int = 0
    error: str = ""

    @property
    def steps(self) -> int:
        """Steps taken."""
        return len(self.rows)

    def add(
        self, time_s: float, reached: Reached, action: Array, command: tuple[Array, float, float], late_s: float, refused: bool
    ) -> None:
        """Add a step.

        Args:
            time_s: Time of the arm's measurement since the first step, s.
            reached: Measured tool pose and opening, table frame.
            action: Action of the policy. [5].
            command: Commanded position, table frame, m [3], yaw, rad, and opening, m.
            late_s: How late the step was, s; 0 or less if it was on time.
            refused: Whether the arm refused the command.
        """
        position, yaw, aperture = command
        measured = [*reached.position, reached.yaw, reached.aperture]
        values = [self.steps, time_s, *measured, *action, *position, yaw, aperture, late_s, refused]
        self.rows.append([float(value) for value in values])
        self.refused += refused
        self.overruns += late_s > 0
        self.worst_late_s = max(self.worst_late_s, float(late_s))

    def column(self, name: str) -> Array:
        """Values of one column of the log. [steps]."""
        return np.array([row[COLUMNS.index(name)] for row in self.rows])


def write_episode(stem: str | Path, log: EpisodeLog, doubts: Sequence[str] = (), **facts: Any) -> None:
    """Write `{stem}.csv`, `{stem}.json` and, where pictures were kept, `{stem}.npz` with `images`, [steps, H, W, 3].

    Args:
        stem: Path without ending.
        log: The episode.
        doubts: Why even an episode that ended normally is degraded, such as by its registration.
        **facts: Further entries of the summary: policy, driver, registration, start pose, verdict.
    """
    stem = Path(stem)
    with atomic_file(stem.with_suffix(".csv")) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        # Enough digits to restore every number exactly.
        table.writerows([[int(row[0]), *(repr(value) for value in row[1:-1]), int(row[-1])] for row in log.rows])
    if log.pictures:
        with atomic_file(stem.with_suffix(".npz")) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, images=np.stack(log.pictures))
    normal = log.end in (End.TIME_OUT, End.DONE)
    write_stage(
        stem.with_suffix(".json"),
        reasons=[
            *([] if normal else [f"the episode ended early: {log.end.value}{': ' if log.error else ''}{log.error}"]),
            *doubts,
        ],
        end=log.end.value,
        steps=log.steps,
        dry_run=log.dry_run,
        overruns=log.overruns,
        worst_late_s=log.worst_late_s,
        clipped=log.clipped,
        saturated=log.saturated,
        refused=log.refused,
        **facts,
    )
