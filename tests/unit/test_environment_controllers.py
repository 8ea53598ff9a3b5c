"""Baseline controllers: both tasks from every start with an arm that lags, no memory, any number of worlds, grips."""

from dataclasses import fields

import numpy as np
import pytest
from environment_fixture import EDGE, GRIP, PLATE, hand_environment

from gsbridge.environment.controllers import GAIN, GraspController, Grip, PlaceController, gain_limit, grip_of, stable_gain
from gsbridge.environment.env import state_of
from gsbridge.errors import InputError
from gsbridge.tasks.state import State


def play(env, controller, options):
    """One episode; the states met and the last info."""
    _, info = env.reset(seed=0, options=options)
    states = []
    while True:
        states.append(state_of(info))
        action = controller(states[-1])
        assert action.shape == (1, 5)
        assert np.abs(action).max() <= 1
        *_, terminated, truncated, info = env.step(action[0])
        if terminated or truncated:
            return states, info


def joined(states):
    return State(**{item.name: np.concatenate([getattr(s, item.name) for s in states]) for item in fields(State)})


@pytest.mark.parametrize("lag", [1, 2, 3])
def test_grasps_from_every_fourth_fixed_start(lag):
    env = hand_environment(lag)
    controller = GraspController(GRIP)
    for index in range(0, 32, 4):
        states, info = play(env, controller, {"pose_set": "fixed", "index": index})
        assert info["success"], (index, info["failure"])
        assert info["steps"] <= 60
        assert env.world.crashes == 0
        assert info["refused"] == 0
        # The fingertips, half a pad below the tool point, stay off the table; the lift stops where it is meant to.
        heights = joined(states).tool_position[:, 2]
        assert heights.min() > 0.0365
        assert heights[10:].max() < controller.lift + GRIP.centre[2] + 0.02


@pytest.mark.parametrize("lag", [1, 2, 3])
def test_places_on_the_plate_without_pressing(lag):
    env = hand_environment(lag, task="pick_and_place", plate=PLATE)
    controller = PlaceController(GRIP, task=env.rules)
    for index in range(0, 32, 4):
        _, info = play(env, controller, {"pose_set": "unseen", "index": index})
        assert info["success"], (index, info["failure"])
        assert info["terms"]["distance"] < 0.015
        assert info["steps"] <= 100


@pytest.mark.parametrize("delay", [1, 2, 3])
def test_the_later_commands_act_the_gentler_it_grasps(delay):
    env = hand_environment(3 + delay)
    for index in range(0, 32, 4):
        _, info = play(env, GraspController(GRIP, gain=stable_gain(delay)), {"pose_set": "fixed", "index": index})
        assert info["success"], (index, info["failure"])
        assert env.world.crashes == 0


def test_without_being_gentler_it_swings():
    env = hand_environment(6)
    ended = [play(env, GraspController(GRIP), {"pose_set": "fixed", "index": index})[1] for index in range(0, 32, 4)]
    assert sum(info["success"] for info in ended) < 4


@pytest.mark.parametrize("lag", [0, 1, 3, 6, 12])
def test_the_limit_is_where_the_slowest_root_leaves_the_unit_circle(lag):
    def largest(gain):
        # z^(lag + 1) - z^lag + gain = 0, of e[t + 1] = e[t] - gain e[t - lag].
        equation = np.zeros(lag + 2)
        equation[[0, 1]] = 1.0, -1.0
        equation[-1] += gain
        return np.abs(np.roots(equation)).max()

    limit = gain_limit(lag)
    assert largest(0.999 * limit) < 1.0 < largest(1.001 * limit)


def test_an_arm_without_delay_is_led_as_ever():
    assert stable_gain(0.0) == GAIN == GraspController(GRIP).gain
    assert stable_gain(3.2) / gain_limit(6.2) == pytest.approx(GAIN / gain_limit(3.0))


def test_no_memory_and_any_number_of_worlds():
    env = hand_environment(task="pick_and_place", plate=PLATE)
    controller = PlaceController(GRIP, task=env.rules)
    states, _ = play(env, controller, {"pose_set": "fixed", "index": 5})
    together = controller(joined(states))
    order = np.random.default_rng(0).permutation(len(states))
    apart = np.concatenate([controller(states[k]) for k in order])
    np.testing.assert_array_equal(apart, together[order])
    assert controller(joined(states[:1])).dtype == np.float32


def test_goes_up_and_opens_after_closing_on_nothing():
    env = hand_environment()
    env.reset(seed=0, options={"pose": [0.05, 0.2, 0.1]})
    env.world.tool = np.array([0.05, 0.2, 0.043])
    env.world.aperture = 0.01
    action = GraspController(GRIP)(env.world.state())[0]
    assert action[2] > 0.3
    assert action[4] > 0.1


def test_broken_world_gets_no_action():
    env = hand_environment()
    env.world.broken = True
    for controller in (GraspController(GRIP), PlaceController(GRIP)):
        assert np.isfinite(controller(env.world.state())).all()


def test_grip_is_across_the_narrow_side():
    rng = np.random.default_rng(1)
    box = (rng.random((400, 3)) - [0.5, 0.5, 0]) * [0.15, 0.04, 0.10]
    turned = 0.3
    rotation = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    box[:, :2] = box[:, :2] @ rotation.T
    grip = grip_of(box)
    assert len(grip.axes) == 1
    # The narrow side of a box turned by 0.3 lies along 0.3 + 90 degrees.
    assert grip.axes[0] == pytest.approx(turned + np.pi / 2, abs=0.06)
    assert grip.width == pytest.approx(0.04, abs=0.003)
    assert grip.centre[2] == pytest.approx(0.05, abs=0.002)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) * EDGE / 2
    cube = grip_of(corners, centre=(0.001, 0.002, 0.03))
    np.testing.assert_allclose(sorted(cube.axes), [0, np.pi / 2], atol=0.02)
    assert cube.centre == (0.001, 0.002, 0.043)
    angle = np.linspace(0, 2 * np.pi, 720)
    assert len(grip_of(np.c_[0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.05 * np.ones(720)]).axes) == 6
    with pytest.raises(InputError, match="grip"):
        Grip((0, 0, np.nan), (0.0,), 0.05, 0.05)
