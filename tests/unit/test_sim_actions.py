"""Actions: steps add up on the command, walls cut and count, nonsense is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.robot.limits import Workspace
from gsbridge.sim.actions import TETHER, ActionScale, ToolTarget

ROOM = Workspace.around()


def target() -> ToolTarget:
    out = ToolTarget.within(ROOM, 0.14)
    out.reset([0.0, 0.265, 0.2], 0.0, 0.14)
    return out


@settings(max_examples=30, deadline=None)
@given(st.lists(st.lists(st.floats(-1, 1), min_size=5, max_size=5), max_size=30))
def test_never_leaves_the_room_nor_steps_too_far(actions):
    held = target()
    for action in actions:
        before, yaw_before = held.position.copy(), held.yaw
        position, yaw, aperture = held.move(np.array(action))
        assert ROOM.contains(position)
        assert 0 <= aperture <= 0.14
        assert np.abs(position - before).max() <= 0.024 + 1e-12
        assert abs(yaw - yaw_before) <= 0.15 + 1e-12
    assert held.counted.commands == len(actions)
    assert held.saturated == 0


def test_steps_mean_what_the_scale_says():
    held = target()
    position, yaw, aperture = held.move(np.array([1, -0.5, 0, 1, -1]))
    np.testing.assert_allclose(position, [0.024, 0.253, 0.2])
    assert (yaw, aperture) == (pytest.approx(0.15), pytest.approx(0.098))


def test_walls_and_saturation_are_counted():
    held = target()
    for _ in range(10):
        held.move(np.array([0, 0, -1.0, 0, 0]))
    assert held.position[2] == pytest.approx(0.035)
    assert held.counted.clipped == 4  # 165 mm down take 6.9 steps
    held.move(np.array([3.0, 0, 0, 0, 0]))
    assert held.saturated == 1
    assert held.position[0] == pytest.approx(0.024)
    held.reset([0.0, 0.265, 0.2], 0.0, 0.14)
    assert held.counted.commands == held.counted.clipped == held.saturated == 0


@pytest.mark.parametrize("action", [[np.nan, 0, 0, 0, 0], [0, 0, 0, 0, np.inf], [0, 0, 0, 0], [[0] * 5]])
def test_nonsense_is_refused(action):
    held = target()
    with pytest.raises(InputError, match="action"):
        held.move(np.array(action))
    np.testing.assert_array_equal(held.position, [0.0, 0.265, 0.2])
    with pytest.raises(InputError, match="action scale"):
        ActionScale(position=-1.0)


def test_the_command_stays_near_an_arm_that_is_held_back():
    out = target()
    out.reset(np.array([0.0, 0.2, 0.2]), 0.0, 0.1)
    for _ in range(5):
        out.tether(np.array([0.0, 0.2, 0.2]), 0.0, 0.13)
        out.move([1.0, 0.0, -0.5, 1.0, -1.0])
    scale = out.scale
    np.testing.assert_allclose(out.position, [(TETHER + 1) * scale.position, 0.2, 0.2 - (TETHER + 0.5) * scale.position])
    assert out.yaw == pytest.approx((TETHER + 1) * scale.yaw)
    # The gripper presses by a command that it cannot follow, and opens at the second action that says so.
    assert out.aperture == pytest.approx(0.13 - (TETHER + 1) * scale.aperture)
    for _ in range(2):
        out.tether(np.array([0.0, 0.2, 0.2]), 0.0, 0.13)
        out.move([0.0, 0.0, 0.0, 0.0, 1.0])
    assert out.aperture > 0.13


def test_the_tether_takes_the_short_way_round_and_lets_a_broken_world_be():
    out = target()
    out.reset(np.array([0.0, 0.2, 0.2]), 3.1, 0.1)
    out.tether(np.array([0.0, 0.2, 0.2]), -3.1, 0.1)
    assert np.cos(out.yaw - 3.1) == pytest.approx(1.0)
    before = out.position.copy()
    out.tether(np.full(3, np.nan), 0.0, 0.1)
    np.testing.assert_array_equal(out.position, before)
