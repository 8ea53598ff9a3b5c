"""Made-up trials of a policy in two worlds, as files."""

import csv
from pathlib import Path

import numpy as np

from gsbridge.environment.trial_log import TrialPath, encode, write_trial_log
from gsbridge.report.figures.paired_trials import ShownTrials

COLUMNS = (
    *("pose_set", "index", "quadrant", "x", "y", "yaw"),
    *("success", "success_tolerant", "failure", "steps", "clipped", "refused"),
)
POSES = [(pose_set, index) for pose_set in ("fixed", "unseen") for index in (0, 8, 16, 24)]
SIZE = 16


def path(pose_set: str, index: int, states: int, shift: float = 0.0) -> TrialPath:
    """The hand moves straight over 0.3 m, `shift` (m) beside the x axis; the object rises at the end."""
    along = np.linspace(0.0, 1.0, states)
    tool = np.c_[0.3 * along, np.full(states, 0.2 + shift), np.full(states, 0.1)]
    pictures = [np.full((SIZE, SIZE, 3), 40 + 5 * index + 2 * state, np.uint8) for state in range(states)]
    return TrialPath(
        pose_set=pose_set,
        index=index,
        tool=tool,
        tool_yaw=0.1 * along,
        aperture=0.14 - 0.05 * along,
        object_position=np.c_[tool[:, :2], 0.1 * along],
        object_quat=np.tile([0.8, 0.0, 0.0, 0.6], (states, 1)),
        forces=np.arange(states)[:, None] + np.arange(4.0),
        actions=np.r_[np.full((states - 1, 5), 0.25), np.zeros((1, 5))],
        jpegs=tuple(encode(picture) for picture in pictures),
    )


def write_trials(
    folder: Path, world: str, *, shift: float = 0.0, states: int = 6, failed: dict | None = None, seed: int = 1, poses=POSES
) -> ShownTrials:
    """Write table and log.

    Args:
        folder: Where to.
        world: Name of the world.
        shift: Of the paths, m, times 1 + the number of the pose.
        states: Of each trial.
        failed: Word of the failure by `(pose_set, index)`; `excess_contact` is forgiven by the tolerant judgement.
        seed: Of the policy.
        poses: Start poses.
    """
    failed = failed or {}
    folder.mkdir(parents=True, exist_ok=True)
    table, log = folder / f"{world}-{seed}.csv", folder / f"{world}-{seed}.npz"
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for pose_set, index in poses:
            failure = failed.get((pose_set, index), "")
            tolerant = failure in ("", "excess_contact")
            judged = [str(value).lower() for value in (not failure, tolerant)]
            start = [f"{value:.6f}" for value in (0.01 * index, 0.2, -0.5)]
            writer.writerow((pose_set, index, 1 + index // 8, *start, *judged, failure, states - 1, 0, 0))
    write_trial_log(log, [path(*pose, states, shift * (1 + number)) for number, pose in enumerate(poses)])
    return ShownTrials(world, seed, table, log)
