"""Trials with a person: poses told in words, answers, and a table that grows by a row and never doubles one."""

import csv

import numpy as np
import pytest
from driver_fixture import HandDriver, registration, setup
from environment_fixture import PLATE

from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.policy.episode_log import COLUMNS as STEPS
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.robot_trials import COLUMNS, Person, StartPose, TrialFile, Verdict, start_poses, still_to_try
from gsbridge.policy.safety import End
from gsbridge.policy.session import Plan, run_session
from gsbridge.tasks.poses import pose_set

SETTINGS = EnvironmentSettings(image_size=64)
DIGEST = "0123456789abcdef"
POSE = StartPose("fixed", 9, 0.0123, -0.3, np.deg2rad(-30.0))


class Answers:
    """A person who gives these answers."""

    def __init__(self, *answers):
        self.left, self.questions = list(answers), []

    def __call__(self, question):
        self.questions.append(question)
        return self.left.pop(0)


def nothing(observation, info):
    return np.zeros(5)


def test_poses_are_those_of_the_sets():
    poses = start_poses(SETTINGS, "unseen", "all")
    expected = pose_set("unseen", SETTINGS.region(), SETTINGS.pose_seed)
    np.testing.assert_array_equal([[pose.x, pose.y, pose.yaw] for pose in poses], expected)
    assert [pose.quadrant for pose in poses] == [k // 8 + 1 for k in range(32)]
    np.testing.assert_array_equal(SETTINGS.region().quadrant(expected[:, :2]), [pose.quadrant for pose in poses])
    assert [pose.index for pose in start_poses(SETTINGS, "fixed", "6-9")] == [6, 7, 8, 9]
    assert [pose.index for pose in start_poses(SETTINGS, "fixed", "31")] == [31]


@pytest.mark.parametrize(("name", "index"), [("fixed", "32"), ("fixed", "-1"), ("fixed", "9-6"), ("fixed", "x"), ("new", "1")])
def test_poses_that_are_none_are_refused(name, index):
    with pytest.raises(InputError):
        start_poses(SETTINGS, name, index)


def test_a_person_is_told_metres_and_degrees():
    told = POSE.describe()
    for part in ("x = +0.012 m", "y = -0.300 m", "30 degrees clockwise", "quadrant 2", "Pose 9", "'fixed'"):
        assert part in told


@pytest.mark.parametrize(
    ("task", "answers", "verdict"),
    [
        ("grasp", ["y"], Verdict(True, True)),
        ("grasp", ["", "maybe", "No", "thrown", "dropped"], Verdict(False, False, "dropped")),
        ("grasp", ["n", ""], Verdict(False, False, "")),
        ("grasp", ["r"], None),
        ("pick_and_place", ["yes", "n"], Verdict(True, True)),
        ("pick_and_place", ["y", "r", "y"], Verdict(False, True, "excess_contact")),
    ],
)
def test_answers_become_verdicts(task, answers, verdict):
    ask = Answers(*answers)
    assert Person(task, ask, None).judge(EpisodeLog()) == verdict
    assert not ask.left


def test_a_series_of_trials_is_recorded_as_it_goes(tmp_path):
    driver = HandDriver()
    # Pose 4: success. Pose 5: does not count, then a failure. Pose 6: the person gives up.
    ask = Answers("", "", "y", "", "", "r", "", "", "n", "not_grasped", "")

    def give_up(question):
        if not ask.left:
            raise KeyboardInterrupt
        return ask(question)

    person, file = Person("grasp", give_up, driver.rest), TrialFile(tmp_path / "trials.csv", DIGEST)
    plan = Plan(start_poses(SETTINGS, "fixed", "4-6"), tmp_path / "logs", file, steps=3, pictures=True)
    with pytest.raises(KeyboardInterrupt):
        run_session(nothing, setup(driver), person, plan, {"driver": "hand"})
    with open(tmp_path / "trials.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    assert tuple(rows[0]) == COLUMNS
    assert [(row["index"], row["success"], row["failure"]) for row in rows] == [
        ("4", "true", ""),
        ("5", "false", "not_grasped"),
    ]
    assert rows[0]["pose_set"] == "fixed"
    assert float(rows[1]["x"]) == plan.poses[1].x
    assert rows[0]["steps"] == "3"
    # The arm lets go and drives home before a person reaches in, and stands still at the end of each episode.
    assert driver.calls[:7] == ["rest", "rest", "command", "command", "command", "stop", "rest"]
    assert driver.calls[-1] == "stop"
    names = sorted(path.name for path in (tmp_path / "logs").glob("*.json"))
    assert names == ["fixed_04.json", "fixed_05.json", "fixed_05_2.json"]
    summary = read_json(tmp_path / "logs" / "fixed_05_2.json")
    assert summary["verdict"] == {"success": False, "success_tolerant": False, "failure": "not_grasped"}
    assert summary["driver"] == "hand"
    assert summary["start_pose"]["index"] == 5
    assert read_json(tmp_path / "logs" / "fixed_05.json")["verdict"] is None
    with np.load(tmp_path / "logs" / "fixed_04.npz") as content:
        assert content["images"].shape == (3, 64, 64, 3)
    with open(tmp_path / "logs" / "fixed_04.csv", newline="") as table:
        steps = list(csv.DictReader(table))
    assert tuple(steps[0]) == STEPS
    assert [float(step["time_s"]) for step in steps] == pytest.approx([0.0, 0.05, 0.1])


def test_rows_are_replaced_not_doubled(tmp_path):
    file = TrialFile(tmp_path / "trials.csv", DIGEST)
    poses = start_poses(SETTINGS, "fixed", "3-5")
    log = EpisodeLog(clipped=2)
    for pose in (poses[1], poses[0]):
        file.add(pose, Verdict(False, False), log)
    again = TrialFile(tmp_path / "trials.csv", DIGEST)
    assert [pose.index for pose in still_to_try(poses, again, redo=False)] == [5]
    assert len(still_to_try(poses, again, redo=True)) == 3
    again.add(poses[0], Verdict(True, True), log)
    rows = TrialFile(tmp_path / "trials.csv", DIGEST).rows
    assert [(row["index"], row["success"], row["clipped"]) for row in rows] == [("3", "true", "2"), ("4", "false", "2")]
    with pytest.raises(InputError, match="--redo"):
        still_to_try(poses[:2], again, redo=False)


def test_trials_of_another_policy_are_not_continued(tmp_path):
    file = TrialFile(tmp_path / "trials.csv", DIGEST)
    file.add(start_poses(SETTINGS, "fixed", "3")[0], Verdict(True, True), EpisodeLog())
    assert file.rows[0]["policy"] == DIGEST[:12]
    before = (tmp_path / "trials.csv").read_bytes()
    with pytest.raises(InputError, match="a trial of the policy '0123456789ab', this one is 'fedc'"):
        TrialFile(tmp_path / "trials.csv", "fedc")
    assert (tmp_path / "trials.csv").read_bytes() == before


def test_another_table_is_left_alone(tmp_path):
    path = tmp_path / "notes.csv"
    path.write_text("pose,good\n1,yes\n")
    with pytest.raises(InputError, match="columns"):
        TrialFile(path, DIGEST)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError):
        TrialFile(path, DIGEST)


def test_an_error_leaves_the_log_and_no_row(tmp_path):
    driver = HandDriver()

    def fail():
        raise OSError("no picture for 1 s")

    file = TrialFile(tmp_path / "trials.csv", DIGEST)
    plan = Plan([POSE], tmp_path, file, steps=9)
    driver.image = fail
    with pytest.raises(OSError, match="no picture"):
        run_session(nothing, setup(driver), Person("grasp", Answers("", ""), driver.rest), plan, {})
    summary = read_json(tmp_path / "fixed_09.json")
    assert summary["status"] == "degraded"
    assert "no picture" in summary["reasons"][0]
    assert summary["end"] == End.ERROR.value
    assert not file.rows
    assert not file.path.exists()


def test_pick_and_place_keeps_its_plate(tmp_path):
    settings = EnvironmentSettings(task="pick_and_place", image_size=64, plate=PLATE)
    chosen = setup(task="pick_and_place", plate=PLATE)
    assert chosen.interface.settings == settings
    assert start_poses(chosen.interface.settings, "fixed", "0") == start_poses(settings, "fixed", "0")


def test_an_episode_under_a_doubtful_registration_is_degraded(tmp_path):
    chosen = setup(HandDriver())
    object.__setattr__(chosen, "registration", registration(reasons=("the places are typed",)))
    run_session(nothing, chosen, Person("grasp", Answers(), None), Plan(out=tmp_path, steps=3), {})
    summary = read_json(tmp_path / "episode.json")
    assert (summary["status"], summary["reasons"]) == ("degraded", ["the registration is degraded: the places are typed"])
