"""The description as physics engines read it: PyBullet's masses, inertias and limits; the same bytes every time."""

import hashlib

import numpy as np
import pybullet
import pytest
from robot_fixture import kinematics, robot

from gsbridge.errors import InputError
from gsbridge.robot.assembly import ARM_EFFORT, ARM_JOINTS, ARM_VELOCITY_DEG, RobotFiles, build_robot
from gsbridge.robot.gripper import GripperDimensions, gripper_links
from gsbridge.robot.nominal import flange_from_camera, flange_from_gripper


@pytest.fixture
def engine():
    client = pybullet.connect(pybullet.DIRECT)
    yield client
    pybullet.disconnect(client)


def load(engine):
    body = pybullet.loadURDF(
        str(robot().urdf), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=engine
    )
    infos = [pybullet.getJointInfo(body, k, physicsClientId=engine) for k in range(pybullet.getNumJoints(body, engine))]
    return body, infos


def test_pybullet_takes_masses_inertias_and_limits_as_meant(engine):
    body, infos = load(engine)
    record, seen = robot().record, {}
    expected = {link.name: link.inertia for link in gripper_links(GripperDimensions(), "flange", flange_from_gripper())[0]}
    for index, info in enumerate(infos):
        name, joint = info[12].decode(), info[1].decode()
        seen[name] = pybullet.getDynamicsInfo(body, index, physicsClientId=engine)
        mass, principal = seen[name][0], np.sort(seen[name][2])
        assert mass == pytest.approx(record["masses"][name], rel=1e-6, abs=1e-12)
        if mass > 0:
            assert (principal > 0).all()
            assert principal[2] <= principal[0] + principal[1]
        if name in expected:
            np.testing.assert_allclose(principal, np.linalg.eigvalsh(expected[name].tensor), rtol=1e-3)
        # Neither damping nor friction comes from the file: the simulation model sets them.
        assert info[6] == 0
        assert info[7] == 0
        if joint in record["limits"]:
            limits = record["limits"][joint]
            assert info[8:12] == pytest.approx([limits[key] for key in ("lower", "upper", "effort", "velocity")])
    # A frame without mass must not be filled up with PyBullet's 1 kg.
    assert seen["tool"][0] == seen["flange"][0] == 0
    assert sum(item[0] for item in seen.values()) == pytest.approx(17.5 + 1.025 + 0.072)


def test_gravity_torques_of_frames_without_mass_are_finite(engine):
    """PyBullet's inverse dynamics over the whole tree, against gravity's virtual work in our own kinematics."""
    body, infos = load(engine)
    pybullet.setGravity(0, 0, -9.81, physicsClientId=engine)
    k, q = kinematics(), np.r_[kinematics().rest, 0.3]
    values = k.joint_values(q)
    moving = [info[1].decode() for info in infos if info[2] != pybullet.JOINT_FIXED]
    found = pybullet.calculateInverseDynamics(
        body, [float(values[name]) for name in moving], [0.0] * len(moving), [0.0] * len(moving), physicsClientId=engine
    )
    centres = {
        info[12].decode(): pybullet.getDynamicsInfo(body, index, physicsClientId=engine) for index, info in enumerate(infos)
    }

    def height_energy(arm):
        poses = k.fk(np.r_[arm, 0.3])
        return sum(9.81 * item[0] * (poses[name] @ [*item[3], 1.0])[2] for name, item in centres.items())

    step = 1e-6
    for index, joint in enumerate(ARM_JOINTS):
        shift = step * np.eye(7)[index]
        torque = (height_energy(q[:7] + shift) - height_energy(q[:7] - shift)) / (2 * step)
        assert found[moving.index(joint)] == pytest.approx(torque, abs=1e-3)


def test_limits_are_the_data_sheets():
    limits = kinematics().arm_limits
    assert limits.names == ARM_JOINTS
    np.testing.assert_allclose(limits.velocity, np.deg2rad(ARM_VELOCITY_DEG), rtol=1e-9)
    np.testing.assert_allclose(limits.effort, ARM_EFFORT)
    np.testing.assert_allclose(np.rad2deg(limits.upper), [170, 120, 170, 120, 170, 120, 175], atol=1e-6)


def test_the_same_input_gives_the_same_bytes(tmp_path):
    def digests(folder):
        return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}

    first = build_robot(tmp_path / "one")
    second = build_robot(tmp_path / "two", GripperDimensions(), flange_from_camera())
    assert digests(first.folder) == digests(second.folder) == digests(robot().folder)
    assert str(tmp_path) not in first.urdf.read_text()
    assert "Redistributions of source code must retain" in first.urdf.read_text()
    moved = flange_from_camera()
    moved[0, 3] += 0.001
    assert digests(build_robot(tmp_path / "one", None, moved).folder) != digests(second.folder)


def test_camera_stands_where_it_was_registered(tmp_path):
    wanted = flange_from_camera(0.07, 0.01, 0.3)
    wanted[1, 3] = 0.012
    files = build_robot(tmp_path / "robot", None, wanted)
    found = type(kinematics()).read(files.urdf).fk(kinematics().rest, ["flange", "camera", "tool"])
    np.testing.assert_allclose(np.linalg.inv(found["flange"]) @ found["camera"], wanted, atol=1e-10)
    np.testing.assert_allclose(np.linalg.inv(found["flange"]) @ found["tool"], files.flange_from_tool, atol=1e-10)
    np.testing.assert_allclose(files.flange_from_camera, wanted)
    assert RobotFiles.read(files.folder).dimensions == GripperDimensions()


def test_nominal_camera_sees_the_tool_point_in_its_lower_half():
    """The point between the pads lies in view (field of view 42.5 deg), below the middle, with image up away from the base."""
    found = kinematics().fk(kinematics().rest, ["camera", "tool"])
    x, y, z = (np.linalg.inv(found["camera"]) @ found["tool"])[:3, 3]
    edge = np.tan(np.deg2rad(42.5 / 2))
    assert z > 0.15
    assert abs(x / z) < 1e-9
    assert 0 < y / z < edge
    assert -found["camera"][0, 1] > 0.9


@pytest.mark.parametrize(
    "pose", [np.eye(3), np.full((4, 4), np.nan), np.diag([2.0, 2.0, 2.0, 1.0]), np.diag([1.0, 1.0, -1.0, 1.0])]
)
def test_camera_poses_that_are_no_transforms_are_refused(tmp_path, pose):
    with pytest.raises(InputError, match="flange_from_camera"):
        build_robot(tmp_path / "robot", None, pose)
    assert not (tmp_path / "robot").exists()


def test_incomplete_robot_is_named(tmp_path):
    files = build_robot(tmp_path / "robot")
    (files.folder / "left_bar.obj").unlink()
    with pytest.raises(InputError, match=r"left_bar\.obj"):
        RobotFiles.read(files.folder)
    with pytest.raises(InputError, match=r"robot\.json"):
        RobotFiles.read(tmp_path)


def test_mujoco_reads_the_same_robot():
    """Frames without mass survive, couplings become constraints, and both trees place every link alike."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(robot().urdf))
    assert (model.nq, model.neq) == (11, 3)
    k, data, rng = kinematics(), mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(5):
        q = np.r_[rng.uniform(k.arm_limits.lower, k.arm_limits.upper), rng.uniform(0.0, 0.7)]
        for name, value in k.joint_values(q).items():
            data.joint(name).qpos = value
        mujoco.mj_forward(model, data)
        for link, pose in k.fk(q).items():
            np.testing.assert_allclose(data.body(link).xpos, pose[:3, 3], atol=1e-12)
            np.testing.assert_allclose(data.body(link).xmat.reshape(3, 3), pose[:3, :3], atol=1e-12)
