"""Models that run away from their records under the logged torques, against an arm that MuJoCo moves."""

import argparse
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pybullet
import pybullet_data
import pytest
import yaml

from benchmarks import gap_panda, gap_ur10e
from benchmarks.gap_owners import compared
from gsbridge.effects.registry import Applied
from gsbridge.files import read_json
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.placeholders import impossible_told, placeholder_told
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.observer import observed
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.workflow import JointBackend
from gsbridge.gap.workflow import write_case_records, write_findings

JOINTS = ("shoulder", "wrist")

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.15 0 0"/><mass value="1.2"/>
    <inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0.02 0 0.01"/><mass value="0.1"/>
    <inertia ixx="2e-5" iyy="2e-5" izz="3e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
  <joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/>
    <origin xyz="0.3 0 0" rpy="0.3 0 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""
"""A light hand, which a motor with a gear turns: without their friction, the logged torques would spin it in no time."""

FRICTION = {"shoulder": 0.8, "wrist": 0.5}
ROTOR = 0.02
RATE, STEP = 200, 5e-5
TRUTH = f"""<mujoco><option timestep="{STEP}" integrator="implicitfast"/><worldbody>
  <body><joint name="shoulder" axis="0 1 0" frictionloss="{FRICTION["shoulder"]}" solreffriction="0.001 1"/>
    <inertial pos="0.15 0 0" mass="1.2" diaginertia="0.001 0.01 0.01"/>
    <body pos="0.3 0 0" euler="17.188733853924695 0 0">
      <joint name="wrist" axis="0 0 1" frictionloss="{FRICTION["wrist"]}" armature="{ROTOR}" solreffriction="0.001 1"/>
      <inertial pos="0.02 0 0.01" mass="0.1" diaginertia="2e-5 2e-5 3e-5"/></body></body>
</worldbody></mujoco>"""


def logged(seed, act=lambda time, torque, data, model: torque, firm=1.0, seconds=6.0):
    """What a controller logs while it moves the arm along sums of sines: times, torques, positions, speeds.

    `act` turns the logged torque into the one that acts, every millisecond, and may change the friction; `firm` scales the
    gains of the controller.
    """
    model = mujoco.MjModel.from_xml_string(TRUTH)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    pace, sway, phase = rng.uniform(1.5, 5.0, (3, 2)), rng.uniform(0.2, 0.4, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    data.qpos[:] = (sway * np.sin(phase)).sum(axis=0)
    data.qvel[:] = (sway * pace * np.cos(phase)).sum(axis=0)
    every, rows = round(1e-3 / STEP), []
    for _ in range(round(seconds * RATE)):
        turned = pace * data.time + phase
        wanted, speed = (sway * np.sin(turned)).sum(axis=0), (sway * pace * np.cos(turned)).sum(axis=0)
        torque = firm * (np.array([120.0, 30.0]) * (wanted - data.qpos) + np.array([8.0, 1.0]) * (speed - data.qvel))
        rows.append(np.concatenate([[data.time], torque, data.qpos, data.qvel]))
        for _ in range(round(1e3 / RATE)):
            data.qfrc_applied[:] = act(data.time, torque, data, model)
            mujoco.mj_step(model, data, every)
    table = np.array(rows)
    table[:, 3:5] += 1e-5 * rng.normal(size=(len(table), 2))
    table[:, 5:] += 1e-3 * rng.normal(size=(len(table), 2))
    return table


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A case of three logs of the arm, whose model knows neither friction nor rotor."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(URDF)
    columns = [f"{kind}.{joint} [{unit}]" for kind, unit in (("command", "N m"), ("position", "rad"), ("velocity", "rad/s"))
               for joint in JOINTS]  # fmt: skip
    for seed, role in enumerate(("fit", "select", "verify")):
        pd.DataFrame(logged(seed), columns=["time [s]", *columns]).to_csv(folder / f"{role}.csv", index=False)
    model = {"urdf": "arm.urdf", "joints": list(JOINTS), "controller": {"mode": "torque"}}
    (folder / "model.yaml").write_text(yaml.safe_dump(model))
    records = {role: f"{role}.csv" for role in ("fit", "select", "verify")}
    (folder / "case.yaml").write_text(yaml.safe_dump({"model": "model.yaml", "records": records}))
    return folder


def test_inertia_is_that_of_another_engine(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    model = {"urdf": "arm.urdf", "joints": list(JOINTS), "controller": {"mode": "torque"}, "armature": [0.0, ROTOR]}
    mechanism, client = Mechanism(parse_mechanism_model(model, tmp_path)), pybullet.connect(pybullet.DIRECT)
    try:
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        body = pybullet.loadURDF(str(tmp_path / "arm.urdf"), useFixedBase=True, flags=flags, physicsClientId=client)
        for q in ([0.0, 0.0], [0.4, -1.1], [2.0, 3.0]):
            theirs = np.array(pybullet.calculateMassMatrix(body, q, physicsClientId=client)) + np.diag([0.0, ROTOR])
            np.testing.assert_allclose(mechanism.inertia(np.array(q)), theirs, rtol=1e-6, atol=1e-9)
    finally:
        pybullet.disconnect(client)


TRUE = [*(Applied("coulomb", joint, {"torque": torque}) for joint, torque in FRICTION.items()),
        Applied("armature", "wrist", {"inertia": ROTOR})]  # fmt: skip


def with_records(case, change):
    """The case with all of its records changed."""
    return replace(case, records={role: change(record) for role, record in case.records.items()})


def thinned(record):
    """A record of every fourth sample, 50 per second, whose torques are the means of those that were given meanwhile."""
    torque = record.commands["command"][: len(record.time) // 4 * 4]
    given = torque.reshape(-1, 4, torque.shape[1]).mean(axis=1)
    measured = {kind: values[::4][: len(given)] for kind, values in record.measured.items()}
    return replace(record, time=record.time[::4][: len(given)], commands={"command": given}, measured=measured)


VARIANTS = {
    "as logged": (lambda record: record, 0.01),
    "positions alone": (lambda record: record.with_measured({"position": record.measured["position"]}), 0.01),
    "fed forward": (
        lambda record: replace(
            record, commands={"command": 0.1 * record.commands["command"], "feedforward": 0.9 * record.commands["command"]}
        ),
        0.01,
    ),
    "at 50 Hz": (thinned, 0.02),
}
"""How records are changed, and the largest share of the gap, root mean square, that the truth may leave."""


@pytest.mark.parametrize("variant", VARIANTS)
def test_what_the_truth_leaves_under_an_observer_is_little_beside_what_the_model_lacks(case, variant):
    change, share = VARIANTS[variant]
    seen, told = observed(with_records(read_joint_case(case / "case.yaml"), change))
    assert "beyond all bounds" in told
    assert "pulled back" in told
    assert "clock_offset" in told
    assert seen.system.controller.observes
    view = JointResiduals.of(Mechanism(seen.system), seen.records["verify"], TRUE)
    lacks, leaves = ((view.residual(effects) ** 2).sum() for effects in ((), TRUE))
    assert leaves < share**2 * lacks


def delayed(seconds):
    """A drive whose torque comes late."""
    asked = []

    def act(time, torque, data, model):
        asked.append(torque)
        return asked[max(len(asked) - 1 - round(1e3 * seconds), 0)]

    return act


def slow(seconds):
    """A drive whose torque follows with a time constant."""
    given = []

    def act(time, torque, data, model):
        given[:] = [given[0] + (torque - given[0]) * (1 - np.exp(-1e-3 / seconds)) if given else torque]
        return given[0]

    return act


def rubbing(friction):
    """Dry friction that `friction` computes from time and torque."""

    def act(time, torque, data, model):
        model.dof_frictionloss[:] = friction(time, torque)
        return torque

    return act


def pure(change):
    """A change of the torque alone."""
    return lambda time, torque, data, model: change(torque, data.qpos)


def each(name, **parameters):
    """An effect at both joints."""
    return [Applied(name, joint, parameters) for joint in JOINTS]


DRY = np.array([*FRICTION.values()])
FURTHER = {
    "torque_gain": (lambda: pure(lambda torque, q: 1.25 * torque), each("torque_gain", change=0.25)),
    "torque_delay": (lambda: delayed(0.015), each("torque_delay", time=0.015)),
    "torque_lag": (lambda: slow(0.02), each("torque_lag", time=0.02)),
    "effort_offset": (lambda: pure(lambda torque, q: torque + 0.3), each("effort_offset", torque=0.3)),
    "ripple": (
        lambda: pure(lambda torque, q: torque + 0.3 * np.sin(12 * q)),
        each("ripple", sine=0.3, cosine=0.0, waves=12.0),
    ),
    "load_friction": (lambda: rubbing(lambda time, torque: DRY + 0.15 * np.abs(torque)), each("load_friction", share=0.15)),
    "warming": (lambda: rubbing(lambda time, torque: DRY * (1 + 0.1 * time)), each("warming", rate=0.1)),
}
"""Effects that act besides `TRUE`: how the logged torque turns into the one that acts, and what is true of it."""

ENCODERS = {
    "encoder_offset": (lambda q, v: (q + 0.2, v), each("encoder_offset", angle=0.2)),
    "encoder_scale": (lambda q, v: (1.15 * q, 1.15 * v), each("encoder_scale", change=0.15)),
    "eccentricity": (
        lambda q, v: (q + 0.1 * np.sin(q), (1 + 0.1 * np.cos(q)) * v),
        each("eccentricity", sine=0.1, cosine=0.0),
    ),
}
"""What an encoder shows of the motion, and what is true of it."""


def left_without_and_with(case, effects):
    """Squared residual of what is pulled back, with the friction and the rotor and then with further effects."""
    seen, told = observed(case)
    assert "pulled back" in told
    assert {effect.name for effect in effects} <= set(seen.names)
    view = JointResiduals.of(Mechanism(seen.system), seen.records["verify"], [*TRUE, *effects])
    return [(view.residual(known) ** 2).sum() for known in (TRUE, [*TRUE, *effects])]


@pytest.mark.parametrize("name", FURTHER)
def test_effects_of_the_motors_and_of_their_friction_show_beside_an_observer(case, name):
    make, effects = FURTHER[name]
    checked, records = read_joint_case(case / "case.yaml"), {}
    for seed, (role, record) in enumerate(checked.records.items()):
        # A firm controller would make a late drive unstable.
        table = logged(seed, make(), firm=0.1 if name == "torque_delay" else 1.0)
        measured = {"position": table[:, 3:5], "velocity": table[:, 5:]}
        records[role] = replace(record, commands={"command": table[:, 1:3]}, measured=measured)
    without, found = left_without_and_with(replace(checked, records=records), effects)
    assert found < 0.04 * without


@pytest.mark.parametrize("name", ENCODERS)
def test_errors_of_encoders_show_beside_an_observer(case, name):
    shows, effects = ENCODERS[name]

    def change(record):
        q, v = shows(record.measured["position"], record.measured["velocity"])
        return record.with_measured({"position": q, "velocity": v})

    without, found = left_without_and_with(with_records(read_joint_case(case / "case.yaml"), change), effects)
    assert found < 0.04 * without


def test_only_effects_that_show_beside_an_observer_are_sought(case):
    seen, _ = observed(read_joint_case(case / "case.yaml"))
    assert seen.names is not None
    assert {"coulomb", "armature", "payload", "torque_lag", "load_friction", "encoder_offset"} < set(seen.names)
    assert not {"command_delay", "lag", "clock_offset", "clock_drift", "saturation"} & set(seen.names)


def test_a_placeholder_of_an_inertia_is_held_by_shorter_steps_or_told(case, tmp_path):
    for size, holds in (("4e-6", True), ("1e-9", False)):
        light = URDF.replace('ixx="2e-5" iyy="2e-5" izz="3e-5"', f'ixx="{size}" iyy="{size}" izz="{size}"')
        light = light.replace('xyz="0.02 0 0.01"/><mass value="0.1"', 'xyz="0 0 0.01"/><mass value="0.1"')
        (tmp_path / "arm.urdf").write_text(light)
        checked = read_joint_case(case / "case.yaml")
        seen, told = observed(replace(checked, system=replace(checked.system, urdf=tmp_path / "arm.urdf")))
        assert seen.system.controller.observes == holds
        assert ("pulled back" in told) == holds
        assert ("'armature'" in told) != holds


def test_a_case_that_no_observer_suits_says_why(case, tmp_path):
    checked = read_joint_case(case / "case.yaml")
    late = replace(checked.system, effects=(Applied("clock_offset", "", {"time": 0.004}),))
    slow = with_records(checked, lambda record: replace(record, time=8.0 * record.time))
    hidden = replace(checked, names=("clock_offset",))
    for asked, word in (
        (hidden, "None of the effects"),
        (replace(checked, system=late), "clock_offset"),
        (slow, "50 samples per second"),
    ):
        seen, told = observed(asked)
        assert seen is asked
        assert "runs away" in told
        assert word in told


def test_the_owners_figures_stand_beside_an_account(tmp_path):
    (tmp_path / gap_ur10e.OWNERS).write_text(f"pi_frcn = [{' '.join(map(str, range(18)))}]\n")
    (tmp_path / gap_panda.FRICTION).parent.mkdir(parents=True)
    (tmp_path / gap_panda.FRICTION).write_text(
        "    fp = [...\n        0.5,0.8,0.6,1.2,0.8,0.3,0.56;...\n        0,0,0,0,0,0,0];\n"
    )
    options = argparse.Namespace(source=tmp_path)
    found = {"verdict": "no_discrepancy", "sentence": "", "reasons": [], "simulations": {}, "seconds": 1.0}
    assert compared(found, gap_ur10e.known(options))["entries"] == []
    for arm, joint, owners in ((gap_ur10e, gap_ur10e.JOINTS[1], [3.0, 4.0, None]), (gap_panda, "joint6", [None, 0.15, None])):
        about = {"joint": joint, "share": 0.5, "verdict": "likely", "parameters": {"size": {"value": 2.0}}}
        entries = [{"label": name, "name": name, **about} for name in ("viscous", "coulomb", "ripple")]
        rows = compared(found | {"account": {"entries": entries, "explained": 0.9}}, arm.known(options))["entries"]
        assert [row["owners"] for row in rows] == owners


def test_friction_that_a_model_lacks_is_told_where_it_runs_away(case, tmp_path):
    """Coulomb friction of both joints and the rotor leads the account, with the sizes of the truth."""
    content = yaml.safe_load((case / "case.yaml").read_text())
    asked = case / "asked.yaml"
    asked.write_text(yaml.safe_dump(content | {"effects": ["coulomb", "viscous", "armature", "torque_delay", "payload"]}))
    data, record = tmp_path / "records.npz", tmp_path / "records.json"
    write_case_records(asked, data, record)
    write_findings(case / "model.yaml", data, record, tmp_path / "bank", tmp_path / "findings.json", tmp_path / "model.yaml", 1)
    found = read_json(tmp_path / "findings.json")
    assert sum("runs away" in reason for reason in found["reasons"]) == 1
    plainly = next(reason for reason in found["reasons"] if reason.startswith("without being pulled back"))
    before, after = re.findall(r"([0-9.e+-]+|beyond all bounds)(?: times| within|,)", plainly)
    assert before == "beyond all bounds"
    assert float(after) < 1.0
    entries = {entry["label"]: entry["parameters"] for entry in found["account"]["entries"]}
    first = [entry["label"] for entry in found["account"]["entries"]][:3]
    assert sorted(first) == ["armature:wrist", "coulomb:shoulder", "coulomb:wrist"]
    for joint, torque in FRICTION.items():
        assert entries[f"coulomb:{joint}"]["torque"]["value"] == pytest.approx(torque, rel=0.1)
    assert entries["armature:wrist"]["inertia"]["value"] == pytest.approx(ROTOR, rel=0.1)
    assert found["account"]["explained"] >= 0.95


def test_a_model_is_pulled_back_if_it_strays_farther_than_the_joint_moved(case):
    """How far plain replays stray grows with the friction that the model lacks."""
    checked = read_joint_case(case / "case.yaml")
    for share, pulled in ((0.9, False), (0.5, True)):
        known = replace(checked.system, coulomb=share * DRY, armature=np.array([0.0, ROTOR]))
        seen, told = observed(replace(checked, system=known))
        assert seen.system.controller.observes == pulled
        assert bool(told) == pulled
        times = float(re.search(r"([0-9.]+) times as far", told)[1]) if told else 0.0
        assert times == 0.0 or 1.0 < times < 5.0


def test_a_model_that_stays_near_its_record_needs_no_observer(case, tmp_path):
    """The same logs, for a model that knows friction and rotor."""
    content = yaml.safe_load((case / "model.yaml").read_text())
    known = content | {"coulomb": [*FRICTION.values()], "armature": [0.0, ROTOR], "urdf": str(case / "arm.urdf")}
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(known))
    records = {role: str(case / f"{role}.csv") for role in ("fit", "select", "verify")}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump({"model": "model.yaml", "records": records}))
    backend = JointBackend.read(tmp_path / "case.yaml")
    assert backend.replayed is backend.case
    assert not any("runs away" in reason for reason in backend.reasons)


PANDA = tuple(f"panda_joint{k}" for k in range(1, 8))
ARMS = {
    "franka_panda/panda.urdf": (PANDA, "10 links of 0.1 to 3 kg all have 0.1 kg m2 about each axis: placeholders"),
    "kuka_iiwa/model.urdf": (tuple(f"lbr_iiwa_joint_{k}" for k in range(1, 8)), ""),
    "xarm/xarm6_robot.urdf": (tuple(f"joint{k}" for k in range(1, 7)), ""),
    "racecar/racecar_differential.urdf": (("left_steering_hinge_joint", "right_steering_hinge_joint"), ""),
}
"""Robots that come with PyBullet, and what is told of their inertias."""


@pytest.mark.parametrize("name", ARMS)
def test_inertias_that_are_placeholders_are_told(name):
    joints, told = ARMS[name]
    folder = Path(pybullet_data.getDataPath())
    model = {"urdf": name, "joints": list(joints), "controller": {"mode": "torque"}}
    mechanism = Mechanism(parse_mechanism_model(model, folder))
    found = placeholder_told(mechanism)
    assert found.startswith(told)
    assert bool(found) == bool(told)
    assert impossible_told(mechanism) == ""


def test_equal_links_are_placeholders_only_if_no_link_can_be_so(tmp_path):
    """Three links of one mass and one inertia: a chain of equal parts, or figures of 1 that a drawing program writes."""
    for moment, told in (("0.002", False), ("1", True)):
        tensor = f'ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"'
        links = "".join(
            f'<link name="l{k}"><inertial><mass value="1"/><inertia {tensor}/></inertial></link>'
            f'<joint name="j{k}" type="continuous"><parent link="{"base" if k == 0 else f"l{k - 1}"}"/><child link="l{k}"/>'
            '<origin xyz="0 0 0.2"/><axis xyz="0 1 0"/></joint>'
            for k in range(3)
        )
        (tmp_path / "chain.urdf").write_text(f'<robot name="chain"><link name="base"/>{links}</robot>')
        model = {"urdf": "chain.urdf", "joints": ["j0", "j1", "j2"], "controller": {"mode": "torque"}}
        assert bool(placeholder_told(Mechanism(parse_mechanism_model(model, tmp_path)))) == told


@pytest.mark.parametrize(
    ("moments", "told"),
    [
        ((0.03, 0.03, 0.003), ""),
        # A flat plate, to the last digit that a drawing program writes.
        ((0.0101, 0.02, 0.0301), ""),
        ((0.03, 0.3, 1.0), "1 kg m2 of 'l0' exceed the sum of its other two principal moments, which no body has"),
        ((30.0, 30.0, 3.0), "'l0' turns as if its 2 kg were 3.9 m from its middle"),
    ],
)
def test_inertias_that_no_link_has_are_told(tmp_path, moments, told):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="l0"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>'
        f'<inertia ixx="{moments[0]}" iyy="{moments[1]}" izz="{moments[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j0" type="continuous"><parent link="base"/><child link="l0"/><axis xyz="0 1 0"/></joint></robot>'
    )
    found = impossible_told(Mechanism(parse_mechanism_model({"urdf": "arm.urdf", "controller": {"mode": "torque"}}, tmp_path)))
    assert found.startswith(told)
    assert bool(found) == bool(told)


def test_long_links_and_beams_on_slides_are_believed(tmp_path):
    """A uniform rod of 4 m, and a beam of 3 m on a rail of 5 m: their inertias are exact."""
    rod = (
        '<inertial><origin xyz="0 0 -2"/><mass value="20"/><inertia ixx="26.7" iyy="26.7" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
    )
    beam = '<inertial><mass value="30"/><inertia ixx="22.5" iyy="0.1" izz="22.5" ixy="0" ixz="0" iyz="0"/>'
    for kind, link in (("continuous", rod), ("prismatic", beam)):
        (tmp_path / "long.urdf").write_text(
            f'<robot name="long"><link name="base"/><link name="l0">{link}</inertial></link><joint name="j0" type="{kind}">'
            '<parent link="base"/><child link="l0"/><axis xyz="0 1 0"/><limit lower="0" upper="5" effort="9" velocity="9"/>'
            "</joint></robot>"
        )
        model = parse_mechanism_model({"urdf": "long.urdf", "controller": {"mode": "torque"}}, tmp_path)
        assert impossible_told(Mechanism(model)) == ""
