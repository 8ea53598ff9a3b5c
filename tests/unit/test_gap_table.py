"""A table in the way of an arm: forces against virtual work, and the name against MuJoCo's own contacts."""

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml

from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.workflow import run_case

JOINTS = ("shoulder", "elbow")
STIFFNESS, DAMPING, ROTOR = 60.0, 4.0, 0.05
URDF = """<robot name="two"><link name="base"/>
<joint name="shoulder" type="revolute"><origin xyz="0 0 0.3"/><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="99" velocity="9"/></joint>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="1.0"/>
<inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><origin xyz="0.4 0 0"/><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="99" velocity="9"/></joint>
<link name="lower"><inertial><origin xyz="0.15 0 0"/><mass value="0.6"/>
<inertia ixx="0.001" iyy="0.005" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="flange" type="fixed"><origin xyz="0.3 0 0"/><parent link="lower"/><child link="tip"/></joint>
<link name="tip"/></robot>"""
MODEL = {
    "urdf": "arm.urdf", "armature": ROTOR, "physics_rate": 500,
    "controller": {"mode": "pd", "rate": 500, "stiffness": STIFFNESS, "damping": DAMPING, "gravity_compensation": 0.0},
}  # fmt: skip
TABLE = -0.02


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(MODEL), encoding="utf-8")
    return tmp_path


def commands(time, seed, middle=(0.55, 0.3)):
    """Slow sweeps around a posture; around the first of these they reach below the table now and then."""
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(0.25, 0.5, 2), rng.uniform(0, 6, 2)
    begun = np.clip(time / 1.0, 0, 1)[:, None]
    return np.array(middle) + begun * np.array([0.35, 0.5]) * np.sin(2 * np.pi * rates * time[:, None] + phases)


def measured_in_mujoco(time, wanted, seed, friction=0.0):
    """What encoders would log of an arm in MuJoCo over a plane of its own, with dry friction (N m) in the elbow."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian"/><option timestep="0.0005"/><worldbody>
        <geom type="plane" size="2 2 0.1" pos="0 0 {TABLE - 0.005}" friction="0 0 0" condim="1"/>
        <body pos="0 0 0.3"><joint name="shoulder" axis="0 1 0" armature="{ROTOR}"/>
        <inertial pos="0.2 0 0" mass="1" diaginertia="0.001 0.01 0.01"/>
        <body pos="0.4 0 0"><joint name="elbow" axis="0 1 0" armature="{ROTOR}" frictionloss="{friction}"/>
        <inertial pos="0.15 0 0" mass="0.6" diaginertia="0.001 0.005 0.005"/>
        <geom type="sphere" size="0.005" pos="0.3 0 0" mass="0" friction="0 0 0" condim="1"/></body></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:] = wanted[0]
    out = np.empty_like(wanted)
    for _ in range(2000):
        data.qfrc_applied[:] = STIFFNESS * (wanted[0] - data.qpos) - DAMPING * data.qvel
        mujoco.mj_step(model, data)
    steps = round((time[1] - time[0]) / model.opt.timestep)
    for k, row in enumerate(wanted):
        out[k] = data.qpos
        for _ in range(steps):
            data.qfrc_applied[:] = STIFFNESS * (row - data.qpos) - DAMPING * data.qvel
            mujoco.mj_step(model, data)
    return out + 1e-4 * np.random.default_rng(seed).standard_normal(out.shape)


def test_a_pressed_arm_is_in_balance(folder):
    system = read_mechanism_model(folder / "model.yaml")
    mechanism = Mechanism(system)
    time = np.arange(300) / 100
    record = Record("press", time, JOINTS, {"command": np.tile([0.8, 0.6], (300, 1))}, {})
    setup = mechanism.setup()
    setup.lay_surface(TABLE, 4000.0)
    q = mechanism.run(record, setup, [(0, 300)], [(np.array([0.3, 0.2]), np.zeros(2))])["position"][-1]
    chain = mechanism.chain

    def height(angles):
        return float(chain.follow(mechanism.tip, mechanism.toe, angles[None])[0, 2])

    def weight(angles):
        return 9.81 * (
            1.0 * float(chain.follow(0, np.array([0.2, 0, 0]), angles[None])[0, 2])
            + 0.6 * float(chain.follow(1, np.array([0.15, 0, 0]), angles[None])[0, 2])
        )

    force = 4000.0 * (TABLE - height(q))
    assert force > 5.0
    for k in range(2):
        nudge = 1e-6 * np.eye(2)[k]
        work = force * (height(q + nudge) - height(q - nudge)) - (weight(q + nudge) - weight(q - nudge))
        assert STIFFNESS * ([0.8, 0.6][k] - q[k]) + work / 2e-6 == pytest.approx(0.0, abs=1e-3)


def test_a_table_that_is_never_reached_changes_nothing(folder):
    mechanism = Mechanism(read_mechanism_model(folder / "model.yaml"))
    time = np.arange(200) / 100
    record = Record("air", time, JOINTS, {"command": commands(time, 1)}, {})
    runs = []
    for height in (None, -1.5):
        setup = mechanism.setup()
        if height is not None:
            setup.lay_surface(height, 1e4)
        runs.append(mechanism.run(record, setup, [(0, 200)], [(commands(time, 1)[0], np.zeros(2))])["position"])
    np.testing.assert_array_equal(*runs)


def test_a_table_is_no_candidate_where_the_tool_stays_level(folder):
    urdf = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>')
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    system = read_mechanism_model(folder / "model.yaml")
    time = np.arange(400) / 100
    wanted = commands(time, 2)
    record = Record("level", time, JOINTS, {"command": wanted}, {"position": wanted})
    names = [candidate.name for candidate in candidates(JointResiduals.of(Mechanism(system), record))]
    assert "coulomb" in names
    assert "table" not in names


def diagnosed(folder, time, middles, friction=0.0):
    """Findings about an arm that moves around a posture in each record."""
    for number, (role, middle) in enumerate(middles.items()):
        wanted = commands(time, number, middle)
        seen = measured_in_mujoco(time, wanted, number, friction)
        columns = {"time [s]": time}
        columns |= {f"command.{name} [rad]": wanted[:, k] for k, name in enumerate(JOINTS)}
        columns |= {f"position.{name} [rad]": seen[:, k] for k, name in enumerate(JOINTS)}
        pd.DataFrame(columns).to_csv(Path(folder) / f"{role}.csv", index=False, float_format="%.7g")
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in middles}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return run_case(folder / "case.yaml", folder / "out", folder / "bank")


LOW, HIGH = (0.55, 0.3), (-0.2, 0.0)


def test_mujocos_contact_is_named(folder):
    findings = diagnosed(folder, np.arange(800) / 100, {"fit": LOW, "select": LOW, "verify": LOW})
    first = findings["account"]["entries"][0]
    assert first["label"] == "table", findings["sentence"]
    assert first["parameters"]["height"]["value"] == pytest.approx(TABLE, abs=0.005)
    assert findings["account"]["explained"] > 0.8


@pytest.mark.parametrize("roles", [("fit", "select", "verify"), ("select", "fit", "verify")])
def test_a_table_that_one_record_alone_reaches_is_accounted_for(folder, roles):
    middles = dict(zip(roles, (HIGH, LOW, LOW), strict=True))
    findings = diagnosed(folder, np.arange(800) / 100, {role: middles[role] for role in ("fit", "select", "verify")}, 0.6)
    entries = {entry["label"]: entry for entry in findings["account"]["entries"]}
    assert {"coulomb:elbow", "table"} <= set(entries), findings["sentence"]
    assert entries["table"]["parameters"]["height"]["value"] == pytest.approx(TABLE, abs=0.005)
    assert findings["account"]["explained"] > 0.8
