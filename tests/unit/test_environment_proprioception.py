"""Proprioception of an arm: one formula serves for states of worlds and for poses of real arms."""

import numpy as np
import pytest
from environment_fixture import hand_environment
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gsbridge.environment.proprioception import PROPRIO_BOUND, Reached, begin, next_command, proprioception
from gsbridge.robot.limits import Workspace
from gsbridge.robot.reach import tool_down
from gsbridge.sim.actions import TETHER, ToolTarget

SPACE = Workspace((-0.2, 0.1, 0.03), (0.1, 0.5, 0.33))

places = st.tuples(st.floats(-0.2, 0.1), st.floats(0.1, 0.5), st.floats(0.03, 0.33))
yaws = st.floats(-1.5, 1.5)


@given(places, yaws, st.floats(0, 0.14), places, yaws, st.floats(0, 0.14), st.floats(0, 0.14))
def test_entries_are_those_of_the_table(position, yaw, aperture, wanted, turn, opening, before):
    target = ToolTarget.within(SPACE, 0.14)
    target.reset(wanted, turn, opening)
    reached = Reached(np.array(position), yaw, aperture)
    found = proprioception(target, reached.after(Reached(np.zeros(3), 0.0, before)))
    middle, half = np.array([-0.05, 0.3, 0.18]), np.array([0.15, 0.2, 0.15])
    # The shorter way round, by rotations instead of a modulo.
    apart = (Rotation.from_euler("z", turn) * Rotation.from_euler("z", yaw).inv()).as_rotvec()[2]
    expected = [*((position - middle) / half), np.sin(yaw), np.cos(yaw), aperture / 0.14]
    expected += [
        *((np.array(wanted) - position) / 0.024),
        apart / 0.15,
        (opening - aperture) / 0.042,
        (aperture - before) / 0.01,
    ]
    np.testing.assert_allclose(found, np.clip(expected, -PROPRIO_BOUND, PROPRIO_BOUND), atol=2e-5)
    assert found.dtype == np.float32


@given(places, yaws)
def test_an_arms_pose_and_a_worlds_state_say_the_same(position, yaw):
    pose = tool_down(np.array(position), yaw)
    found = Reached.of_pose(pose, 0.07)
    np.testing.assert_allclose([*found.position, found.yaw, found.aperture], [*position, yaw, 0.07], atol=1e-12)
    assert Rotation.from_matrix(pose[:3, :3]).apply([0, 0, 1])[2] == pytest.approx(-1)


def test_the_command_begins_at_the_tool_and_stays_on_its_tether():
    target = ToolTarget.within(SPACE, 0.14)
    reached = Reached(np.array([-0.05, 0.3, 0.2]), 0.4, 0.1)
    begin(target, reached)
    np.testing.assert_array_equal(proprioception(target, reached)[6:], 0)
    for _ in range(9):
        position, yaw, aperture = next_command(target, reached, np.array([1, -1, 0.5, 1, -0.1]))
    # An arm that does not move leads the command on by the tether and one action.
    far = TETHER + 1
    expected = reached.position + np.array([far, -far, 2.0]) * 0.024
    np.testing.assert_allclose(position, expected, atol=1e-12)
    assert yaw == pytest.approx(0.4 + 0.15 * far)
    assert aperture == pytest.approx(0.1 - 9 * 0.0042)


def test_the_environment_uses_it():
    env = hand_environment()
    first, begun = env.reset(seed=3)
    assert first["proprio"][11] == 0
    observation, *_, info = env.step(np.array([0.5, -1, 0.3, 0.7, -1]))
    state = info["state"]
    turn = Rotation.from_quat(state["tool_quat"], scalar_first=True).as_matrix()
    travel = float(state["aperture"] - begun["state"]["aperture"])
    assert travel < 0
    reached = Reached(state["tool_position"], np.arctan2(turn[1, 0], turn[0, 0]), float(state["aperture"]), travel)
    np.testing.assert_allclose(observation["proprio"], proprioception(env.target, reached), atol=1e-6)
