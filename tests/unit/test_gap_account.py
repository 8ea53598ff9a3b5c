"""Diagnosis where the model errs by more than noise: a tolerance, a named effect beside a remainder, the account of a gap."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml
from axis_logs import SLOW, axis_in, records_of, simulated
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.amend import amend_model
from gsbridge.gap.diagnosis.backend import best_effects
from gsbridge.gap.diagnosis.closure import closed, closed_beside_rest
from gsbridge.gap.diagnosis.results import Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import decide
from gsbridge.gap.joints.account import _order
from gsbridge.gap.joints.bank import make_bank, signature_bank
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints
from gsbridge.gap.joints.fit import EffectFit, derivatives, fit
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.looks import Look
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.pooled import PooledResiduals, spread_of
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.scatter import RecordSizes, widened
from gsbridge.gap.joints.screen import Screen
from gsbridge.gap.joints.widening import strained


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_in(tmp_path_factory.mktemp("axis"))


def test_a_slow_error_within_the_tolerance_is_no_discrepancy(axis):
    records = records_of(axis, error=SLOW)
    view = JointResiduals.of(Mechanism(axis[0]), records["fit"])
    assert joint_null(view, np.random.default_rng(0)).p_value(view.residual()) < Rules.alarm

    tolerant = replace(records["fit"], tolerance={"position": np.array([1.5 * SLOW])})
    view = JointResiduals.of(Mechanism(axis[0]), tolerant)
    assert joint_null(view, np.random.default_rng(0)).p_value(view.residual()) >= Rules.alarm


def test_an_effect_beyond_the_tolerance_still_is_one(axis):
    records = records_of(axis, ("coulomb",), 40.0)
    tolerant = {role: replace(r, tolerance={"position": np.array([1e-4])}) for role, r in records.items()}
    found = diagnose_joints(axis[0], tolerant, axis[2] / "bank", seed=1).finding
    assert found.verdict == "named"
    assert found.best.names == ("coulomb:axis",)


def test_a_tolerance_and_repeats_are_read_from_a_case(axis, tmp_path):
    record = records_of(axis)["fit"]
    shift = 1e-3 * np.sin(2 * np.pi * 0.4 * record.time)[:, None]
    for name, apart in (("fit", 0.0), ("again", shift)):
        table = {
            "time [s]": record.time,
            "command.axis [rad]": record.commands["command"][:, 0],
            "position.axis [rad]": (record.measured["position"] + apart)[:, 0],
        }
        pd.DataFrame(table).to_csv(tmp_path / f"{name}.csv", index=False)
    (tmp_path / "other.csv").write_text((tmp_path / "fit.csv").read_text().replace("0.3,", "0.2,", 1))
    for path in axis[2].iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    content = {"model": "model.yaml", "records": {"fit": "fit.csv", "select": "fit.csv", "verify": "fit.csv"}}

    def read(**more):
        (tmp_path / "case.yaml").write_text(yaml.safe_dump({**content, **more}), encoding="utf-8")
        return read_joint_case(tmp_path / "case.yaml").records

    assert read(tolerance={"position": 2e-4})["select"].tolerance["position"].tolist() == [2e-4]
    # For two records that differ by d, the standard deviation of a single one is d over the square root of two.
    found = read(repeats={"fit": ["again.csv"]})["verify"].tolerance["position"]
    assert found == pytest.approx(np.sqrt((shift**2).mean() / 2), rel=0.1)
    with pytest.raises(InputError, match="no such record"):
        read(repeats={"chirp": "again.csv"})
    with pytest.raises(InputError, match=r"tolerance.position"):
        read(tolerance={"position": -1.0})


def test_fits_start_where_the_projection_leads(axis):
    """A mass of half a kilogram beside the frame's origin, ten times what just shows, and in none of the bank's places."""
    records = records_of(axis)
    view = JointResiduals.of(Mechanism(axis[0]), records["fit"])
    true = {"mass": 0.5, "x": 0.06, "y": 0.0, "z": 0.04}
    view = JointResiduals.of(Mechanism(axis[0]), simulated(axis, records, (Applied("payload", "", true),))["fit"])
    screen = Screen(view, make_bank(view, [JointCandidate("payload")]))
    start = screen.matches(view.residual())[0].starts[0]
    # A single axis cannot separate a mass from its lever arm, so the start is judged by how much it explains.
    left = (view.residual([JointCandidate("payload").applied(start)]) ** 2).sum()
    assert left < 0.05 * (view.residual() ** 2).sum()
    found = fit(view, [JointCandidate("payload")], [start], screen=screen)
    assert found.chi2 < 1.5 * view.freedom


def test_free_play_vanishes_with_its_size(axis):
    """At a millisecond's step as at any: the smaller the gap, the less it changes."""
    view = JointResiduals.of(Mechanism(axis[0]), records_of(axis)["fit"])
    rigid, sizes = view.stack(view.simulate()), []
    for gap in (1e-3, 1e-5, 1e-7):
        sizes.append(float(np.abs(view.stack(view.simulate([Applied("backlash", "axis", {"gap": gap})])) - rigid).max()))
    for twist in (1e-4, 1e-6, 1e-8):
        sizes.append(
            float(np.abs(view.stack(view.simulate([Applied("compliance", "axis", {"compliance": twist})])) - rigid).max())
        )
    assert np.isfinite(sizes).all()
    # Not-a-number where it diverged; of the size of the gap where it did not.
    assert sizes[1] < 0.1 * sizes[0] + 1e-3
    assert sizes[4] < 0.1 * sizes[3] + 1e-3
    assert sizes[5] < 1e-2


def _hypothesis(who, chi2, size=400):
    part = np.full((size, 1), np.sqrt(chi2 / size))
    count = len(who)
    candidate = tuple(JointCandidate(name, "axis") for name in who)
    effects = tuple(c.applied({p.name: 1.0 for p in c.effect.parameters}) for c in candidate)
    numbers = sum(len(c.effect.parameters) for c in candidate)
    made = EffectFit(candidate, effects, chi2, True, np.full(numbers, 0.01), 0.0, count)
    return Hypothesis(made, part, part, chi2, 0.9)


def test_one_number_more_must_explain_more_than_what_remains():
    """Where a model errs, friction with two numbers always does a little better than friction with one."""
    simple, rich = _hypothesis(["coulomb"], 4000.0), _hypothesis(["coulomb_asym"], 3500.0)
    assert decide([simple, rich], Rules(), 400.0).trials[0] is simple
    much = _hypothesis(["coulomb_asym"], 900.0)
    assert decide([simple, much], Rules(), 400.0).trials[0] is much


def test_an_effect_is_not_needed_because_a_fit_without_it_went_astray(monkeypatch):
    """Of three effects one alone does better than it did with either of the others: neither explains what it seems to."""
    first, second, third = "coulomb", "compliance", "armature"
    judge = object.__new__(JointIdentification)
    judge.rules, judge.floor, judge.plain_chi2 = Rules(), 400.0, 200_000.0
    monkeypatch.setattr(JointIdentification, "_closed", lambda self, trial: 0.95)
    monkeypatch.setattr(JointIdentification, "_closed_first", lambda self, trial: 0.95)
    whole = _hypothesis([first, second, third], 1500.0)
    astray = [_hypothesis([first, second], 6000.0), _hypothesis([first, third], 5600.0)]
    parts = [*astray, _hypothesis([second, third], 40_000.0)]
    assert judge._suffices(whole, [whole, *parts])
    assert not judge._suffices(whole, [whole, *parts, _hypothesis([first], 3500.0)])


def test_friction_that_creeps_at_rest_is_judged_by_motion():
    """Unless more is left at rest than there was, or nothing but one stretch of motion is left to judge by."""
    rng = np.random.default_rng(0)
    before, after = (size + rng.standard_normal((1000, 2)) for size in (20.0, 1.0))
    rests = np.arange(1000) % 250 >= 150
    after[rests] += 15.0
    moving = closed(before[~rests], after[~rests], 1.0)
    assert closed(before, after, 1.0) < 0.6 < 0.9 < moving
    assert closed_beside_rest(before, after, 1.0, rests) == moving
    for other in (after + 10.0 * rests[:, None], after):
        still = rests if other is not after else np.arange(1000) >= 400
        assert closed_beside_rest(before, other, 1.0, still) == closed(before, other, 1.0)


def test_intervals_know_how_far_records_disagree(axis):
    records = records_of(axis)
    torques = {"fit": 0.3, "select": 0.33, "verify": 0.36}
    friction = JointCandidate("coulomb", "axis")
    other = {
        role: simulated(axis, {role: record}, (friction.applied({"torque": torques[role]}),))[role]
        for role, record in records.items()
    }
    same = simulated(axis, records, (friction.applied({"torque": 0.3}),))
    spreads = []
    for logs in (other, same):
        views = [JointResiduals.of(Mechanism(axis[0]), record) for record in logs.values()]
        found = fit(views[0], (friction,), ({"torque": 0.3},))
        spreads.append(float(RecordSizes.of(views, found).scatter()[0]))
    # A standard deviation of 0.30, 0.33, 0.36.
    assert spreads[0] == pytest.approx(0.03, rel=0.15)
    assert spreads[1] < 0.003


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("between", [0.0, 1.0, 3.0, 30.0])
def test_intervals_hold_what_they_say_where_records_disagree(count, between):
    """A fit to one record, and to two of them, with sizes that scatter as much as noise, much more, and not at all."""
    rng, noise, draws = np.random.default_rng(7), np.array([0.8, 1.0, 1.0]), 4000
    values = np.hypot(noise, between)[:, None] * rng.standard_normal((3, draws))
    sizes = RecordSizes(values, np.broadcast_to(noise[:, None], values.shape))
    weights = 1.0 / noise[:count] ** 2
    fitted = weights @ values[:count] / weights.sum()
    spread = widened(np.full(draws, 1.0 / np.sqrt(weights.sum())), sizes, count)
    held = float(np.mean(np.abs(fitted) <= 1.645 * spread))
    assert 0.85 < held < (0.955 if count == 1 else 0.97)


def test_records_that_agree_widen_no_interval():
    sizes = RecordSizes(np.array([[1.0, 2.0], [1.1, 2.0], [0.9, 2.0]]), np.array([[0.2, np.inf], [0.2, np.inf], [0.3, np.inf]]))
    assert sizes.told.tolist() == [3, 0]
    assert widened(np.array([0.1, np.inf]), sizes, 2).tolist() == pytest.approx([0.1, np.inf])
    # A record that decides nothing averages nothing.
    assert sizes.alone(2).tolist() == pytest.approx([0.5, 1.0])
    assert RecordSizes(np.zeros((2, 1)), np.array([[0.1], [9.0]])).alone(2)[0] == pytest.approx(1.0, abs=1e-3)


def test_efforts_in_another_scale_are_told_and_friction_is_not_taken_for_one(axis):
    """As logged with a wrong constant of the motor; with the right one, friction is named as ever."""
    records, told = records_of(axis), {}
    friction = JointCandidate("coulomb", "axis").applied({"torque": 0.3})
    for name, scale, effects in (("scale", 1.1, ()), ("friction", 1.0, (friction,))):
        seen = simulated(axis, records, effects)
        for role, record in seen.items():
            seen[role] = record.with_measured({**record.measured, "effort": scale * record.measured["effort"]})
        diagnosis = diagnose_joints(axis[0], seen, axis[2] / "bank", names=("coulomb", "armature", "viscous"), seed=1)
        told[name] = JointAccount().findings_of(diagnosis, seen, seed=1)
    assert told["scale"]["verdict"] == "none_of_the_known"
    assert "logged by simulated are axis 1.1" in told["scale"]["sentence"]
    assert told["scale"]["status"] == "degraded"
    assert told["scale"]["amended"] == []
    assert told["friction"]["verdict"] == "named"
    assert told["friction"]["status"] == "pass"


def test_effects_that_were_never_tried_together_are_compared_by_the_rules_of_a_name(axis):
    """A search that looks for one effect at once does not find two; brought by others, they are named, a wrong pair is not."""
    friction, late = JointCandidate("coulomb", "axis"), JointCandidate("command_delay")
    truth = (friction.applied({"torque": 0.3}), late.applied({"time": 0.01}))
    logs = simulated(axis, records_of(axis), truth)
    mechanism = Mechanism(axis[0])
    views = [JointResiduals.of(mechanism, logs[role]) for role in ("fit", "select")]
    who = [friction, late, JointCandidate("lag"), JointCandidate("armature", "axis")]
    search = JointIdentification(views[0], views[1], signature_bank(views[0], who, axis[2] / "bank"), who, Rules(most=1))
    assert search.run().verdict == "none_of_the_known"
    wrong = search.again((friction, who[3]), ({"torque": 0.3}, {"inertia": 0.01}))
    assert wrong is None or wrong.verdict == "none_of_the_known"
    found = search.again((friction, late), ({"torque": 0.25}, {"time": 0.008}))
    assert found.verdict == "named"
    assert set(found.best.fit.who) == {friction, late}
    assert not found.something_remains
    # What may stand in the place of one of them is compared, and its name is not as good.
    search = JointIdentification(views[0], views[1], signature_bank(views[0], who, axis[2] / "bank"), who, Rules(most=1))
    search.run()
    found = search.again((friction, late), ({"torque": 0.25}, {"time": 0.008}), ((), ("lag",)))
    assert found.verdict == "named"
    assert ("coulomb:axis", "lag") in {trial.names for trial, _ in found.rivals}


def test_of_what_does_not_show_at_all_nothing_is_known(axis):
    view = JointResiduals.of(Mechanism(axis[0]), records_of(axis)["fit"])
    jacobian = np.stack([np.zeros(view.residual().size), np.ones(view.residual().size)], axis=1)
    deviations = spread_of(PooledResiduals((view,)), (), jacobian)
    assert deviations[0] == np.inf
    assert np.isfinite(deviations[1])


def drifting(axis):
    """Latency and friction, and beside them a slow error of the model that no effect makes."""
    records = records_of(axis)
    effects = (Applied("command_delay", "", {"time": 0.02}), Applied("coulomb", "axis", {"torque": 0.6}))
    records = simulated(axis, records, effects)
    rng = np.random.default_rng(3)
    for role, record in records.items():
        drift = lfilter([np.sqrt(1 - 0.99**2)], [1, -0.99], rng.standard_normal((len(record.time) + 500, 1)), axis=0)[500:]
        measured = {**record.measured, "position": record.measured["position"] + 5 * SLOW * drift}
        records[role] = record.with_measured(measured)
    return records


@pytest.fixture(scope="module")
def told(axis):
    """The account of records that drift."""
    records = drifting(axis)
    diagnosis = diagnose_joints(axis[0], records, axis[2] / "bank", seed=1)
    return diagnosis, JointAccount().findings_of(diagnosis, records, seed=1)


def test_right_effects_are_named_although_something_remains(told):
    diagnosis, found = told
    assert diagnosis.finding.something_remains
    assert found["verdict"] == "named"
    assert {row["name"] for row in found["effects"]} <= {"command_delay", "coulomb"}


def test_what_is_named_has_the_size_that_the_account_has(told):
    _, found = told
    entries = {entry["label"]: entry["parameters"] for entry in found["account"]["entries"]}
    for row in found["effects"]:
        entry = entries[f"{row['name']}:{row['joint']}" if row["joint"] else row["name"]]
        for name, parameter in row["parameters"].items():
            assert parameter["value"] == entry[name]["value"]
            np.testing.assert_allclose(parameter["interval90"], entry[name]["interval90"], rtol=1e-9)


class Parts:
    """Residuals from which each effect takes a part of its own; the last one adds to them."""

    def residual(self, effects):
        taken = [effect.parameters["part"] for effect in effects]
        return np.array([3.0, 2.0, 1.0]) - np.array([np.isin(k, taken) * size for k, size in enumerate((3.0, 2.0, -1.0))])


def test_effects_that_explain_nothing_are_in_no_account():
    effects = tuple(Applied("any", "", {"part": float(part)}) for part in (1, 0, 7, 2))
    assert _order(Parts(), effects) == [1, 0]


def test_effects_that_explain_only_together_are_both_in_the_account():
    """A stiffer servo and the friction that it overcomes: each alone leaves more than neither does."""

    class Rows:
        def residual(self, effects):
            rows = {"friction": [1.0, 3.0], "servo": [1.0, -3.0], "idle": [0.0, 0.1]}
            return np.array([2.0, 0.0]) - sum((np.array(rows[effect.name]) for effect in effects), np.zeros(2))

    effects = tuple(Applied(name, "", {}) for name in ("idle", "friction", "servo"))
    assert sorted(_order(Rows(), effects)) == [1, 2]
    assert _order(Rows(), effects[:1]) == []


def test_effects_that_explain_only_together_come_as_soon_as_they_matter():
    """Together they explain more than a third effect does, and each alone does harm."""

    class Rows:
        def residual(self, effects):
            rows = {"friction": [1.5, 3.0, 0.0], "servo": [1.5, -3.0, 0.0], "lag": [0.0, 0.0, 1.0], "zero": [0.0, 0.0, 0.5]}
            return np.array([3.0, 0.0, 1.5]) - sum((np.array(rows[effect.name]) for effect in effects), np.zeros(3))

    effects = tuple(Applied(name, "", {}) for name in ("zero", "servo", "lag", "friction"))
    order = _order(Rows(), effects)
    assert set(order[:2]) == {1, 3}
    assert order[2:] == [2, 0]


@given(st.integers(0, 2**32 - 1))
def test_the_order_of_an_account_is_never_worse_than_adding_the_next_best(seed):
    """Against plain greedy search, over random effects that help and harm each other."""
    rng = np.random.default_rng(seed)
    rows, gap = rng.normal(size=(5, 4)), 3 * rng.normal(size=4)

    class Rows:
        def residual(self, effects):
            return gap - sum((rows[int(effect.name)] for effect in effects), np.zeros(4))

    def left(who):
        return float((Rows().residual([Applied(str(k), "", {}) for k in who]) ** 2).sum())

    order = _order(Rows(), tuple(Applied(str(k), "", {}) for k in range(5)))
    greedy = list[int]()
    while len(greedy) < len(order):
        greedy.append(min(set(order) - set(greedy), key=lambda k: left([*greedy, k])))
    along = [sum(left(who[:count]) for count in range(len(order) + 1)) for who in (order, greedy)]
    assert along[0] <= along[1]
    assert all(left([k for k in order if k != gone]) > left(order) for gone in order)


def test_an_account_tells_effects_in_order_with_their_shares(told):
    _, found = told
    account = found["account"]
    labels = [entry["label"] for entry in account["entries"]]
    assert labels[:2] == ["command_delay", "coulomb:axis"]
    shares = [entry["share"] for entry in account["entries"]]
    assert sum(shares) == pytest.approx(account["explained"], abs=1e-9)
    assert shares[0] > shares[1] > 0.0
    assert account["explained"] > 0.9
    assert {entry["verdict"] for entry in account["entries"]} <= {"named", "one of", "likely, not proven"}
    assert [e["name"] for e in found["amended"]] == [e["name"] for e in account["entries"]]
    assert [e.name for e in best_effects(found)] == [e["name"] for e in account["entries"]]
    assert found["verify"]["after"] < found["verify"]["before"]


def test_an_account_stays_when_the_fitted_motions_change_places(axis, told):
    """What else helps is fitted to both; what is named was fitted to one, of which little depends on which."""
    _, found = told
    records = drifting(axis)
    turned = {"fit": records["select"], "select": records["fit"], "verify": records["verify"]}
    other = JointAccount().findings_of(diagnose_joints(axis[0], turned, axis[2] / "bank", seed=1), turned, seed=1)
    values = [
        {entry["label"]: [row["value"] for row in entry["parameters"].values()] for entry in content["account"]["entries"]}
        for content in (found, other)
    ]
    assert list(values[0])[:2] == list(values[1])[:2]
    for label in list(values[0])[:2]:
        assert values[0][label] == pytest.approx(values[1][label], rel=0.05)


def test_spreads_hold_errors_that_last(axis):
    """Parts of records that pull apart: as the curvature has it where noise is white, wider where the model errs slowly."""
    true, wide = Applied("command_delay", "", {"time": 0.02}), []
    candidate = JointCandidate("command_delay")
    for error in (0.0, 5 * SLOW):
        records = simulated(axis, records_of(axis), (true,))
        rng = np.random.default_rng(5)
        for role, record in records.items():
            drift = lfilter([np.sqrt(1 - 0.99**2)], [1, -0.99], rng.standard_normal((len(record.time), 1)), axis=0)
            position = record.measured["position"] + error * drift
            records[role] = record.with_measured({**record.measured, "position": position})
        mechanism = Mechanism(axis[0])
        views = tuple(JointResiduals.of(mechanism, records[role], (true,)) for role in ("fit", "select"))
        both = PooledResiduals(views)
        found = fit(both, [candidate], [{"time": 0.018}])
        # Known derivatives save the finite differences, and do not change the result.
        known = derivatives(both, found)
        again = fit(both, [candidate], [dict(found.values[0])], known=known)
        assert again.values[0]["time"] == pytest.approx(found.values[0]["time"], abs=0.1 * float(found.deviations[0]))
        plain = 1.0 / np.linalg.norm(known)
        wide.append(float(spread_of(both, found.effects, known)[0]) / plain)
        assert abs(found.values[0]["time"] - 0.02) < 4.0 * float(spread_of(both, found.effects, known)[0])
    assert 0.99 < wide[0] < 1.6
    assert wide[1] > 2.0 * wide[0]


def test_moments_of_something_else_pull_an_account_less(axis):
    """A fifth of a record in which the arm leans on something: Huber's weights keep the estimate nearer to the truth."""
    true, candidate = Applied("viscous", "axis", {"coefficient": 0.3}), JointCandidate("viscous", "axis")
    records = simulated(axis, records_of(axis), (true,))
    record = records["fit"]
    rows = slice(len(record.time) // 5, 2 * len(record.time) // 5)
    position = record.measured["position"].copy()
    position[rows] += 0.02
    views = [JointResiduals.of(Mechanism(axis[0]), record.with_measured({**record.measured, "position": position}), (true,))]
    plain = PooledResiduals(tuple(views))
    found = fit(plain, [candidate], [{"coefficient": 0.2}])
    held = plain.robust(found.effects)
    assert held.weights.min() < 0.5
    assert held.weights.max() == 1.0
    better = fit(held, [candidate], [dict(found.values[0])])
    assert abs(better.values[0]["coefficient"] - 0.3) < 0.8 * abs(found.values[0]["coefficient"] - 0.3)


def test_a_candidate_is_judged_by_what_a_fit_of_all_would_win():
    rng = np.random.default_rng(2)
    others = rng.normal(size=(200, 3))
    change = others @ [1.0, -2.0, 0.5] + 0.3 * rng.normal(size=200)
    wanted = 0.7 * change + rng.normal(size=200)
    left = wanted - others @ np.linalg.lstsq(others, wanted, rcond=None)[0]
    look = Look(JointCandidate("gain_p", "axis"), {"change": 0.1}, change).beside(np.linalg.qr(others)[0])
    factor, gain = look.guess(left)
    together = np.column_stack([others, change])
    solved, squares, *_ = np.linalg.lstsq(together, wanted, rcond=None)
    assert factor == pytest.approx(solved[-1], rel=1e-9)
    assert gain == pytest.approx(float(left @ left) - float(squares[0]), rel=1e-9)


@pytest.mark.parametrize(("angle", "taken"), [(0.1, True), (-0.276, False)])
def test_what_would_have_to_be_very_large_is_something_else(angle, taken):
    candidate = JointCandidate("encoder_offset", "axis")
    fitted = EffectFit((candidate,), (candidate.applied({"angle": angle}),), 1.0, True, np.ones(1), 0.0, 1)
    assert strained(fitted) == (not taken)


def test_a_doubtful_noise_is_told(told):
    _, found = told
    assert any("repeats" in text for text in found["warnings"])


def test_what_is_likely_is_told_as_closest(axis, told):
    _, found = told
    model = axis[2] / "model.yaml"
    amend_model(model, {**found, "verdict": "none_of_the_known"}, axis[2] / "amended.yaml")
    content = yaml.safe_load((axis[2] / "amended.yaml").read_text(encoding="utf-8"))
    assert content["evidence"][-1]["verdicts"] == {e["label"]: e["verdict"] for e in found["account"]["entries"]}
    assert [e["name"] for e in content["effects"]] == [e["name"] for e in found["account"]["entries"]]
    assert read_mechanism_model(axis[2] / "amended.yaml").effects


def test_it_is_the_model_that_lacks_an_effect():
    """The joint itself has it."""
    row = {"value": 0.42, "unit": "N m", "interval90": [0.39, 0.45]}
    item = {"joint": "axis", "title": "Coulomb friction", "parameters": {"torque": row}}
    assert JointAccount().lacks(item) == "The model of joint 'axis' lacks Coulomb friction (torque 0.420 ± 0.030 N m)"
