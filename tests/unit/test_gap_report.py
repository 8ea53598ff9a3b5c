"""The report of a case: what it says, and that a browser shows it without a network."""

import json
import re

import numpy as np
import pytest
from browser import check, needs_browser
from gap_files import findings, write_case
from recording_file import read_recording
from scipy import stats

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.residual_map import LEVEL, few_false
from gsbridge.gap.joints.residual_map import GROUPS
from gsbridge.report.gap.page import CaseFiles, write_gap_report
from gsbridge.report.gap.rows import COLUMNS, write_gap_rows
from gsbridge.report.gap.text import effect_title, explanation_title, most, next_steps, remains
from gsbridge.report.recordings.gap import enlargement, lines, place_joints, record_gap
from gsbridge.report.tables.rows import read_rows


def case_files(paths):
    """Arguments of the page."""
    return CaseFiles(*(paths[name] for name in ("records", "comparison", "screen", "findings", "series", "replays")))


def page(tmp_path, found, joints=("axis",)):
    """Text of the page of a made-up case."""
    write_gap_report("my_case", case_files(write_case(tmp_path, found, joints)), tmp_path / "report.html")
    return (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_page_says_all_that_is_asked_for(tmp_path):
    text = page(tmp_path, findings())
    for said in (
        "Coulomb friction (torque 0.42 ± 0.03 N m)",
        *("31 ×", "2.1 ×", "93 %", "0.39 to 0.45", "5\u202f718", "0.0002", "f" * 16, "241", "61", "12.5"),
        "results/gap/my_case/model.yaml",
        "speeds up forwards: 31 times the noise",
        "Nothing beyond the noise",
        "free play in the transmission at axis (0.970)",
        "friction that changes while running",
    ):
        assert said in text, said
    # On a phone a column of units would be out of sight.
    assert re.search(r'torque, <span class="unit">N m</span></td>', text)
    assert text.count("<img") == 3
    assert "with reserve" not in text


@pytest.mark.parametrize(
    ("verdict", "p", "said"),
    [
        ("no_discrepancy", 0.6, "Nothing beyond the noise."),
        ("not_enough_excitation", 0.6, "Nothing beyond the noise."),
        ("not_enough_excitation", 1e-4, "All of it: the difference shows on 'select' alone, so that nothing could be learnt"),
        ("not_attributable", 1e-4, "All of it: nothing learnt from some throws holds on others."),
        ("none_of_the_known", 1e-4, "All of it: no effect was fitted."),
    ],
)
def test_what_remains_is_nothing_where_nothing_shows_and_all_where_nothing_explains(verdict, p, said):
    """As the sentences of the findings say."""
    found = {**findings(), "verdict": verdict, "effects": [], "p_value": p, "p_remaining": p}
    nowhere = {"values": [[0.5]], "marked": [[False]], "channels": ["position"], "groups": {"phase": ["flight"]}}
    assert remains(found, nowhere).startswith(said)


@pytest.fixture
def without_figures(monkeypatch):
    """Pages of words alone: drawing takes most of the time."""
    for name in ("gap.sections.draw_residuals", "gap.sections.draw_channels", "gap.page.draw_residual_map"):
        monkeypatch.setattr(f"gsbridge.report.{name}", lambda *arguments: "data:,")


@pytest.mark.usefixtures("without_figures")
def test_an_account_is_told_line_by_line(tmp_path):
    found = findings("none_of_the_known", warnings=["The gap is 70 times the noise."])
    entry = {**found["effects"][0], "label": "coulomb:axis", "share": 0.62, "verdict": "one of"}
    entry["alternatives"] = ["viscous:axis"]
    remains = {"channel": "position.axis", "phase": "when it moves fast", "size": 4.2, "unit": "noise"}
    text = page(tmp_path, {**found, "account": {"entries": [entry], "explained": 0.62, "remains": remains}})
    for said in (
        "The account",
        "62.0 %",
        "one of",
        "viscous friction",
        "It closes 62 % of the gap",
        "4.2 times",
        "70 times the noise",
    ):
        assert said in text, said
    assert "To prove Coulomb friction: compare slow with fast constant speed" in text
    two = page(tmp_path, {**found, "account": {"entries": [entry, entry], "explained": 0.9, "remains": remains}})
    assert "Together they close 90 % of the gap" in two
    assert "Each share is what an effect adds to those above it." in two


@pytest.mark.usefixtures("without_figures")
def test_what_is_all_but_impossible_is_told_without_powers_of_ten(tmp_path):
    found = findings()
    found["rivals"][0]["probability"], found["rivals"][1]["probability"] = 1.0 - 5.85e-12, 5.85e-227
    text = page(tmp_path, {**found, "p_value": 1e-6, "p_remaining": 1e-6, "something_remains": True})
    for said in ("&lt; 0.1 %", "&gt; 99.9 %", "&lt; 0.001", "More than noise (p &lt; 0.001)"):
        assert said in text, said
    assert not re.search(r"\d[eE]-\d", re.sub(r'data:[^"]*|<style>.*?</style>', "", text, flags=re.DOTALL))


@pytest.mark.usefixtures("without_figures")
def test_degraded_reasons_stand_at_the_top(tmp_path):
    text = page(tmp_path, findings(status="degraded", reasons=["the record 'fit' was cut"]))
    assert text.index("the record &#39;fit&#39; was cut") < text.index('id="residuals"')


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize(
    ("verdict", "label", "said"),
    [
        ("no_discrepancy", "no discrepancy", "could not show"),
        ("ambiguous", "ambiguous", "compare slow with fast constant speed"),
        ("none_of_the_known", "none of the known effects", "no catalogue has"),
        ("not_attributable", "something remains, not attributable", "Throw it slowly"),
        ("not_enough_excitation", "not enough excitation", "faster and slower motion"),
    ],
)
def test_every_verdict_has_a_page_and_a_next_step(tmp_path, verdict, label, said):
    text = page(tmp_path, findings(verdict, sentence="What was found."))
    assert label in text
    assert said in text
    assert "model.yaml instead" not in text


@pytest.mark.usefixtures("without_figures")
def test_an_account_that_calls_an_effect_likely_stands_at_the_top(tmp_path):
    entry = {**findings()["effects"][0], "label": "coulomb", "share": 0.7, "verdict": "likely, not proven", "alternatives": []}
    remains = {"channel": "position", "phase": "while the joint is at rest", "size": 2.0, "unit": "noise"}
    text = page(tmp_path, findings("none_of_the_known", account={"entries": [entry], "explained": 0.7, "remains": remains}))
    assert "none of the known effects" not in text
    assert "likely, not proven" in text[: text.index('id="residuals"')]
    assert "Most of the rest: position, while the joint is at rest: 2 times the noise." in text
    assert "The same commands went to a machine" in text


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize(("explained", "label"), [(0.77, "likely together, none proven"), (0.4, "none of the known effects")])
def test_effects_that_only_together_close_most_are_told_at_the_top(tmp_path, explained, label):
    entry = {**findings()["effects"][0], "label": "coulomb", "share": 0.3, "verdict": "likely, not proven", "alternatives": []}
    remains = {"channel": "position.elbow", "phase": "when it moves fast", "size": 2000.0, "unit": "noise"}
    account = {"entries": [entry, entry], "explained": explained, "remains": remains}
    text = page(tmp_path, findings("none_of_the_known", account=account))
    assert label in text[: text.index('id="residuals"')]
    alone = {**account, "entries": [{**entry, "share": explained, "verdict": "one of"}]}
    assert "likely together" not in page(tmp_path, findings("none_of_the_known", account=alone))
    assert "Most of the rest: position of elbow, when it moves fast: 2\u202f000 times the noise." in text


@pytest.mark.usefixtures("without_figures")
def test_what_was_not_adopted_is_not_called_amended(tmp_path):
    text = page(tmp_path, findings("none_of_the_known"))
    assert "The best explanation, which was not adopted" in text
    assert "amended model" not in text


@pytest.mark.usefixtures("without_figures")
def test_titles_are_escaped(tmp_path):
    assert "<script>" not in page(tmp_path, findings(sentence="<script>alert(1)</script>"))


def test_a_damaged_file_is_refused(tmp_path):
    paths = write_case(tmp_path, findings())
    paths["series"].write_bytes(b"no archive")
    with pytest.raises(InputError, match="cannot be read"):
        write_gap_report("x", case_files(paths), tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


@needs_browser
def test_page_of_an_arm_in_a_browser(tmp_path):
    """Seven joints: nothing sticks out, and the sentence is seen without scrolling."""
    found = check(page(tmp_path, findings(), tuple(f"a{k}" for k in range(7))), tmp_path)
    assert found["pictures"] == 3
    assert found["sentence"] < 400


def test_rows_of_cases(tmp_path):
    for name, found in (("a", findings()), ("b", findings("ambiguous")), ("c", findings("no_discrepancy"))):
        (tmp_path / f"{name}.json").write_text(json.dumps(found))
    write_gap_rows({name: tmp_path / f"{name}.json" for name in "abc"}, tmp_path / "gap.csv")
    rows = read_rows(tmp_path / "gap.csv", COLUMNS)
    assert [row["effects"] for row in rows] == ["coulomb:axis", "coulomb:axis", ""]
    assert [row["amended"] for row in rows] == ["coulomb:axis", "", ""]
    assert rows[1]["ambiguous"] == "coulomb:axis | lag + viscous:axis"
    assert (rows[0]["verify_before"], rows[2]["verify_before"]) == ("31.0000", "")


def test_no_cases_give_a_table_without_rows(tmp_path):
    write_gap_rows({}, tmp_path / "gap.csv")
    assert (tmp_path / "gap.csv").read_text() == ",".join(COLUMNS) + "\n"


def test_names_of_effects_are_those_of_the_catalogue():
    assert effect_title("coulomb:a4") == "Coulomb friction at a4"
    assert effect_title("no_such_effect") == "no such effect"
    assert (
        explanation_title(["coulomb:a4", "no_such"])
        == explanation_title("coulomb:a4 + no_such")
        == "Coulomb friction at a4 + no such"
    )


def test_without_efforts_the_page_asks_for_them():
    about = {"records": {"fit": {"measured": ["position"]}}, "mode": "pd"}
    steps = next_steps(findings("ambiguous"), about, {"unseen": []}, "x")
    assert any("efforts" in step for step in steps)
    assert not any("efforts" in step for step in next_steps(findings(), {**about, "mode": "free"}, {"unseen": []}, "x"))


def test_an_experiment_that_proves_an_effect_at_two_joints_is_proposed_once():
    about = {"records": {"fit": {"measured": ["position"]}}, "mode": "torque"}
    dry = {"title": "Coulomb friction", "tell_apart": "ramp the torque"}
    entries = [{**dry, "joint": "a"}, {**dry, "joint": "b"}, {"title": "drag", "tell_apart": "go fast", "joint": "a"}]
    found = findings("none_of_the_known") | {"account": {"entries": entries, "explained": 0.9}, "amended": []}
    steps = next_steps(found, about, {"unseen": []}, "x")
    assert [step for step in steps if step.startswith("To prove")] == [
        "To prove Coulomb friction: ramp the torque; log that as a further record.",
        "To prove drag: go fast; log that as a further record.",
    ]


def test_what_no_simulation_plays_comes_with_something_else_to_do():
    found = findings()
    found["effects"][0]["instead"] = JOINT_EFFECTS["backlash"].advice
    about = {"records": {"fit": {"measured": ["position", "effort"]}}, "mode": "pd"}
    steps = next_steps(found, about, {"unseen": []}, "x")
    assert any("cannot learn with this" in step and "Have the gear tightened" in step for step in steps)
    assert not any("cannot learn with this" in step for step in next_steps(findings(), about, {"unseen": []}, "x"))


def test_the_darkest_cell_is_told_only_where_it_is_marked():
    columns = sum(len(names) for names in GROUPS.values())
    values = np.ones((1, columns))
    values[0, 8] = 5.0
    found = {"groups": GROUPS, "channels": ["effort.elbow"], "values": values.tolist(), "marked": (values > 2).tolist()}
    assert most(found) == "effort of elbow, when it moves fast: 5 times the noise"
    assert most({**found, "marked": (values > 9).tolist()}) is None


def test_marked_cells_are_those_of_benjamini_and_hochberg():
    """Against scipy's adjusted p-values."""
    rng = np.random.default_rng(1)
    chances = np.concatenate([rng.uniform(size=40), 10 ** rng.uniform(-8, -2, 20)]).reshape(6, 10)
    counted = rng.random(chances.shape) < 0.8
    expected = np.zeros_like(counted)
    expected[counted] = stats.false_discovery_control(chances[counted]) <= LEVEL
    np.testing.assert_array_equal(few_false(chances, counted), expected)
    assert expected.any()


URDF = """<robot name="arm"><link name="base"/>
<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="a"/><origin xyz="0 0 0.5" rpy="0.3 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0" rpy="0 0.2 0.1"/><axis xyz="0 1 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""  # noqa: E501


@pytest.fixture
def mechanism(tmp_path):
    """A lift with a turning link, as a model and as a chain."""
    from gsbridge.gap.joints.mechanism.chain import Chain
    from gsbridge.gap.joints.mechanism.inertials import Skeleton

    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "model.yaml").write_text("urdf: arm.urdf\ncontroller: {mode: free}\n")
    skeleton = Skeleton.read(tmp_path / "arm.urdf", ("lift", "turn"))
    chain = Chain.of(skeleton, ("lift", "turn"))
    return chain, chain.bodies(skeleton.inertials)[:, 1:4], tmp_path


def test_joints_stand_where_mujoco_puts_them(mechanism):
    import mujoco

    chain, centres, folder = mechanism
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.urdf"))
    data = mujoco.MjData(model)
    q = np.array([0.3, -0.7])
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    poses = place_joints(chain, q)
    np.testing.assert_allclose(poses[:, :3, 3], data.xpos[1:], atol=1e-9)
    np.testing.assert_allclose(poses[:, :3, :3].reshape(2, 9), data.xmat[1:], atol=1e-9)
    np.testing.assert_allclose(lines(chain, centres, q)[2:, 1], data.xipos[1:], atol=1e-9)


@pytest.mark.parametrize(("verdict", "ways"), [("named", 3), ("no_discrepancy", 2)])
def test_the_recording_holds_every_way_and_every_residual(mechanism, tmp_path, verdict, ways):
    paths = write_case(tmp_path, findings(verdict), ("lift", "turn"))
    record_gap(tmp_path / "model.yaml", paths["findings"], paths["series"], paths["replays"], "my_case", tmp_path / "out.rrd")
    found = read_recording(tmp_path / "out.rrd")
    moving = [name for name in found if name.endswith("/mechanism")]
    assert len(moving) == ways
    assert all(found[name]["rows"] == 75 for name in moving)
    curves = [name for name in found if name.startswith("/plots/residual/")]
    assert len(curves) == 6 * (ways - 1)
    assert all(found[name]["timelines"] == {"time"} for name in curves)
    assert sum(name.startswith("/plots/position/") for name in found) == 2 * ways


@pytest.mark.parametrize(("deviation", "factor"), [(0.01, 20.0), (0.3, 1.0), (0.0, 1.0), (3e-4, 800.0)])
def test_deviations_are_enlarged_until_they_show(deviation, factor):
    q = np.zeros((5, 1))
    assert enlargement({"measured": q, "nominal": q + deviation}) == factor
