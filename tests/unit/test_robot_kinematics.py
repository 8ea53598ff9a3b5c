"""Kinematics against PyBullet, finite differences and a planar arm; inverse kinematics over the working area."""

import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_fixture import kinematics, robot

from gsbridge.errors import InputError
from gsbridge.geometry import rotation_angle
from gsbridge.robot import chain
from gsbridge.robot.chain import cholesky_solve, rotation_error
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.limits import ClippedCommands, JointLimits, Workspace
from gsbridge.robot.links import rotation_from_rpy, translation
from gsbridge.robot.nominal import WORK_CENTRE, base_from_table
from gsbridge.robot.reach import require_reach, residual_grid, tool_down
from gsbridge.robot.urdf import read_description, read_urdf
from gsbridge.robot.warmup import compile_kernels


def random_q(rng):
    limits = kinematics().arm_limits
    return np.r_[rng.uniform(limits.lower, limits.upper), rng.uniform(-0.03, 0.72)]


def test_forward_kinematics_agrees_with_pybullet():
    """Within 1e-6 m and 1e-6: PyBullet's own double arithmetic is left with the float32 numbers of its file reader."""
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(robot().urdf), useFixedBase=True, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, k, physicsClientId=client) for k in range(pybullet.getNumJoints(body, client))]
    index = {info[1].decode(): k for k, info in enumerate(infos)}
    moving = [info[1].decode() for info in infos if info[2] != pybullet.JOINT_FIXED]
    k, rng = kinematics(), np.random.default_rng(0)
    for _ in range(20):
        q = random_q(rng)
        values = k.joint_values(q)
        for name, value in values.items():
            pybullet.resetJointState(body, index[name], value, physicsClientId=client)
        poses = k.fk(q)
        for link, info in enumerate(infos):
            # Entries 4 and 5 are the link frame; 0 and 1 would be its centre of mass. PyBullet's quaternions are xyzw.
            state = pybullet.getLinkState(body, link, computeForwardKinematics=True, physicsClientId=client)
            pose = poses[info[12].decode()]
            np.testing.assert_allclose(state[4], pose[:3, 3], atol=1e-6)
            rotation = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
            np.testing.assert_allclose(rotation, pose[:3, :3], atol=2e-6)
        zeros = [0.0] * len(moving)
        tool = [info[12].decode() for info in infos].index("tool")
        found = pybullet.calculateJacobian(
            body, tool, [0, 0, 0], [float(values[name]) for name in moving], zeros, zeros, physicsClientId=client
        )
        columns = [moving.index(name) for name in k.arm_joints]
        np.testing.assert_allclose(np.concatenate(found)[:, columns], k.jacobian(q)[:, :7], atol=2e-6)
    pybullet.disconnect(client)


@pytest.mark.parametrize("link", ["tool", "left_pad", "right_bar", "lbr_iiwa_link_4"])
def test_jacobian_agrees_with_finite_differences(link):
    """Of the coupled fingers too: a follower counts for the coordinate it follows."""
    k, step = kinematics(), 1e-6
    q = random_q(np.random.default_rng(3))
    jacobian = k.jacobian(q, link)
    for column in range(len(q)):
        ahead, behind = (k.fk(q + s * step * np.eye(8)[column], [link])[link] for s in (1, -1))
        np.testing.assert_allclose(jacobian[:3, column], (ahead - behind)[:3, 3] / (2 * step), atol=1e-8)
        turn = (ahead[:3, :3] - behind[:3, :3]) @ k.fk(q, [link])[link][:3, :3].T / (2 * step)
        np.testing.assert_allclose(jacobian[3:, column], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-8)


def test_many_postures_at_once_equal_one_by_one():
    k, rng = kinematics(), np.random.default_rng(4)
    many = np.stack([random_q(rng) for _ in range(6)]).reshape(2, 3, 8)
    together = k.fk(many, ["tool", "left_pad"])
    assert together["tool"].shape == (2, 3, 4, 4)
    np.testing.assert_array_equal(together["left_pad"][1, 2], k.fk(many[1, 2], ["left_pad"])["left_pad"])
    np.testing.assert_array_equal(k.fk(many[..., :7], ["tool"])["tool"], together["tool"])
    assert k.joint_values(many)["right_pad_joint"] == pytest.approx(-many[..., 7])


def test_whole_working_area_is_within_reach():
    """Below 0.1 mm everywhere from 35 mm to 350 mm, yaw -90..90 deg, and no joint against its limit."""
    reach = residual_grid(kinematics(), base_from_table(), Workspace.around(), counts=(7, 7, 4, 3))
    assert reach.reached.all()
    assert reach.position_errors.max() < 1e-6
    assert reach.angle_errors.max() < 1e-5
    assert np.rad2deg(reach.margins.min()) > 3.0
    inner = residual_grid(
        kinematics(), base_from_table(), Workspace.around(side=0.30, heights=(0.05, 0.35)), counts=(7, 7, 4, 3)
    )
    assert np.rad2deg(inner.margins.min()) > 6.0


def test_solution_reaches_the_pose_within_limits_and_forgets_the_way_there():
    k, rng = kinematics(), np.random.default_rng(5)
    box = Workspace.around()
    for _ in range(30):
        target = base_from_table() @ tool_down(rng.uniform(box.lower, box.upper), rng.uniform(*box.yaw))
        first = k.inverse(target)
        again = k.inverse(target, first.q + rng.normal(0, 0.1, 7))
        assert first.converged
        assert again.converged
        assert k.arm_limits.inside(first.q).all()
        found = k.fk(first.q, ["tool"])["tool"]
        assert np.linalg.norm(found[:3, 3] - target[:3, 3]) == pytest.approx(first.position_error_m, abs=1e-9)
        assert float(rotation_angle(found[:3, :3].T @ target[:3, :3])) < 1e-6
        # The posture is settled to 10 tolerances per step, which leaves some 1e-5 rad.
        np.testing.assert_allclose(first.q, again.q, atol=5e-5)


def test_small_moves_give_small_joint_steps():
    """What the control loop does: 24 mm steps, each begun at the last command."""
    k = kinematics()
    q = k.inverse(base_from_table() @ tool_down([*WORK_CENTRE, 0.30])).q
    for step in range(12):
        angle = 2 * np.pi * step / 12
        point = [WORK_CENTRE[0] + 0.09 * np.sin(angle), WORK_CENTRE[1] + 0.09 * (1 - np.cos(angle)) / 2, 0.30 - 0.02 * step]
        found = k.inverse(base_from_table() @ tool_down(point, 0.1 * step), q)
        assert found.converged
        assert np.abs(found.q - q).max() < 0.35
        q = found.q


def test_out_of_reach_is_told_and_never_leaves_the_limits():
    k = kinematics()
    far = k.inverse(tool_down([1.6, 0.0, 0.3]))
    assert not far.converged
    # Fully stretched, shoulder to tool is at most 1.16 m with the hand pointing out.
    assert far.position_error_m > 0.3
    assert k.arm_limits.inside(far.q).all()
    assert np.isfinite(far.q).all()
    with pytest.raises(InputError, match="NaN"):
        k.inverse(np.full((4, 4), np.nan))


def test_inverse_is_repeatable_to_the_bit():
    target = base_from_table() @ tool_down([0.05, 0.2, 0.1], 0.4)
    np.testing.assert_array_equal(kinematics().inverse(target).q, kinematics().inverse(target).q)


@pytest.mark.parametrize("table", [translation(0.9, 0, -0.18), translation(0.60, 0, 0.5), translation(0.2, -0.265, -0.18)])
def test_table_out_of_reach_is_an_error_that_names_its_source(table):
    require_reach(kinematics(), base_from_table(), Workspace.around(), "registration.json")
    with pytest.raises(InputError, match=r"registration\.json: the arm misses \d+ of 225 tool poses"):
        require_reach(kinematics(), table, Workspace.around(), "registration.json")


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 1.0, 3.0, np.pi - 1e-10, np.pi])
def test_rotation_error_is_the_rotation_vector(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    cross = np.cross(np.eye(3), axis) * -1
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    current, target, out = np.eye(4), np.eye(4), np.empty(3)
    current[:3, :3] = rotation_from_rpy([0.3, -0.5, 1.0])
    target[:3, :3] = rotation @ current[:3, :3]
    assert rotation_error(target, current, out) == pytest.approx(angle, abs=1e-7)
    # At half a turn both senses are right.
    np.testing.assert_allclose(out * (np.sign(out @ axis) or 1.0), angle * axis, atol=1e-6)


def test_cholesky_solves():
    rng = np.random.default_rng(0)
    half, right = rng.normal(size=(6, 6)), rng.normal(size=(6, 2))
    matrix = half @ half.T + 0.1 * np.eye(6)
    found = right.copy()
    cholesky_solve(matrix.copy(), found)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9)


PLANAR = """<robot name="planar"><link name="ground"/><link name="upper"/><link name="tip"/>
<joint name="b" type="revolute"><parent link="upper"/><child link="tip"/><origin xyz="0.5 0 0"/><axis xyz="0 0 2"/>
<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
<joint name="a" type="revolute"><parent link="ground"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>%s</robot>"""


def test_joints_may_stand_in_any_order_in_the_file(tmp_path):
    path = tmp_path / "planar.urdf"
    path.write_text(PLANAR % "")
    k = Kinematics.read(path, rest=(0.0, 0.0), tip="tip")
    assert k.joints == ("a", "b")
    pose = k.fk([0.3, 0.4], ["tip"])["tip"]
    np.testing.assert_allclose(pose[:2, 3], [0.5 * np.cos(0.3), 0.5 * np.sin(0.3)])
    assert np.arctan2(pose[1, 0], pose[0, 0]) == pytest.approx(0.7)
    np.testing.assert_allclose(JointLimits.read(path, ["b"]).upper, [1.0])


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("<robot>", "no valid XML"),
        (PLANAR % '<link name="lost"/>', "no tree"),
        (
            PLANAR % '<joint name="c" type="prismatic"><parent link="tip"/><child link="d"/></joint><link name="d"/>',
            "c is prismatic",
        ),
        (PLANAR % '<joint name="c" type="fixed"><parent link="tip"/></joint>', "lacks"),
        (PLANAR % '<joint name="c" type="fixed"><parent link="x"/><child link="y"/></joint>', "parent of joint c"),
    ],
)
def test_bad_descriptions_are_named(tmp_path, content, problem):
    path = tmp_path / "bad.urdf"
    path.write_text(content)
    with pytest.raises(InputError, match=rf"bad\.urdf: .*{problem}"):
        read_urdf(path)
    with pytest.raises(InputError, match="it does not exist"):
        read_urdf(tmp_path / "none.urdf")


BODY = """<link name="tip2"><inertial><origin xyz="0 0 0.1"/><mass value="%s"/>
<inertia ixx="%s" iyy="2" izz="2" ixy="0" ixz="%s" iyz="0"/></inertial></link>
<joint name="c" type="fixed"><parent link="tip"/><child link="tip2"/></joint>"""


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('value="1"', 'value="nan"', "damaged mass properties"),
        ('value="1"', 'value="-1"', "its mass is -1 kg"),
        ('<mass value="1"/>', "", "damaged mass properties: it lacks"),
        ('ixx="2"', 'ixx="nan"', "damaged mass properties"),
        ('ixz="0"', 'ixz="3"', "no body has its inertia"),
        ('<axis xyz="0 0 2"/>', '<axis xyz="0 0 0"/>', "joint b has an axis of no length"),
        ('<axis xyz="0 0 2"/>', '<axis xyz="0 2"/>', "row of 3 numbers"),
        ('lower="-1"', 'lower="abc"', 'joint b: lower="abc" is no number'),
        ('upper="1"', 'upper="nan"', 'joint b: upper="nan" is no number'),
        ('<child link="tip2"/>', "", "joint c lacks <child link=>"),
        ('<parent link="ground"/>', '<parent link="wall"/>', "parent of joint a, 'wall', is not there"),
        ('<parent link="tip"/>', '<parent link="tip2"/>', "no tree: joint c hangs on itself"),
        ("</robot>", '<link name="ground"/></robot>', "'ground' is there twice as a link"),
        ('name="c" type="fixed"', 'name="b" type="fixed"', "'b' is there twice as a joint"),
        ("</robot>", '<link name="lost"/></robot>', r"2 links have no parent \(ground, lost\)"),
        ('name="c" type="fixed"', 'name="c" type="hinge"', "joint c is of the unknown type 'hinge'"),
        ('<limit lower="-2"', '<mimic joint="z"/><limit lower="-2"', "joint a follows 'z', which is no joint"),
        ("<robot", "<model", "its root is no <robot>"),
    ],
)
def test_a_damaged_description_is_one_clear_error(tmp_path, old, new, problem):
    content = PLANAR % (BODY % (1, 2, 0))
    path = tmp_path / "bad.urdf"
    path.write_text(content)
    assert read_description(path).inertials["tip2"].mass == 1.0
    assert old in content
    path.write_text(content.replace(old, new).replace("</robot>", "</model>" if new == "<model" else "</robot>"))
    with pytest.raises(InputError, match=problem) as told:
        read_description(path)
    assert "\n" not in str(told.value)
    assert "bad.urdf" in str(told.value)


def test_a_sliding_joint_keeps_its_metres(tmp_path):
    path = tmp_path / "lift.urdf"
    path.write_text(
        """<robot name="lift"><link name="ground"/><link name="cart"/><joint name="up" type="prismatic"><parent link="ground"/>
        <child link="cart"/><axis xyz="0 0 1"/><limit lower="-0.02" upper="0.3" velocity="0.1" effort="50"/>
        <dynamics damping="2" friction="3"/></joint></robot>"""
    )
    (joint,) = read_description(path).joints
    assert (joint.kind, joint.lower, joint.upper, joint.velocity, joint.effort) == ("prismatic", -0.02, 0.3, 0.1, 50.0)
    assert (joint.damping, joint.friction) == (2.0, 3.0)


@pytest.mark.parametrize(
    ("joint", "problem"),
    [
        ('<mimic joint="a" offset="0.1"/>', "coupled with an offset"),
        ("", "lacks <limit"),
    ],
)
def test_a_robot_needs_limits_and_plain_couplings(tmp_path, joint, problem):
    path = tmp_path / "bad.urdf"
    limit = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'
    path.write_text((PLANAR % "").replace(limit, joint + limit if joint else ""))
    assert read_description(path).base == "ground"
    with pytest.raises(InputError, match=problem):
        read_urdf(path)


def test_unknown_links_and_joints_are_named():
    with pytest.raises(InputError, match=r"'elbow'.*no such link"):
        kinematics().fk(kinematics().rest, ["elbow"])
    with pytest.raises(InputError, match="'elbow'"):
        JointLimits.read(robot().urdf, ["elbow"])
    with pytest.raises(InputError, match="'elbow'"):
        Kinematics.read(robot().urdf, tip="elbow")
    with pytest.raises(InputError, match="rest posture"):
        Kinematics.read(robot().urdf, rest=(0, 9, 0, 0, 0, 0, 0))
    with pytest.raises(ValueError, match="8 joint values"):
        kinematics().fk(np.zeros(5))


def test_joint_commands_keep_speed_and_range():
    limits = kinematics().arm_limits
    way = 10.0 * np.array([1.0, -0.5, 0.2, 0.1, 0.0, 0.3, -0.4])
    step = limits.follow(np.zeros(7), 0.1 * way, 0.1)
    # The joint that would be fastest sets the pace of all.
    np.testing.assert_allclose(step, 0.1 * way * step[0] / way[0] / 0.1)
    assert np.max(np.abs(step) / (0.1 * limits.velocity)) == pytest.approx(1.0)
    np.testing.assert_allclose(limits.follow(np.zeros(7), 1e-3 * way, 0.1), 1e-3 * way)
    np.testing.assert_allclose(limits.follow(limits.upper, limits.upper + 1, 0.1), limits.upper)
    assert (limits.margin(limits.upper + 0.1) < 0).all()


@given(point=st.tuples(*[st.floats(-1, 1)] * 3), yaw=st.floats(-4, 4))
def test_the_kernel_for_one_command_is_the_general_pose(point, yaw):
    out = np.empty((4, 4))
    chain.place_tool_down(base_from_table(), *point, yaw, out)
    np.testing.assert_allclose(out, base_from_table() @ tool_down(point, yaw), atol=1e-14)


def test_workspace_clips_counts_and_refuses_nan():
    commands = ClippedCommands(Workspace((0, 0, 0), (1, 1, 1), (-1.0, 1.0)))
    given = (([0.5, 0.5, 0.5], 0.0), ([0.5, -0.1, 2.0], 0.0), ([0.5, 0.5, 0.5], 1.5), ([0.1, 0.2, 0.3], 0.0))
    positions, yaws = zip(*(commands.clip(position, yaw) for position, yaw in given), strict=True)
    np.testing.assert_allclose(positions, [[0.5, 0.5, 0.5], [0.5, 0.0, 1.0], [0.5, 0.5, 0.5], [0.1, 0.2, 0.3]])
    np.testing.assert_allclose(yaws, [0.0, 0.0, 1.0, 0.0])
    assert (commands.commands, commands.clipped) == (4, 2)
    with pytest.raises(InputError, match="not finite"):
        commands.clip([0.1, np.nan, 0.3], 0.0)
    with pytest.raises(InputError, match="workspace"):
        Workspace((0, 0, 0), (1, -1, 1))
    assert Workspace.around().contains([*WORK_CENTRE, 0.1])
    assert not Workspace.around().contains([0.3, 0.3, 0.1])


def test_warm_up_compiles_every_kernel():
    compile_kernels()
    for kernel in (chain.place_links, chain.tool_jacobian, chain.solve_inverse):
        assert kernel.signatures
        count = len(kernel.signatures)
        kinematics().inverse(base_from_table() @ tool_down([*WORK_CENTRE, 0.2]))
        kinematics().jacobian(kinematics().rest)
        # The torque law, compiled in this very process, adds a form of its own; what counts is that use adds none.
        assert len(kernel.signatures) == count
