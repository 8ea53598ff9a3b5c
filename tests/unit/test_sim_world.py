"""The simulated world: rest, motion, grasping, contact forces, repeatability and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import EDGE, cube, hull, model, slab, world

from gsbridge.errors import InputError
from gsbridge.geometry import rotation_angle, rotation_from_quat
from gsbridge.robot.reach import tool_down
from gsbridge.sim.dynamics import packed
from gsbridge.sim.world import SimWorld
from gsbridge.tasks.state import State, clearance
from gsbridge.tasks.world import World

WEIGHT = 600 * EDGE**3 * 9.81
MIDDLE = np.array([0.0, 0.265, 0.0])


def follow(sim: SimWorld, position, yaw: float, aperture: float, steps: int) -> State:
    """Hold a target for some steps."""
    for _ in range(steps):
        sim.command(np.asarray(position, dtype=float), yaw, aperture)
        sim.step()
    return sim.state()


def grasp(sim: SimWorld, x: float, y: float, yaw: float, lift: float = 0.16) -> tuple[State, State]:
    """Scripted grasp of the cube from above; the state while held on the table and after lifting."""
    follow(sim, [x, y, 0.15], yaw, 0.12, 12)
    follow(sim, [x, y, 0.045], yaw, 0.12, 12)
    held = follow(sim, [x, y, 0.045], yaw, 0.0, 16)
    for height in np.linspace(0.045, lift, 12):
        follow(sim, [x, y, height], yaw, 0.0, 1)
    return held, follow(sim, [x, y, lift], yaw, 0.0, 10)


@pytest.fixture(scope="module")
def sim():
    with world() as out:
        yield out


def test_is_a_world_and_rests(sim):
    sim.reset(np.array([0.08, 0.2, 0.5]), 1)
    state = follow(sim, [0.0, 0.265, 0.25], 0.0, 0.14, 5)
    assert isinstance(sim, World)
    assert len(state) == 1
    assert state.finite().all()
    np.testing.assert_allclose(state.object_position[0], [0.08, 0.2, 0.0], atol=2e-4)
    assert state.object_contact[0] == pytest.approx(WEIGHT, rel=0.01)
    assert state.pad_forces.max() == state.robot_contact[0] == 0.0
    assert -2e-4 < state.object_clearance[0] < 1e-5
    # The controller carries the arm's weight: it does not sag.
    np.testing.assert_allclose(state.tool_position[0], [0.0, 0.265, 0.25], atol=1e-4)
    q, dq, effort = sim.joints()
    assert q.shape == dq.shape == effort.shape == (8,)
    assert np.abs(dq).max() < 1e-3


def test_poses_and_state_agree_with_kinematics(sim):
    """The state's compiled short cuts against the library's plain functions."""
    sim.reset(np.array([0.05, 0.3, -0.4]), 2)
    follow(sim, [0.05, 0.3, 0.2], 0.4, 0.1, 8)
    # Tilted and moving, so that nothing vanishes.
    sim.place(np.array([[0.8, 0, 0.6, 0.05], [0, 1, 0, 0.3], [-0.6, 0, 0.8, 0.1], [0, 0, 0, 1]], dtype=float))
    sim.push([0.1, -0.2, 0.3], [1.0, 2.0, -1.0])
    state, poses = sim.state(), sim.body_poses()
    expected = sim.table_from_base @ sim.kinematics.fk(sim.joints()[0], ["tool"])["tool"]
    np.testing.assert_allclose(poses["tool"], expected, atol=1e-12)
    np.testing.assert_allclose(state.tool_position[0], expected[:3, 3], atol=1e-12)
    np.testing.assert_allclose(rotation_from_quat(state.tool_quat[0]), expected[:3, :3], atol=1e-12)
    np.testing.assert_allclose(rotation_from_quat(state.object_quat[0]), poses["object"][:3, :3], atol=1e-12)
    np.testing.assert_allclose(poses["object"][:3, 0], [0.8, 0, -0.6], atol=1e-9)
    assert state.object_clearance == pytest.approx(
        clearance(cube().points, state.object_position, state.object_quat), abs=1e-12
    )
    centre = poses["object"] @ [0, 0, EDGE / 2, 1]
    moved = np.array([0.1, -0.2, 0.3]) + np.cross([1.0, 2.0, -1.0], poses["object"][:3, 3] - centre[:3])
    np.testing.assert_allclose(state.object_velocity[0], moved, atol=1e-9)
    np.testing.assert_allclose(sim.camera_pose() @ poses["camera"], np.eye(4), atol=1e-12)


def test_reaches_commanded_poses_in_a_straight_line(sim):
    sim.reset(MIDDLE, 0)
    start, end = np.array([-0.1, 0.2, 0.25]), np.array([0.12, 0.38, 0.20])
    follow(sim, start, 0.0, 0.14, 15)
    way = []
    for share in np.linspace(0, 1, 16):
        follow(sim, start + share * (end - start), share, 0.14, 1)
        way.append(sim.state().tool_position[0])
    state = follow(sim, end, 1.0, 0.14, 8)
    assert np.linalg.norm(state.tool_position[0] - end) < 2e-4
    turned = rotation_from_quat(state.tool_quat[0]).T @ tool_down(end, 1.0)[:3, :3]
    assert rotation_angle(turned) < 2e-3
    direction = (end - start) / np.linalg.norm(end - start)
    off = np.array(way) - start
    off -= np.outer(off @ direction, direction)
    assert np.linalg.norm(off, axis=1).max() < 2e-3


def test_scripted_grasp_lifts_the_cube_ten_centimetres(sim):
    sim.reset(np.array([0.06, 0.22, 0.3]), 3)
    held, lifted = grasp(sim, 0.06, 0.22, 0.3)
    assert held.gripped(0.5).all()
    assert held.pad_forces[0] == pytest.approx([40, 40], rel=0.1)  # the model's gripping force
    assert held.robot_contact[0] == 0.0
    assert lifted.gripped(0.5).all()
    assert lifted.object_clearance[0] > 0.10
    assert lifted.object_contact[0] == 0.0
    assert lifted.aperture[0] == pytest.approx(EDGE, abs=2e-3)
    # It neither slipped nor tilted in the grip.
    assert lifted.object_clearance[0] - held.object_clearance[0] == pytest.approx(0.115, abs=2e-3)
    assert lifted.tilt()[0] < 0.02
    np.testing.assert_allclose(lifted.object_position[0, :2], [0.06, 0.22], atol=2e-3)


def test_fingers_let_go_when_told_to_however_long_they_pressed(sim):
    sim.reset(np.array([0.06, 0.22, 0.3]), 3)
    grasp(sim, 0.06, 0.22, 0.3, lift=0.08)
    # The pads open by 7.5 mm per step, from where they are.
    state = follow(sim, [0.06, 0.22, 0.08], 0.3, 0.12, 2)
    assert (state.pad_forces == 0.0).all()
    assert state.aperture[0] > EDGE + 0.005


def test_gripper_pressed_on_the_table_is_felt(sim):
    sim.reset(np.array([-0.1, 0.2, 0.0]), 0)
    # Half a pad below the tool point: the command lies 2.5 mm inside the table, which no action may ask for.
    state = follow(sim, [0.1, 0.3, 0.030], 0.0, 0.0, 25)
    assert state.robot_contact[0] > 5.0
    assert state.object_contact[0] == pytest.approx(WEIGHT, rel=0.01)


def test_same_seed_same_trajectory_bit_by_bit(sim):
    """Through contact, in one world after other episodes and in a second one."""

    def trajectory(which: SimWorld) -> np.ndarray:
        which.reset(np.array([0.06, 0.22, 0.3]), 7)
        rows = []
        for position, aperture in [([0.06, 0.22, 0.045], 0.12)] * 14 + [([0.06, 0.23, 0.05], 0.0)] * 14:
            follow(which, position, 0.25, aperture, 1)
            state = which.state()
            rows.append(np.r_[which.joints()[0], which.joints()[2], state.object_position[0], state.pad_forces[0]])
        return np.array(rows)

    first = trajectory(sim)
    assert first[-1, -2:].min() > 1.0
    grasp(sim, -0.1, 0.3, 0.1)
    np.testing.assert_array_equal(trajectory(sim), first)
    with world() as other:
        np.testing.assert_array_equal(trajectory(other), first)


@pytest.mark.parametrize("raised", [False, True])
def test_an_episode_does_not_know_what_was_before(tmp_path, raised):
    """At once again, with the object in the hand, after pressing on it, and in a new world; a hull, as assets are."""
    plate = slab(tmp_path) if raised else None
    start = np.array([0.02, 0.25, 0.7])

    def trajectory(which: SimWorld) -> np.ndarray:
        which.reset(start, 0)
        rows = []
        for position in [[0.02, 0.25, 0.09]] * 6 + [[0.02, 0.25, 0.05]] * 4:
            follow(which, position, 0.0, 0.05, 1)
            state = which.state()
            rows.append(np.r_[which.joints()[0], state.object_position[0], state.object_velocity[0], state.pad_forces[0]])
        return np.array(rows)

    with world(hull(tmp_path), plate=plate) as sim, world(hull(tmp_path), plate=plate) as other:
        first = trajectory(sim)
        assert np.abs(np.diff(first[-5:, -5:], axis=0)).max() > 0  # it is pushed about
        again = [trajectory(sim)]
        for _ in range(3):
            sim.reset(start, 0)
            again.append(trajectory(sim))
        held, _ = grasp(sim, 0.02, 0.25, 0.7)
        assert held.pad_forces.min() > 1.0
        again.append(trajectory(sim))
        grasp(sim, -0.1, 0.3, 0.0)
        again += [trajectory(sim), trajectory(other)]
        for found in again:
            np.testing.assert_array_equal(found, first)


def test_two_worlds_do_not_touch_each_other(sim):
    sim.reset(MIDDLE, 0)
    with world() as other:
        other.reset(np.array([0.1, 0.3, 0.0]), 0)
        before = sim.state()
        follow(other, [0.1, 0.3, 0.1], 0.0, 0.1, 5)
        np.testing.assert_array_equal(sim.state().tool_position, before.tool_position)
        assert other.state().tool_position[0, 2] < 0.2


def test_records_of_equal_fields_share_their_type():
    # numba knows a type at sight, and compares all fields of one that is equal, but another object.
    first, second = (packed(law=np.full((6, 7), value), slot=np.zeros(1, np.int64)) for value in (1.0, 2.0))
    assert first.dtype is second.dtype
    np.testing.assert_array_equal(second["law"][0], np.full((6, 7), 2.0))
    assert packed(law=np.zeros((6, 8)), slot=np.zeros(1, np.int64)).dtype != first.dtype


def test_object_starts_on_the_plate_not_in_it(tmp_path):
    """A static background of triangles, 6 mm high."""
    plate = slab(tmp_path)

    def slide(friction: float) -> float:
        contact = {"contact__plate__friction": friction, "contact__table__friction": 2.0}
        with SimWorld(robot(), cube(), model(**contact), plate=plate) as sim:
            state = sim.state()
            # The engine grows triangles by its margin of 1 mm.
            assert 0.005 < state.object_clearance[0] < 0.0075
            assert np.linalg.norm(state.object_velocity) < 1e-3
            assert state.object_contact[0] == pytest.approx(WEIGHT, rel=0.05)
            sim.push([0.4, 0, 0], [0, 0, 0])
            for _ in range(8):
                sim.step()
            return sim.state().object_position[0, 0]

    # v^2 / (2 mu g): 41 mm and 16 mm; the table's coefficient plays no part.
    assert slide(0.2) == pytest.approx(0.041, abs=0.008)
    assert slide(0.5) == pytest.approx(0.016, abs=0.006)


def test_bad_input_is_refused(sim):
    sim.reset(MIDDLE, 0)
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="not finite"):
            sim.command(np.array([0.0, bad, 0.2]), 0.0, 0.1)
        with pytest.raises(InputError, match="not finite"):
            sim.command(np.array([0.0, 0.265, 0.2]), 0.0, bad)
        with pytest.raises(InputError, match="finite"):
            sim.reset(np.array([0.0, 0.2, bad]), 0)
    goal = sim.controller.goal.copy()
    sim.command(np.array([1.5, 0.265, 0.2]), 0.0, 0.1)
    assert sim.refused == 1
    np.testing.assert_array_equal(sim.controller.goal, goal)


def test_impossible_set_ups_are_refused(tmp_path):
    with pytest.raises(InputError, match="opens 140 mm"):
        SimWorld(robot(), replace(cube(), width=0.2), model())
    far = np.eye(4)
    far[:3, 3] = 1.2, 0.0, -0.18
    with pytest.raises(InputError, match="the arm misses"):
        SimWorld(robot(), cube(), model(), base_from_table=far)
    with pytest.raises(InputError, match="cannot load"):
        SimWorld(robot(), replace(cube(), urdf=tmp_path / "none.urdf"), model())
