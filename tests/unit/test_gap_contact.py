"""Throws from files, their first states, and verdicts about them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from thrown_bodies import HORIZON, MODEL, own_throws, soft_ball

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.body_truth import ThrowScene, throw_box
from gsbridge.gap.contact.account import throw_account
from gsbridge.gap.contact.body import parse_body, read_body
from gsbridge.gap.contact.case import read_throw_case, split_throws
from gsbridge.gap.contact.diagnose import ThrowAccount, diagnose_throws
from gsbridge.gap.contact.identify import ThrowHypothesis, ThrowIdentification, ThrowRules
from gsbridge.gap.contact.interval import intervals
from gsbridge.gap.contact.null import ThrowNull, closure, throw_null
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import ThrowFit, refine
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.starts import Starts, pooled_speeds, quat_from_turn, starts_of, turn_between
from gsbridge.gap.contact.throws import Throw, Throws, read_throws, write_throws
from gsbridge.gap.contact.world import simulate
from gsbridge.gap.loop.amend import amend_object
from gsbridge.gap.workflow import run_case
from gsbridge.geometry import quat_multiply
from gsbridge.sim.model import read_model

NAMES = ("contact_friction", "restitution", "table_height")
NOMINAL = Path(__file__).resolve().parents[2] / "models" / "nominal.yaml"


def ballistic(count=12, seed=0, speeds=False):
    """Throws in free flight with noise, and their true speeds."""
    rng = np.random.default_rng(seed)
    time = np.arange(20) / 100
    items, truth = [], []
    for k in range(count):
        velocity, spin = rng.normal(0, 1, 3), rng.normal(0, 4, 3)
        position = [0, 0, 2.0] + time[:, None] * velocity - 0.5 * 9.81 * time[:, None] ** 2 * [0, 0, 1]
        quat = quat_from_turn(time[:, None] * spin + rng.normal(0, 1e-3, (20, 3)))
        given_speeds = (velocity + rng.normal(0, 0.05, 3), spin + rng.normal(0, 0.2, 3)) if speeds else (None, None)
        items.append(Throw(str(k), time, position + rng.normal(0, 2e-4, (20, 3)), quat, *given_speeds))
        truth.append((velocity, spin))
    return Throws(tuple(items)), truth


def test_noise_of_logged_speeds_is_told_where_poses_know_them_worse():
    """Of throws that soon touch, poses tell speeds badly, which must not hide the noise of what is logged."""
    rng, sets = np.random.default_rng(4), []
    for seed in range(3):
        throws, truth = ballistic(40, seed, speeds=True)
        items = [
            replace(item, velocity=speed + rng.normal(0, 4e-3, 3), spin=spin + rng.normal(0, 0.02, 3))
            for item, (speed, spin) in zip(throws.items, truth, strict=True)
        ]
        for k in range(0, 40, 2):
            short = items[k]
            items[k] = replace(short, time=short.time[:8], position=short.position[:8], quat=short.quat[:8])
        sets.append(starts_of(Throws(tuple(items)))[1])
    for noise in pooled_speeds(sets):
        assert noise.velocity == pytest.approx(4e-3, rel=0.4)
        assert noise.spin == pytest.approx(0.02, rel=0.4)


def test_first_states_come_from_the_first_stretch():
    throws, truth = ballistic(40)
    starts, noise = starts_of(throws)
    assert noise.position == pytest.approx(2e-4, rel=0.25)
    assert noise.angle == pytest.approx(1e-3, rel=0.25)
    speeds = starts.velocity - np.array([velocity for velocity, _ in truth])
    spins = starts.spin - np.array([spin for _, spin in truth])
    # The spread that the noise claims is the spread that the speeds have.
    assert speeds.std() == pytest.approx(noise.velocity, rel=0.3)
    assert spins.std() == pytest.approx(noise.spin, rel=0.3)
    assert not starts.logged


def test_logged_speeds_are_taken_with_their_own_noise():
    throws, _ = ballistic(60, speeds=True)
    starts, noise = starts_of(throws)
    assert starts.logged
    assert np.array_equal(starts.velocity, [throw.velocity for throw in throws.items])
    assert noise.velocity == pytest.approx(0.05, rel=0.35)
    assert noise.spin == pytest.approx(0.2, rel=0.5)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3).filter(lambda turn: np.linalg.norm(turn) < 3.1))
def test_turns_and_quaternions_are_inverse(turn):
    reference = np.array([0.5, -0.5, 0.5, 0.5])
    quat = quat_multiply(quat_from_turn(np.array(turn)), reference)
    assert np.allclose(turn_between(quat[None], reference)[0], turn, atol=1e-9)


def test_throws_survive_their_file(tmp_path):
    throws, _ = ballistic(3, speeds=True)
    write_throws(tmp_path / "throws.csv", throws)
    back = read_throws(tmp_path / "throws.csv")
    assert len(back) == 3
    for one, other in zip(throws.items, back.items, strict=True):
        for key in ("time", "position", "velocity", "spin"):
            assert np.allclose(getattr(one, key), getattr(other, key), atol=1e-12)
        assert np.allclose(np.abs((one.quat * other.quat).sum(axis=1)), 1.0)


def test_start_speeds_may_stand_in_the_first_row_of_each_throw_alone(tmp_path):
    import pandas as pd

    throws, _ = ballistic(3, speeds=True)
    write_throws(tmp_path / "all.csv", throws)
    table = pd.read_csv(tmp_path / "all.csv")
    first, speeds = ~table["throw"].duplicated(), [name for name in table if "velocity" in name]
    assert len(speeds) == 6
    table[speeds] = table[speeds].where(first)
    table.to_csv(tmp_path / "first.csv", index=False)
    for one, other in zip(throws.items, read_throws(tmp_path / "first.csv").items, strict=True):
        assert np.allclose(one.velocity, other.velocity, atol=1e-12)
        assert np.allclose(one.spin, other.spin, atol=1e-12)
    row = int(np.flatnonzero(first)[1])
    for value, said in ((np.nan, "no number"), (1e40, "holds 1e[+]40")):
        table.loc[row, "velocity.y [m/s]"] = value
        table.to_csv(tmp_path / "bad.csv", index=False)
        with pytest.raises(InputError, match=f"velocity.y.*{said} in data row {row + 1}"):
            read_throws(tmp_path / "bad.csv")


def test_throws_keep_their_own_numbers(tmp_path):
    throws, _ = ballistic(3)
    named = Throws(tuple(replace(throw, name=name) for throw, name in zip(throws.items, ("12", "7", "41"), strict=True)))
    write_throws(tmp_path / "throws.csv", named)
    back = read_throws(tmp_path / "throws.csv")
    assert [throw.name for throw in back.items] == ["12", "7", "41"]
    assert np.allclose(back.items[2].position, throws.items[2].position)


def test_a_folder_holds_one_throw_per_file_in_the_order_of_their_numbers(tmp_path):
    import pandas as pd

    throws, _ = ballistic(3)
    write_throws(tmp_path / "all.csv", throws)
    table = pd.read_csv(tmp_path / "all.csv")
    (tmp_path / "set").mkdir()
    for k, name in enumerate((2, 10, 1)):
        rows = table[table["throw"] == k].drop(columns="throw").rename(columns={"position.x [m]": "px"})
        rows.assign(px=1e3 * rows["px"]).to_csv(tmp_path / "set" / f"throw_{name}.csv", index=False)
    back = read_throws(tmp_path / "set", {"position.x": "px"}, {"position.x": "mm"})
    assert [throw.name for throw in back.items] == ["throw_1", "throw_2", "throw_10"]
    assert np.allclose(back.items[0].position, throws.items[2].position)


def damaged(table, kind):
    """A table of throws with one thing wrong."""
    if kind == "missing":
        return table.drop(columns="orientation.w")
    if kind == "unit":
        return table.rename(columns={"position.x [m]": "position.x [kg]"})
    if kind == "no unit":
        return table.rename(columns={"position.x [m]": "position.x"})
    if kind == "backwards":
        table.loc[5, "time [s]"] = 0.0
    if kind == "nan":
        table.loc[5, "position.y [m]"] = np.nan
    if kind == "quaternion":
        table.loc[5, "orientation.w"] = 3.0
    if kind == "short":
        return table[table["time [s]"] < 0.05]
    if kind == "partial":
        return table.assign(**{"velocity.x [m/s]": 0.0})
    return table


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("missing", "is missing"),
        ("unit", "which is no length"),
        ("no unit", "has no unit"),
        ("backwards", "backwards"),
        ("nan", "no number"),
        ("quaternion", "length 3"),
        ("short", "rows in"),
        ("partial", "lacks a component"),
    ],
)
def test_bad_throws_are_refused(tmp_path, kind, said):
    import pandas as pd

    write_throws(tmp_path / "good.csv", ballistic(2)[0])
    damaged(pd.read_csv(tmp_path / "good.csv"), kind).to_csv(tmp_path / "bad.csv", index=False)
    with pytest.raises(InputError, match=said):
        read_throws(tmp_path / "bad.csv")


def test_one_file_of_throws_is_cut_into_roles_and_marked():
    throws, _ = ballistic(30)
    roles, reasons = split_throws({"fit": throws}, "case")
    assert [len(roles[role]) for role in ("fit", "select", "verify")] == [10, 10, 10]
    assert reasons
    assert split_throws(roles, "case")[1] == ()
    with pytest.raises(InputError, match="at least"):
        split_throws({"fit": throws.part(0, 20)}, "case")
    with pytest.raises(InputError, match="'fit'"):
        split_throws({"select": throws}, "case")


def test_closure_counts_from_the_floor():
    assert closure(0.09, 0.01, 0.01) == pytest.approx(1.0)
    assert closure(0.09, 0.05, 0.01) == pytest.approx(0.5)
    assert closure(0.09, 0.13, 0.01) < 0


def test_an_interval_knows_that_bodies_sink_in(tmp_path):
    """A contact of some milliseconds lets a ball sink in by some per cent of its radius, at which friction turns it."""
    replay = soft_ball(tmp_path, 1.4)
    fit = refine(replay, (Applied("inertia_scale", "", {"share": 0.3}),))
    (spans,) = intervals(replay, fit, np.random.default_rng(0))
    assert spans["share"][0] < 0.4 < spans["share"][1]
    assert spans["share"][1] - spans["share"][0] < 0.2


@pytest.mark.parametrize(("inertia", "alarm"), [(1.0, False), (1.1, True)])
def test_a_ball_that_sinks_in_raises_no_alarm_and_one_that_is_heavier_to_turn_does(tmp_path, inertia, alarm):
    replay = soft_ball(tmp_path, inertia)
    null = throw_null(replay, (), np.random.default_rng(0), weigh=True)
    assert (null.p_value(replay.errors(), replay.early()) < 0.01) == alarm


def test_nothing_hidden_is_no_discrepancy(tmp_path):
    body = parse_body({**MODEL, "contact": {"friction": 0.3}}, ".")
    throws = {role: own_throws(0.3, 8, seed) for seed, role in enumerate(("fit", "select", "verify"))}
    diagnosis = diagnose_throws(body, throws, tmp_path, names=("contact_friction",), horizon=HORIZON)
    assert diagnosis.finding.verdict == "no_discrepancy"
    assert diagnosis.effects == ()
    found = ThrowAccount().findings_of(diagnosis, throws, seed=0)
    assert found["amended"] == []
    assert found["verify"] is None


def test_contacts_of_another_engine_are_attributed_to_nothing_but_a_gust_is_an_alarm(tmp_path):
    """Where nothing may be named but friction, and it is right: a slow contact moves bodies, a gust even before."""
    body, found = parse_body({**MODEL, "contact": {"friction": 0.3}}, "."), {}
    for name, change in (("slow", {"slowness": 0.012}), ("gust", {"gust": 2.0})):
        scene = ThrowScene(friction=0.3, duration=HORIZON, **change)
        throws = {role: throw_box(scene, 12, seed) for seed, role in enumerate(("fit", "select", "verify"))}
        diagnosis = diagnose_throws(body, throws, tmp_path, names=("contact_friction",), horizon=HORIZON)
        assert diagnosis.finding.p_value < 0.01
        found[name] = ThrowAccount().findings_of(diagnosis, throws, seed=0)
    assert found["slow"]["verdict"] == "not_attributable"
    assert found["slow"]["status"] == "degraded"
    assert "which no known effect explains" in found["slow"]["reasons"][0]
    assert found["slow"]["something_remains"]
    assert "nothing learnt from some throws holds on others" in found["slow"]["sentence"]
    assert found["slow"]["amended"] == []
    assert found["gust"]["verdict"] == "none_of_the_known"
    assert "No single known effect suffices" in found["gust"]["sentence"]
    assert found["gust"]["account"]["explained"] < 0.5
    assert found["gust"]["amended"] == []
    assert "account" not in found["slow"]


@pytest.mark.parametrize(("change", "verdict"), [({"gust": 2.0}, "none_of_the_known"), ({"force": (0.5, 0.0)}, "named")])
def test_a_wind_in_gusts_is_no_steady_force(tmp_path, change, verdict):
    """A steady force closes most of the gap that gusts leave behind the impact, but bodies fly otherwise."""
    body = parse_body({**MODEL, "contact": {"friction": 0.3}}, ".")
    scene = ThrowScene(friction=0.3, duration=HORIZON, **change)
    throws = {role: throw_box(scene, 20, seed) for seed, role in enumerate(("fit", "select", "verify"))}
    diagnosis = diagnose_throws(body, throws, tmp_path, names=("steady_force", "contact_friction"), horizon=HORIZON)
    assert diagnosis.finding.best.names == ("steady_force",)
    assert diagnosis.finding.verdict == verdict


@pytest.mark.parametrize(
    ("plain", "left", "otherwise"),
    [(8.4, 5.2, True), (8.4, 4.5, False), (8.4, 8.3, False), (110.0, 21.6, False), (5.2, 3.9, False)],
    ids=["gusts", "noise", "an effect of the contact", "a loss of another law", "nothing beyond chance"],
)
def test_what_a_name_leaves_in_flight_counts_where_it_acts_there(plain, left, otherwise):
    """Distances in mm before the first touch, where noise explains 3.8 and, in one set of a hundred, 4.6."""
    best = ThrowHypothesis(ThrowFit((Applied("steady_force", "", {"x": 1.0, "y": 0.0}),), 0.0, True), np.zeros(8))
    identification = object.__new__(ThrowIdentification)
    identification.second = SimpleNamespace(early=lambda effects=(): np.full(8, left if effects else plain))
    identification.rules = ThrowRules()
    rest = ThrowNull(np.zeros((6, 8)), np.linspace(3.0, 4.6, 499), 0.0, np.ones_like, np.arange(8))
    assert identification._flies_otherwise(rest, best) == otherwise


@pytest.fixture(scope="module")
def thrown(tmp_path_factory):
    """A case from files: MuJoCo throws with friction 0.2, a PyBullet model with 0.5."""
    folder = tmp_path_factory.mktemp("thrown")
    for seed, role in enumerate(("fit", "select", "verify")):
        write_throws(folder / f"{role}.csv", throw_box(ThrowScene(friction=0.2, duration=HORIZON), 12, seed))
    (folder / "model.yaml").write_text(yaml.safe_dump(MODEL))
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ("fit", "select", "verify")}}
    (folder / "case.yaml").write_text(yaml.safe_dump({**case, "effects": list(NAMES), "horizon": HORIZON}))
    return folder, run_case(folder / "case.yaml", folder / "out", folder / "bank")


def test_friction_of_another_engine_is_named(thrown):
    _, findings = thrown
    assert findings["verdict"] == "named", findings["sentence"]
    assert [item["name"] for item in findings["effects"]] == ["contact_friction"]
    row = findings["effects"][0]["parameters"]["friction"]
    assert row["becomes"] == pytest.approx(0.2, abs=0.04)
    assert row["interval90"][0] <= row["value"] <= row["interval90"][1]
    assert findings["verify"]["removed"] > 0.7
    assert findings["verify"]["closure"] > 0.8
    assert findings["residual_map"]["after"][1] < 0.4 * findings["residual_map"]["after"][0]
    (entry,) = findings["account"]["entries"]
    assert (entry["label"], entry["verdict"], entry["alternatives"]) == ("contact_friction", "named", [])
    assert entry["parameters"] == findings["effects"][0]["parameters"]
    assert entry["share"] == findings["account"]["explained"] == findings["verify"]["closure"]
    assert findings["account"]["remains"]["phase"] in ("in flight", "at the first impact", "behind the first impact")


def test_an_account_of_throws_tells_each_effect_by_what_it_closes_beside_those_before():
    hidden = (Applied("contact_friction", "", {"friction": -0.2}), Applied("gravity_scale", "", {"share": 0.05}))
    body = parse_body(MODEL, ".")
    select, verify = (ThrowReplay(body, own_throws(0.5, 12, seed, effects=hidden), HORIZON) for seed in (1, 2))
    effects, near = hidden[::-1], ("restitution",)
    spans = [{"share": (0.0, 0.1)}, {"friction": (-0.3, -0.1)}]
    figures = [{"share": (9.81, 10.3)}, {"friction": (0.5, 0.3)}]
    account = throw_account(effects, ("none_of_the_known", near), 0.0, select, verify, spans, figures)
    alone = {one.name: select.errors((one,)).mean() for one in hidden}
    assert account.entries[0].effect.name == min(alone, key=alone.get)
    assert sum(entry.share for entry in account.entries) == pytest.approx(account.explained)
    errors = [verify.errors(effects).mean() for effects in ((), account.effects[:1], account.effects)]
    assert [entry.share for entry in account.entries] == pytest.approx((-np.diff(errors) / errors[0]).tolist())
    told = {entry.effect.name: (entry.spans, entry.figures) for entry in account.entries}
    assert told == {"gravity_scale": (spans[0], figures[0]), "contact_friction": (spans[1], figures[1])}
    assert {(entry.verdict, entry.instead) for entry in account.entries} == {("one of", near)}
    sure = throw_account(effects, ("none_of_the_known", ()), 0.0, select, verify, spans, figures)
    assert {(entry.verdict, entry.instead) for entry in sure.entries} == {("likely, not proven", ())}


def test_the_amended_model_can_be_read_and_holds_the_name(thrown):
    folder, findings = thrown
    amended = read_body(folder / "out" / "model.yaml")
    assert [effect.name for effect in amended.effects] == ["contact_friction"]
    assert read_json(folder / "out" / "findings.json")["sentence"] == findings["sentence"]
    evidence = yaml.safe_load((folder / "out" / "model.yaml").read_text())["evidence"]
    assert evidence[0]["records"] == findings["records"]


def test_what_throws_showed_becomes_the_simulations(thrown):
    folder, findings = thrown
    amend_object(NOMINAL, folder / "out" / "findings.json", folder / "simulation.yaml")
    before, after = read_model(NOMINAL), read_model(folder / "simulation.yaml")
    assert after.contact.table.friction == pytest.approx(findings["effects"][0]["parameters"]["friction"]["becomes"], abs=1e-6)
    assert replace(after, contact=before.contact) == before
    assert f"# {findings['sentence']}\n" in (folder / "simulation.yaml").read_text()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"records": {"fit": "none.csv"}}, "cannot be read"),
        ({"records": {"best": "fit.csv"}}, "no role"),
        ({"effects": ["viscous"]}, "mechanisms"),
        ({"effects": ["magic"]}, "unknown"),
        ({"model": "none.yaml"}, "cannot be read"),
        ({"colour": 1}, "unknown"),
        ({"records": None}, "does not name a file for each role"),
        ({"horizon": "long"}, "'horizon' is 'long', no number"),
        ({"horizon": -1}, "'horizon' is -1"),
        ({"effects": "restitution"}, "no list of names"),
        ({"units": "mm"}, "'units' is no section"),
    ],
)
def test_a_wrong_case_is_refused_and_nothing_is_written(thrown, tmp_path, change, said):
    folder, _ = thrown
    case = {**yaml.safe_load((folder / "case.yaml").read_text()), **change}
    (folder / "wrong.yaml").write_text(yaml.safe_dump(case))
    with pytest.raises(InputError, match=said):
        read_throw_case(folder / "wrong.yaml")
    with pytest.raises(InputError):
        run_case(folder / "wrong.yaml", tmp_path / "out", tmp_path / "bank")
    assert not list(tmp_path.iterdir())


def _low_and_high(seed):
    """Forty drops from just above the table, then forty throws from a metre, all as the model moves."""
    rng, body, count = np.random.default_rng(seed), parse_body({**MODEL, "contact": {"friction": 0.4}}, "."), 80
    high = np.arange(count) >= 40
    heights = np.where(high, rng.uniform(0.9, 1.2, count), rng.uniform(0.16, 0.22, count))
    turns = rng.normal(size=(count, 4))
    speeds = np.c_[rng.uniform(-1.0, 1.0, (count, 2)), rng.uniform(-0.3, 0.3, count)]
    position = np.c_[np.zeros((count, 2)), heights]
    starts = Starts(position, turns / np.linalg.norm(turns, axis=1)[:, None], speeds, rng.normal(0, 2.5, (count, 3)), True)
    time = np.arange(91) / 120
    items = []
    for k, flight in enumerate(simulate(body, body_setup(body), starts, [time] * count)):
        noise = quat_from_turn(rng.normal(0, 1e-3, flight.position.shape))
        moved = flight.position + rng.normal(0, 2e-4, flight.position.shape)
        items.append(Throw(str(k), time, moved, quat_multiply(noise, flight.quat)))
    return body, items


def test_more_throws_than_the_null_has_are_judged_alike_in_any_order():
    """The first forty were once taken for all: where they were the low ones, a perfect model had an alarm."""
    body, items = _low_and_high(0)
    p_values = []
    for order in (range(80), range(79, -1, -1), np.random.default_rng(1).permutation(80)):
        replay = ThrowReplay(body, Throws(tuple(items[k] for k in order)))
        null = throw_null(replay, (), np.random.default_rng(0), weigh=True)
        few = replay.part(40)
        # The same throws in the same unit, whether asked of the part or of the whole.
        np.testing.assert_allclose(few.errors(), replay.errors()[null.numbers], rtol=1e-12)
        p_values.append(null.p_value(replay.errors(), replay.early()))
    assert min(p_values) > 0.05, p_values


@pytest.mark.parametrize(("left", "better"), [(0.17, False), (0.14, True)])
def test_one_effect_more_takes_a_tenth_of_the_whole_gap_away(left, better):
    """Of a gap of 1 mm above a floor of 0.1, of which the first effect leaves 0.25."""
    rng = np.random.default_rng(1)
    search = object.__new__(ThrowIdentification)
    search.rules, search.plain = ThrowRules(), np.full(30, 1e-3)
    noise = 1e-6 * rng.normal(size=(2, 30))
    old, new = (ThrowHypothesis(None, 1e-3 * size + row) for size, row in zip((0.25, left), noise, strict=True))
    assert search._better(new, old, 1e-4) == better


def test_an_engine_more_is_as_far_apart_as_six_engines_lead_one_to_expect():
    """Engines differ by a third, throws of one by a tenth: of effect-free sets as many are called odd as the p-value says."""
    rng = np.random.default_rng(6)
    engines = np.exp(rng.normal(0.0, 0.3, (3000, 7, 1))) * np.exp(rng.normal(0.0, 0.1, (3000, 7, 30)))
    early = np.linspace(1.0, 2.0, 499)
    odd = [ThrowNull(sets[:6], early, 1.0, np.ones_like, np.arange(30)).p_value(sets[6], np.ones(30)) for sets in engines]
    for level in (0.01, 0.05):
        assert np.mean(np.array(odd) < level) <= 1.5 * level
    far = [ThrowNull(sets[:6], early, 1.0, np.ones_like, np.arange(30)).p_value(5.0 * sets[6], np.ones(30)) for sets in engines]
    assert np.mean(np.array(far) < 0.01) > 0.8
    # Throws that the replicates do not have must not make a set look odd, even if chaos drives them far apart.
    more = np.concatenate([engines[0, 6], np.full(60, 9.0)])
    null = ThrowNull(engines[0, :6], early, 1.0, np.ones_like, np.arange(30))
    assert null.p_value(more, np.ones(90)) == null.p_value(engines[0, 6], np.ones(30))
    # Before the first touch all engines agree.
    assert ThrowNull(engines[0, :6], early, 1.0, np.ones_like, np.arange(30)).p_value(engines[0, 6], np.full(30, 3.0)) < 0.01
