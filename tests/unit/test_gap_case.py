"""Mistakes of users in a case and in its model: each is refused in one line that names the key."""

import re

import pandas as pd
import pytest
import yaml
from test_gap_sliding import STIFFNESS, log, write_case, write_model

from gsbridge.errors import InputError
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.diagnose import views_of
from gsbridge.gap.joints.effort_scale import EffortScale, effort_scale
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.workflow import JointBackend


def refused(path, read=read_joint_case) -> str:
    with pytest.raises(InputError) as error:
        read(path)
    assert error.value.source == str(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"columns": {"stamp": "time"}},
            "'stamp' under 'columns' is no name of ours for a column. Write 'columns: {position.ra",
        ),
        ({"columns": {"position.rial": "enc"}}, "'position.rial' under 'columns'"),
        (
            {"columns": {"position.rail": "enc", "command.rail": "enc"}},
            "'command.rail' and 'position.rail' are both read from 'enc'",
        ),
        ({"columns": {"position.rail": 3}}, "columns.position.rail is 3, which is no text"),
        ({"units": {"postion": "m"}}, "'postion' under 'units'"),
        ({"units": "SI"}, "'units' is 'SI'. Write 'units: {position: deg}'"),
        ({"noise": {"command": 1e-4}}, "'command' under 'noise'"),
        ({"tolerance": 1e-4}, "'tolerance' is 0.0001. Write 'tolerance: {position: 5.0e-4}'"),
        ({"records": {"fit": None}}, "records.fit is None, which is no file name. Write 'fit: log.csv'"),
    ],
)
def test_keys_of_a_case_that_name_nothing(tmp_path, changes, said):
    assert said in refused(write_case(tmp_path, **changes))


CONTROLLER = {"mode": "pd", "stiffness": STIFFNESS, "damping": 900.0}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"joints": "rail"}, "'joints' is 'rail'. Write a list, 'joints: [rail]'"),
        ({"gravity": -9.81}, "'gravity' is -9.81. Give three numbers"),
        ({"gravity": [0, -9.81]}, "Give three numbers"),
        ({"armature": {"rail": 1.0}}, "'armature' is given by joint. Give a list in the order of rail"),
        ({"viscous": -1.0}, "'viscous' is below zero"),
        ({"viscous": [1.0, 2.0]}, "'viscous' has 2 numbers for 1 joints (rail)"),
        ({"urdf": None}, "'urdf' is None. Write 'urdf: FILE'"),
        ({"torque_limit": 5.0}, "'torque_limit' is unknown. It belongs to 'controller'"),
        ({"controller": CONTROLLER | {"armature": 1.0}}, "'controller.armature' is unknown. It belongs beside 'controller'"),
        ({"controller": CONTROLLER | {"stiffness": "80 N/m"}}, "'controller.stiffness' is '80 N/m', which is no number"),
        ({"controller": CONTROLLER | {"torque_limit": 0}}, "'controller.torque_limit' is zero, so that the motor does nothing"),
        ({"controller": CONTROLLER | {"rate": 0}}, "'rate' is 0. Give a number above zero"),
        ({"controller": CONTROLLER | {"rate": "1 kHz"}}, "'rate' is '1 kHz', which is no number"),
        ({"controller": CONTROLLER | {"rate": 4000}}, "no multiple of controller.rate 4000. Write 'physics_rate: 4000'"),
        (
            {"controller": CONTROLLER | {"gravity_compensation": 100}},
            "'gravity_compensation' is 100. Give a number from 0 to 2",
        ),
        ({"controller": {"mode": "position", "bandwidth": -3}}, "'bandwidth' is -3. Give a number above zero"),
    ],
)
def test_numbers_of_a_model_that_make_no_sense(tmp_path, changes, said):
    assert said in refused(write_model(tmp_path, **changes), read_mechanism_model)


@pytest.mark.parametrize(("rate", "whole"), [(66.667, 15), (33.333, 30), (333.333, 3), (1e3 / 15.0, 15), (250, 4)])
def test_a_rate_that_was_rounded_is_taken(tmp_path, rate, whole):
    """Loops of 15, 30 and 3 ms, as people write them down."""
    system = read_mechanism_model(write_model(tmp_path, controller=CONTROLLER | {"rate": rate}))
    assert system.controller.rate == 1000.0 / whole


@pytest.mark.parametrize("rate", [300.0, 123.4567, 70.0, 333.0])
def test_the_rate_that_is_advised_is_taken(tmp_path, rate):
    said = refused(write_model(tmp_path, controller=CONTROLLER | {"rate": rate}), read_mechanism_model)
    wanted = float(re.search(r"Write 'physics_rate: ([0-9.]+)'", said)[1])
    system = read_mechanism_model(write_model(tmp_path, controller=CONTROLLER | {"rate": rate}, physics_rate=wanted))
    assert system.controller.rate == pytest.approx(rate, rel=1e-6)


def test_joints_may_be_numbers(tmp_path):
    path = write_model(tmp_path, joints=[1])
    (tmp_path / "gantry.urdf").write_text((tmp_path / "gantry.urdf").read_text().replace('name="rail"', 'name="1"'))
    assert read_mechanism_model(path).joints == ("1",)


def test_a_column_that_is_not_in_the_log_is_told(tmp_path):
    """A name that the user wrote down is never passed over: without the column, the diagnosis would blame something else."""
    case = write_case(tmp_path, columns={"effort.rail": "tau_rial"})
    with pytest.raises(
        InputError, match=r"no record has the column 'tau_rial', which the case names for 'effort\.rail'\. They"
    ):
        read_joint_case(case)
    # A kind that one record alone has is left out, and told.
    table = pd.read_csv(tmp_path / "fit.csv")
    table.rename(columns=lambda name: name.replace("effort.rail", "tau_rial")).to_csv(tmp_path / "fit.csv", index=False)
    assert any("effort" in reason for reason in read_joint_case(case).reasons)


def test_a_model_that_runs_away_by_itself_is_refused(tmp_path):
    """Gains that no step of a millisecond holds, as those of a light wrist without its rotor."""
    case = write_case(tmp_path)
    write_model(tmp_path, controller=CONTROLLER | {"stiffness": 1e9, "damping": 1e7})
    with pytest.raises(InputError, match=r"the model itself is unstable: it runs away after 0\.\d+ s of") as error:
        JointBackend.read(case)
    assert error.value.source == str(tmp_path / "model.yaml")


@pytest.mark.parametrize("mode", ["free", "torque"])
def test_repeats_need_a_controller_that_leads_them_to_the_same_positions(tmp_path, mode):
    """Two perfect logs of one swing differ by up to its speed times the time by which one of them begins later."""
    case = write_case(tmp_path, repeats={"fit": "again.csv"})
    write_model(tmp_path, controller={"mode": mode})
    assert f"'repeats' tell nothing in mode {mode}, where no controller leads" in refused(case)
    content = yaml.safe_load(case.read_text())
    case.write_text(yaml.safe_dump(content | {"repeats": None}))
    if mode == "free":
        assert read_joint_case(case).records["fit"].tolerance == {}


def test_a_log_that_rests_has_nothing_to_fit(tmp_path):
    case = write_case(tmp_path)
    still = log(1).assign(**{"command.rail [m]": 0.1})
    still.to_csv(tmp_path / "select.csv", index=False)
    assert any("commanded to move in the record 'select'" in reason for reason in read_joint_case(case).reasons)
    still.to_csv(tmp_path / "fit.csv", index=False)
    with pytest.raises(InputError, match="no joint is commanded to move") as error:
        read_joint_case(case)
    assert error.value.source == str(tmp_path / "fit.csv")


def test_breaks_of_a_log_and_joints_that_are_held_are_told(tmp_path):
    case = write_case(tmp_path)
    table = log(0)
    table.loc[600:, "time [s]"] += 60.0
    table["position.hoist [mm]"] = 200.0
    table.to_csv(tmp_path / "fit.csv", index=False)
    urdf = (tmp_path / "gantry.urdf").read_text()
    joint = (
        '<link name="hook"/><joint name="hoist" type="prismatic"><parent link="carriage"/><child link="hook"/></joint></robot>'
    )
    (tmp_path / "gantry.urdf").write_text(urdf.replace("</robot>", joint))
    model = yaml.safe_load((tmp_path / "model.yaml").read_text()) | {"joints": ["rail"]}
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(model))
    found = read_joint_case(case)
    assert found.records["fit"].duration == pytest.approx(2.995)
    assert any("of the record 'fit' it breaks off for up to 60 s" in reason for reason in found.reasons)
    assert any("joint 'hoist' is logged up to 0.2 m from zero" in reason for reason in found.reasons)


@pytest.mark.parametrize(("scale", "told"), [(-1.0, True), (3.0, False)])
def test_efforts_of_the_other_sign_are_to_be_turned(scale, told):
    said = EffortScale({"shoulder": 1.0, "elbow": scale}, 900.0, 4.0, 1).sentence
    assert ("turn the sign of the efforts of elbow, and check the unit" in said) == told
    assert "check the unit of the efforts" in said


@pytest.mark.parametrize("lacking", ["fit", "select"])
def test_columns_that_one_record_lacks_are_left_out_of_all(tmp_path, lacking):
    """The case is then the same as one in which no record has these columns."""
    scales = []
    for without in ((lacking,), ("fit", "select", "verify")):
        case = write_case(tmp_path, noise={"velocity": 2e-4})
        for number, role in enumerate(("fit", "select", "verify")):
            dropped = ["velocity.rail [mm/s]"] if role in without else []
            log(number).drop(columns=dropped).to_csv(tmp_path / f"{role}.csv", index=False)
        found = read_joint_case(case)
        told = f"the columns of 'velocity' are missing in the record '{lacking}': they were left out of the others, too"
        assert (told in found.reasons) == (len(without) == 1)
        assert [sorted(record.measured) for record in found.records.values()] == [["effort", "position"]] * 3
        assert not any("velocity" in record.sigma for record in found.records.values())
        views = views_of(Mechanism(found.system), found.records)
        scales.append(effort_scale((views["fit"], views["select"])).scales["rail"])
    assert scales[0] == scales[1]


def test_records_that_share_no_positions_are_refused(tmp_path):
    case = write_case(tmp_path)
    write_model(tmp_path, tool="carriage")
    tool = {"tool.x [m]": 0.0, "tool.y [m]": 0.0, "tool.z [m]": 0.0}
    log(1).drop(columns="position.rail [mm]").assign(**tool).to_csv(tmp_path / "select.csv", index=False)
    assert "some records log the joints' positions and others the tool's, which cannot be compared" in refused(case)
