"""The gripper's linkage against its own forward kinematics, and the mass properties of its parts against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_fixture import kinematics, robot

from gsbridge.errors import InputError
from gsbridge.robot.assembly import HULL_DIRECTIONS
from gsbridge.robot.gripper import DRIVER, PADS, GripperDimensions, gripper_links
from gsbridge.robot.links import (
    box,
    convex_hull,
    cylinder_points,
    hull,
    number,
    rotation_from_rpy,
    rpy_from_rotation,
    solid_inertia,
    support_hull,
)

D = GripperDimensions()


@pytest.mark.parametrize("aperture", np.linspace(0.0, 0.140, 8))
def test_pads_are_parallel_and_as_far_apart_as_asked_at_every_opening(aperture):
    """The linkage's formulas against the poses of the links that the description gives."""
    q = np.r_[kinematics().rest, D.angle(aperture)]
    poses = kinematics().fk(q, ["palm", "tool", *PADS])
    tool_from = {pad: np.linalg.inv(poses["tool"]) @ poses[pad] for pad in PADS}
    faces = {pad: tool_from[pad] @ [0, sign * D.pad_inset, D.pad_z, 1] for pad, sign in zip(PADS, (-1, 1), strict=True)}
    for pad in PADS:
        np.testing.assert_allclose(tool_from[pad][:3, :3], np.eye(3), atol=1e-12)
        # Both pads stand at the same height, behind the tool point by what `retreat` says, in the middle of the hand.
        np.testing.assert_allclose(faces[pad][[0, 2]], [0, -D.retreat(aperture)], atol=1e-12)
    assert faces["left_pad"][1] == pytest.approx(aperture / 2, abs=1e-12)
    assert faces["right_pad"][1] == pytest.approx(-aperture / 2, abs=1e-12)
    assert D.aperture(D.angle(aperture)) == pytest.approx(aperture, abs=1e-12)


def test_outer_dimensions_are_the_manuals():
    """Length when closed 233 mm without coupling, width when open 202 mm."""
    assert float(D.pad_height(D.closed_angle)) + D.pad_size[2] / 2 == pytest.approx(0.2328, abs=0.0005)
    poses = kinematics().fk(np.r_[kinematics().rest, D.open_angle], ["palm", "left_bar", "left_pad"])
    meshes = robot().visuals()
    widest = 0.0
    for link in ("left_bar", "left_pad"):
        palm_from_link = np.linalg.inv(poses["palm"]) @ poses[link]
        for mesh, _ in meshes[link]:
            widest = max(widest, (mesh.vertices @ palm_from_link[:3, :3].T + palm_from_link[:3, 3])[:, 1].max())
    assert 2 * widest == pytest.approx(0.202, abs=0.004)
    assert D.retreat(0.0) == pytest.approx(0.0, abs=1e-12)
    assert float(D.retreat(D.stroke)) == pytest.approx(0.0254, abs=0.0005)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 0.140), st.floats(10.0, 125.0))
def test_torque_is_the_work_of_the_force(aperture, force):
    """Virtual work by finite differences: torque times turn equals force times the way both pads go."""
    angle, step = float(D.angle(aperture)), 1e-6
    work = force * (D.aperture(angle - step) - D.aperture(angle + step))
    assert D.torque(force, angle) * 2 * step == pytest.approx(work, rel=1e-6)
    assert D.torque(force, angle) < 0


def test_links_share_the_mass_and_mirror_each_other():
    links, joints = gripper_links(D, "flange", np.eye(4))
    by_name = {link.name: link for link in links}
    assert sum(link.inertia.mass for link in links) == pytest.approx(D.mass)
    for part in ("bar", "pad"):
        left, right = by_name[f"left_{part}"].inertia, by_name[f"right_{part}"].inertia
        flip = np.diag([1.0, -1.0, 1.0])
        np.testing.assert_allclose(right.centre, flip @ left.centre, atol=1e-9)
        np.testing.assert_allclose(right.tensor, flip @ left.tensor @ flip, atol=1e-12)
    for link in links:
        a, b, c = np.linalg.eigvalsh(link.inertia.tensor)
        assert 0 < a <= b <= c <= a + b  # what every real body keeps
        assert all(part.mesh.is_watertight() and part.mesh.volume() > 0 for part in link.parts)
    assert [joint.name for joint in joints if joint.kind == "revolute" and joint.follows is None] == [DRIVER]


def test_closed_pads_touch_and_nothing_else_of_the_fingers_does():
    poses = kinematics().fk(np.r_[kinematics().rest, D.closed_angle], ["palm", *PADS, "left_bar"])
    meshes = robot().visuals()
    for link in ("left_pad", "left_bar"):
        palm_from_link = np.linalg.inv(poses["palm"]) @ poses[link]
        lowest = min((m.vertices @ palm_from_link[:3, :3].T + palm_from_link[:3, 3])[:, 1].min() for m, _ in meshes[link])
        assert lowest >= -2e-6  # meshes are written to a micrometre
        if link == "left_pad":
            assert lowest <= 2e-6


def test_inertia_of_parts_agrees_with_closed_forms():
    density = 2700.0
    block = solid_inertia([box((0.1, 0.04, 0.02), (0.3, -0.2, 0.1), (0, 0, 0))], density)
    mass = density * 0.1 * 0.04 * 0.02
    expected = mass / 12 * np.diag([0.04**2 + 0.02**2, 0.1**2 + 0.02**2, 0.1**2 + 0.04**2])
    assert block.mass == pytest.approx(mass)
    np.testing.assert_allclose(block.centre, [0.3, -0.2, 0.1])
    np.testing.assert_allclose(block.tensor, expected, atol=1e-12)
    # The same block in two halves: the parallel-axis theorem must put them together again.
    halves = solid_inertia([box((0.05, 0.04, 0.02), (0.3 + s * 0.025, -0.2, 0.1), (0, 0, 0)) for s in (-1, 1)], density)
    np.testing.assert_allclose(halves.tensor, expected, atol=1e-12)
    cylinder = solid_inertia([hull(cylinder_points(0.03, 0.0, 0.1, 256), (0, 0, 0))], 1000.0)
    assert cylinder.tensor[2, 2] == pytest.approx(0.5 * cylinder.mass * 0.03**2, rel=1e-3)  # 256 sides instead of a circle


def test_support_hull_is_small_and_close_to_the_full_hull():
    for link in range(8):
        mesh = robot().visuals()[f"lbr_iiwa_link_{link}"][0][0]
        full, small = convex_hull(mesh.vertices), support_hull(mesh.vertices, HULL_DIRECTIONS)
        assert len(small.vertices) <= 400
        assert small.is_watertight()
        planes = small.corners()[:, 0], small.normals()
        outside = ((full.vertices[:, None] - planes[0][None]) * planes[1][None]).sum(-1).max(1)
        assert outside.max() < 0.003, link


@settings(max_examples=50, deadline=None)
@given(st.tuples(st.floats(-3.1, 3.1), st.floats(-1.57, 1.57), st.floats(-3.1, 3.1)))
def test_roll_pitch_yaw_round_trip(rpy):
    rotation = rotation_from_rpy(rpy)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(rotation)), rotation, atol=1e-9)


def test_roll_pitch_yaw_where_the_pitch_is_a_right_angle():
    rotation = rotation_from_rpy((0.4, np.pi / 2, 0.3))
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(rotation)), rotation, atol=1e-9)


def test_numbers_carry_no_rounding_noise():
    assert number(-0.0) == "0"
    assert number(1e-19) == "0"
    assert number(0.1 + 0.2) == "0.3"


@pytest.mark.parametrize(
    "change", [{"stroke": 0.4}, {"mass": -1.0}, {"bar": float("nan")}, {"max_force": 5.0}, {"pad_size": (0.02, 0.027, 0.065)}]
)
def test_impossible_grippers_are_refused(change):
    with pytest.raises(InputError, match="gripper"):
        GripperDimensions(**change)


@pytest.mark.parametrize("width", [0.2, 0.135, 0.0, float("nan")])
def test_object_larger_than_the_gripper_is_refused(width):
    D.check_object(0.110, "cake")
    with pytest.raises(InputError, match=r"bear: .*opens 140 mm"):
        D.check_object(width, "bear")
