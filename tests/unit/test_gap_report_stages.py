"""Stages of a case: what each leaves, and that bad input ends with one sentence and leaves nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.gap.formats.records import Record
from gsbridge.gap.formats.store import load_records
from gsbridge.gap.joints.residual_map import GROUPS, map_residuals
from gsbridge.gap.workflow import load_backend, write_case_records, write_comparison, write_replays

URDF = """<robot name="axis"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-6" upper="6" effort="50" velocity="20"/></joint></robot>"""
MODEL = "urdf: axis.urdf\ncontroller: {mode: pd, stiffness: 60, damping: 4, gravity_compensation: 1.0, between: line}\n"
CASE = "model: model.yaml\nrecords: {fit: a.csv, select: b.csv, verify: c.csv}\n"
HEADER = ["time [s]", "command.axis [rad]", "position.axis [rad]", "velocity.axis [rad/s]", "effort.axis [N m]"]


def rows(phase: float) -> np.ndarray:
    """A log that is well formed: the axis follows a sine, as slowly as its own controller lets it."""
    rng, time = np.random.default_rng(0), np.arange(250) / 100
    wanted, q = 0.4 * np.sin(2.5 * time + phase), 0.39 * np.sin(2.5 * time - 0.17 + phase)
    v = 0.39 * 2.5 * np.cos(2.5 * time - 0.17 + phase)
    effort = 60 * (wanted - q) - 4 * v + 9.81 * 0.2 * np.cos(q)
    table = np.stack([time, wanted, q, v, effort], axis=1)
    table[:, 2:] += rng.normal(size=(250, 3)) * [2e-4, 5e-3, 0.02]
    return table


@pytest.fixture
def folder(tmp_path):
    """A case of one axis with three records."""
    (tmp_path / "axis.urdf").write_text(URDF)
    (tmp_path / "model.yaml").write_text(MODEL)
    (tmp_path / "case.yaml").write_text(CASE)
    for name, phase in (("a", 0.0), ("b", 1.0), ("c", 2.0)):
        np.savetxt(tmp_path / f"{name}.csv", rows(phase), delimiter=",", header=",".join(HEADER), comments="")
    return tmp_path


def read(folder):
    """Run the first stage; returns its files."""
    out = folder / "out"
    write_case_records(folder / "case.yaml", out / "records.npz", out / "records.json")
    return out / "records.npz", out / "records.json"


def test_stages_leave_records_comparison_and_replays(folder):
    data, record = read(folder)
    about = read_json(record)
    assert about["status"] == "pass"
    assert about["records"]["select"]["samples"] == 250
    assert about["records"]["fit"]["rate_hz"] == pytest.approx(100)
    assert list(load_records(data)) == ["fit", "select", "verify"]
    assert load_backend(folder / "model.yaml", data, record).case.records["fit"].digest == about["records"]["fit"]["digest"]

    write_comparison(folder / "model.yaml", data, record, folder / "out/comparison.json")
    compared = read_json(folder / "out/comparison.json")["records"]["select"]
    assert list(compared["channels"]) == ["position.axis", "velocity.axis", "effort.axis"]
    # The log is no motion of this axis: its inertia is nowhere in the efforts.
    assert compared["whole"] > 2

    effect = {"name": "viscous", "joint": "axis", "parameters": {"coefficient": {"value": 0.2}}}
    for effects, there in (([], False), ([effect], True)):
        write_json(folder / "out/findings.json", {"effects": effects})
        write_replays(
            folder / "model.yaml", data, record, folder / "out/findings.json", folder / "out/r.npz", folder / "out/r.json"
        )
        with np.load(folder / "out/r.npz") as series:
            assert ("verify/after" in series.files) == there
            assert series["verify/before"].shape == (250, 3)
            np.testing.assert_allclose(series["verify/measured"], rows(2.0)[:, 2:], atol=1e-5)
    left = read_json(folder / "out/r.json")["records"]["verify"]
    assert left["after"] != pytest.approx(left["before"])


def test_a_split_record_degrades_every_stage(folder):
    (folder / "case.yaml").write_text("model: model.yaml\nrecords: {fit: a.csv, select: b.csv}\n")
    later = rows(2.0)
    later[:, 0] += 2.5
    np.savetxt(folder / "b.csv", np.concatenate([rows(1.0), later]), delimiter=",", header=",".join(HEADER), comments="")
    data, record = read(folder)
    write_comparison(folder / "model.yaml", data, record, folder / "out/comparison.json")
    for name in ("records", "comparison"):
        content = read_json(folder / f"out/{name}.json")
        assert content["status"] == "degraded"
        assert any("cut into" in reason for reason in content["reasons"])


def spoil_rows(change):
    """Write the record to be selected with a change."""

    def spoil(folder):
        table, header = rows(1.0), list(HEADER)
        table, header = change(table, header)
        np.savetxt(folder / "b.csv", table, delimiter=",", header=",".join(header), comments="")

    return spoil


def renamed(place, name):
    """A column of another name or unit."""
    return lambda table, header: (table, [name if k == place else text for k, text in enumerate(header)])


def scaled(place, factor):
    """A column times a factor."""
    return lambda table, header: (table * np.where(np.arange(5) == place, factor, 1.0), header)


def set_to(row, column, value):
    """One number changed."""

    def change(table, header):
        table[row, column] = value
        return table, header

    return change


def text(name, content):
    """Another file."""
    return lambda folder: (folder / name).write_text(content)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (spoil_rows(renamed(2, "angle [rad]")), "the column 'position.axis' is missing"),
        (spoil_rows(renamed(1, "wish.axis [rad]")), "no columns 'command.axis'"),
        (spoil_rows(renamed(2, "position.axis")), "has no unit"),
        (spoil_rows(renamed(2, "position.axis [kg]")), "is no angle"),
        (spoil_rows(renamed(4, "effort.axis [A]")), "in amperes and no gain is known"),
        (spoil_rows(scaled(2, 180 / np.pi)), "degrees"),
        (spoil_rows(set_to(99, 0, 0.5)), "the clock runs backwards"),
        (spoil_rows(set_to(50, 3, np.nan)), "holds no number in data row 51"),
        (spoil_rows(lambda table, header: (table[:150], header)), "lasts 1.49 s"),
        (lambda folder: (folder / "b.csv").unlink(), "cannot be read"),
        (text("b.csv", ""), "this is no table"),
        (text("model.yaml", MODEL + "joints: [elbow]\n"), "no moving joint 'elbow'"),
        (text("model.yaml", MODEL.replace("stiffness: 60, ", "")), "controller.stiffness is missing"),
        (text("axis.urdf", "<robot>"), r"this is no valid XML .*\)\. Correct it, or export it again$"),
        (
            lambda folder: (folder / "axis.urdf").unlink(),
            r"axis\.urdf: the description cannot be read: it does not exist.* Check 'urdf' in .*model\.yaml$",
        ),
        (text("axis.urdf", URDF.replace('<mass value="1"/>', "")), "damaged mass properties"),
        (text("case.yaml", "model: model.yaml\nrecords: {train: a.csv}\n"), "'train' is no role"),
        (text("case.yaml", "model: model.yaml\nrecord: {fit: a.csv}\n"), "the key 'record' is unknown"),
        (text("case.yaml", "model: model.yaml\nrecords: [a.csv]\n"), "'records' does not name a file for each role"),
        (text("model.yaml", MODEL.replace("stiffness: 60", "stiffness: -60")), "'controller.stiffness' is below zero"),
        (text("case.yaml", CASE + "effects: [rust]\n"), "'rust' is unknown"),
        # The end of the file, as PyYAML's own parser and as libyaml counts it.
        (text("case.yaml", "model: ["), "line 1, column 9|line 2, column 1"),
        (text("case.yaml", CASE + "model: other.yaml\n"), "the key 'model' stands twice, in lines 1 and 3"),
        (lambda folder: (folder / "case.yaml").write_bytes(b"model: \xff"), "not valid YAML"),
    ],
)
def test_bad_input_ends_with_one_sentence_and_leaves_nothing(folder, spoil, said):
    spoil(folder)
    with pytest.raises(InputError, match=said) as error:
        read(folder)
    assert "\n" not in str(error.value)
    assert not (folder / "out").exists()


def test_a_difference_in_one_direction_is_found_there():
    """Noise everywhere, and more of it while the first joint speeds up forwards; the second joint's channel is quiet."""
    time = np.arange(2000) / 100
    q = np.stack([np.sin(time), np.cos(0.7 * time)], axis=1)
    v = np.stack([np.cos(time), -0.7 * np.sin(0.7 * time)], axis=1)
    outputs = {"position": q, "velocity": v, "effort": np.ones_like(q)}
    residual = np.random.default_rng(3).normal(size=(2000, 2))
    faster = (v[:, 0] > 0.05) & (q[:, 0] < -0.2)
    residual[faster, 0] *= 4
    view = SimpleNamespace(record=Record("fit", time, ("a", "b"), {}, {}), channels=(("position", 0), ("position", 1)))
    found = map_residuals(view, residual, outputs)
    columns = [name for names in GROUPS.values() for name in names]
    place = columns.index("speeds up +")
    assert found.channels == ("position.a", "position.b")
    assert np.nanargmax(found.values[0]) == place
    assert found.values[0, place] == pytest.approx(4.0, rel=0.1)
    assert found.marked[0, place]
    assert not found.marked[0, columns.index("slows down +")]
    assert not found.marked[1].any()
    assert np.nanmax(np.abs(found.values[1] - 1)) < 0.35
