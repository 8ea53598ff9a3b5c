"""Trials: every start pose once, successes counted by seed, and the reason of each failure."""

from dataclasses import replace

import numpy as np
import pytest
from environment_fixture import GRIP, PLATE, HandWorld

from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trials import run_trial, spread, try_controller
from gsbridge.errors import InputError
from gsbridge.files import read_json

SETTINGS = EnvironmentSettings(image_size=64)


def test_counts_and_trials_by_seed(tmp_path):
    record = tmp_path / "trials.json"
    trials = try_controller(HandWorld(), GraspController(GRIP), SETTINGS, record, name="hand", seeds=[0, 7], poses=8)
    content = read_json(record)
    assert content["status"] == "pass"
    assert content["counts"]["success"] == {"0": 8, "7": 8}
    assert [trial["index"] for trial in content["trials"]] == 2 * list(range(0, 32, 4))
    assert [trial["quadrant"] for trial in content["trials"][:8]] == [1, 1, 2, 2, 3, 3, 4, 4]
    assert len({trial.start for trial in trials}) == 16
    assert all(trial.steps < SETTINGS.time_out and trial.success_tolerant for trial in trials)


def test_failures_degrade_the_record_and_are_named(tmp_path):
    record = tmp_path / "trials.json"
    hurried = replace(SETTINGS, max_steps=5)
    try_controller(HandWorld(), GraspController(GRIP), hurried, record, name="hand", seeds=[0], poses=4)
    content = read_json(record)
    assert content["status"] == "degraded"
    assert content["reasons"][0].startswith("4 of 4 trials failed: ")
    assert content["counts"] == {"success": {"0": 0}, "success_tolerant": {"0": 0}}
    assert all(trial["failure"] and trial["steps"] == 5 for trial in content["trials"])


def test_objects_keep_off_the_plate_in_either_task(tmp_path):
    settings = replace(SETTINGS, plate=PLATE)
    trials = try_controller(
        HandWorld(plate=PLATE), GraspController(GRIP), settings, tmp_path / "trials.json", name="hand", seeds=[3]
    )
    away = [np.hypot(trial.start[0] - PLATE.x, trial.start[1] - PLATE.y) for trial in trials]
    assert len(trials) == 32
    assert min(away) >= PLATE.keep_out


def test_a_policy_sees_pictures_and_the_same_trial_is_the_same():
    world = HandWorld()
    environment = PickEnvironment(world, replace(SETTINGS, max_steps=6))
    seen = []

    def policy(observation, info):
        seen.append(observation["image"])
        return np.array([0.5, 0, 0, 0, 0])

    first, second = (run_trial(environment, policy, "unseen", 9) for _ in range(2))
    assert first == second
    assert first.quadrant == 2
    np.testing.assert_array_equal(seen[0], seen[6])
    assert not BlankRenderer(64).render({}, np.eye(4)).any()


@pytest.mark.parametrize("count", [0, 33])
def test_more_poses_than_a_set_has_are_refused(count):
    with pytest.raises(InputError, match="trials: poses"):
        spread(count)
