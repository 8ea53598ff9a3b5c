"""Trials of a policy: tables, logs, resuming after a kill; and the log file itself."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from environment_fixture import GRIP, HandWorld

from gsbridge.environment.biased import BiasedController, teacher_name
from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.policy_trials import COLUMNS, TrialPlace, follow, try_policy
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trial_log import decode, encode, read_trial_log, write_trial_log
from gsbridge.errors import InputError
from gsbridge.files import read_json

SETTINGS = EnvironmentSettings(image_size=64)
CONTROLLER = GraspController(GRIP)


def act(observation, info):
    return CONTROLLER(state_of(info))[0]


def place(folder):
    return TrialPlace(folder / "trials.csv", folder / "trials.npz", folder / "trials.json", folder / "state")


def environment(**changes):
    return PickEnvironment(HandWorld(), replace(SETTINGS, **changes))


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_both_sets_are_tried_and_told(tmp_path):
    out = place(tmp_path)
    try_policy(environment(), act, out, name="hand", poses=4, reasons=["policy: young"])
    table = rows(out.table)
    assert tuple(table[0]) == COLUMNS
    assert [(row["pose_set"], row["index"], row["quadrant"]) for row in table] == [
        (pose_set, str(8 * k), str(k + 1)) for pose_set in ("fixed", "unseen") for k in range(4)
    ]
    assert {(row["success"], row["failure"]) for row in table} == {("true", "")}
    record = read_json(out.record)
    assert (record["status"], record["reasons"], record["world"]) == ("degraded", ["policy: young"], "hand")
    assert record["counts"]["unseen"] == {"trials": 4, "success": 4, "success_tolerant": 4, "failures": {}}
    log = read_trial_log(out.log)
    assert [len(path) for path in log] == [int(row["steps"]) + 1 for row in table]
    assert [(path.pose_set, str(path.index)) for path in log] == [(row["pose_set"], row["index"]) for row in table]
    for row, path in zip(table, log, strict=True):
        np.testing.assert_allclose(path.object_position[0, :2], [float(row["x"]), float(row["y"])], atol=1e-6)
        assert path.object_position[-1, 2] > 0.1
        assert path.pictures().shape == (len(path), 64, 64, 3)


def test_failures_have_a_reason(tmp_path):
    out = place(tmp_path)
    try_policy(environment(max_steps=5), act, out, name="hand", poses=4)
    assert {(row["success"], row["failure"] != "") for row in rows(out.table)} == {("false", True)}
    assert sum(read_json(out.record)["counts"]["fixed"]["failures"].values()) == 4


def test_a_killed_job_goes_on_with_the_next_trial(tmp_path):
    whole, parts = place(tmp_path / "whole"), place(tmp_path / "parts")
    try_policy(environment(), act, whole, name="hand", poses=4)
    episodes = []

    def mortal(observation, info):
        if info["steps"] == 0:
            episodes.append(info["start_pose"])
            if len(episodes) == 4:
                raise KeyboardInterrupt
        return act(observation, info)

    with pytest.raises(KeyboardInterrupt):
        try_policy(environment(), mortal, parts, name="hand", poses=4)
    assert not parts.table.exists()
    episodes.clear()
    episodes += [None] * 10
    try_policy(environment(), mortal, parts, name="hand", poses=4)
    assert len(episodes) == 10 + 5
    assert parts.table.read_bytes() == whole.table.read_bytes()
    assert parts.log.read_bytes() == whole.log.read_bytes()
    assert list(parts.state.iterdir()) == []


def test_the_same_trial_is_the_same():
    first, second = (follow(environment(), act, "unseen", 9, seed=5) for _ in range(2))
    assert first[0] == second[0]
    np.testing.assert_array_equal(first[1].actions, second[1].actions)
    assert first[1].jpegs == second[1].jpegs
    assert not first[1].actions[-1].any()


def test_pictures_survive_the_log_nearly_unchanged():
    picture = (np.add.outer(np.arange(64), np.arange(64))[..., None] + [0, 60, 120]).astype(np.uint8)
    assert np.abs(decode(encode(picture)).astype(int) - picture).max() <= 4
    with pytest.raises(ValueError, match="damaged"):
        decode(b"no picture")


def test_damaged_and_missing_logs_are_named(tmp_path):
    path = tmp_path / "log.npz"
    with pytest.raises(InputError, match="does not exist"):
        read_trial_log(path)
    write_trial_log(path, [follow(environment(max_steps=3), act, "fixed", 0, seed=0)[1]])
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match=r"log.npz.*damaged"):
        read_trial_log(path)


def test_a_biased_controller_reaches_for_another_place():
    seen = environment()
    _, info = seen.reset(options={"pose": np.array([0.02, 0.25, 0.1])})
    there = environment()
    _, elsewhere = there.reset(options={"pose": np.array([0.05, 0.24, 0.3])})
    biased = BiasedController(CONTROLLER, (0.03, -0.01, 0.0, 0.2))
    np.testing.assert_allclose(biased(state_of(info)), CONTROLLER(state_of(elsewhere)), atol=1e-12)
    higher = BiasedController(CONTROLLER, (0.0, 0.0, 0.015, 0.0))
    there.reset(options={"pose": np.array([0.02, 0.25, 0.1])})
    for world in (seen.world, there.world):
        world.tool, world.yaw = np.array([0.02, 0.25, 0.10]), 0.1
    there.world.cube[2] = 0.015
    true, raised = seen.world.state(), there.world.state()
    np.testing.assert_allclose(higher(true), CONTROLLER(raised), atol=1e-12)
    # Both corrections lie within an action; the share of 15 mm that one corrects is 0.1 and more of it.
    assert np.abs(higher(true) - CONTROLLER(true))[0, 2] > 0.1
    assert teacher_name((0.0, 0.0, 0.0, 0.0)) == "exact"
    assert teacher_name((0.015, 0.0, 0.0, 0.2)) == "x 15 mm, yaw 0.20 rad"
