"""Vessels are gripped by their wall: where, and whether a hand that grips there lifts them in both worlds."""

import cup_fixture as cups
import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import world

from gsbridge.asset.rim import Rim, find_rim
from gsbridge.environment.controllers import GraspController, rim_grip
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.reality.world.bodies import TrueBody
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics


@pytest.fixture(scope="module")
def rim() -> Rim:
    found = find_rim(cups.surface(cups.pieces()))
    assert found is not None
    return found


def test_a_cup_is_taken_across_its_wall_far_from_the_handle(rim):
    x, y, angle = np.transpose(rim.places)
    np.testing.assert_allclose(np.hypot(x, y), cups.RADIUS - cups.WALL / 2, atol=0.002)
    # Straight across the wall, most of all opposite to the handle, and nowhere near it.
    assert (np.cos(angle - np.arctan2(y, x)) > 0.98).all()
    assert x[0] < -0.9 * (cups.RADIUS - cups.WALL)
    assert len(rim.places) > 20
    assert np.abs(np.arctan2(y, x)).min() > np.deg2rad(20)
    # Flat pads touch a round wall at their edges inside, in the middle outside.
    assert cups.WALL <= rim.thickness < cups.WALL + 0.005
    assert rim.height == pytest.approx(cups.HEIGHT, abs=1e-3)
    assert rim.depth == pytest.approx(0.030)


@pytest.mark.parametrize("turned", [0.4, 2.0, -2.6])
def test_the_place_turns_with_the_cup(rim, turned):
    turn = np.array([[np.cos(turned), -np.sin(turned), 0], [np.sin(turned), np.cos(turned), 0], [0, 0, 1]])
    found = find_rim(cups.surface([part @ turn.T for part in cups.pieces()]))
    assert found is not None
    np.testing.assert_allclose(found.places[0][:2], (turn @ [*rim.places[0][:2], 0.0])[:2], atol=0.006)


@pytest.mark.parametrize(
    "shape", [{"radius": 0.022}, {"height": 0.020}, {"wall": 0.026}], ids=["too narrow for a finger", "a dish", "a thick wall"]
)
def test_what_leaves_no_room_for_a_finger_is_taken_like_a_solid_thing(shape):
    assert find_rim(cups.surface(cups.pieces(**{"handle": False, **shape}))) is None


def test_a_solid_thing_has_no_rim():
    assert find_rim(cups.surface(cups.pieces()[:1])) is None


def lifted(world, controller, index):
    env = PickEnvironment(world, EnvironmentSettings(image_size=64), BlankRenderer(64), stroke=controller.stroke)
    _, info = env.reset(seed=index, options={"pose_set": "fixed", "index": index})
    ended = False
    while not ended:
        _, _, terminated, truncated, info = env.step(controller(state_of(info))[0])
        ended = terminated or truncated
    return info


@pytest.mark.parametrize("index", [0, 11, 22, 31])
def test_the_controller_lifts_a_cup_in_simulation(rim, tmp_path, index):
    with world(cups.cup(tmp_path, rim.thickness)) as sim:
        info = lifted(sim, GraspController(rim_grip(rim, cups.HEIGHT)), index)
    assert info["success"], info["failure"]


@pytest.mark.parametrize("index", [5, 26])
def test_the_controller_lifts_a_cup_in_the_mirror(rim, index):
    parts = cups.pieces()
    body = cups.properties(parts)
    true = TrueBody("cup", body.mass, body.centre, body.inertia, np.concatenate(parts), parts)
    hidden = Hidden()
    physics = MirrorPhysics(robot(), Stand(true_base_from_table(hidden)), true, hidden)
    info = lifted(physics, GraspController(rim_grip(rim, cups.HEIGHT)), index)
    assert info["success_tolerant"], info["failure"]
