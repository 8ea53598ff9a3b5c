"""Mechanisms that others have published: URDFs that hang on a world without a link, and MJCF against MuJoCo itself."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from gsbridge.errors import InputError
from gsbridge.gap.formats.description_file import read_description_root
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.joints.mechanism.chain import Chain
from gsbridge.gap.joints.mechanism.description import read_mechanism_description
from gsbridge.gap.joints.mechanism.dynamics import bias, inertia, place, spread
from gsbridge.gap.joints.mechanism.inertials import Skeleton
from gsbridge.gap.joints.mechanism.joint_kernel import LOADS
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model, read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.robot.mjcf_files import mjcf_files
from gsbridge.robot.urdf import read_description

INERTIAL = '<inertial><mass value="1"/><origin xyz="0 0 -0.3"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'
HANGING = f"""<robot xmlns="https://drake.mit.edu" name="pendulum">
<joint name="weld" type="fixed"><parent link="world"/><child link="base"/><axis xyz="0 0 0"/></joint>
<link name="base"/><link name="rod">{INERTIAL}</link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0" effort="0" velocity="0"/><dynamics damping="0.1"/></joint>
<transmission type="SimpleTransmission" name="t"><actuator name="e"/><joint name="hinge"/></transmission></robot>"""

ARM = """<mujoco model="arm"><compiler angle="degree" autolimits="true"/><option gravity="0.5 0 -9.7"/>
<include file="defaults.xml"/>
<worldbody><body name="column" pos="0.1 0 0.2" quat="0.96 0.1 0.2 0.05">
  <inertial pos="0.01 0.02 0.1" mass="3" diaginertia="0.03 0.02 0.01" quat="0.9 0.1 0.3 0.2"/>
  <joint name="lift" type="slide" axis="0 0.2 1" range="-0.2 0.3" damping="4" ref="0.05"/>
  <joint name="turn" axis="0.1 0 1" pos="0.05 0.02 0" range="-90 90" frictionloss="0.3" armature="0.02" ref="20"/>
  <body name="plate" pos="0.1 0 0.3"><inertial pos="0 0 0.05" mass="0.5" diaginertia="0.001 0.001 0.001"/>
    <body name="arm" pos="0.2 0.1 0" euler="10 20 30"><geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/>
      <joint name="elbow" axis="0 1 0" pos="-0.02 0 0.01"/></body></body>
  </body></worldbody>
<actuator><motor joint="elbow" gear="20"/></actuator></mujoco>"""
DEFAULTS = '<mujocoinclude><default><geom density="800"/></default></mujocoinclude>'


def write(folder: Path, text: str, name: str = "arm.xml") -> Path:
    (folder / name).write_text(text)
    (folder / "defaults.xml").write_text(DEFAULTS)
    key = "mjcf" if name.endswith(".xml") else "urdf"
    (folder / "model.yaml").write_text(yaml.safe_dump({key: name, "controller": {"mode": "free"}}))
    return folder / "model.yaml"


def test_a_world_that_has_no_link_and_a_name_space(tmp_path):
    system = read_mechanism_model(write(tmp_path, HANGING, "pendulum.urdf"))
    assert system.joints == ("hinge",)
    assert system.viscous == [0.1]
    skeleton = Skeleton.read(system.urdf, system.joints)
    assert skeleton.description.base == "world"
    # The URDF that is written again holds every link, as engines require.
    skeleton.write(tmp_path / "plain.urdf", skeleton.inertials)
    assert read_description(tmp_path / "plain.urdf").links == ("world", "base", "rod")


FRAMES = """<robot name="arm"><link name="base"/><link name="frame"/><link name="metal"/><link name="hand"/><link name="jaw"/>
<link name="other_jaw"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="frame"/><axis xyz="0 1 0"/></joint>
<joint name="bolts" type="fixed"><parent link="frame"/><child link="metal"/>
<origin xyz="0.1 0 0.2" rpy="0 0 1.5707963267948966"/></joint>
<joint name="flange" type="fixed"><parent link="metal"/><child link="hand"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="jaw"/><axis xyz="0 1 0"/><origin xyz="0 0 0.3"/></joint>
<joint name="other_grip" type="prismatic"><parent link="hand"/><child link="other_jaw"/><mimic joint="grip"/></joint>
</robot>"""


def test_a_frame_without_mass_takes_that_of_links_that_are_fixed_to_it(tmp_path):
    inertial = '<inertial><mass value="{}"/><origin xyz="0.1 0 0"/><inertia ixx="0.1" iyy="0.2" izz="0.3"/></inertial>'
    text = FRAMES
    for name, mass in (("metal", 3), ("jaw", 1)):
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{inertial.format(mass)}</link>')
    (tmp_path / "arm.urdf").write_text(text)
    skeleton = Skeleton.read(tmp_path / "arm.urdf", ("hinge",))
    frame = skeleton.inertials["frame"]
    assert frame.mass == 4.0
    # The metal's centre is turned to y, the jaw's too, from 0.3 m higher.
    np.testing.assert_allclose(frame.centre, [0.1, 0.1, 0.2 + 0.3 / 4], atol=1e-12)
    # About x: the metal's y; by Steiner as two masses at 0.3 m.
    np.testing.assert_allclose(frame.inertia[0, 0], 0.2 + 0.2 + 3 * 1 / 4 * 0.3**2, atol=1e-12)
    assert {"metal", "jaw"}.isdisjoint(skeleton.inertials)
    # A link with mass of its own stays as it is, and what another joint moves is not fixed.
    apart = Skeleton.read(tmp_path / "arm.urdf", ("hinge", "grip"))
    assert (apart.inertials["frame"].mass, apart.inertials["jaw"].mass) == (3.0, 1.0)


def test_a_joint_with_nothing_to_move_is_refused(tmp_path):
    path = write(
        tmp_path,
        HANGING.replace(INERTIAL, '<inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'),
        "p.urdf",
    )
    with pytest.raises(InputError, match="joint 'hinge' moves neither mass nor inertia"):
        Mechanism(read_mechanism_model(path))
    path.write_text(path.read_text() + "armature: 0.1\n")
    Mechanism(read_mechanism_model(path))


def test_joints_that_follow_others_are_not_driven(tmp_path):
    assert read_mechanism_model(write(tmp_path, FRAMES, "arm.urdf")).joints == ("hinge", "grip")


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x.xacro"/><link name="base"/></robot>',
        HANGING.replace('lower="0"', 'lower="${-pi}"'),
    ],
)
def test_a_xacro_file_is_to_be_expanded(tmp_path, text):
    with pytest.raises(InputError, match=r"xacro file\. Expand it first: xacro arm\.urdf > arm_expanded\.urdf"):
        read_mechanism_model(write(tmp_path, text, "arm.urdf"))


def test_only_the_world_may_be_left_out(tmp_path):
    with pytest.raises(InputError, match="'wall', is not there"):
        read_mechanism_model(write(tmp_path, HANGING.replace('link="world"', 'link="wall"'), "pendulum.urdf"))


def test_mjcf_has_the_dynamics_of_mujoco(tmp_path):
    """Inertia and bias forces at random states, several joints on a body, anchors, references and turned frames included."""
    system = read_mechanism_model(write(tmp_path, ARM))
    assert system.joints == ("lift", "turn", "elbow")
    assert system.sliding == ("lift",)
    np.testing.assert_allclose(system.gravity, [0.5, 0.0, -9.7])
    np.testing.assert_allclose(system.viscous, [4.0, 0.0, 0.0])
    np.testing.assert_allclose(system.coulomb, [0.0, 0.3, 0.0])
    np.testing.assert_allclose(system.armature, [0.0, 0.02, 0.0])
    np.testing.assert_allclose(system.limits[:2], [[-0.2, 0.3], [-np.pi / 2, np.pi / 2]])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    skeleton = Skeleton.read(system.urdf, system.joints)
    chain = Chain.of(skeleton, system.joints)
    bodies, count = chain.bodies(skeleton.inertials), len(system.joints)
    np.testing.assert_array_equal(chain.order, np.arange(count))
    for _ in range(5):
        data.qpos[:], data.qvel[:] = rng.uniform(-1, 1, count), rng.uniform(-2, 2, count)
        mujoco.mj_forward(model, data)
        theirs = np.zeros((count, count))
        mujoco.mj_fullM(model, data, theirs)
        turn, origin, axis = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
        screws, loads, work = np.empty((count, 6)), np.empty((count, LOADS)), np.empty((count, 18))
        ours, hold = np.empty((count, count)), np.empty(count)
        place(chain.parents, chain.fixed, chain.axes, chain.slides, data.qpos.copy(), turn, origin, axis)
        spread(chain.slides, bodies, turn, origin, axis, screws, loads)
        # The inertia's kernel sums loads up in place, as a replay does it.
        bias(chain.parents, screws, loads, system.gravity, data.qvel.copy(), work, hold)
        inertia(chain.parents, screws, loads, ours)
        np.testing.assert_allclose(ours + np.diag(system.armature), theirs, atol=1e-9)
        np.testing.assert_allclose(hold, data.qfrc_bias, atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('axis="0 1 0" pos="-0.02 0 0.01"/>', 'type="ball"/>', "'elbow' is a ball joint"),
        ('pos="-0.02 0 0.01"/>', 'stiffness="3"/>', r"'elbow' has a spring \(stiffness 3\).*effect 'spring'"),
        ("<actuator>", '<equality><joint joint1="turn" joint2="elbow"/></equality><actuator>', "constraints of <equality>"),
        (
            "<actuator>",
            '<tendon><fixed name="t"><joint joint="turn" coef="1"/></fixed></tendon><actuator>',
            "has 1 tendons.*take them out",
        ),
        ("<worldbody>", "<worldbody><oops/>", "MuJoCo cannot read it"),
    ],
)
def test_what_no_tree_of_hinges_and_slides_can_say_is_refused(tmp_path, old, new, said):
    text = ARM.replace(old, new)
    assert text != ARM
    with pytest.raises(InputError, match=said) as error:
        read_mechanism_model(write(tmp_path, text))
    assert "\n" not in str(error.value)


def test_a_model_has_one_description(tmp_path):
    write(tmp_path, ARM)
    with pytest.raises(InputError, match="both a URDF and an MJCF"):
        parse_mechanism_model({"urdf": "a.urdf", "mjcf": "arm.xml", "controller": {"mode": "free"}}, tmp_path)


def test_what_an_mjcf_includes_is_watched_and_counts(tmp_path):
    model = write(tmp_path, ARM)
    (tmp_path / "case.yaml").write_text("model: model.yaml\nrecords: {}\n")
    assert tmp_path / "defaults.xml" in case_files(tmp_path / "case.yaml")
    before = read_mechanism_model(model).digest()
    (tmp_path / "defaults.xml").write_text(DEFAULTS.replace("800", "900"))
    assert read_mechanism_model(model).digest() != before


@pytest.mark.parametrize("key", ["urdf", "mjcf"])
def test_a_pipe_is_no_description_and_nobody_waits_for_it(tmp_path, key):
    """Neither the workflow, which looks for files that a description names, nor the reader."""
    os.mkfifo(tmp_path / "pipe.xml")
    assert mjcf_files(tmp_path / "pipe.xml") == []
    with pytest.raises(InputError, match=rf"it is a folder, a device or a pipe\. Check '{key}' in model\.yaml"):
        read_description_root(tmp_path / "pipe.xml", key, "model.yaml")


def test_an_encoding_that_nobody_knows_does_not_stop_the_planning(tmp_path):
    """The reader tells it afterwards."""
    path = tmp_path / "arm.xml"
    path.write_text('<?xml version="1.0" encoding="martian"?><mujoco/>')
    assert mjcf_files(path) == []
    with pytest.raises(InputError, match="no valid XML"):
        read_description_root(path, "mjcf", "model.yaml")


@pytest.mark.parametrize(
    "inside",
    [
        '<worldbody><replicate count="100000000"><body><joint/><geom size="1"/></body></replicate></worldbody>',
        '<worldbody><replicate count="9999"><replicate count="9999"><body><joint/></body></replicate></replicate></worldbody>',
        '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>',
        '<asset><texture type="2d" name="t" builtin="flat" width="100000" height="100000"/></asset>',
    ],
)
def test_a_few_words_of_mjcf_that_stand_for_too_much_are_refused_at_once(tmp_path, inside):
    """MuJoCo worked on the first without an end, and asked for 14 GB for the third. An included file is no way round."""
    (tmp_path / "arm.xml").write_text(f"<mujoco>{inside}</mujoco>")
    (tmp_path / "outer.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    for name in ("arm.xml", "outer.xml"):
        with pytest.raises(InputError, match="stands for more than a mechanism has"):
            read_mechanism_description(tmp_path / name)
