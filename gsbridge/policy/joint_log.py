"""Repetition of trials with a log of the joints, as records of a gap case: a robot's driver writes such logs by itself.

The trials to repeat are in a table and its log (`gsbridge.environment.policy_trials`). Each is played again from the same
start, with the same seed and the same actions, so the arm moves as it did, and no picture has to be drawn. On a robot no
repetition is needed, because the driver logs the trials themselves.
"""

from __future__ import annotations

import csv
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trial_log import TrialPath, read_trial_log
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file, write_stage
from gsbridge.geometry import Array
from gsbridge.policy.arm_trials import arm_setup, play_on_arm
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.worlds import MirrorDriver, world_seed
from gsbridge.reality.world.driver_log import DriverLog, LoggedPhysics
from gsbridge.registration.result import Registration
from gsbridge.robot.limits import Workspace
from gsbridge.tasks.outcome import Failure
from gsbridge.tasks.poses import trial_seed
from gsbridge.tasks.views import ROLES
from gsbridge.tasks.world import CONTROL_HZ

__all__ = ["ROLES", "Repeat", "choose_trials", "log_trials", "repeat_trial", "write_driver_log"]

logger = logging.getLogger("gsbridge")

SHORTEST = 1.5
"""Shortest trial that is used as a record, s; with the rest before it and `AFTER`, a record lasts 2.5 s or more."""

AFTER = 0.5
"""How long the arm holds its last command while the driver goes on logging, s."""

SAME = 1e-5
"""Largest distance of the tool from the logged path in a repeated trial, m; logs keep 32 bits."""

_TOUCHED = tuple(str(outcome) for outcome in (Failure.DROPPED, Failure.PUSHED_AWAY, Failure.EXCESS_CONTACT))
"""Failures in which the hand pushed or carried something."""


@dataclass(frozen=True)
class Repeat:
    """A trial to repeat.

    Args:
        number: Row of the trial in the table.
        success: Whether it succeeded when excess contact is forgiven, as in all worlds but the simulated one.
        path: Its states and actions.
    """

    number: int
    success: bool
    path: TrialPath


def choose_trials(table: str | Path, log: str | Path, period: float, count: int = len(ROLES)) -> list[Repeat]:
    """Choose the trials to repeat: failed ones first, then the longest, from different quadrants of the table.

    Of the failed ones, those in which nothing was pushed or dropped come first, since the arm's model has no contacts.

    Args:
        table: Trials, CSV.
        log: Log of those trials.
        period: Length of a step, s.
        count: Number of trials to choose.

    Raises:
        InputError: Table and log do not belong together.
        StageError: Too few trials are long enough.
    """
    with open(table, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    paths = read_trial_log(log)
    if [(row["pose_set"], int(row["index"])) for row in rows] != [(path.pose_set, path.index) for path in paths]:
        raise InputError(log, f"it does not hold the trials of {table}", "Make both again")
    trials = [Repeat(k, row["success_tolerant"] == "true", path) for k, (row, path) in enumerate(zip(rows, paths, strict=True))]
    long = [trial for trial in trials if (len(trial.path) - 1) * period >= SHORTEST]
    if len(long) < count:
        raise StageError(
            "log_trials",
            f"{len(long)} of {len(trials)} trials last {SHORTEST:g} s, {count} records are needed",
            "Judge from more start poses",
        )
    touched = {trial.number: rows[trial.number]["failure"] in _TOUCHED for trial in long}
    ranked = sorted(long, key=lambda trial: (trial.success, touched[trial.number], -len(trial.path), trial.number))
    # For different excitation, take one trial towards each quadrant of the table before a second one towards the same.
    turns: Counter[tuple[bool, bool, str]] = Counter()
    order = []
    for place, trial in enumerate(ranked):
        free = trial.success, touched[trial.number]
        kind = (*free, rows[trial.number]["quadrant"])
        order.append((*free, turns[kind], place))
        turns[kind] += 1
    return [ranked[place] for *_, place in sorted(order)[:count]]


def repeat_trial(world: LoggedPhysics, registration: Registration, settings: EnvironmentSettings, trial: Repeat) -> DriverLog:
    """Play a trial's actions again, and return the driver's log.

    Args:
        world: The world in which it was tried.
        registration: The registration with which it was tried.
        settings: Settings of the environment.
        trial: The trial.

    Raises:
        StageError: The tool moves otherwise than in the trial.
    """
    interface = PolicyInterface(
        wrist_camera(settings.image_size), Workspace.around(), world.dimensions.stroke, settings, CONTROL_HZ
    )
    driver = MirrorDriver(world, registration, settings)
    # The first action answers the warm-up's empty observation.
    actions = iter([np.zeros_like(trial.path.actions[0]), *trial.path.actions[:-1]])
    _, path, _ = play_on_arm(
        lambda observation, info: next(actions), arm_setup(driver, registration, interface), driver, trial.path.pose_set,
        trial.path.index, world_seed(settings, trial_seed(trial.path.pose_set, trial.path.index)),
        steps=len(trial.path) - 1,
    )  # fmt: skip
    off = float(np.abs(path.tool - trial.path.tool).max()) if len(path) == len(trial.path) else np.inf
    if off > SAME:
        raise StageError(
            "log_trials",
            f"trial {trial.path.pose_set} {trial.path.index} takes another way when repeated: {1e3 * off:.3g} mm off",
            "World, seed or code are not those of the trials; make the trials again",
        )
    for _ in range(round(AFTER * CONTROL_HZ)):
        world.step()
    return world.log()


def write_driver_log(path: str | Path, joints: Sequence[str], log: DriverLog) -> None:
    """Write a log in the format of gap cases: CSV whose header gives name and unit of each column.

    Args:
        path: File to write.
        joints: Names of the joints, in the order of the log's columns.
        log: What the driver logged.
    """
    columns: Mapping[str, tuple[Array, str, int]] = {
        "command": (log.command, "rad", 8),
        "command_velocity": (log.command_velocity, "rad/s", 8),
        "position": (log.position, "rad", 8),
        "velocity": (log.velocity, "rad/s", 7),
        "effort": (log.effort, "N m", 5),
    }
    header = ["time [s]", *(f"{kind}.{joint} [{unit}]" for kind, (_, unit, _) in columns.items() for joint in joints)]
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for k, time in enumerate(log.time):
            row = [f"{value:.{digits}f}" for values, _, digits in columns.values() for value in values[k]]
            writer.writerow([f"{time:.6f}", *row])


def log_trials(
    table: str | Path,
    log: str | Path,
    world: LoggedPhysics,
    registration: Registration,
    settings: EnvironmentSettings,
    out: Mapping[str, str | Path],
    record: str | Path,
    *,
    name: str,
) -> None:
    """Repeat trials of a policy, failed ones first, and write what the driver logs.

    Args:
        table: Trials of the policy in that world, CSV.
        log: Log of those trials.
        world: The world in which they were made.
        registration: The registration with which they were made.
        settings: Settings of the environment.
        out: File of each role of `ROLES`.
        record: Record of the stage, which names the trials.
        name: The world's name.

    Raises:
        InputError: Table and log do not belong together.
        StageError: Too few trials are long enough, or the tool moves otherwise in a repeated one.
    """  # fmt: skip
    chosen = choose_trials(table, log, 1.0 / CONTROL_HZ, len(out))
    rows = []
    for (role, path), trial in zip(out.items(), chosen, strict=True):
        found = repeat_trial(world, registration, settings, trial)
        write_driver_log(path, world.robot.record["arm_joints"], found)
        rows.append(
            {
                "role": role,
                "pose_set": trial.path.pose_set,
                "index": trial.path.index,
                "success": trial.success,
                "seconds": float(found.time[-1]),
                "rate_hz": 1.0 / float(found.time[1] - found.time[0]),
            }
        )
        logger.info("%s: trial %s %d, %.1f s", role, trial.path.pose_set, trial.path.index, found.time[-1])
    write_stage(record, packages=("mujoco",), world=name, trials=rows)
