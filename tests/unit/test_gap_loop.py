"""Closing the loop: the simulated arm as a mechanism of the gap, its calibration, the driver's log, the amended simulation."""

import csv
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
import yaml
from robot_fixture import robot
from sim_fixture import NOMINAL, cube, model

from gsbridge.cameras import Camera
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import read_effects
from gsbridge.environment.lens import WristLens
from gsbridge.environment.trial_log import TrialPath, write_trial_log
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json, write_json
from gsbridge.gap.formats.records import Record
from gsbridge.gap.image.workflow import amend_camera
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model, read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.loop.amend import amend_object, amend_simulation, amended_content, object_content
from gsbridge.gap.loop.arm import write_arm
from gsbridge.gap.loop.calibrate import calibrate, calibrated_model
from gsbridge.policy.joint_log import choose_trials, write_driver_log
from gsbridge.reality.world.driver_log import WAIT, DriverLog, LoggedPhysics
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.sim.model import EFFECTS, parse_model, read_model
from gsbridge.sim.world import SimWorld

COLUMNS = ("pose_set", "index", "quadrant", "x", "y", "yaw", "success", "success_tolerant", "failure", "steps")


def with_effects(effects: tuple, **changes):
    """The nominal model with some values changed and with effects."""
    return replace(model(**changes), effects=read_effects([dict(effect) for effect in effects], "test", *EFFECTS))


def logged_simulation(steps: int = 50, effects: tuple = (), **changes) -> tuple[DriverLog, np.ndarray]:
    """What a driver of the simulated arm would log in a motion that uses every joint; and `base_from_table`."""
    with SimWorld(robot(), cube(), with_effects(effects, **changes)) as sim:
        controller, rows = sim.controller, []
        substep = controller.substep

        def keep(number, measured):
            state = controller.sense(measured)[:, :7].copy()
            slot = int(controller._arm["slot"][0, 0])
            out = substep(number, measured)
            rows.append(np.stack([controller._ring[slot, 0, :7], controller._ring[slot, 1, :7], *state, out[1, :7]]))
            return out

        controller.substep = keep
        for k in range(10 + steps):
            share = np.sin(0.35 * max(k - 10, 0))
            position = np.array([0.12 * share, 0.265 + 0.08 * np.sin(0.22 * max(k - 10, 0)), 0.25 + 0.05 * share])
            if k >= 10:
                sim.command(position, 0.7 * share, 0.14)
            sim.step()
        command, speed, position, velocity, effort = np.array(rows).transpose(1, 0, 2)
        return DriverLog(1e-3 * np.arange(len(rows)), command, speed, position, velocity, effort), sim.base_from_table


def replay(folder, record: Record, base_from_table, effects: tuple = (), **changes) -> dict:
    """The gap's own replay of a record, by a model with the given effects."""
    write_arm(robot(), with_effects(effects, **changes), base_from_table, folder / "arm.urdf", folder / "model.yaml")
    mechanism = Mechanism(read_mechanism_model(folder / "model.yaml"))
    start = record.measured["position"][0], record.measured["velocity"][0]
    return mechanism.run(record, apply_effects(mechanism, ()), [(0, len(record.time))], [start])


def record_of(folder, log: DriverLog, base_from_table) -> Record:
    """The log as the gap reads it."""
    write_arm(robot(), with_effects(()), base_from_table, folder / "arm.urdf", folder / "model.yaml")
    write_driver_log(folder / "log.csv", robot().record["arm_joints"], log)
    (folder / "case.yaml").write_text("model: model.yaml\nrecords: {fit: log.csv, select: log.csv, verify: log.csv}\n")
    return read_joint_case(folder / "case.yaml").records["fit"]


@pytest.mark.parametrize("delay", [0.0, 0.08])
def test_the_gap_replays_the_simulated_arm(tmp_path, delay):
    """Another engine, another code of the same equations: apart by less than the sensors of the mirror see."""
    log, base_from_table = logged_simulation(arm__delay=delay)
    record = record_of(tmp_path, log, base_from_table)
    out = replay(tmp_path, record, base_from_table, arm__delay=delay)
    assert np.ptp(record.measured["position"], axis=0).min() > 0.01
    # The mirror's sensors have 3e-5 rad, 7e-4 rad/s and 0.1 N m; the last joint is all but massless without its armature.
    for kind, most in (("position", 3e-5), ("velocity", 1e-3), ("effort", 0.1)):
        rms = np.sqrt(((record.measured[kind] - out[kind]) ** 2).mean(axis=0))
        assert (rms < most).all(), (kind, rms)


SIZES = {
    "armature": 100.0, "encoder_scale": 20.0, "quadratic_drag": 400.0,
    "saturation": 3.0, "spring": 100.0, "torque_delay": 3.0, "viscous": 100.0,
}  # fmt: skip
"""Multiples of the typical amplitude with which effects show in this motion; eight for the others."""


@pytest.mark.parametrize("name", [name for name, effect in JOINT_EFFECTS.items() if effect.amendable])
def test_an_effect_on_a_joint_is_the_same_in_the_simulation_and_in_the_gap(tmp_path, name):
    """Amended, it changes what the arm does, by far more than the two engines differ; and both play the same effect."""
    effect = JOINT_EFFECTS[name]
    values = effect.scaled({p.name: p.typical for p in effect.parameters}, SIZES.get(name, 8.0))
    entry = {"name": name, "parameters": values} | ({"joint": "lbr_iiwa_joint_3"} if effect.scope == "joint" else {})
    log, base_from_table = logged_simulation(32, (entry,))
    record = record_of(tmp_path, log, base_from_table)
    with_it, without = (replay(tmp_path, record, base_from_table, effects) for effects in ((entry,), ()))
    # The first state is corrected for an eccentric encoder to first order only; from sample 300 on, the error has decayed.
    later = slice(300, None)
    share = {
        kind: float(np.linalg.norm((seen - with_it[kind])[later]) / np.linalg.norm((seen - without[kind])[later]))
        for kind, seen in record.measured.items()
    }
    assert min(share.values()) < 0.1, share


AXIS = """<robot name="axis"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-6" upper="6" effort="50" velocity="20"/></joint></robot>"""


def axis_content() -> dict:
    """Model of a single axis."""
    control = {"mode": "pd", "rate": 1000, "stiffness": [60], "damping": [4], "gravity_compensation": 1.0, "between": "hold"}
    return {"urdf": "axis.urdf", "joints": ["axis"], "controller": control, "viscous": [0.2], "armature": [0.02], "effects": []}


def test_calibration_finds_every_figure(tmp_path):
    """Gains, inertia, both frictions and the delay of an axis, from noisy records, within what it says it is sure of."""
    (tmp_path / "axis.urdf").write_text(AXIS)
    truth = {"stiffness": 75.0, "damping": 5.0, "armature": 0.05, "viscous": 0.1, "coulomb": 0.3}
    content = axis_content()
    hidden = {**content, "viscous": [0.1], "coulomb": [0.3], "armature": [0.05]}
    hidden["controller"] = {**content["controller"], "stiffness": [75.0], "damping": [5.0]}
    hidden["effects"] = [{"name": "command_delay", "parameters": {"time": 0.03}}]
    rng, records = np.random.default_rng(1), {}
    for role, waves in (("fit", 2.0), ("select", 3.1), ("verify", 1.4)):
        time = np.arange(2500) / 1000
        fade = np.clip(2 * (time - 0.2), 0, 1)
        command = (fade * (0.5 * np.sin(2 * waves * time) + 0.2 * np.sin(7 * waves * time)))[:, None]
        speed = np.gradient(command, 1e-3, axis=0)
        blank = {kind: np.zeros((len(time), 1)) for kind in ("position", "velocity", "effort")}
        record = Record(role, time, ("axis",), {"command": command, "command_velocity": speed}, blank)
        mechanism = Mechanism(parse_mechanism_model(hidden, tmp_path))
        out = mechanism.run(record, apply_effects(mechanism, ()), [(0, len(time))], [(np.zeros(1), np.zeros(1))])
        noise = {"position": 1e-5, "velocity": 1e-3, "effort": 0.01}
        records[role] = record.with_measured({k: v + noise[k] * rng.standard_normal(v.shape) for k, v in out.items()})
    found = calibrate(parse_mechanism_model(content, tmp_path), records)
    assert found.delay == pytest.approx(0.03, abs=2e-4)
    for name, value in truth.items():
        assert found.figures[name][0] == pytest.approx(value, rel=0.02, abs=2e-3), name
    assert found.after["verify"] < 1.5 < found.before["verify"]
    # Channels were weighed by a hundredth of their range; what is left, summed up over time, is a ten-thousandth of it.
    assert found.floor["position"][0] < 1e-4 * np.ptp(records["verify"].measured["position"])
    written = parse_mechanism_model(calibrated_model(content, found), tmp_path)
    assert written.coulomb[0] == pytest.approx(0.3, rel=0.02)
    assert [effect.name for effect in written.effects] == ["command_delay"]


def test_the_log_leaves_the_mirror_as_it_is():
    """The same motion to the last bit; rows from before the episode on, and measured what is sent a latency later."""
    hidden = Hidden(latency=0.05, encoder_noise=1e-6, torque_noise=1e-3)
    stand = Stand(true_base_from_table(hidden))
    plain, logged = MirrorPhysics(robot(), stand, None, hidden), LoggedPhysics(robot(), stand, None, hidden)
    for place in (plain, logged):
        MirrorPhysics.reset(place, np.zeros(3), 3) if place is plain else place.reset(np.zeros(3), 3)
        for k in range(12):
            place.command(np.array([0.01 * k, 0.265, 0.25]), 0.0, 0.1)
            place.step()
    np.testing.assert_array_equal(plain.data.qpos, logged.data.qpos)
    log = logged.log()
    begin = round(1000 * WAIT)
    assert len(log.time) == begin + 600
    assert np.abs(log.command_velocity[:begin]).max() == 0
    np.testing.assert_allclose(log.position[:begin], np.broadcast_to(log.command[0], (begin, 7)), atol=1e-5)
    moved = np.abs(log.effort - log.effort[:begin].mean(axis=0)).max(axis=1) > 0.5
    assert 0.05 <= log.time[np.argmax(moved)] - WAIT + 1e-9 < 0.06
    # Torques hold the weight at rest: joint 2 carries the arm.
    assert np.abs(log.effort[:begin, 1]).mean() > 5


def trials_of(folder, rows) -> tuple:
    """A table of trials and its log: success, quadrant, steps each."""
    paths = []
    with open(folder / "trials.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for index, (success, quadrant, steps, *failure) in enumerate(rows):
            word = "true" if success else "false"
            writer.writerow(("fixed", index, quadrant, 0, 0, 0, word, word, *(failure or [""]), steps))
            states = {"tool": 3, "object_position": 3, "object_quat": 4, "forces": 4, "actions": 5}
            arrays = {name: np.zeros((steps + 1, width)) for name, width in states.items()}
            line = {name: np.zeros(steps + 1) for name in ("tool_yaw", "aperture")}
            paths.append(TrialPath("fixed", index, **arrays, **line, jpegs=(b"x",) * (steps + 1)))
    write_trial_log(folder / "trials.npz", paths)
    return folder / "trials.csv", folder / "trials.npz"


def test_failed_trials_are_logged_first(tmp_path):
    rows = [(True, 1, 40), (False, 1, 80), (False, 1, 80), (False, 2, 60), (True, 3, 50), (False, 4, 20)]
    table, log = trials_of(tmp_path, rows)
    chosen = choose_trials(table, log, 0.05)
    # Two quadrants failed, the second failure of the first comes after; the last failure is too short.
    assert [trial.number for trial in chosen] == [1, 3, 2]
    assert not any(trial.success for trial in chosen)


def test_failed_trials_without_contact_come_before_those_with(tmp_path):
    rows = [(True, 1, 40, ""), (False, 1, 80, "dropped"), (False, 2, 80, "pushed_away"), (False, 3, 60, "time_out")]
    table, log = trials_of(tmp_path, [*rows, (False, 3, 50, "not_grasped")])
    assert [trial.number for trial in choose_trials(table, log, 0.05)] == [3, 4, 1]


def test_too_few_trials_are_refused(tmp_path):
    table, log = trials_of(tmp_path, [(True, 1, 40), (False, 1, 10), (False, 2, 10)])
    with pytest.raises(StageError, match="1 of 3 trials"):
        choose_trials(table, log, 0.05)


def arm_with(*effects) -> dict:
    """Content of an arm's model with effects."""
    nominal = yaml.safe_load(NOMINAL.read_text())["arm"]
    return {
        "joints": [f"lbr_iiwa_joint_{k}" for k in range(1, 8)],
        "controller": {"stiffness": nominal["stiffness"], "damping": nominal["damping"], "gravity_compensation": 1.0},
        "viscous": nominal["viscous_friction"],
        "armature": nominal["armature"],
        "coulomb": [0.0] * 7,
        "effects": list(effects),
    }


def test_findings_reach_the_simulation():
    nominal = yaml.safe_load(NOMINAL.read_text())
    delays = [{"name": "command_delay", "parameters": {"time": time}} for time in (0.058, 0.182)]
    gain = {"name": "gain_p", "joint": "lbr_iiwa_joint_2", "parameters": {"change": -0.1}}
    content, left = amended_content(nominal, arm_with(*delays, gain), "arm.yaml")
    found = parse_model(content)
    assert found.arm.delay == pytest.approx(0.24)
    assert found.arm.stiffness[1] == pytest.approx(0.9 * nominal["arm"]["stiffness"][1])
    assert left == []
    # Effects for which the model has no parameter of its own join its list of effects, beside those of object and camera.
    dry = {"name": "coulomb", "joint": "lbr_iiwa_joint_3", "parameters": {"torque": 2.0}}
    dark = {"name": "exposure", "parameters": {"stops": -0.5}}
    content, _ = amended_content({**nominal, "effects": [dark]}, arm_with(gain, dry), "arm.yaml")
    assert parse_model(content).effects == read_effects([dry, dark], "test", *EFFECTS)
    # Without effects the file is the nominal one: nothing else moves.
    assert parse_model(amended_content(nominal, arm_with(), "arm.yaml")[0]) == parse_model(nominal)


def test_what_the_simulation_cannot_express_is_refused_by_name():
    nominal = yaml.safe_load(NOMINAL.read_text())
    play = {"name": "backlash", "joint": "lbr_iiwa_joint_3", "parameters": {"gap": 0.01}}
    with pytest.raises(InputError, match=r"cannot play 'backlash' of joint 'lbr_iiwa_joint_3'.*Have the gear tightened"):
        amended_content(nominal, arm_with(play), "arm.yaml")
    late = {"name": "command_delay", "parameters": {"time": 0.7}}
    with pytest.raises(InputError, match=r"arm\.delay"):
        amended_content(nominal, arm_with(late), "arm.yaml")


def test_calibrated_friction_is_left_out_and_said():
    arm = {**arm_with(), "coulomb": [0.5] * 7}
    assert "Coulomb friction" in amended_content(yaml.safe_load(NOMINAL.read_text()), arm, "arm.yaml")[1][0]


def test_the_amended_model_carries_its_evidence(tmp_path):
    late = {"name": "command_delay", "parameters": {"time": 0.1}}
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(arm_with(late)))
    row = {
        "name": "command_delay",
        "joint": "",
        "parameters": {"time": {"value": 0.1, "unit": "s", "interval90": [0.09, 0.11]}},
    }
    findings = {"amended": [late], "effects": [row], "verdict": "named", "sentence": "The model lacks latency.", "seed": 1}
    findings["records"] = {"fit": "abc"}
    write_json(tmp_path / "findings.json", findings)
    write_json(tmp_path / "calibration.json", {"records": {"fit": "def"}})
    paths = [tmp_path / name for name in ("arm.yaml", "findings.json", "calibration.json", "model.yaml", "amendment.json")]
    amend_simulation(NOMINAL, *paths)
    text = paths[3].read_text()
    assert "# The model lacks latency." in text
    assert "# record fit: abc" in text
    assert parse_model(yaml.safe_load(text)).arm.delay == pytest.approx(0.1)
    record = read_json(paths[4])
    assert record["intervals"] == {"command_delay": {"time": [0.09, 0.11]}}
    assert record["changed"]["delay"] == {"before": 0.0, "after": 0.1}
    findings["amended"] = []
    write_json(tmp_path / "findings.json", {**findings, "verdict": "ambiguous"})
    with pytest.raises(StageError, match=r"named nothing \(ambiguous\)"):
        amend_simulation(NOMINAL, *paths)


def found_in(folder, name: str, effects: list, rows: list | None = None):
    """Findings as a diagnosis leaves them."""
    content = {"amended": effects, "effects": rows or [], "verdict": "named", "sentence": f"Found: {name}.", "seed": 1}
    write_json(folder / f"{name}.json", content | {"records": {"fit": "abc"}})
    return folder / f"{name}.json"


def test_arm_object_and_camera_may_be_amended_in_any_order(tmp_path):
    """The same model whatever was found first, and a simulation that plays all of it."""
    late = {"name": "command_delay", "parameters": {"time": 0.1}}
    dry = {"name": "coulomb", "joint": "lbr_iiwa_joint_3", "parameters": {"torque": 8.0}}
    dark = {"name": "exposure", "parameters": {"stops": -1.0}}
    slippery = {"name": "contact_friction", "parameters": {"friction": -0.2}}
    windy = {"name": "steady_force", "parameters": {"x": 0.1, "y": 0.0}}
    rows = [
        {"name": "contact_friction", "parameters": {"friction": {"becomes": 0.3}}},
        {"name": "steady_force", "parameters": {"x": {"becomes": 0.1}, "y": {"becomes": 0.0}}},
    ]
    arm_row = {"name": "coulomb", "joint": dry["joint"], "parameters": {"torque": {"interval90": [7.0, 9.0]}}}
    camera, thrown = found_in(tmp_path, "camera", [dark]), found_in(tmp_path, "object", [slippery, windy], rows)
    arm = found_in(tmp_path, "arm", [dry], [arm_row])
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(arm_with(late, dry)))
    write_json(tmp_path / "calibration.json", {"records": {"fit": "def"}})
    stages = {
        "arm": lambda before, after: amend_simulation(
            before, tmp_path / "arm.yaml", arm, tmp_path / "calibration.json", after, tmp_path / "record.json"
        ),
        "object": lambda before, after: amend_object(before, thrown, after),
        "camera": lambda before, after: amend_camera(before, camera, after),
    }
    models = []
    for order in permutations(stages):
        path = NOMINAL
        for name in order:
            after = tmp_path / f"{'-'.join(order)}-{name}.yaml"
            stages[name](path, after)
            path = after
        models.append(read_model(path))
    assert all(one == models[0] for one in models)
    amended = models[0]
    assert [effect.name for effect in amended.effects] == ["coulomb", "steady_force", "exposure"]
    assert (amended.arm.delay, amended.contact.table.friction) == (0.1, 0.3)
    # A second amendment replaces the arm's effects by those of its model, and keeps the others.
    again = amended_content(yaml.safe_load(path.read_text(encoding="utf-8")), arm_with(late, dry), "arm.yaml")[0]
    assert parse_model(again) == amended
    image = np.full((8, 8, 3), 128 / 255, np.float32)
    camera = Camera(8, 8, 10.0, 10.0, 4.0, 4.0)
    seen = WristLens(amended.effects_on("camera"), camera).photo(image, np.eye(4), np.random.default_rng(0))
    assert (seen < 128).all()
    ways = []
    for played in (parse_model(yaml.safe_load(NOMINAL.read_text())), amended):
        with SimWorld(robot(), cube(), played) as sim:
            sim.place(np.array([[1.0, 0, 0, 0.25], [0, 1, 0, 0.1], [0, 0, 1, 0.6], [0, 0, 0, 1]]))
            rows = []
            for _ in range(5):
                sim.command(np.array([0.0, 0.4, 0.3]), 0.0, 0.14)
                sim.step()
                rows.append(np.append(sim.state().object_position[0], sim.joints()[2][2]))
            ways.append(np.array(rows))
    # The wind moves the falling cube; dry friction asks another torque of the third joint.
    assert ways[1][-1, 0] - ways[0][-1, 0] == pytest.approx(0.5 * 0.1 / 0.117 * 0.25**2, rel=0.1)
    assert np.abs(ways[1][:, -1] - ways[0][:, -1]).max() > 1.0


def test_what_was_found_about_an_object_becomes_the_simulations(tmp_path):
    """Coefficients become what they are; shares hold of the asset; what no simulation plays is refused with a way out."""
    nominal = yaml.safe_load(NOMINAL.read_text())
    named = [
        {"name": "object_mass", "parameters": {"share": 0.5}},
        {"name": "gravity_scale", "parameters": {"share": 0.1}},
        {"name": "inertia_scale", "parameters": {"share": 0.2}},
        {"name": "linear_damping", "parameters": {"coefficient": 0.04}},
    ]
    rows = [
        {"name": "object_mass", "parameters": {"share": {"becomes": 0.2}}},
        {"name": "gravity_scale", "parameters": {"share": {"becomes": 10.791}}},
        {"name": "inertia_scale", "parameters": {"share": {"becomes": 1.2}}},
        {"name": "linear_damping", "parameters": {"coefficient": {"becomes": 0.1}}},
    ]
    found = {"amended": named, "effects": rows}
    model = parse_model(object_content(nominal, found, "findings.json"))
    assert (model.object.mass, model.gravity) == (1.5, 10.791)
    assert [(e.name, dict(e.parameters)) for e in model.effects] == [
        ("inertia_scale", {"share": 0.2}), ("linear_damping", {"coefficient": 0.1}),
    ]  # fmt: skip
    large = {"amended": [{"name": "object_size", "parameters": {"share": 0.1}}], "effects": []}
    with pytest.raises(InputError, match=r"findings\.json: the simulation cannot play 'object_size'.*Film the object again"):
        object_content(nominal, large, "findings.json")
    of_an_arm = {"amended": [{"name": "payload", "parameters": {"mass": 0.1}}], "effects": []}
    with pytest.raises(InputError, match="'payload' is no effect on a thrown body"):
        object_content(nominal, of_an_arm, "findings.json")
