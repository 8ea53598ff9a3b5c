"""The simulated world and the mirror behind the driver: nothing changes for the policy, and the referee judges alike."""

import numpy as np
import pytest
from driver_fixture import spec
from robot_fixture import kinematics
from sim_fixture import world

from gsbridge.environment.controllers import GraspController, Grip
from gsbridge.environment.env import DrawnEye, PickEnvironment, state_of
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.export import _robot
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.robot_trials import StartPose
from gsbridge.policy.runner import Setup, run_policy
from gsbridge.policy.safety import End, Limits
from gsbridge.policy.session import WorldOperator
from gsbridge.policy.worlds import MirrorDriver, MirrorSetting, WorldDriver
from gsbridge.reality.world import camera as camera_module
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table
from gsbridge.registration.result import Registration
from gsbridge.robot import nominal
from gsbridge.sim.model import CameraModel
from gsbridge.tasks.poses import trial_seed

SETTINGS = EnvironmentSettings(image_size=64, hold_steps=3)
EDGE = 0.058


class PlaceRenderer:
    """A picture of where things are: every hundredth of a millimetre of object, tool and camera changes it."""

    def __init__(self):
        self.camera = wrist_camera(64)

    def render(self, body_poses, cam_from_table):
        places = np.concatenate([body_poses["object"][:3, 3], body_poses["tool"][:3, 3], cam_from_table[:3, 3]])
        picture = np.add.outer(np.arange(64), np.arange(64))[..., None] + 1e5 * places.reshape(3, 3).sum(0)
        return (picture % 256).astype(np.uint8)


def registered(base_from_table):
    return Registration(base_from_table, nominal.flange_from_camera())


def test_the_same_episode_as_in_the_environment():
    """A grasp with contact, noise of the sensor, and the trial's own seed: as `gsbridge.environment.trials` runs it."""
    response = CameraModel(1.1, 1.0, 0.9, 1.0, 0.0, 0.0, 0.02)
    env = PickEnvironment(world(), SETTINGS, PlaceRenderer(), response=response)
    controller = GraspController(Grip((0.0, 0.0, 0.043), (0.0, np.pi / 2), EDGE, EDGE), SETTINGS.action_scale())
    observation, info = env.reset(seed=9, options={"pose_set": "fixed", "index": 9})
    actions, pictures, proprio, tools, touched, ended = [], [], [], [], [], False
    start = info["start_pose"]
    while not ended:
        pictures.append(observation["image"].copy())
        proprio.append(observation["proprio"])
        tools.append(info["state"]["tool_position"])
        touched.append(info["state"]["pad_forces"].max() > 0)
        actions.append(controller(state_of(info))[0])
        observation, _, terminated, truncated, info = env.step(actions[-1])
        ended = terminated or truncated
    assert info["success"]

    sim = world()
    driver = WorldDriver(
        sim, DrawnEye(PlaceRenderer(), response), sim.kinematics, sim.dimensions, sim.base_from_table, SETTINGS
    )
    seen = []

    def policy(observation, _):
        # The warm-up comes first.
        seen.append({name: np.array(value) for name, value in observation.items()})
        return actions[max(0, len(seen) - 2)]

    found = PolicyInterface.of(spec(hold_steps=3))
    operator = WorldOperator(driver, SETTINGS)
    operator.place(StartPose("fixed", 9, *start))
    log = EpisodeLog(keep_pictures=True)
    setup = Setup(found, driver, registered(sim.base_from_table), driver.clock, Limits(frozen=None))
    run_policy(policy, setup, until=operator.over, log=log)
    assert log.end == End.DONE
    assert operator.judge(log).success
    assert log.steps == len(actions)
    # The interface hands actions on as float32. Where the pads begin to hold, that rounding decides between two places that lie
    # 0.1 mm apart; the same actions to the bit give the same episode to the bit (`test_sim_world`).
    free = touched.index(True)
    assert free > 10
    np.testing.assert_allclose(np.array(log.rows)[:free, 2:5], tools[:free], atol=1e-9)
    np.testing.assert_allclose(np.array(log.rows)[:, 2:5], tools, atol=2e-4)
    for step, (a, b, image, picture) in enumerate(zip(proprio, seen[1:], log.pictures, pictures, strict=True)):
        np.testing.assert_allclose(b["proprio"], a, atol=1e-6 if step < free else 5e-3)
        if step < free:
            np.testing.assert_array_equal(image, picture)


def test_a_trial_has_the_seed_of_the_trials():
    env = PickEnvironment(world(), SETTINGS, PlaceRenderer())
    seeds = []
    reset = env.world.reset
    env.world.reset = lambda pose, seed: (seeds.append((pose, seed)), reset(pose, seed))[1]
    env.reset(seed=trial_seed("unseen", 17), options={"pose_set": "unseen", "index": 17})
    driver = WorldDriver(env.world, env.eye, env.world.kinematics, env.world.dimensions, env.world.base_from_table, SETTINGS)
    pose = env.start_pose
    WorldOperator(driver, SETTINGS).place(StartPose("unseen", 17, *pose))
    driver.rest()
    np.testing.assert_array_equal(seeds[0][0], seeds[1][0])
    assert seeds[0][1] == seeds[1][1]


def test_the_policy_knows_its_robot():
    sim = world()
    robot = _robot(sim)
    np.testing.assert_allclose(robot["flange_from_camera"], nominal.flange_from_camera(), atol=1e-9)
    at_rest = np.linalg.inv(sim.base_from_table) @ kinematics().fk(kinematics().rest, ["tool"])["tool"]
    np.testing.assert_allclose(robot["table_from_tool_at_rest"], at_rest, atol=1e-9)
    found = PolicyInterface.of({**spec(), "robot": robot})
    found.check_start(at_rest)
    assert found.check_mount(registered(sim.base_from_table)) == pytest.approx((0, 0), abs=1e-7)


def test_the_mirror_is_driven_by_what_was_registered(monkeypatch, tmp_path):
    monkeypatch.setattr(camera_module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    truth = true_base_from_table(Hidden.draw(3))
    believed = np.array(truth)
    believed[:3, 3] += [0.015, 0.0, 0.004]
    mirror = MirrorSetting("small_cube", "foam_pad", seed=3, pieces=tmp_path, samples=1)
    driver = MirrorDriver(mirror.build(), registered(believed), SETTINGS)
    driver.prepare([0.05, 0.3, 0.1], 1)
    found = PolicyInterface.of(spec())
    setup = Setup(found, driver, registered(believed), driver.clock, Limits(frozen=None))
    log = run_policy(lambda o, i: np.array([0.5, -0.3, 0, 0, 0]), setup, steps=6, log=EpisodeLog(keep_pictures=True))
    for _ in range(20):
        driver.world.step()
    # By its encoders and the registration the arm stands where it was sent; truly it stands beside it.
    place = np.linalg.inv(believed) @ driver.measure().base_from_tool
    wanted = [log.rows[-1][k] for k in (12, 13, 14)]
    np.testing.assert_allclose(place[:3, 3], wanted, atol=1.5e-3)
    true = driver.referee.world.state().tool_position[0]
    away = truth[:3, :3].T @ [0.015, 0.0, 0.004]
    np.testing.assert_allclose(true - wanted, away, atol=1.5e-3)
    # Encoders have noise: two readings differ, by less than a tenth of a millimetre.
    first, second = (driver.measure().base_from_tool[:3, 3] for _ in range(2))
    assert 0 < np.linalg.norm(first - second) < 1e-4
    assert log.pictures[0].shape == (64, 64, 3)
    assert len({picture.tobytes() for picture in log.pictures}) == 6
    verdict = driver.referee.verdict
    assert not verdict.success
    assert verdict.failure == "not_grasped"
