"""From records to a verdict, on a single axis whose truth is an equation of its own (tier T0), and the scoring of verdicts."""

import numpy as np
import pytest
import yaml

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.campaign import Order, read_verdicts, run_orders
from gsbridge.gap.benchmark.generate import UNIT, draw_case
from gsbridge.gap.benchmark.plants import UNKNOWN, axis_plant
from gsbridge.gap.benchmark.score import Verdict, outcome, score, wilson
from gsbridge.gap.case import run_case
from gsbridge.gap.diagnose import diagnose, findings_of
from gsbridge.gap.effects import catalogue
from gsbridge.gap.replay import Mechanism
from gsbridge.gap.system import Applied, read_system
from gsbridge.gap.view import View, build_setup, white_noise

SEED, COURSES = 40, 41


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    return (*axis_plant(folder), folder)


def case_of(axis, names, units, seed=SEED, **options):
    return draw_case(axis[1], names, units, seed, COURSES, **options)


def diagnosed(axis, names, units, seed=SEED, **options):
    case = case_of(axis, names, units, seed, **options)
    return case, diagnose(axis[0], case.records, axis[2] / "bank", seed=1)


@pytest.mark.parametrize("name", ["coulomb", "viscous", "armature"])
def test_hidden_effect_is_named_with_its_size(axis, name):
    case, result = diagnosed(axis, (name,), 20.0)
    assert result.finding.verdict == "named"
    assert result.finding.best.names == (f"{name}:axis",)
    value = next(iter(result.finding.best.fit.effects[0].parameters.values()))
    assert value == pytest.approx(case.hidden[name], rel=0.05)
    assert result.verification.accepted
    assert result.verification.closure > 0.9
    assert result.effects == result.finding.best.fit.effects


def test_nothing_hidden_is_no_discrepancy(axis):
    for seed in range(3):
        _, result = diagnosed(axis, (), 0.0, 50 + seed)
        assert result.finding.verdict == "no_discrepancy"
        assert result.effects == ()


def test_structural_twins_are_ambiguous(axis):
    # On one axis a motor that gives more torque and a link that is lighter make the same equation.
    _, result = diagnosed(axis, ("torque_gain",), 10.0)
    assert result.finding.verdict == "ambiguous"
    assert {"torque_gain:axis", "link_mass:axis"} <= set(result.finding.ambiguous)
    assert result.effects == ()


def test_effect_outside_the_catalogue_is_not_given_a_name(axis):
    _, result = diagnosed(axis, ("shaking",), 20.0)
    assert result.finding.verdict == "none_of_the_known"
    assert result.finding.something_remains
    assert result.effects == ()


def test_without_efforts_the_verdict_is_still_right(axis):
    case, result = diagnosed(axis, ("coulomb",), 20.0, kinds=("position",))
    assert "effort" not in case.records["fit"].measured
    named = result.finding.verdict == "named" and result.finding.best.names == ("coulomb:axis",)
    assert named or "coulomb:axis" in result.finding.ambiguous


def test_same_seed_gives_the_same_findings(axis):
    case = case_of(axis, ("coulomb",), 5.0)
    found = []
    for _ in range(2):
        result = findings_of(diagnose(axis[0], case.records, axis[2] / "bank", seed=3), case.records, seed=3)
        found.append({key: value for key, value in result.items() if key != "seconds"})
    assert found[0] == found[1]


def test_unit_is_the_stated_signature(axis):
    system, plant, _ = axis
    case = case_of(axis, ("viscous",), 3.0)
    rows = case.records["select"]
    mechanism = Mechanism(system)
    view = View.of(mechanism, rows)
    with_it = view.simulate([Applied("viscous", "axis", {"coefficient": case.hidden["viscous"]})])
    plain = view.simulate()
    size = sum((((with_it[kind] - plain[kind]) / plant.noise[kind]) ** 2).sum() for kind in plain)
    assert size == pytest.approx(9 * UNIT, rel=0.25)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if "pd" in e.modes])
def test_every_parameter_changes_the_output(axis, name):
    system, effect = axis[0], catalogue()[name]
    record = case_of(axis, (), 0.0).records["fit"]
    view = View.of(Mechanism(system), record)
    joint = "axis" if effect.scope == "joint" else ""
    rubbing = [Applied("coulomb", "axis", {"torque": 0.2})] if name == "warming" else []
    # Shapes act only beside an amplitude, and limits only once they are passed.
    large = {"saturation": 3.0, "rate_limit": 2.0}.get(name)
    values = effect.directions()[0]
    values = {p.name: large if large else 4 * values[p.name] if p.amplitude else values[p.name] for p in effect.parameters}
    base = view.stack(view.simulate([*rubbing, Applied(name, joint, values)]))
    for parameter in effect.parameters:
        step = 0.3 * (abs(values[parameter.name]) or 0.1 * (parameter.high - parameter.low))
        moved = view.stack(
            view.simulate([*rubbing, Applied(name, joint, values | {parameter.name: values[parameter.name] + step})])
        )
        if name == "payload" and parameter.name == "y":
            continue  # along the axis of the only joint: no equation of this mechanism knows it
        if name == "base_tilt" and parameter.name == "about_x":
            continue  # turns gravity out of the plane of motion, which shows in second order only
        assert np.abs((moved - base) / view.sigma).max() > 0.01, parameter.name


def test_catalogue_is_consistent():
    for name, effect in catalogue().items():
        assert name == effect.name
        assert set(effect.contains) <= set(catalogue())
        assert effect.signature
        assert effect.tell_apart
        for values in effect.directions():
            assert set(values) == {p.name for p in effect.parameters}


def test_unknown_effect_or_parameter_is_refused(axis):
    mechanism = Mechanism(axis[0])
    for wrong in (Applied("magic", "", {}), Applied("viscous", "axis", {}), Applied("viscous", "elbow", {"coefficient": 1.0})):
        with pytest.raises(InputError):
            build_setup(mechanism, [wrong])


def test_noise_is_told_from_motion():
    rng = np.random.default_rng(0)
    time = np.arange(2000) / 100
    values = np.sin(5 * time) + 1e-3 * rng.normal(size=2000)
    assert white_noise(values[:, None])[0] == pytest.approx(1e-3, rel=0.1)


def test_case_from_files_writes_findings_and_a_model_that_can_be_read(axis, tmp_path):
    import pandas as pd

    _, _, folder = axis
    records = case_of(axis, ("coulomb",), 20.0).records
    for role, record in records.items():
        columns = {"time [s]": record.time, "command.axis [rad]": record.commands["command"][:, 0]}
        columns |= {
            "position.axis [rad]": record.measured["position"][:, 0],
            "effort.axis [N m]": record.measured["effort"][:, 0],
        }
        pd.DataFrame(columns).to_csv(tmp_path / f"{role}.csv", index=False)
    content = {"model": str(folder / "model.yaml"), "records": {role: f"{role}.csv" for role in records}}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    findings = run_case(tmp_path / "case.yaml", tmp_path / "out", tmp_path / "bank")
    assert findings["verdict"] == "named"
    assert "Coulomb friction" in findings["sentence"]
    assert read_json(tmp_path / "out" / "findings.json")["verify"]["accepted"]
    amended = read_system(tmp_path / "out" / "model.yaml")
    assert [effect.name for effect in amended.effects] == ["coulomb"]
    # What was added is no longer missing.
    content["model"] = "out/model.yaml"
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    assert run_case(tmp_path / "again.yaml", tmp_path / "out2", tmp_path / "bank")["verdict"] == "no_discrepancy"


def test_campaign_resumes_and_guards_its_truths(axis, tmp_path):
    system, plant, folder = axis
    orders = [Order(("coulomb",), 20.0, SEED, COURSES), Order((), 0.0, SEED, COURSES)]
    places = tmp_path / "truth", tmp_path / "verdicts"
    run_orders(system, plant, orders, *places, folder / "bank")
    before = {path.name: path.stat().st_mtime_ns for path in places[1].iterdir()}
    run_orders(system, plant, orders, *places, folder / "bank")
    assert before == {path.name: path.stat().st_mtime_ns for path in places[1].iterdir()}
    figures = score(read_verdicts(*places, system.joints), frozenset(UNKNOWN))
    assert figures["named_right"]["value"] == 1.0
    assert figures["false_alarm"]["value"] == 0.0
    for path in places[0].iterdir():
        path.write_text(path.read_text(encoding="utf-8").replace('"seal": "', '"seal": "0'), encoding="utf-8")
    with pytest.raises(ValueError, match="changed after"):
        read_verdicts(*places, system.joints)


def test_outcomes():
    def said(verdict, named=(), sets=(), hidden=("a",)):
        return outcome(Verdict(frozenset(hidden), 5.0, verdict, frozenset(named), tuple(frozenset(s) for s in sets)))

    assert said("named", ["a"]) == "right"
    assert said("named", ["b"]) == "wrong"
    assert said("named", ["a", "b"]) == "wrong"
    assert said("ambiguous", ["b"], [["b"], ["a"]]) == "covered"
    assert said("ambiguous", ["b"], [["b"], ["c"]]) == "wrong"
    assert said("none_of_the_known") == "abstained"
    assert said("no_discrepancy") == "missed"
    assert said("no_discrepancy", hidden=()) == "quiet"
    assert said("none_of_the_known", hidden=()) == "false_alarm"


def test_wilson_interval_known_values():
    # Newcombe, Statistics in Medicine 17, 1998, table I: 81 of 263 and 0 of 20.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=2e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=2e-4)
