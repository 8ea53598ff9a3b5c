"""The whole environment on the simulated world: repeatable bit by bit, and the controllers do both tasks."""

import numpy as np
import pytest
from environment_fixture import GRIP
from gymnasium.utils.env_checker import check_env
from robot_fixture import robot
from sim_fixture import EDGE, content, cube, hull, model, world

from gsbridge.environment.controllers import GraspController, PlaceController
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.mesh_renderer import MeshRenderer
from gsbridge.environment.proprioception import Reached, proprioception
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.robot_splats import link_meshes
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.meshes import Mesh
from gsbridge.sim.model import parse_model
from gsbridge.sim.world import SimWorld

FLAT = Plate(0.02, 0.285, 0.0)
"""A plate that is only painted on the table."""

SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


def renderer() -> MeshRenderer:
    half = EDGE / 2
    corners = np.array([(x, y, EDGE) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))])
    table = np.array([(x, y, 0) for x, y in ((-0.5, -0.3), (0.5, -0.3), (0.5, 0.8), (-0.5, 0.8))])
    grey = np.full((4, 3), 0.5, np.float32)
    links = link_meshes(robot())
    return MeshRenderer(Mesh(corners, SQUARE, 0.2 * grey), Mesh(table, SQUARE, grey), links, wrist_camera(64))


@pytest.fixture(scope="module")
def sim():
    with world() as out:
        yield out


def environment(sim, **settings) -> PickEnvironment:
    response = model(camera__read_noise=0.02).camera
    return PickEnvironment(sim, EnvironmentSettings(image_size=64, **settings), renderer(), response=response)


def play(env, controller, index, steps=1000):
    observation, info = env.reset(seed=index, options={"pose_set": "fixed", "index": index})
    seen = [observation]
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(controller(state_of(info))[0])
        seen.append(observation)
        if terminated or truncated:
            break
    return seen, info


def test_same_seed_same_pictures_and_motion_bit_by_bit(sim):
    """Sensor noise included, and after another episode."""
    env, controller = environment(sim), GraspController(GRIP)
    first, _ = play(env, controller, 3, steps=25)
    play(env, controller, 4, steps=3)
    again, _ = play(env, controller, 3, steps=25)
    assert len({image["image"].tobytes() for image in first}) == len(first)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a["image"], b["image"])
        np.testing.assert_array_equal(a["proprio"], b["proprio"])


@pytest.mark.filterwarnings("ignore:.*not initialized via.*")
def test_gymnasium_accepts_it(tmp_path):
    """It begins the same episode several times, with nothing in between that would move the object away."""
    with world(hull(tmp_path)) as sim:
        check_env(environment(sim), skip_render_check=True)


@pytest.mark.parametrize("index", [0, 21])
def test_controller_grasps(sim, index):
    _, info = play(environment(sim), GraspController(GRIP), index)
    assert info["success"], info["failure"]
    assert info["refused"] == 0


@pytest.mark.parametrize("index", [9, 30])
def test_controller_places(sim, index):
    env = environment(sim, task="pick_and_place", plate=FLAT)
    _, info = play(env, PlaceController(GRIP, task=env.rules), index)
    assert info["success"], info["failure"]


class Plain:
    """Pictures of nothing."""

    camera = wrist_camera(64)

    def render(self, body_poses, pose):
        return np.zeros((64, 64, 3), np.uint8)


ENCODERS = (
    {"name": "encoder_offset", "joint": "lbr_iiwa_joint_2", "parameters": {"angle": 0.02}},
    {"name": "encoder_scale", "joint": "lbr_iiwa_joint_4", "parameters": {"change": 0.01}},
    {"name": "eccentricity", "joint": "lbr_iiwa_joint_1", "parameters": {"sine": 0.01, "cosine": -0.005}},
)


def steps_of(effects):
    """Observed `proprio`, the one by the measured joints, and the one by the true state, in each of some steps."""
    rows = []
    with SimWorld(robot(), cube(), parse_model({**content(), "effects": list(effects)})) as sim:
        env = PickEnvironment(sim, EnvironmentSettings(image_size=64), Plain())
        observation, info = env.reset(seed=1)
        before = None
        for number in range(8):
            if number:
                observation, *_, info = env.step(np.array([1.0, -0.5, -0.3, 0.4, -0.2]))
            pose = sim.table_from_base @ sim.kinematics.fk(sim.joints()[0], ["tool"])["tool"]
            opening = float(state_of(info).aperture[0])
            by_joints = Reached.of_pose(pose, opening).after(before)
            by_state = Reached.of_state(state_of(info)).after(before)
            before = by_joints
            rows.append([observation["proprio"], *(proprioception(env.target, found) for found in (by_joints, by_state))])
    return np.moveaxis(np.array(rows), 1, 0)


@pytest.mark.parametrize("effect", ENCODERS, ids=lambda effect: effect["name"])
def test_a_policy_feels_what_the_encoders_report(effect):
    """As an arm does, whose tool pose is computed from its joints: here by the kinematics of `run-policy`."""
    found, by_joints, by_state = steps_of([effect])
    np.testing.assert_allclose(found, by_joints, atol=1e-5)
    # In units of half the workspace, 17 cm.
    assert np.abs(found - by_state)[:, :3].max() > 0.005


@pytest.mark.parametrize("effects", [(), ({"name": "lag", "parameters": {"time": 0.02}},)])
def test_without_effects_on_encoders_a_policy_feels_the_true_state_bit_by_bit(effects):
    found, by_joints, by_state = steps_of(effects)
    np.testing.assert_array_equal(found, by_state)
    np.testing.assert_allclose(found, by_joints, atol=1e-5)
