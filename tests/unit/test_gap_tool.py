"""Records of an arm's tool pose alone: where the tool is, what an effect does to it, and which effects are named from it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pybullet
import pytest
import yaml
from pybullet_utils.bullet_client import BulletClient

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.bullet_truth import BulletTruth
from gsbridge.gap.benchmark.generate import _joined
from gsbridge.gap.benchmark.mechanisms import arm_model
from gsbridge.gap.benchmark.mujoco_truth import MujocoTruth
from gsbridge.gap.benchmark.trajectories import KINDS, course
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.workflow import JointBackend

CENTRE, REACH = np.array([0.0, 0.4, 0.0, -1.2, 0.0, 0.8, 0.0]), np.full(7, 0.5)
LINK = "lbr_iiwa_link_7"
NOISE = 2e-4


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def bank(tmp_path_factory):
    """Signatures depend on commands and on the size of the noise alone, so that all cases here share them."""
    return tmp_path_factory.mktemp("bank")


def test_place_of_a_link_is_that_of_pybullet(model):
    system = read_mechanism_model(model)
    mechanism, rng = Mechanism(system), np.random.default_rng(0)
    client = BulletClient(pybullet.DIRECT)
    body = client.loadURDF(str(system.urdf), useFixedBase=True)
    numbers = {client.getJointInfo(body, k)[1].decode(): k for k in range(client.getNumJoints(body))}
    links = {client.getJointInfo(body, k)[12].decode(): k for k in range(client.getNumJoints(body))}
    for q in rng.uniform(-1.5, 1.5, (5, 7)):
        for name, value in zip(system.joints, q, strict=True):
            client.resetJointState(body, numbers[name], float(value))
        for link in (LINK, "lbr_iiwa_link_3"):
            theirs = client.getLinkState(body, links[link], computeForwardKinematics=1)[4]
            ours = mechanism.chain.place(link, q[None, mechanism.chain.order])[0]
            np.testing.assert_allclose(ours, theirs, atol=1e-6)
    client.disconnect()


def motion(system, truth, hidden, role, duration=4.0):
    """Commands and what a truth logs."""
    kind = KINDS[role]
    wanted = _joined(course(kind, CENTRE, REACH, duration, np.random.default_rng(len(role))), 100.0)
    times = np.arange(round(100 * duration)) / 100
    return times, np.array([wanted(t) for t in times]), truth(wanted, duration, times, hidden)


@pytest.mark.parametrize("engine", [BulletTruth, MujocoTruth])
def test_replayed_tool_is_that_of_the_engines(model, engine):
    system = read_mechanism_model(model)
    times, sent, logged = motion(system, engine(system), {}, "fit", 2.5)
    record = Record("fit", times, system.joints, {"command": sent}, {"tool": logged["tool"]})
    mechanism = Mechanism(system)
    state = (sent[0], np.zeros(7))
    out = mechanism.run(record, apply_effects(mechanism, ()), [(0, len(times))], [state])
    own = mechanism.chain.place(LINK, logged["position"][:, mechanism.chain.order])
    np.testing.assert_allclose(logged["tool"], own, atol=2e-6)
    # By the model's step of a millisecond.
    assert np.abs(out["tool"] - logged["tool"]).max() < 2e-4
    # An encoder's error shows in the pose of the tool; without joint positions in the record, it shows nowhere else.
    off = [Applied("encoder_offset", system.joints[1], {"angle": 0.01})]
    moved = mechanism.run(record, apply_effects(mechanism, off), [(0, len(times))], [state])
    arm = np.linalg.norm(logged["tool"][0] - [0, 0, 0.34])
    assert np.linalg.norm(moved["tool"][0] - out["tool"][0]) == pytest.approx(0.01 * arm, rel=0.05)


def test_tool_of_a_soft_joint_is_where_the_link_is(model):
    """At rest the link hangs behind the motor by the compliance times the torque."""
    system = read_mechanism_model(model)
    mechanism, times = Mechanism(system), np.arange(250) / 100
    record = Record("fit", times, system.joints, {"command": np.tile(CENTRE, (250, 1))}, {"tool": np.zeros((250, 3))})
    twist = 2e-3
    soft = [Applied("compliance", SECOND, {"compliance": twist})]
    out = mechanism.run(record, apply_effects(mechanism, soft), [(0, 250)], [(CENTRE, np.zeros(7))])
    motor, asked = out["position"][-1], out["effort"][-1]
    hangs = motor.copy()
    hangs[system.joints.index(SECOND)] -= twist * asked[system.joints.index(SECOND)]
    np.testing.assert_allclose(out["tool"][-1], mechanism.chain.place(LINK, hangs[None, mechanism.chain.order])[0], atol=5e-4)
    rigid = mechanism.chain.place(LINK, motor[None, mechanism.chain.order])[0]
    assert np.linalg.norm(out["tool"][-1] - rigid) > 0.01


def write_case(folder, model, hidden):
    """A case whose records hold commands and the tool."""
    system, rng = read_mechanism_model(model), np.random.default_rng(5)
    for role in KINDS:
        times, sent, logged = motion(system, MujocoTruth(system), hidden, role)
        columns = {"time [s]": times}
        columns |= {f"command.{name} [rad]": column for name, column in zip(system.joints, sent.T, strict=True)}
        seen = 1e3 * (logged["tool"] + NOISE * rng.standard_normal(logged["tool"].shape))
        columns |= {f"tool.{axis} [mm]": column for axis, column in zip("xyz", seen.T, strict=True)}
        pd.DataFrame(columns).to_csv(folder / f"{role}.csv", index=False)
    case = {"model": str(model), "records": {role: f"{role}.csv" for role in KINDS}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


LATE = {"command_delay", "lag", "clock_offset"}
SECOND = "lbr_iiwa_joint_2"


@pytest.mark.parametrize(
    ("hidden", "names"), [({}, None), ({"command_delay": 0.02}, LATE), ({f"coulomb:{SECOND}": 4.0}, {"coulomb"})]
)
def test_tool_alone_tells_what_is_missing(model, bank, tmp_path, hidden, names):
    work = JointBackend.read(write_case(tmp_path, model, hidden))
    assert any("no joint positions" in reason for reason in work.reasons)
    found = work.diagnose(bank, 0)
    if names is None:
        assert found["verdict"] == "no_discrepancy", found["sentence"]
        return
    said = [effect["name"] for effect in found["effects"]]
    assert found["verdict"] in ("named", "ambiguous"), found["sentence"]
    assert said[0] in names
    assert set(found["noise_floor"]) == {"tool.x", "tool.y", "tool.z"}
    assert found["noise_floor"]["tool.x"] == pytest.approx(NOISE, rel=0.15)
    values = [{name: row["value"] for name, row in effect["parameters"].items()} for effect in found["effects"]]
    effects = [Applied(e["name"], e["joint"], v) for e, v in zip(found["effects"], values, strict=True)]
    arrays, rows = work.replay(effects)
    assert rows["records"]["verify"]["channels"] == ["tool.x", "tool.y", "tool.z"]
    assert rows["records"]["verify"]["after"] < 0.5 * rows["records"]["verify"]["before"]
    assert arrays["verify/position"].shape == (400, 7)


def test_what_tells_no_tool_is_refused(model, tmp_path):
    path = write_case(tmp_path, model, {})
    content = yaml.safe_load(model.read_text(encoding="utf-8"))
    bare = tmp_path / "bare.yaml"
    bare.write_text(yaml.safe_dump({**content, "urdf": str(model.parent / "arm.urdf"), "tool": None}), encoding="utf-8")
    case = yaml.safe_load(path.read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump({**case, "model": str(bare)}), encoding="utf-8")
    with pytest.raises(InputError, match="does not say which link"):
        read_joint_case(path)
    bare.write_text(yaml.safe_dump({**content, "urdf": str(model.parent / "arm.urdf"), "tool": "hand"}), encoding="utf-8")
    with pytest.raises(InputError, match="no link 'hand'"):
        read_joint_case(path)
    table = pd.read_csv(tmp_path / "fit.csv").drop(columns="tool.y [mm]")
    table.to_csv(tmp_path / "fit.csv", index=False)
    path.write_text(yaml.safe_dump({**case, "model": str(model)}), encoding="utf-8")
    with pytest.raises(InputError, match=r"no 'tool\.y'"):
        read_joint_case(path)


@pytest.mark.parametrize(("change", "said"), [(1e3, "it looks like millimetres. State"), (None, "the model reaches 1")])
def test_a_tool_beyond_the_arms_reach_is_refused(model, tmp_path, change, said):
    """In millimetres that are called metres, and in the frame of a tracker that stands elsewhere."""
    path = write_case(tmp_path, model, {})
    for role in KINDS:
        table = pd.read_csv(tmp_path / f"{role}.csv")
        for axis in "xyz":
            seen = table.pop(f"tool.{axis} [mm]") / 1e3
            table[f"tool.{axis} [m]"] = seen * change if change else seen + 2.5
        table.to_csv(tmp_path / f"{role}.csv", index=False)
    with pytest.raises(InputError, match=r"the tool of 'fit' is logged [0-9.]+ m from the base") as error:
        JointBackend.read(path)
    assert said in str(error.value)
    assert ("millimetres" in str(error.value)) == bool(change)


def test_system_with_a_tool_is_another(model):
    system = read_mechanism_model(model)
    assert system.digest() != replace(system, tool="").digest()
