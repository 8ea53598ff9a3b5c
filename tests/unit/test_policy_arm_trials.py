"""Trials on an arm: the policy knows the arm by encoders and registration alone, so errors of both take effect."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from robot_fixture import kinematics, robot
from scipy.spatial.transform import Rotation

from gsbridge.environment.controllers import GraspController, Grip
from gsbridge.environment.policy_trials import TrialPlace, run_trials
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.environment.trial_log import read_trial_log
from gsbridge.files import read_json
from gsbridge.meshes import Mesh
from gsbridge.policy.arm_trials import ArmTrials, arm_setup, try_controller_on_arm
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.joint_log import Repeat, repeat_trial
from gsbridge.policy.runner import run_policy
from gsbridge.policy.safety import End
from gsbridge.policy.worlds import MirrorDriver
from gsbridge.reality.mirror.backgrounds import PLATE_CENTRE_M, make_plate
from gsbridge.reality.mirror.objects import make_object
from gsbridge.reality.world import camera as camera_module
from gsbridge.reality.world.bodies import DENSITIES, body_of
from gsbridge.reality.world.camera import Quality, Setting
from gsbridge.reality.world.driver_log import LoggedPhysics
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.reality.world.pieces import convex_pieces
from gsbridge.reality.world.severity import Severity, worsened
from gsbridge.registration.result import Registration
from gsbridge.robot import nominal
from gsbridge.robot.limits import Workspace
from gsbridge.tasks.poses import trial_seed
from gsbridge.tasks.world import CONTROL_HZ

SETTINGS = EnvironmentSettings(image_size=64, hold_steps=3)
EDGE = 0.058
TRUTH = nominal.base_from_table()
FOLDER = TemporaryDirectory(prefix="gsbridge-pieces-")
REST = kinematics().rest
ACTIONS = np.array([[0.4, -0.3, -0.6, 0.5, -0.2], [-0.2, 0.5, -0.4, 0.3, 0.1]])


@cache
def cube():
    mesh, _ = make_object("small_cube", 0, 4.0)
    return body_of("small_cube", mesh, DENSITIES["small_cube"], convex_pieces(Mesh(mesh.vertices, mesh.faces), FOLDER.name))


def physics(kind=MirrorPhysics, **hidden):
    return kind(robot(), Stand(TRUTH), cube(), Hidden(**{"encoder_noise": 3e-5, **hidden}))


def registered(shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """The truth, moved along the table's axes, m, and turned by a rotation vector, degrees."""
    error = np.eye(4)
    error[:3, :3], error[:3, 3] = Rotation.from_rotvec(np.deg2rad(turn)).as_matrix(), shift
    return Registration(TRUTH @ error, nominal.flange_from_camera())


def interface(**settings):
    return PolicyInterface(wrist_camera(64), Workspace.around(), 0.14, replace(SETTINGS, **settings), CONTROL_HZ)


class Script:
    """Acts without looking, and keeps what it was shown; the first call is the warm-up."""

    def __init__(self):
        self.seen = []

    def __call__(self, observation, info):
        assert not info
        self.seen.append(np.array(observation["proprio"], np.float64))
        return ACTIONS[len(self.seen) // 6 % 2]

    def tool(self):
        """Tool points that it was told, table frame. [steps, 3]."""
        space = Workspace.around()
        middle, half = (np.add(space.upper, space.lower) / 2, np.subtract(space.upper, space.lower) / 2)
        return np.array(self.seen)[1:, :3] * half + middle


def grasp_controller():
    return GraspController(Grip((0.0, 0.0, 0.043), (0.0, np.pi / 2), EDGE, EDGE), SETTINGS.action_scale())


@pytest.mark.parametrize(
    ("shift", "turn"), [((0, 0, 0), (0, 0, 0)), ((0.003, -0.004, 0), (0, 0, 0)), ((0, 0, 0.005), (0.6, 0.0, 0.8))]
)
def test_an_error_of_the_registration_shows_in_what_a_policy_is_told(shift, turn):
    script = Script()
    chosen = registered(shift, turn)
    trials = ArmTrials(physics(), chosen, interface(max_steps=20), script)
    trial, path = trials("fixed", 3, 5)
    assert trial.steps == 20
    assert trial.end == "time_out"
    # Through the base, which both share: the truth, seen from where the table is believed to be.
    error = np.linalg.inv(chosen.base_from_table) @ TRUTH
    believed = path.tool[:-1] @ error[:3, :3].T + error[:3, 3]
    np.testing.assert_allclose(script.tool(), believed, atol=2e-4)
    away = np.linalg.norm(script.tool() - path.tool[:-1], axis=1)
    expected = np.linalg.norm(believed - path.tool[:-1], axis=1)
    np.testing.assert_allclose(away, expected, atol=2e-4)
    if any(shift):
        assert away.min() > 2e-3
    # The two differ by the noise of the encoders only.
    assert np.abs(script.tool() - believed).max() > 0


def test_offsets_of_the_encoders_show_in_the_truth_alone():
    """What a policy is told is where it sent its arm; the arm stands as much beside it as the joints are off."""
    offset = (0.002, -0.003, 0.001, 0.002, -0.002, 0.003, 0.0)
    told, true = [], []
    for hidden in ({}, {"encoder_offset": offset}):
        script = Script()
        _, path = ArmTrials(physics(**hidden), registered(), interface(max_steps=12), script)("fixed", 3, 5)
        told.append(script.tool())
        true.append(path.tool[:-1])
    np.testing.assert_allclose(told[1], told[0], atol=4e-4)
    away = true[1] - true[0]
    assert np.linalg.norm(away, axis=1).min() > 2e-3
    # To first order, as the arm's own Jacobian says at the start.
    arm = physics()
    step = [np.linalg.inv(TRUTH) @ arm.kinematics.fk(q, ["tool"])["tool"] for q in (REST, REST - np.array(offset))]
    np.testing.assert_allclose(away[0], (step[1] - step[0])[:3, 3], atol=2e-4)


def test_a_grasp_misses_by_the_error_of_the_registration():
    """The controller is told where the object is: it goes there by its own measure, which lies 5 mm beside the truth."""
    middles = []
    for shift in ((0.0, 0.0, 0.0), (0.0, 0.005, 0.0)):
        world = physics()
        path = controller_path(world, registered(shift))
        low = path.tool[:, 2].argmin()
        middles.append(path.tool[low, :2] - path.object_position[0, :2])
    assert np.linalg.norm(middles[0]) < 4e-3
    np.testing.assert_allclose(middles[1] - middles[0], [0.0, 0.005], atol=1.5e-3)


def controller_path(world, registration):
    from gsbridge.policy.arm_trials import SeeingController, play_on_arm

    driver = MirrorDriver(world, registration, SETTINGS)
    acting = SeeingController(grasp_controller(), driver, registration.base_from_table)
    setup = arm_setup(driver, registration, interface())
    return play_on_arm(acting, setup, driver, "fixed", 9, 3)[1]


def test_a_plate_that_was_reconstructed_aside_does_not_move_the_goal():
    believed = replace(SETTINGS, task="pick_and_place", plate=Plate(PLATE_CENTRE_M[0] + 0.025, PLATE_CENTRE_M[1], 0.009))
    world = MirrorPhysics(robot(), Stand(TRUTH, PLATE_CENTRE_M), cube(), Hidden())
    rules = MirrorDriver(world, registered(), believed).referee.rules
    assert rules.plate_centre == PLATE_CENTRE_M
    # What the well's floor is in the mesh that the mirror is made of.
    vertices = make_plate(0)[0].vertices
    assert rules.plate_height == vertices[np.argmin(np.hypot(vertices[:, 0], vertices[:, 1]) - 1e-6 * vertices[:, 2]), 2]
    assert MirrorDriver(physics(), registered(), believed).referee.rules == believed.rules()


class NoTruth(MirrorPhysics):
    """A world that nobody can ask for the truth."""

    def state(self):
        raise AssertionError("the truth was asked for")

    body_poses = camera_pose = state


def test_a_trial_runs_to_the_bit_alike_where_there_is_no_truth():
    logs = []
    for kind in (MirrorPhysics, NoTruth):
        driver = MirrorDriver(physics(kind), registered((0.002, 0.0, 0.001)), SETTINGS)
        driver.prepare(np.array([0.02, 0.25, 0.3]), 7)
        for name in ("state", "body_poses", "camera_pose", "physics", "hidden", "stand", "data", "model"):
            assert not hasattr(driver.world, name), name
        until = None
        if kind is NoTruth:
            driver.referee.begin = lambda: None
        else:
            until = driver.referee
        chosen = arm_setup(driver, registered((0.002, 0.0, 0.001)), interface(max_steps=25))
        script = Script()
        log = run_policy(script, chosen, until=until)
        assert log.end == End.TIME_OUT
        logs.append((np.array(log.rows).tobytes(), np.array(script.seen).tobytes()))
    assert logs[0] == logs[1]


def test_a_controllers_trials_are_counted_and_resemble_those_by_the_truth(tmp_path):
    record = tmp_path / "mirror.json"
    trials = try_controller_on_arm(
        physics(), registered(), grasp_controller(), SETTINGS, record, name="mirror", seeds=[0, 2], poses=4
    )
    content = read_json(record)
    assert content["counts"]["success"] == {"0": 4, "2": 4}
    assert content["ends"] == {"done": 8}
    assert content["status"] == "pass"
    assert all(20 < trial.steps < SETTINGS.time_out for trial in trials)


@pytest.mark.parametrize("extreme", [{"friction_pad": 0.02}, {"lost_commands": 0.9}, {"latency": 0.3}])
def test_even_a_controller_that_sees_everything_fails_where_physics_is_extreme(extreme, tmp_path):
    """It succeeds at every severity, for it sees object and tool anew at each step; effects act nevertheless."""
    settings = replace(SETTINGS, hold_steps=10)
    played = [
        try_controller_on_arm(
            physics(**hidden),
            registered(),
            grasp_controller(),
            settings,
            tmp_path / "trials.json",
            name="lab",
            seeds=[0],
            poses=1,
        )
        for hidden in ({}, extreme)
    ]
    assert [trials[0].success_tolerant for trials in played] == [True, False]


def test_a_trial_that_is_repeated_for_its_log_takes_the_same_way():
    hidden = {"latency": 0.03, "torque_noise": 0.1}
    chosen = registered((0.0, 0.004, 0.0), (0.5, 0.0, 0.5))
    trials = ArmTrials(physics(**hidden), chosen, interface(max_steps=30), Script())
    _, path = trials("unseen", 4, trial_seed("unseen", 4))
    log = repeat_trial(physics(LoggedPhysics, **hidden), chosen, SETTINGS, Repeat(11, False, path))
    # Half a second before the first command and half a second after the last, at the rate of the physics.
    assert len(log.time) == 500 + 30 * 50 + 500


def test_ends_are_counted_over_all_trials_of_a_job_that_was_killed(tmp_path):
    """Ends of the trials that a first job finished count in the record that the second one writes."""
    place = TrialPlace(tmp_path / "trials.csv", tmp_path / "trials.npz", tmp_path / "trials.json", tmp_path / "state")
    play = ArmTrials(physics(), registered(), interface(max_steps=6), Script())
    played = []

    def mortal(pose_set, index, seed):
        if len(played) == 2:
            raise KeyboardInterrupt
        played.append(play(pose_set, index, seed))
        return played[-1]

    counts = {"fixed": 2, "unseen": 1}
    with pytest.raises(KeyboardInterrupt):
        run_trials(mortal, "grasp", place, name="lab", counts=counts)
    done = run_trials(play, "grasp", place, name="lab", counts=counts, facts=lambda: {"path_tracer": "none"})
    assert [trial for _, trial in done[:2]] == [trial for trial, _ in played]
    record = read_json(place.record)
    assert record["ends"] == {"time_out": 3}
    assert record["path_tracer"] == "none"


def test_a_policys_trials_on_a_bad_day_leave_table_log_and_record(tmp_path, monkeypatch):
    monkeypatch.setattr(camera_module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    hidden = worsened(Hidden.draw(11), 11, Severity(4, 4))
    world = build_mirror(
        Setting("small_cube"), robot(), TRUTH, hidden, pieces=Path(FOLDER.name), quality=Quality(samples=1, depth=2)
    )
    script = Script()
    play = ArmTrials(world, registered((0.002, 0.0, 0.0)), interface(max_steps=7), script)
    place = TrialPlace(tmp_path / "trials.csv", tmp_path / "trials.npz", tmp_path / "trials.json", tmp_path / "state")
    counts = {"fixed": 1, "unseen": 1}
    done = run_trials(play, "grasp", place, name="lab", counts=counts, reasons=["policy: young"])
    assert [(name, trial.steps, trial.success) for name, trial in done] == [("fixed", 7, False), ("unseen", 7, False)]
    record = read_json(place.record)
    assert record["ends"] == {"time_out": 2}
    assert (record["world"], record["status"], record["reasons"]) == ("lab", "degraded", ["policy: young"])
    first, _ = read_trial_log(place.log)
    assert len(first) == 8
    np.testing.assert_array_equal(first.actions[:7], ACTIONS[np.arange(2, 9) // 6 % 2].astype(np.float32))
    # What moved is in the pictures, and what was measured lies beside the truth by offsets and registration.
    assert (first.pictures()[-1] != first.pictures()[0]).any()
    away = np.linalg.norm(script.tool()[:7] - first.tool[:-1], axis=1)
    assert away.min() > 1e-3
