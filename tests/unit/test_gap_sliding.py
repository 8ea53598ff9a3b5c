"""A linear axis in metres: what its effects are in, what of its logs is refused, and a case of it through all stages."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.sliding import SLIDING_EFFECTS, UNITS
from gsbridge.errors import InputError
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.records import Layout
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model, read_mechanism_model
from gsbridge.gap.workflow import write_case_records, write_comparison, write_findings, write_replays, write_screening
from gsbridge.report.gap.page import CaseFiles, write_gap_report

MASS, STIFFNESS, DAMPING, FRICTION = 12.0, 20_000.0, 900.0, 9.0
"""kg, N/m, N s/m, N."""

URDF = f"""<robot name="gantry"><link name="base"/>
<link name="carriage"><inertial><mass value="{MASS}"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-0.6" upper="0.6" effort="500" velocity="2"/></joint></robot>"""


def write_model(folder, **changes):
    """The nominal axis: a carriage on a level rail, without friction."""
    (folder / "gantry.urdf").write_text(URDF)
    controller = {"mode": "pd", "stiffness": STIFFNESS, "damping": DAMPING, "between": "line"}
    content = {"urdf": "gantry.urdf", "controller": controller} | changes
    (folder / "model.yaml").write_text(yaml.safe_dump(content))
    return folder / "model.yaml"


def log(number: int, friction: float = FRICTION, rate: int = 200, seconds: float = 5.0, fine: int = 8) -> pd.DataFrame:
    """What a carriage with dry friction does, stepped here at 8 kHz: its controller at 1 kHz, the log in millimetres."""
    grid = np.arange(round(1000 * seconds)) / 1000
    stamps = np.arange(round(rate * seconds)) / rate
    sines = [(0.11, 1.3 + 0.4 * number), (0.05, 4.1 - 0.7 * number), (0.012, 9.0 + 1.1 * number)]
    sent = np.interp(grid, stamps, sum(a * np.sin(w * stamps) for a, w in sines))
    x, v, rows, step = 0.0, 0.0, [], 1e-3 / fine
    v = sum(a * w for a, w in sines)
    for target in sent:
        force = STIFFNESS * (target - x) - DAMPING * v
        rows.append((x, v, force))
        for _ in range(fine):
            new = v + step * force / MASS
            new -= np.clip(new, -step * friction / MASS, step * friction / MASS)
            x, v = x + step * 0.5 * (v + new), new
    table = np.array(rows)[:: 1000 // rate]
    rng = np.random.default_rng(number)
    noisy = table + rng.normal(0.0, 1.0, table.shape) * [2e-6, 2e-4, 0.05]
    return pd.DataFrame(
        {
            "time [s]": stamps,
            "command.rail [m]": sent[:: 1000 // rate],
            "position.rail [mm]": 1e3 * noisy[:, 0],
            "velocity.rail [mm/s]": 1e3 * noisy[:, 1],
            "effort.rail [N]": noisy[:, 2],
        }
    )


def write_case(folder, spoil=lambda table: table, **changes):
    for number, role in enumerate(("fit", "select", "verify")):
        spoil(log(number)).to_csv(folder / f"{role}.csv", index=False)
    write_model(folder)
    content = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ("fit", "select", "verify")}} | changes
    (folder / "case.yaml").write_text(yaml.safe_dump(content))
    return folder / "case.yaml"


@pytest.mark.parametrize("name", list(SLIDING_EFFECTS))
def test_effects_of_a_joint_that_slides_are_in_metres_and_newtons(name):
    """At a wheel of 0.1 m a torque of 1 N m is a force of 10 N, an angle of 1 rad a way of 0.1 m."""
    sizes = {"rad": 0.1, "N m": 10.0, "kg m2": 100.0}
    for ours, theirs in zip(SLIDING_EFFECTS[name].parameters, JOINT_EFFECTS[name].parameters, strict=True):
        assert "rad" not in ours.unit.replace("rad/m", "")
        assert "N m" not in ours.unit
        assert (ours.unit != theirs.unit) == (theirs.unit in UNITS or theirs.per_angle)
        if theirs.unit in sizes:
            assert ours.high == pytest.approx(theirs.high * sizes[theirs.unit])
    for values in SLIDING_EFFECTS[name].directions():
        assert SLIDING_EFFECTS[name].scaled(values, 1.0) == values


def test_an_eccentric_encoder_needs_a_joint_that_turns(tmp_path):
    assert set(JOINT_EFFECTS) - set(SLIDING_EFFECTS) == {"eccentricity"} | {
        name for name, effect in JOINT_EFFECTS.items() if effect.scope == "mechanism"
    }
    item = {"name": "eccentricity", "joint": "rail", "parameters": {"sine": 0.01, "cosine": 0.0}}
    with pytest.raises(InputError, match="'eccentricity' is unknown"):
        read_mechanism_model(write_model(tmp_path, effects=[item]))


def test_ranges_of_a_models_effects_are_those_of_a_sliding_joint(tmp_path):
    item = {"name": "coulomb", "joint": "rail", "parameters": {"torque": 300.0}}
    assert read_mechanism_model(write_model(tmp_path, effects=[item])).effects[0].parameters == {"torque": 300.0}
    item["parameters"]["torque"] = 600.0
    with pytest.raises(InputError, match="0 to 500 N"):
        read_mechanism_model(write_model(tmp_path, effects=[item]))
    with pytest.raises(InputError, match="no list"):
        parse_mechanism_model({"urdf": "gantry.urdf", "controller": {"mode": "free"}, "effects": {"a": 1}}, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "factor", "said"),
    [
        ("position.rail [mm]", "position.rail [rad]", 1e-3, r"\[rad\], which is no length\. Use \[m\]"),
        ("position.rail [mm]", "position.rail [m]", 1.0, "looks like .*millimetres"),
        ("velocity.rail [mm/s]", "velocity.rail [m/s]", 1.0, "'velocity' is .* looks like millimetres"),
        ("effort.rail [N]", "effort.rail [N m]", 1.0, "no force"),
        ("effort.rail [N]", "effort.rail [A]", 1.0, "N/A"),
    ],
)
def test_units_that_no_linear_axis_has_are_refused(tmp_path, old, new, factor, said):
    def spoil(table):
        return table.rename(columns={old: new}).assign(**{new: factor * table[old]})

    with pytest.raises(InputError, match=said) as error:
        read_joint_case(write_case(tmp_path, spoil))
    assert "\n" not in str(error.value)


def test_currents_of_several_joints_have_a_gain_each(tmp_path):
    """A rail in N/A and a hinge in N m/A, from a list or by name."""
    time = np.arange(300) / 100
    wave = np.sin(3 * time)
    columns = {"time [s]": time, "position.rail [m]": 0.1 * wave, "position.hinge [rad]": wave}
    columns |= {"effort.rail [A]": 2 * wave, "effort.hinge [A]": 3 * wave}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    gains = {"rail": 40.0, "hinge": 0.5}
    record = read_log(tmp_path / "log.csv", Layout(("rail", "hinge"), torque_per_ampere=gains, sliding=("rail",)))
    np.testing.assert_allclose(record.measured["effort"], np.stack([80 * wave, 1.5 * wave], axis=1), atol=1e-9)
    with pytest.raises(InputError, match=r"effort\.hinge' is in amperes"):
        read_log(tmp_path / "log.csv", Layout(("rail", "hinge"), torque_per_ampere={"rail": 40.0}, sliding=("rail",)))


@pytest.mark.parametrize("gains", ["ten", [1.0, 2.0], {"slide": 1.0}, True, 0])
def test_gains_that_fit_no_joint_are_refused(tmp_path, gains):
    with pytest.raises(InputError, match="torque_per_ampere"):
        read_joint_case(write_case(tmp_path, torque_per_ampere=gains))


def test_dry_friction_of_a_linear_axis_is_named_in_newtons(tmp_path):
    """From the case to the page, as the workflow's rules do it."""
    case, model = write_case(tmp_path, effects=["coulomb", "viscous", "lag", "gain_p", "armature"]), tmp_path / "model.yaml"
    data, record, bank = tmp_path / "records.npz", tmp_path / "records.json", tmp_path / "bank"
    names = ("comparison", "screen", "findings", "replays")
    comparison, screen, findings, replays = (tmp_path / f"{name}.json" for name in names)
    write_case_records(case, data, record)
    write_comparison(model, data, record, comparison)
    write_screening(model, data, record, bank, screen)
    write_findings(model, data, record, bank, findings, tmp_path / "amended.yaml", seed=0)
    write_replays(model, data, record, findings, tmp_path / "replays.npz", replays)
    found = json.loads(findings.read_text())
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    row = effect["parameters"]["torque"]
    assert (effect["name"], effect["joint"], row["unit"], row["called"]) == ("coulomb", "rail", "N", "force")
    assert row["value"] == pytest.approx(FRICTION, rel=0.05)
    assert "(force " in found["sentence"]
    assert json.loads(record.read_text())["sliding"] == ["rail"]
    (amended,) = read_mechanism_model(tmp_path / "amended.yaml").effects
    assert amended.parameters["torque"] == row["value"]
    files = CaseFiles(record, comparison, screen, findings, tmp_path / "replays.npz", replays)
    write_gap_report("rail", files, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "force" in page
    assert not any(f">{unit}<" in page for unit in ("rad", "rad/s", "N m"))
