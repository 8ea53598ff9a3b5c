"""Descriptions of robots that are well formed but make no sense, and files that are no text."""

import os
from pathlib import Path

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.description import read_mechanism_description, stated_besides
from gsbridge.robot.urdf import collision_meshes, read_description
from tests.fuzz.samples import MJCF, URDF, Reader, write_case
from tests.fuzz.test_readers import read_within

LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="3"/>'


def joint(limit: str) -> bytes:
    """The arm with another limit."""
    return URDF.replace(LIMIT, limit).encode()


ODD = {
    "limits the wrong way round": joint('<limit lower="2" upper="-2" effort="10" velocity="3"/>'),
    "a damping below zero": joint(f'{LIMIT}<dynamics damping="-1"/>'),
    "a friction below zero": joint(f'{LIMIT}<dynamics friction="-1"/>'),
    "xacro": joint('<limit lower="${low}" upper="2" effort="10" velocity="3"/>'),
    "xacro under another name": URDF.replace(
        '<robot name="arm">', '<robot name="arm" xmlns:xacro="http://ros.org/xacro"><xacro:include filename="rest.xacro"/>'
    ).encode(),
    "an argument of xacro": joint('<limit lower="$(arg low)" upper="2" effort="10" velocity="3"/>'),
    "utf-32": URDF.encode("utf-32"),
    "another encoding than it says": b'<?xml version="1.0" encoding="utf-16"?>' + URDF.encode(),
    "an unknown encoding": b'<?xml version="1.0" encoding="klingon"?>' + URDF.encode(),
    "an encoding of several bytes": b'<?xml version="1.0" encoding="gb2312"?>' + URDF.encode(),
    "bytes of latin-1": URDF.replace("upper", "\xfcber").encode("latin-1"),
    "zero bytes": URDF.replace("upper", "up\0per").encode(),
    "nothing": b"",
}


@pytest.mark.parametrize("reader", [read_description, read_mechanism_description])
@pytest.mark.parametrize("what", ODD)
def test_descriptions_that_mean_nothing_are_refused(what, reader, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(ODD[what])
    with pytest.raises(InputError) as said:
        reader(path)
    assert "\n" not in str(said.value)
    assert isinstance(collision_meshes(path), list)


def test_an_effort_and_a_speed_of_minus_one_are_no_limits(tmp_path):
    (tmp_path / "arm.urdf").write_bytes(joint('<limit lower="-2" upper="2" effort="-1" velocity="-1"/>'))
    (found,) = read_description(tmp_path / "arm.urdf").joints
    assert (found.effort, found.velocity) == (0.0, 0.0)


def test_a_mesh_may_be_named_as_ros_finds_it(tmp_path):
    visual = '<visual><geometry><mesh filename="$(find arm)/a.stl"/></geometry></visual></link></robot>'
    (tmp_path / "arm.urdf").write_text(
        URDF.replace("</robot>", f'<link name="x">{visual}').replace(
            '<link name="x">', '<joint name="f" type="fixed"><parent link="upper"/><child link="x"/></joint><link name="x">'
        )
    )
    assert len(read_description(tmp_path / "arm.urdf").joints) == 2


@pytest.mark.parametrize("text", ["\ufeff" + URDF, '<?xml version="1.0" encoding="UTF-8"?>' + URDF])
def test_marks_of_an_encoding_are_read(text, tmp_path):
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    assert read_description(tmp_path / "arm.urdf").base == "base"


@pytest.mark.parametrize("reader", [read_description, read_mechanism_description, collision_meshes])
def test_pipes_folders_and_long_names_are_no_descriptions(reader, tmp_path):
    os.mkfifo(tmp_path / "pipe.urdf")
    (tmp_path / "folder.urdf").mkdir()
    for name in ("pipe.urdf", "folder.urdf", "x" * 5000, "a\0b", "none.urdf"):

        def read(path: Path, name: str = name) -> None:
            try:
                assert reader(path / name) == []
            except InputError:
                assert reader is not collision_meshes

        read_within(Reader(lambda folder: folder, read), tmp_path)


def test_many_joints_are_read_in_the_order_of_the_tree(tmp_path):
    """Ten thousand, the last of which stand first in the file."""
    count = 10_000
    links = "".join(f'<link name="l{number}"/>' for number in range(count + 1))
    joints = "".join(
        f'<joint name="j{number}" type="fixed"><parent link="l{number}"/><child link="l{number + 1}"/></joint>'
        for number in reversed(range(count))
    )
    (tmp_path / "long.urdf").write_text(f'<robot name="long">{links}{joints}</robot>')

    def read(path: Path) -> None:
        found = read_description(path)
        assert found.base == "l0"
        assert [joint.name for joint in found.joints] == [f"j{number}" for number in range(count)]

    read_within(Reader(lambda folder: folder, read), tmp_path / "long.urdf")


def test_a_circle_of_links_is_told(tmp_path):
    joints = "".join(
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'
        for name, parent, child in (("a", "x", "y"), ("b", "y", "x"))
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/><link name="x"/><link name="y"/>{joints}</robot>')
    with pytest.raises(InputError, match="joint a hangs on itself"):
        read_description(tmp_path / "arm.urdf")


def test_a_finger_that_follows_is_told_where_it_stands_still(tmp_path):
    path = write_case(tmp_path)
    finger = (
        '<link name="finger"><inertial><mass value="0.2"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0"'
        ' izz="0.001"/></inertial></link><joint name="follower" type="revolute"><parent link="upper"/><child link="finger"/>'
        f'<axis xyz="0 1 0"/>{LIMIT}<mimic joint="shoulder" multiplier="-1"/></joint></robot>'
    )
    assert not any("follower" in reason for reason in read_joint_case(path).reasons)
    (tmp_path / "arm.urdf").write_text(URDF.replace("</robot>", finger))
    (reason,) = [reason for reason in read_joint_case(path).reasons if "follower" in reason]
    assert "follows 'shoulder'" in reason
    assert "0.2 kg" in reason


def test_a_mujoco_model_without_gravity_has_none(tmp_path):
    (tmp_path / "arm.xml").write_text(MJCF.replace("<mujoco>", '<mujoco><option gravity="0 0 -3"/>'))
    assert np.array_equal(stated_besides(read_mechanism_description(tmp_path / "arm.xml")).gravity, [0, 0, -3])
    (tmp_path / "arm.xml").write_text(MJCF.replace("<mujoco>", '<mujoco><option><flag gravity="disable"/></option>'))
    assert np.array_equal(stated_besides(read_mechanism_description(tmp_path / "arm.xml")).gravity, [0, 0, 0])


MUJOCO = {
    "a body that is lifted": MJCF.replace('<body name="upper">', '<body name="upper" gravcomp="1">'),
    "limits the wrong way round": MJCF.replace('"-90 90"', '"90 -90"'),
    "a pipe that is included": MJCF.replace("<mujoco>", '<mujoco><include file="pipe.xml"/>'),
    "a pipe that an included file includes": MJCF.replace("<mujoco>", '<mujoco><include file="other.xml"/>'),
    "a pipe as a mesh": MJCF.replace("<mujoco>", '<mujoco><asset><mesh name="m" file="pipe.stl"/></asset>'),
    "a pipe in another folder of meshes": MJCF.replace(
        "<mujoco>", '<mujoco><compiler/><compiler meshdir="assets"/><asset><mesh name="m" file="pipe.stl"/></asset>'
    ),
    "a pipe in the folder of textures": MJCF.replace(
        "<mujoco>",
        '<mujoco><compiler texturedir="assets"/><asset><texture name="t" type="cube" fileright="pipe.png"/></asset>',
    ),
    "a pipe by its bare name": MJCF.replace(
        "<mujoco>", '<mujoco><compiler strippath="true"/><asset><mesh name="m" file="far/pipe.stl"/></asset>'
    ),
    "a name that no system takes": MJCF.replace("<mujoco>", f'<mujoco><include file="{"x" * 5000}.xml"/>'),
}


@pytest.mark.parametrize("what", MUJOCO)
def test_mujoco_models_that_mean_nothing_are_refused(what, tmp_path):
    os.mkfifo(tmp_path / "pipe.xml")
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "assets").mkdir()
    os.mkfifo(tmp_path / "assets/pipe.png")
    os.mkfifo(tmp_path / "assets/pipe.stl")
    (tmp_path / "other.xml").write_text('<mujoco><include file="pipe.xml"/></mujoco>')
    (tmp_path / "arm.xml").write_text(MUJOCO[what])

    def read(path: Path) -> None:
        with pytest.raises(InputError):
            read_mechanism_description(path)

    read_within(Reader(lambda folder: folder, read), tmp_path / "arm.xml")


def test_degrees_and_radians_of_mujoco_are_told_apart(tmp_path):
    for compiler, text in (("", '"-90 90"'), ('<compiler angle="radian"/>', '"-1.5707963267948966 1.5707963267948966"')):
        (tmp_path / "arm.xml").write_text(MJCF.replace("<mujoco>", f"<mujoco>{compiler}").replace('"-90 90"', text))
        (found,) = read_mechanism_description(tmp_path / "arm.xml").joints
        assert (found.lower, found.upper) == pytest.approx((-np.pi / 2, np.pi / 2))
