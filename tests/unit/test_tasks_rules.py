"""Reward, success and failure of both tasks on written-down episodes."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.geometry import quat_from_rotation
from gsbridge.tasks import grasp, place
from gsbridge.tasks.outcome import Failure, Progress
from gsbridge.tasks.rules import Grasp, Place
from gsbridge.tasks.state import State, clearance

CENTRE = (0.0, 0.265)
PLATE = (0.05, 0.30)


def state(height=0.0, grip=0.0, xy=CENTRE, speed=0.0, robot=0.0, load=0.0, quat=(1.0, 0.0, 0.0, 0.0)):
    """One world."""
    return State(
        tool_position=[[*xy, height + 0.03]],
        tool_quat=[[0.0, 1.0, 0.0, 0.0]],
        aperture=[0.06],
        pad_forces=[[grip, grip]],
        object_position=[[*xy, height]],
        object_quat=[quat],
        object_velocity=[[0.0, 0.0, -speed]],
        object_spin=[[0.0, 0.0, 0.0]],
        object_clearance=[height],
        robot_contact=[robot],
        object_contact=[load],
    )


def play(module, task, steps):
    """Judge an episode; the last outcome."""
    progress, outcome = Progress.start(1), None
    for one in steps:
        progress, outcome = module.judge(one, progress, task)
    return outcome


def stacked(states):
    return State(**{item.name: np.concatenate([getattr(one, item.name) for one in states]) for item in fields(State)})


LIFT = Grasp(hold_steps=3)
HIGH = state(0.11, grip=10)


def test_grasp_succeeds_when_held_high_for_long_enough():
    rewards = [float(play(grasp, LIFT, [HIGH] * n).reward[0]) for n in (1, 2, 3)]
    assert rewards == [0.0, 0.0, 1.0]
    done = play(grasp, LIFT, [HIGH] * 3)
    assert done.success[0]
    assert done.success_tolerant[0]
    assert done.failure[0] == Failure.NONE


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        ([state()] * 5, Failure.NOT_GRASPED),
        ([state(0.11)] * 5, Failure.NOT_GRASPED),  # high, but not held: thrown up, or resting on the gripper
        ([state(0.0, grip=10)] * 5, Failure.NOT_LIFTED),
        ([HIGH] * 2 + [state(0.0)], Failure.DROPPED),
        ([state(0.05, grip=10)] * 5, Failure.TIME_OUT),
        ([HIGH] * 2 + [state(0.09, grip=10)] + [HIGH] * 2, Failure.TIME_OUT),  # the streak broke
        ([state(xy=(0.6, 0.265))], Failure.PUSHED_AWAY),
        ([HIGH] * 2 + [replace(HIGH, object_clearance=[np.nan])], Failure.NOT_FINITE),
    ],
)
def test_grasp_failures_have_their_reason(steps, reason):
    outcome = play(grasp, LIFT, steps)
    assert not outcome.success[0]
    assert outcome.reward[0] == 0
    assert outcome.failure[0] == reason


def test_one_pad_alone_does_not_hold():
    assert not play(grasp, LIFT, [replace(HIGH, pad_forces=[[10.0, 0.0]])] * 5).success[0]


TASK = Place(PLATE, settle_steps=3)
CARRIED = state(0.08, grip=10)
ABOVE = state(0.05, grip=10, xy=PLATE)
LANDED = state(0.004, grip=10, xy=PLATE, load=2.0)
THERE = state(0.004, xy=PLATE, load=0.7)


def test_placing_succeeds_when_released_and_at_rest_on_the_plate():
    episode = [CARRIED, ABOVE, LANDED, THERE, THERE, THERE]
    assert not play(place, TASK, episode[:-1]).success[0]
    done = play(place, TASK, episode)
    assert done.reward[0] == 1
    assert done.success[0]
    assert done.success_tolerant[0]
    assert done.failure[0] == Failure.NONE


@pytest.mark.parametrize(
    "contact",
    [
        state(0.004, grip=10, xy=PLATE, load=5.1),  # the held cake is pressed on the plate
        state(0.004, grip=10, xy=PLATE, load=1.0, robot=0.2),  # the gripper touches the plate
        state(0.03, xy=PLATE, robot=3.0),  # the open gripper bumps into it
    ],
)
def test_excess_contact_fails_but_is_told_apart(contact):
    outcome = play(place, TASK, [CARRIED, ABOVE, contact, THERE, THERE, THERE])
    assert not outcome.success[0]
    assert outcome.reward[0] == 0
    assert outcome.success_tolerant[0]
    assert outcome.failure[0] == Failure.EXCESS_CONTACT


def test_contact_before_the_lift_and_the_cakes_own_weight_are_no_excess():
    before = [state(0.0, grip=10, load=40.0, robot=2.0), CARRIED, LANDED]
    heavy = replace(THERE, object_contact=[20.0])
    assert play(place, TASK, [*before, heavy, heavy, heavy]).success[0]
    assert play(place, replace(TASK, max_contact_force=1.0), [CARRIED, LANDED]).terms["excess"][0]


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        ([state()] * 4, Failure.NOT_GRASPED),
        ([THERE] * 4, Failure.NOT_GRASPED),  # pushed onto the plate
        # Squeezed and dragged over the plate's rim, which is higher than what counts as lifted.
        ([state(grip=10, load=2.0), state(0.015, grip=10, load=2.0), LANDED, *[THERE] * 5], Failure.NOT_LIFTED),
        ([state(grip=10)] * 4, Failure.NOT_LIFTED),
        ([CARRIED] * 4, Failure.TIME_OUT),
        ([CARRIED, LANDED, LANDED], Failure.NOT_RELEASED),
        ([CARRIED, THERE], Failure.TIME_OUT),
        ([CARRIED] + [state(0.004, xy=(0.05, 0.35))] * 5, Failure.MISSED_PLATE),
        ([CARRIED] + [state(0.0, xy=CENTRE)] * 5, Failure.MISSED_PLATE),
        ([CARRIED, state(0.0, xy=(0.0, 0.8))], Failure.DROPPED),
        ([state(xy=(0.0, 0.8))], Failure.PUSHED_AWAY),
        ([CARRIED] + [replace(THERE, object_velocity=[[0.05, 0.0, 0.0]])] * 5, Failure.TIME_OUT),
        ([CARRIED] + [state(0.03, xy=PLATE)] * 5, Failure.MISSED_PLATE),  # hanging on something above the plate
        ([CARRIED, THERE, replace(THERE, tool_quat=[[np.nan, 0, 0, 0]])], Failure.NOT_FINITE),
    ],
)
def test_placing_failures_have_their_reason(steps, reason):
    outcome = play(place, TASK, steps)
    assert not outcome.success[0]
    assert outcome.failure[0] == reason


def test_a_toppled_cake_is_not_placed():
    lying = quat_from_rotation(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    assert not play(place, TASK, [CARRIED] + [state(0.004, xy=PLATE, quat=lying)] * 5).success[0]


@pytest.mark.parametrize(("module", "task"), [(grasp, LIFT), (place, TASK)])
def test_many_worlds_at_once_equal_one_by_one(module, task):
    episodes = [
        [HIGH] * 6,
        [state()] * 6,
        [CARRIED, ABOVE, LANDED, THERE, THERE, THERE],
        [CARRIED, ABOVE, state(0.004, grip=10, xy=PLATE, load=9.0), THERE, THERE, THERE],
    ]
    progress = Progress.start(len(episodes))
    for step in zip(*episodes, strict=True):
        progress, together = module.judge(stacked(step), progress, task)
    for row, episode in enumerate(episodes):
        alone = play(module, task, episode)
        assert together.failure[row] == alone.failure[0]
        assert together.reward[row] == alone.reward[0]
        for name, term in together.terms.items():
            assert term[row] == alone.terms[name][0]


def test_memory_of_one_world_can_be_reset_alone():
    progress = Progress.start(2)
    for _ in range(2):
        progress, _ = grasp.judge(stacked([HIGH, HIGH]), progress, LIFT)
    again = progress.reset(np.array([True, False]))
    np.testing.assert_array_equal(again.streak, [0, 2])
    np.testing.assert_array_equal(again.gripped, [False, True])
    np.testing.assert_array_equal(progress.streak, [2, 2])


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-1, 1) for _ in range(4)]).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_clearance_of_a_box_is_its_closed_form(quat):
    """Lowest corner of a box about its own middle: half extents projected on the vertical."""
    half = np.array([0.03, 0.05, 0.02])
    corners = half * np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    w, x, y, z = np.array(quat) / np.linalg.norm(quat)
    row = np.abs([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    found = clearance(corners, np.array([[0.1, 0.2, 0.3]]), np.array([quat]))
    np.testing.assert_allclose(found, 0.3 - row @ half, atol=1e-12)


def test_tilt_is_the_angle_to_the_vertical():
    half = np.deg2rad(30) / 2
    assert state(quat=(np.cos(half), np.sin(half), 0, 0)).tilt()[0] == pytest.approx(np.deg2rad(30))
    assert state(quat=(np.cos(half), 0, 0, np.sin(half))).tilt()[0] == pytest.approx(0.0)
    assert state(quat=(0, 1, 0, 0)).tilt()[0] == pytest.approx(np.pi)


def test_bad_states_and_rules_are_refused():
    with pytest.raises(ValueError, match="pad_forces"):
        replace(state(), pad_forces=[[1.0, 2.0, 3.0]])
    with pytest.raises(InputError, match="hull has no vertices"):
        clearance(np.empty((0, 3)), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]))
    for bad in (
        lambda: Grasp(lift=0.0),
        lambda: Grasp(hold_steps=0),
        lambda: Place((np.nan, 0.0)),
        lambda: Place(PLATE, seat=0.0),
    ):
        with pytest.raises(InputError, match="task"):
            bad()
