"""From records to a verdict, on a single axis whose truth is an equation of its own (tier T0)."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.generate import UNIT, _joined, draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.benchmark.noises import NOISES
from gsbridge.gap.benchmark.trajectories import KINDS, course
from gsbridge.gap.diagnosis.results import EffectFit, Hypothesis, Rules, Verification
from gsbridge.gap.diagnosis.verdict import decide, transfer
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints
from gsbridge.gap.joints.fit import fit, polish
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.workflow import run_case

SEED, COURSES = 40, 41

BUDGET = 100
"""Simulations that a diagnosis may take beside the bank and the account."""


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    return (*axis_plant(folder), folder)


def case_of(axis, names, units, seed=SEED, **options):
    return draw_case(axis[1], names, units, seed, COURSES, **options)


def diagnosed(axis, names, units, seed=SEED, only=None, **options):
    case = case_of(axis, names, units, seed, **options)
    result = diagnose_joints(axis[0], case.records, axis[2] / "bank", names=only, seed=1)
    assert result.runs <= BUDGET
    assert result.account_runs <= Rules().account + BUDGET
    return case, result


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


@pytest.mark.parametrize("spoil", NOISES)
def test_nothing_hidden_is_no_discrepancy_whatever_the_noise(axis, spoil):
    _, result = diagnosed(axis, (), 0.0, 50, spoil=spoil)
    assert result.finding.verdict == "no_discrepancy"
    assert result.effects == ()


def test_noise_that_passed_a_filter_is_no_discrepancy_however_large_it_looks(axis):
    records, rng = {}, np.random.default_rng(2)
    for role, record in case_of(axis, (), 0.0, 50).records.items():
        measured = {}
        for kind, values in record.measured.items():
            sigma, size = axis[1].noise[kind], (len(values) + 200, values.shape[1])
            slow = lfilter([np.sqrt(1 - 0.97**2)], [1, -0.97], rng.normal(size=size), axis=0)[200:]
            measured[kind] = values + 10.0 * sigma * slow
        records[role] = replace(record, measured=measured, sigma={})
    result = diagnose_joints(axis[0], records, axis[2] / "bank", seed=1)
    assert result.finding.verdict == "no_discrepancy"
    assert result.finding.before > 5.0
    # The findings are degraded all the same: this verdict does not prove that the model is right.
    findings = JointAccount().findings_of(result, records, seed=1)
    assert findings["status"] == "degraded"
    assert "'repeats'" in findings["reasons"][0]


def test_two_effects_are_named_together(axis):
    _, result = diagnosed(axis, ("coulomb", "armature"), 15.0)
    assert result.finding.verdict == "named"
    assert set(result.finding.best.names) == {"coulomb:axis", "armature:axis"}
    assert result.verification.accepted


def test_structural_twins_are_ambiguous(axis):
    # On one axis a motor that gives more torque and a link that is lighter make the same equation.
    _, result = diagnosed(axis, ("torque_gain",), 10.0)
    assert result.finding.verdict == "ambiguous"
    assert {"torque_gain:axis", "link_mass:axis"} <= set(result.finding.ambiguous)
    # The model takes one of them, and the account says that it may as well be another.
    (entry,) = result.account.entries
    assert entry.verdict == "one of"
    assert {str(entry.candidate), *entry.instead} == set(result.finding.ambiguous)
    assert result.effects == (entry.effect,)


def test_effect_outside_the_catalogue_is_not_given_a_name(axis):
    _, result = diagnosed(axis, ("shaking",), 20.0)
    assert result.finding.verdict == "none_of_the_known"
    assert result.finding.something_remains
    assert result.effects == ()


def test_an_effect_that_would_have_to_be_larger_than_makes_sense_is_not_named(axis, monkeypatch, tmp_path):
    case = case_of(axis, ("coulomb",), 20.0)
    effect = JOINT_EFFECTS["coulomb"]
    (parameter,) = effect.parameters
    # It closes 97 % of the gap, and stands on its bound.
    monkeypatch.setattr(effect, "parameters", (replace(parameter, high=0.97 * case.hidden["coulomb"]),))
    result = diagnose_joints(axis[0], case.records, tmp_path, names=("coulomb",), seed=1)
    assert result.finding.verdict == "none_of_the_known"
    assert result.effects == ()


@pytest.mark.parametrize(
    ("name", "value", "stopped"), [("link_mass", 3.0, True), ("link_mass", -0.8, True), ("coulomb", 0.0, False)]
)
def test_a_fit_on_its_bound_is_told(name, value, stopped):
    candidate = JointCandidate(name, "axis")
    effects = (candidate.from_vector(np.array([value])),)
    assert EffectFit((candidate,), effects, 1.0, True, np.zeros(1), 0.0, 1).stopped == stopped


@pytest.mark.parametrize("first", [0, 100], ids=["throughout", "in two blocks"])
def test_what_holds_on_another_record_is_told_from_coloured_noise(first):
    # An explanation of five standard deviations and more, all the time or in a moment, under white noise.
    rng, shape = np.random.default_rng(3), np.zeros((400, 3))
    shape[first : first + 20 if first else None] = np.sin(np.arange(20 if first else 400) / 7.0)[:, None] + 0.5
    shape *= 12.0 / np.sqrt((shape**2).sum())
    noise = rng.standard_normal(shape.shape)
    assert transfer(noise + shape, noise) > Rules().deviations
    # The same explanation has nothing to do with noise that a filter coloured.
    said = []
    for _ in range(400):
        noise = lfilter([1.0], [1.0, -0.85], rng.standard_normal((500, 3)), axis=0)[100:]
        said.append(transfer(noise, noise - shape) > Rules().deviations)
    assert np.mean(said) < 0.02


@pytest.mark.parametrize(("spread", "blurred"), [(0.02, False), (0.05, True)])
def test_effects_that_may_as_well_be_absent_mimic_something_else(spread, blurred):
    who = (JointCandidate("viscous", "axis"), JointCandidate("coulomb", "axis"))
    effects = tuple(candidate.from_vector(np.array([0.1])) for candidate in who)
    assert EffectFit(who, effects, 1.0, True, np.array([0.001, spread]), 0.9, 2).blurred == blurred
    assert not EffectFit(who[1:], effects[1:], 1.0, True, np.array([spread]), 0.0, 1).blurred


def test_what_would_be_larger_than_makes_sense_is_no_rival_of_what_does_as_well():
    def trial(name, values, square):
        candidate, rest = JointCandidate(name, "axis"), np.full((400, 1), np.sqrt(square / 400))
        fitted = EffectFit(
            (candidate,), (candidate.from_vector(np.array(values)),), square, True, np.zeros(len(values)), 0.0, 1
        )
        return Hypothesis(fitted, rest, rest, square, 1.0)

    bound = JOINT_EFFECTS["eccentricity"].parameters[0].high
    sensible, huge = trial("encoder_scale", [0.1], 400.0), trial("eccentricity", [bound, 0.0], 399.5)
    found = decide([sensible, huge], Rules(), 400.0)
    assert found.trials == (sensible,)
    assert found.near == ()
    # It still says that nothing known fits where all that is sensible does worse.
    assert decide([trial("encoder_scale", [0.1], 500.0), huge], Rules(), 400.0).trials[0] is huge


@pytest.mark.parametrize(
    ("closure", "p_remaining", "one", "several"),
    [
        (0.99, 0.5, True, True),
        (0.97, 0.005, True, True),
        (0.92, 0.005, True, False),
        (0.7, 0.005, False, False),
        (0.3, 0.5, False, False),
    ],
)
def test_third_record_refutes_what_does_not_close_the_gap_there(closure, p_remaining, one, several):
    seen, rules = Verification(2.0, 1.1, closure, {}, True, p_remaining), Rules()
    assert seen.transfers(rules) == one
    assert seen.transfers(replace(rules, closure=rules.several)) == several


def test_a_short_third_record_refutes_nothing_by_the_chance_of_its_noise():
    """A gap of 1.1 falls to 1.03: of 1 200 numbers, that is a spread and a half beyond noise; of 120 000, sixteen."""
    short, long = (Verification(1.1, 1.033, 0.44, {}, True, 0.1, chance=np.sqrt(2.0 / count)) for count in (1200, 120_000))
    assert short.transfers()
    assert not long.transfers()
    assert short.at_best > 0.99
    assert long.at_best == pytest.approx(0.46, abs=0.02)
    # An explanation that leaves more than noise is still refuted.
    assert not replace(short, p_remaining=0.001).transfers()


def test_lost_samples_and_a_clock_that_drifts_hide_no_friction(axis):
    case, result = diagnosed(axis, ("clock_drift", "coulomb"), 20.0, lost=0.03)
    record = case.records["fit"]
    assert 370 < len(record.time) < 400
    assert record.time[-1] == pytest.approx(3.99)
    assert all(len(values) == len(case.records["verify"].time) for values in (*case.clean.values(), *case.plain.values()))
    assert result.finding.verdict == "named"
    assert result.finding.best.names == ("clock_drift", "coulomb:axis")


def test_without_efforts_the_verdict_is_still_right(axis):
    rivals = ("coulomb", "viscous", "gain_d", "gain_p", "load_friction")
    case, result = diagnosed(axis, ("coulomb",), 20.0, kinds=("position",), only=rivals)
    assert "effort" not in case.records["fit"].measured
    named = result.finding.verdict == "named" and result.finding.best.names == ("coulomb:axis",)
    assert named or "coulomb:axis" in result.finding.ambiguous


def test_same_seed_gives_the_same_findings(axis):
    case = case_of(axis, ("coulomb",), 5.0)
    found = []
    for _ in range(2):
        result = JointAccount().findings_of(
            diagnose_joints(axis[0], case.records, axis[2] / "bank", seed=3), case.records, seed=3
        )
        found.append({key: value for key, value in result.items() if key != "seconds"})
    assert found[0] == found[1]


def test_intervals_know_what_the_step_of_time_does_where_a_limit_magnifies_it(axis):
    # A motor too weak for the courses falls: the truth, stepped ten times finer, parts from the replay exponentially.
    system, plant, _ = axis
    case, mechanism = case_of(axis, ("viscous",), 1.0), Mechanism(system)
    record = case.records["fit"]
    weak = 0.36
    roads = np.random.default_rng(COURSES)
    wanted = _joined(course(KINDS["fit"], plant.centre, plant.reach, 4.0, roads), 100.0)
    clean = plant.truth(wanted, 4.0, record.time, {"saturation": weak})
    view = JointResiduals.of(mechanism, replace(record.with_measured(clean), sigma=plant.noise))
    candidate = JointCandidate("saturation", "axis")
    rough = fit(view, (candidate,), ({"weakness": weak},))
    final = polish(view, rough)
    error = abs(final.values[0]["weakness"] - weak)
    assert error < 1.7 * final.deviations[0]
    # Smooth motion is none of its business.
    viscous = (Applied("viscous", "axis", {"coefficient": 0.03}),)
    assert (view.stepping_beyond(viscous) ** 2).sum() < 0.01
    assert (view.stepping_beyond(rough.effects) ** 2).sum() > 1.0


def test_unit_is_the_stated_signature(axis):
    system, plant, _ = axis
    case = case_of(axis, ("viscous",), 3.0)
    rows = case.records["select"]
    mechanism = Mechanism(system)
    view = JointResiduals.of(mechanism, rows)
    with_it = view.simulate([Applied("viscous", "axis", {"coefficient": case.hidden["viscous"]})])
    plain = view.simulate()
    size = sum((((with_it[kind] - plain[kind]) / plant.noise[kind]) ** 2).sum() for kind in plain)
    assert size == pytest.approx(9 * UNIT, rel=0.25)


@pytest.mark.parametrize("name", [n for n, e in JOINT_EFFECTS.items() if "pd" in e.modes and n != "table"])
def test_every_parameter_changes_the_output(axis, name):
    system, effect = axis[0], JOINT_EFFECTS[name]
    record = case_of(axis, (), 0.0).records["fit"]
    view = JointResiduals.of(Mechanism(system), record)
    joint = "axis" if effect.scope == "joint" else ""
    rubbing = [Applied("coulomb", "axis", {"torque": 0.2})] if name == "warming" else []
    # Shapes act only beside an amplitude, and limits only once they are passed.
    large = {"saturation": 3.0, "rate_limit": 2.0}.get(name)
    # A payload on the joint's own axis shows nowhere.
    values = effect.directions()[1 if name == "payload" else 0]
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
    for name, effect in JOINT_EFFECTS.items():
        assert name == effect.name
        assert set(effect.contains) <= set(JOINT_EFFECTS)
        assert effect.signature
        assert effect.tell_apart
        for values in effect.directions():
            assert set(values) == {p.name for p in effect.parameters}


def test_unknown_effect_or_parameter_is_refused(axis):
    mechanism = Mechanism(axis[0])
    for wrong in (Applied("magic", "", {}), Applied("viscous", "axis", {}), Applied("viscous", "elbow", {"coefficient": 1.0})):
        with pytest.raises(InputError):
            apply_effects(mechanism, [wrong])


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
    content["effects"] = ["coulomb", "viscous", "stribeck", "effort_offset"]
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    findings = run_case(tmp_path / "case.yaml", tmp_path / "out", tmp_path / "bank")
    assert findings["verdict"] == "named"
    assert "Coulomb friction" in findings["sentence"]
    assert read_json(tmp_path / "out" / "findings.json")["verify"]["accepted"]
    amended = read_mechanism_model(tmp_path / "out" / "model.yaml")
    assert [effect.name for effect in amended.effects] == ["coulomb"]
    # With the amended model, the same case shows no discrepancy.
    content["model"] = "out/model.yaml"
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    assert run_case(tmp_path / "again.yaml", tmp_path / "out2", tmp_path / "bank")["verdict"] == "no_discrepancy"
