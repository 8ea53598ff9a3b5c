"""Policies of the toy: trained, tried in both worlds, shown in the tables."""

import csv
import json
from collections import Counter

import numpy as np
import pytest

from gsbridge.environment.trial_log import read_trial_log
from gsbridge.policy.export import load_policy
from gsbridge.policy.onnx import load_onnx

CELL = "grasp/small_cube+foam_pad/gs/default"
POSES = {"fixed": 8, "unseen": 8, "outside": 4}
"""Trials of each set of starts. Those of `outside` lie beyond the square in which the policy was trained."""


@pytest.fixture(scope="module")
def policy(toy):
    return toy / "results/policies" / CELL / "seed1"


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_policy_has_learned_in_minutes(policy):
    record = json.loads((policy / "training.json").read_text())
    assert record["retest_success"] >= 0.75
    assert record["controller_success"] == 1.0
    assert record["replay_mb"] <= 200
    assert sum(record["cpu_seconds"].values()) <= 480
    curve = rows(policy / "training.csv")
    assert float(curve[-1]["success"]) > float(curve[0]["success"])


def test_policy_is_delivered_in_two_formats_that_act_alike(policy):
    torch_policy, onnx_policy = load_policy(policy), load_onnx(policy)
    rng = np.random.default_rng(0)
    seen = {"image": rng.integers(0, 256, (64, 64, 3), dtype=np.uint8), "proprio": rng.normal(size=12).astype(np.float32)}
    np.testing.assert_allclose(torch_policy(seen), onnx_policy(seen), atol=1e-5)


@pytest.mark.parametrize("world", ["sim", "mirror"])
def test_every_trial_is_told_and_logged(toy, world):
    place = toy / "results/trials" / CELL / world
    trials, log = rows(place / "seed1.csv"), read_trial_log(place / "seed1.npz")
    assert Counter(trial["pose_set"] for trial in trials) == POSES
    assert len(log) == len(trials)
    for trial, path in zip(trials, log, strict=True):
        assert (trial["success"] == "true") == (trial["failure"] == "")
        assert len(path) == int(trial["steps"]) + 1
    inside = [trial["success"] == "true" for trial in trials if trial["pose_set"] != "outside"]
    assert sum(inside) >= 0.6 * len(inside)


def test_tables_show_both_worlds(toy):
    table = rows(toy / "results/rows/grasping.csv")
    assert {(row["world"], row["pose_set"]) for row in table} >= {
        (world, pose_set) for world in ("sim", "mirror") for pose_set in POSES
    }
    assert all(int(row["trials"]) == POSES[row["pose_set"]] for row in table)
    page = (toy / "results/tables/index.html").read_text()
    assert "Grasping" in page
