"""Trials of one policy from the same start poses in several worlds, with their outcome, paths and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gsbridge.environment.trial_log import TrialPath, read_trial_log
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.report.figures.path_distance import path_distance
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows

COLUMNS = ("pose_set", "index", "quadrant", "x", "y", "yaw", "success", "success_tolerant", "failure", "steps")
"""Columns that are read from a table of trials."""

SIM = "sim"
STEP_S = 0.05
"""Control period of every world, s."""

_AGAIN = "Delete it and try the policy again"


@dataclass(frozen=True)
class ShownTrials:
    """Trials of one policy in one world.

    Args:
        world: Name of the world; `sim` is the one in which the policy learned.
        seed: Seed of the policy.
        table: CSV, one row per trial.
        log: Paths and pictures (`gsbridge.environment.trial_log`).
    """

    world: str
    seed: int
    table: str | Path
    log: str | Path


@dataclass(frozen=True)
class Tried:
    """One trial in one world.

    Args:
        success: Success as the tables count it: excess contact is a failure in simulation only.
        failure: Word of `gsbridge.tasks.outcome.Failure`; empty for a success.
        path: Path, forces and pictures of the trial.
    """

    success: bool
    failure: str
    path: TrialPath

    @property
    def seconds(self) -> float:
        """Time until the end of the episode, s."""
        return STEP_S * (len(self.path) - 1)

    def outcome(self) -> str:
        """State the outcome in words: `success` or the reason of the failure."""
        return "success" if self.success else self.failure.replace("_", " ")

    @cached_property
    def hand(self) -> Array:
        """Path of the tool point without states that are not finite, with which a diverged simulation ends. [N, 3], m."""
        tool = np.asarray(self.path.tool, dtype=np.float64)
        return tool[np.isfinite(tool).all(axis=1)]


@dataclass(frozen=True)
class Start:
    """Trials of one policy from one start pose.

    Args:
        seed: Seed of the policy.
        pose_set: `fixed`, `unseen` or `outside`.
        index: Number of the pose in its set.
        quadrant: 1 to 4.
        pose: x, y, m, and yaw, rad, of the object. [3].
        trials: Trials by world, simulation first.
    """

    seed: int
    pose_set: str
    index: int
    quadrant: int
    pose: tuple[float, float, float]
    trials: Mapping[str, Tried]

    @property
    def label(self) -> str:
        """Name of the start pose for people, such as `unseen 12`."""
        return f"{self.pose_set} {self.index}"

    def succeeded(self) -> bool:
        """Whether the trial succeeded in every world."""
        return all(trial.success for trial in self.trials.values())

    def distance_mm(self, world: str) -> float:
        """Distance of the hand's paths in simulation and in a world, mm; see `gsbridge.report.figures.path_distance`."""
        return 1e3 * path_distance(self.trials[SIM].hand, self.trials[world].hand)


def trials_by_cell(
    cells: Sequence[Mapping[str, str]],
    worlds: Sequence[str],
    seeds: Sequence[int],
    tables: Sequence[str | Path],
    logs: Sequence[str | Path],
) -> list[tuple[CellPaths, list[ShownTrials]]]:
    """Group files of trials by their policy. The lists have one entry per file each, in the same order.

    Args:
        cells: Cell of each file's policy, by the names of its fields.
        worlds: World that each file's trials were made in.
        seeds: Seed of each file's policy.
        tables: Tables of trials (`.csv`).
        logs: Logs of the same trials (`.npz`).

    Returns:
        Cells in the order of their first file, each with its files.
    """
    out: dict[CellPaths, list[ShownTrials]] = {}
    for cell, world, seed, table, log in zip(cells, worlds, seeds, tables, logs, strict=True):
        out.setdefault(CellPaths(**cell), []).append(ShownTrials(world, seed, table, log))
    return list(out.items())


def cell_name(cell: CellPaths) -> str:
    """Name of a cell for people, such as `cake on plate`."""
    return f"{cell.object} on {cell.background}".replace("_", " ")


def read_starts(files: Sequence[ShownTrials]) -> list[Start]:
    """Join trials of one cell by their start poses.

    Args:
        files: All worlds and seeds. Every seed has the same worlds, every world the same start poses.

    Returns:
        Starts in the order of the seeds and of the first world's table.

    Raises:
        InputError: A file is missing or damaged, a table and its log or two worlds do not fit together, or there is no trial.
    """
    out = []
    for seed in dict.fromkeys(file.seed for file in files):
        of_seed = sorted((file for file in files if file.seed == seed), key=lambda file: file.world != SIM)
        found = {file.world: _read(file) for file in of_seed}
        first = found[of_seed[0].world]
        for file in of_seed[1:]:
            _check_same(first, found[file.world], of_seed[0], file)
        for key, (row, _) in first.items():
            pose = (float(row["x"]), float(row["y"]), float(row["yaw"]))
            trials = {world: table[key][1] for world, table in found.items()}
            out.append(Start(seed, *key, int(row["quadrant"]), pose, trials))
    if not out:
        raise InputError("trials", "there is none to show", "Name the trials of at least one world")
    return out


def failures_first(starts: Sequence[Start]) -> list[Start]:
    """Sort failures outside simulation first, then those in simulation alone, then successes; otherwise in the given order."""

    def rank(start: Start) -> int:
        elsewhere = all(trial.success for world, trial in start.trials.items() if world != SIM)
        return 2 if start.succeeded() else 1 if elsewhere else 0

    return sorted(starts, key=rank)


def _read(file: ShownTrials) -> dict[tuple[str, int], tuple[Row, Tried]]:
    """Read row and trial of each start pose, by pose set and index."""
    rows, paths = read_rows(file.table, COLUMNS), read_trial_log(file.log)
    known = {(path.pose_set, path.index): path for path in paths}
    out = {}
    for row in rows:
        try:
            key = (row["pose_set"], int(row["index"]))
            numbers = [float(row[name]) for name in ("x", "y", "yaw", "quadrant", "steps")]
        except ValueError as error:
            raise InputError(file.table, f"the table is damaged ({error})", _AGAIN) from error
        if key not in known or len(known[key]) != int(numbers[-1]) + 1:
            raise InputError(file.log, f"it holds other trials than {Path(file.table).name}: {key[0]} {key[1]}", _AGAIN)
        success = row["success" if file.world == SIM else "success_tolerant"] == "true"
        out[key] = (row, Tried(success, "" if success else row["failure"], known[key]))
    return out


def _check_same(one: Mapping, two: Mapping, file: ShownTrials, other: ShownTrials) -> None:
    """Refuse two worlds that were tried from different start poses."""

    def start(row: Row) -> Array:
        return np.array([float(row[name]) for name in ("x", "y", "yaw")])

    # Tables hold six digits, so that equal poses may differ by rounding.
    same = one.keys() == two.keys() and all(np.abs(start(one[key][0]) - start(two[key][0])).max() < 1e-5 for key in one)
    if not same:
        raise InputError(
            other.table, f"its start poses are others than those of {file.table}", "Try the policy from the same poses in both"
        )
