"""Trials of a policy in one world, from all sets of start poses.

They result in a table with one row per trial, a log of paths and pictures (`gsbridge.environment.trial_log`) and a record.
Finished trials are saved one by one, so that a killed job resumes with the next.
"""

from __future__ import annotations

import csv
import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.trial_log import TrialPath, encode, read_trial_log, write_trial_log
from gsbridge.environment.trials import Policy, TrialResult, spread
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json, write_json, write_stage
from gsbridge.geometry import Array
from gsbridge.logs import ProgressLog
from gsbridge.tasks.poses import POSES, StartRegion, sets_of, trial_seed
from gsbridge.tasks.state import State

logger = logging.getLogger("gsbridge")

COLUMNS = (
    *("pose_set", "index", "quadrant", "x", "y", "yaw"),
    *("success", "success_tolerant", "failure", "steps", "clipped", "refused"),
)


Play = Callable[[str, int, int], tuple[TrialResult, TrialPath]]
"""Function that plays one trial: it takes the name of a pose set, the index of a pose in it and the trial's seed, and returns
outcome and path."""


@dataclass(frozen=True)
class TrialPlace:
    """Files that the outcome of trials is written to.

    Args:
        table: CSV, one row per trial.
        log: See `gsbridge.environment.trial_log`.
        record: Record of the stage.
        state: Folder that keeps finished trials until all are done; jobs of different keys need different folders.
    """

    table: str | Path
    log: str | Path
    record: str | Path
    state: str | Path


def try_policy(
    environment: PickEnvironment,
    policy: Policy,
    place: TrialPlace,
    *,
    name: str,
    poses: int = POSES,
    outside: int = 0,
    reasons: Sequence[str] = (),
) -> list[tuple[str, TrialResult]]:
    """Let a policy act in an environment once from every start pose of all sets.

    Args:
        environment: Environment in the simulated world.
        policy: Gives an action for an observation.
        place: Files that the outcome is written to.
        name: The world's name, for the record.
        poses: Number of poses of each set inside the start square of the training, evenly over the quadrants.
        outside: Number of poses of the set `outside`, likewise; ignored if the task's square leaves no room for that set.
        reasons: Reasons that degrade the outcome before any trial, such as a degraded policy.

    Returns:
        Name of the set and outcome, by trial.

    Raises:
        InputError: Too many poses.
    """

    def play(pose_set: str, index: int, seed: int) -> tuple[TrialResult, TrialPath]:
        return follow(environment, policy, pose_set, index, seed)

    counts = pose_counts(environment.settings.region(), poses, outside)
    return run_trials(play, environment.settings.task, place, name=name, counts=counts, reasons=reasons)


def pose_counts(region: StartRegion, poses: int, outside: int) -> dict[str, int]:
    """Return how many start poses of each set are tried.

    Args:
        region: Where objects start.
        poses: Number of start poses of each set inside the start square of the training.
        outside: Number of start poses of the set beyond that square, if the region has one.
    """
    counts = {name: outside if name == "outside" else poses for name in sets_of(region)}
    return {name: count for name, count in counts.items() if count}


def run_trials(
    play: Play,
    task: str,
    place: TrialPlace,
    *,
    name: str,
    counts: Mapping[str, int],
    reasons: Sequence[str] = (),
    facts: Callable[[], Mapping[str, Any]] | None = None,
) -> list[tuple[str, TrialResult]]:
    """Play one episode from every start pose of all sets, and write the outcome.

    Args:
        play: Plays an episode.
        task: `grasp` or `pick_and_place`.
        place, name, reasons: See `try_policy`.
        counts: Start poses of each set, evenly over the quadrants (`pose_counts`).
        facts: Gives further entries of the record; called when all trials are done. How often episodes ended for each reason
            on an arm is counted here, over the trials of earlier jobs as well.

    Returns:
        Name of the set and outcome, by trial.

    Raises:
        InputError: Too many poses.
    """
    chosen = [(pose_set, index) for pose_set, count in counts.items() for index in spread(count)]
    state = Path(place.state)
    progress = ProgressLog(len(chosen), f"trials in {name}")
    done, paths = [], []
    for pose_set, index in chosen:
        kept = _kept(state, pose_set, index)
        if kept is None:
            kept = play(pose_set, index, trial_seed(pose_set, index))
            _keep(state, *kept)
        trial, path = kept
        done.append((pose_set, trial))
        paths.append(path)
        progress.update(f"{sum(trial.success for _, trial in done)} of {len(done)}")
    write_trial_log(place.log, paths)
    write_table(place.table, done)
    ends = Counter(trial.end for _, trial in done if trial.end)
    more: dict[str, Any] = {"ends": dict(sorted(ends.items()))} if ends else {}
    more |= facts() if facts is not None else {}
    write_stage(
        place.record,
        reasons=reasons,
        packages=("pybullet", "mujoco", "torch"),
        world=name,
        task=task,
        poses=dict(counts),
        counts={pose_set: _counts([trial for found, trial in done if found == pose_set]) for pose_set in counts},
        **more,
    )
    # All results are written, so the trials saved for a killed job are not needed any more.
    for file in state.glob("*"):
        file.unlink()
    return done


def follow(environment: PickEnvironment, policy: Policy, pose_set: str, index: int, seed: int) -> tuple[TrialResult, TrialPath]:
    """Play one episode until it ends, and keep its path and pictures.

    Args:
        environment: Environment in any world.
        policy: The policy that acts.
        pose_set: Name of a set of start poses.
        index: Start pose in it.
        seed: Seed of what is random in the episode.
    """
    observation, info = environment.reset(seed=seed, options={"pose_set": pose_set, "index": index})
    rows, jpegs, over = [], [], False
    while not over:
        action = np.asarray(policy(observation, info), dtype=np.float32)
        rows.append((*path_row(state_of(info)), action))
        jpegs.append(encode(observation["image"]))
        observation, _, terminated, truncated, info = environment.step(action)
        over = terminated or truncated
    rows.append((*path_row(state_of(info)), np.zeros_like(action)))
    jpegs.append(encode(observation["image"]))
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    x, y, yaw = (float(value) for value in info["start_pose"])
    trial = TrialResult(
        environment.settings.pose_seed,
        index,
        (x, y, yaw),
        info["success"],
        info["success_tolerant"],
        "" if info["success"] else info["failure"],
        info["steps"],
        int(info["refused"]),
        int(info["clipped"]),
    )
    # The columns are the fields between `index` and `jpegs`.
    return trial, TrialPath(pose_set, index, *columns, jpegs=tuple(jpegs))  # type: ignore[misc,arg-type]


def write_table(path: str | Path, trials: Sequence[tuple[str, TrialResult]]) -> None:
    """Write the rows of trials, whole or not at all."""
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for pose_set, trial in trials:
            judged = (_word(trial.success), _word(trial.success_tolerant), trial.failure)
            start = (f"{value:.6f}" for value in trial.start)
            writer.writerow((pose_set, trial.index, trial.quadrant, *start, *judged, trial.steps, trial.clipped, trial.refused))


def path_row(state: State) -> tuple[Array, ...]:
    """Return the columns of a log for one state of one world, without the action."""
    forces = np.array([*state.pad_forces[0], state.robot_contact[0], state.object_contact[0]])
    return (
        state.tool_position[0],
        state.tool_yaw()[0],
        state.aperture[0],
        state.object_position[0],
        state.object_quat[0],
        forces,
    )


def _counts(trials: Sequence[TrialResult]) -> dict[str, Any]:
    failures = sorted({trial.failure for trial in trials if not trial.success})
    return {
        "trials": len(trials),
        "success": sum(trial.success for trial in trials),
        "success_tolerant": sum(trial.success_tolerant for trial in trials),
        "failures": {failure: sum(trial.failure == failure for trial in trials) for failure in failures},
    }


def _word(value: bool) -> str:
    return "true" if value else "false"


def _keep(state: Path, trial: TrialResult, path: TrialPath) -> None:
    """Save a finished trial; the outcome is written last and marks the trial as complete."""
    stem = state / f"{path.pose_set}-{path.index:02d}"
    write_trial_log(stem.with_suffix(".npz"), [path])
    write_json(stem.with_suffix(".json"), {**trial.__dict__})


def _kept(state: Path, pose_set: str, index: int) -> tuple[TrialResult, TrialPath] | None:
    """Read a trial that an earlier job finished; None if none did."""
    stem = state / f"{pose_set}-{index:02d}"
    if not stem.with_suffix(".json").is_file():
        return None
    content = read_json(stem.with_suffix(".json"))
    try:
        trial = TrialResult(**{**content, "start": tuple(content["start"])})
    except (KeyError, TypeError) as error:
        raise InputError(stem.with_suffix(".json"), f"the trial is damaged ({error})", f"Delete the folder {state}") from error
    return trial, read_trial_log(stem.with_suffix(".npz"))[0]
