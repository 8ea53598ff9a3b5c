"""The blind benchmark: truths that share no code with the diagnosis, hidden and sealed, and their scoring."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from axis_logs import axis_course

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark.axis_truth import run_axis
from gsbridge.gap.benchmark.baselines import METHODS, SEARCHES, available
from gsbridge.gap.benchmark.campaign import case_keys, diagnose_cases
from gsbridge.gap.benchmark.case_plan import BODIES, MACHINES, SPLITS, TIER_SIZE, TIERS, PlannedCase, plan_cases
from gsbridge.gap.benchmark.drawing import _drawn, generate_cases
from gsbridge.gap.benchmark.generate import BenchmarkMechanism, NotShownError, draw_case, size_of_units
from gsbridge.gap.benchmark.images import draw_image_case
from gsbridge.gap.benchmark.images import image_site as photo_site
from gsbridge.gap.benchmark.joint_diagnosis import diagnose_joint_case
from gsbridge.gap.benchmark.mechanisms import MechanismSite, axis_plant
from gsbridge.gap.benchmark.mujoco_truth import MujocoTruth
from gsbridge.gap.benchmark.photo_baselines import run_photo_baseline
from gsbridge.gap.benchmark.photo_cases import photo_closure, read_photos, write_photos
from gsbridge.gap.benchmark.photo_diagnosis import diagnose_photo_case
from gsbridge.gap.benchmark.score import rate, score, score_findings
from gsbridge.gap.benchmark.throw_diagnosis import diagnose_thrown_case
from gsbridge.gap.benchmark.twins import twins_of
from gsbridge.gap.benchmark.verdicts import JudgedCase
from gsbridge.gap.diagnosis.results import says_likely
from gsbridge.gap.image.model import shooting
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.statistics import wilson_interval


def test_a_truth_that_runs_away_is_told_and_not_logged(tmp_path, monkeypatch):
    """MuJoCo puts a mechanism that runs away back to where it began, and goes on; it also leaves a file where it ran."""
    system, _ = axis_plant(tmp_path)
    monkeypatch.chdir(tmp_path)
    truth, times = MujocoTruth(system), np.arange(100) / 100
    lost = truth(lambda time: np.array([0.3 + time]), 1.0, times, {"viscous": -20.0})
    begun = np.isfinite(lost["position"][:, 0])
    assert begun[0]
    assert not begun[-1]
    # A motion that has run away never comes back.
    assert (np.diff(begun.astype(int)) <= 0).all()
    assert np.isfinite(lost["tool"][:, 0]).sum() <= begun.sum() + 1
    assert not list(tmp_path.glob("MUJOCO*"))
    # The search for a size takes a motion that runs away for too large. A case whose motion runs away later is refused.
    plant = plant_of({"odd": (1e-3, 1)}, lambda hidden: 10 * hidden["odd"] if hidden else 0.0)
    selected = []

    def wild(wanted, duration, times, hidden):
        moved = plant.truth(wanted, duration, times, hidden)
        if hidden:
            selected.append(wanted(0.3))
        # Sizes are found on `select`, on which no motion runs away.
        return moved if not hidden or selected[0] == wanted(0.3) else {kind: values * np.nan for kind, values in moved.items()}

    with pytest.raises(NotShownError, match="runs away") as caught:
        draw_case(replace(plant, truth=wild), ("odd",), 5.0, 1, 2, duration=1.0, rate=20.0, kinds=("position",))
    assert caught.value.name == "odd"


def plant_of(sizes, shows):
    """A plant whose position is `shows` of the hidden sizes, under noise of one."""

    def truth(wanted, duration, times, hidden):
        return {"position": np.full((len(times), 1), shows(hidden) / np.sqrt(len(times)))}

    return BenchmarkMechanism(("a",), np.zeros(1), np.ones(1), {"position": np.ones(1)}, truth, sizes)


@pytest.mark.parametrize(
    "law",
    [
        lambda x: x,
        lambda x: 1e4 * x * x,
        # A lag smaller than the period of the loop once looked like this, and the search went to and fro.
        lambda x: 1e5 * x * np.exp(-1e-3 / x),
        lambda x: 1e3 * np.sqrt(x),
        # Nothing below a threshold.
        lambda x: 1e3 * max(x - 0.05, 0.0),
    ],
)
@pytest.mark.parametrize("units", [1.0, 20.0])
def test_unit_is_found_whatever_the_law_of_the_size(law, units):
    plant = plant_of({"odd": (1e-3, 1)}, lambda hidden: law(hidden["odd"]) if hidden else 0.0)
    times = np.arange(10) / 10
    plain = plant.truth(None, 1.0, times, {})
    size = size_of_units(plant, "odd", 1.0, units, None, 1.0, times, ("position",), plain)
    assert law(size) == pytest.approx(5 * units, rel=0.05)


def test_what_does_not_show_gives_way_and_what_cancels_is_not_hidden():
    def shows(hidden):
        return 1e3 * np.hypot(hidden.get("good", 0.0), hidden.get("late", 0.0) - hidden.get("early", 0.0))

    plant = plant_of(dict.fromkeys(("good", "mute", "late", "early"), (1e-2, 1)), shows)
    site = MechanismSite("axis", None, plant, ("good", "mute", "late", "early"), (), "axis")
    for names in (("mute",), ("early", "late")):
        order, case = _drawn(site, PlannedCase("a", "single", names, 5.0, 1, 2, ("position",)))
        assert "mute" not in case.hidden
        assert set(order.names) == set(case.hidden) != set(names)
    with pytest.raises(InputError, match="mute do not show"):
        _drawn(replace(site, names=("mute",)), PlannedCase("a", "single", ("mute",), 5.0, 1, 2, ("position",)))


def test_no_effect_is_larger_than_a_likely_fault():
    plant = replace(plant_of({"weak:a": (1e-3, 1)}, lambda hidden: hidden.get("weak:a", 0.0)), largest={"weak": 2.0})
    times = np.arange(10) / 10
    plain = plant.truth(None, 1.0, times, {})
    assert size_of_units(plant, "weak:a", 1.0, 0.3, None, 1.0, times, ("position",), plain) == pytest.approx(1.5, rel=0.05)
    with pytest.raises(NotShownError):
        size_of_units(plant, "weak:a", 1.0, 1.0, None, 1.0, times, ("position",), plain)


def test_twins_are_one_equation():
    wanted, times = axis_course()
    share = 0.05
    lighter, stronger = (run_axis(wanted, 1.0, times, hidden) for hidden in (
        {"link_mass": 1 / (1 + share) - 1}, {"torque_gain": share})
    )  # fmt: skip
    plain = run_axis(wanted, 1.0, times, {})
    for kind in plain:
        np.testing.assert_allclose(lighter[kind], stronger[kind], atol=1e-9)
        assert np.abs(lighter[kind] - plain[kind]).max() > 1e-4


def test_twins_are_written_down_per_plant():
    full = ("position", "velocity", "effort")
    assert frozenset({"link_mass"}) in twins_of("axis", {"torque_gain": 0.1}, full)
    assert twins_of("arm", {"torque_gain:a": 0.1}, full) == ()
    first, second = "lbr_iiwa_joint_1", "lbr_iiwa_joint_2"
    assert twins_of("arm", {f"armature:{first}": 0.1}, full) == (frozenset({f"link_mass:{first}"}),)
    assert twins_of("arm", {f"armature:{second}": 0.1}, full) == ()
    assert twins_of("arm", {"viscous:a": 0.1}, full[:2]) == (frozenset({"gain_d:a"}),)
    assert twins_of("axis", {"lag": 1e-3}, full) == (frozenset({"command_delay"}),)
    assert twins_of("axis", {"lag": 1e-2}, full) == ()
    assert twins_of("axis", {}, full) == ()
    pair = twins_of("axis", {"torque_gain": 0.1, "coulomb": 0.1}, full)
    assert frozenset({"link_mass", "coulomb"}) in pair
    assert frozenset({"torque_gain", "coulomb"}) not in pair


def test_orders_keep_the_mix_and_splits_share_nothing():
    names, strange = ("coulomb:a", "coulomb:b", "viscous:a", "lag"), ("odd",)
    drawn = {split: plan_cases("t2", split, names, strange) for split in SPLITS}
    assert drawn["scored"] == plan_cases("t2", "scored", names, strange)
    for field in ("seed", "course_seed", "units"):
        sets = [{getattr(order, field) for order in drawn[split] if order.names} for split in SPLITS]
        assert not sets[0] & sets[1]
    kinds = [order.kind for order in drawn["scored"]]
    few = [order.kind for order in plan_cases("t2", "scored", names, strange, 26)]
    mixed = [kind for kind in kinds if kind not in ("contact", "tool")]
    assert len(mixed) < len(kinds)
    for kind in set(mixed):
        assert kinds.count(kind) == few.count(kind) * len(mixed) // 26
    assert all(order.touched == (order.kind == "contact") for order in drawn["scored"])
    assert all((order.channels == ("tool",)) == (order.kind == "tool") for order in drawn["scored"])
    assert sorted(order.key for order in drawn["scored"]) == [f"t2-{k:03d}" for k in range(TIER_SIZE["t2"])]
    assert all(order.noise == "white" or order.kind in ("free", "coloured") for order in drawn["scored"])
    lossy = [order for order in drawn["scored"] if order.kind == "dropped"]
    assert lossy
    assert all(order.lost > 0 and "clock_drift" in order.names and len(order.names) == 2 for order in lossy)
    assert {order.lost for order in drawn["scored"] if order.kind != "dropped"} == {0.0}
    free = sum(order.kind == "free" for tier in TIERS for order in plan_cases(tier, "scored", names, strange))
    assert free >= 150
    assert sum(size for tier, size in TIER_SIZE.items() if tier not in (BODIES, MACHINES)) <= 500
    assert TIER_SIZE[BODIES] + TIER_SIZE[MACHINES] <= 200


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benchmark")
    generate_cases("t0", "development", folder / "cases", folder / "truths", count=2, seed=1)
    return folder


def test_cases_tell_nothing_and_their_truths_are_sealed(drawn):
    manifest = read_json(drawn / "cases" / "manifest.json")
    assert case_keys(drawn / "cases") == tuple(row["key"] for row in sorted(manifest["cases"], key=lambda r: r["courses"]))
    assert case_keys(drawn / "cases", 0, 2) + case_keys(drawn / "cases", 1, 2) == case_keys(drawn / "cases")
    text = "".join(path.read_text(encoding="utf-8") for path in (drawn / "cases").rglob("*.yaml")) + str(manifest)
    for path in (drawn / "truths").glob("*.json"):
        for name in read_json(path)["hidden"]:
            assert name not in text


def test_chunk_is_diagnosed_once_and_scored(drawn, tmp_path):
    for key in case_keys(drawn / "cases"):
        path = drawn / "cases" / key / "case.yaml"
        hidden = [name.split(":")[0] for name in read_json(drawn / "truths" / f"{key}.json")["hidden"]]
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        content["effects"] = sorted({*hidden, "coulomb", "viscous", "encoder_offset"})
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
    keys = case_keys(drawn / "cases")
    diagnose_cases(drawn / "cases", keys, tmp_path / "found", drawn / "bank", diagnose_joint_case)
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "found").iterdir()}
    diagnose_cases(drawn / "cases", keys, tmp_path / "found", drawn / "bank", diagnose_joint_case)
    assert before == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "found").iterdir()}
    figures = score_findings(drawn / "cases", drawn / "truths", {METHODS[0]: [tmp_path / "found"]})["methods"][METHODS[0]]
    assert figures["false_alarm"]["value"] == 0.0
    assert figures["named_wrong"]["value"] == 0.0
    assert figures["simulations_most"] <= 100
    (tmp_path / "found" / f"{keys[0]}.json").unlink()
    with pytest.raises(InputError, match="is missing"):
        score_findings(drawn / "cases", drawn / "truths", {METHODS[0]: [tmp_path / "found"]})


def test_changed_truth_is_refused(drawn, tmp_path):
    truths = tmp_path / "truths"
    truths.mkdir()
    for path in (drawn / "truths").iterdir():
        (truths / path.name).write_bytes(path.read_bytes())
    changed = next(truths.glob("*.json"))
    write_json(changed, read_json(changed) | {"units": 3.0})
    with pytest.raises(InputError, match="changed after"):
        score_findings(drawn / "cases", truths, {METHODS[0]: [tmp_path]})


def test_unknown_tier_method_and_missing_package_are_refused(tmp_path):
    with pytest.raises(InputError, match="no tier 't9'"):
        generate_cases("t9", "scored", tmp_path / "a", tmp_path / "b")
    assert not (tmp_path / "a").exists()
    assert all(available(method) is None for method in METHODS if method not in SEARCHES)


def said(verdict, named=(), sets=(), hidden=("a",), twins=(), **more):
    sets = tuple(frozenset(s) for s in sets)
    return JudgedCase(frozenset(hidden), 5.0, verdict, frozenset(named), sets, twins=tuple(frozenset(t) for t in twins), **more)


def test_outcomes_are_counted_in_classes_of_sizes():
    cases = [replace(said("named", ["a"]), units=units) for units in (1.3, 4.7, 5.0, 9.9, 20.6, 100.0)]
    found = [(row["units"], row["n"]) for row in score(cases)["by_units"]]
    assert found == [(0.0, 1), (2.0, 1), (5.0, 2), (10.0, 1), (50.0, 1)]


def test_outcomes():
    assert said("named", ["a"]).outcome == "right"
    assert said("named", ["b"]).outcome == "wrong"
    assert said("named", ["a", "b"]).outcome == "wrong"
    # A method that can answer "ambiguous" must do so; one that always decides is right with any effect of the same equation.
    assert said("named", ["b"], twins=[["b"]]).outcome == "wrong"
    assert said("named", ["b"], twins=[["b"]], decides=True).outcome == "right"
    assert said("named", ["c"], twins=[["b"]], decides=True).outcome == "wrong"
    assert said("ambiguous", ["b"], [["b"], ["a"]]).outcome == "covered"
    assert said("ambiguous", ["b"], [["b"], ["a"]], twins=[["b"]]).outcome == "right"
    assert said("ambiguous", ["b"], [["b"], ["a"], ["c"]], twins=[["b"]]).outcome == "covered"
    assert said("ambiguous", ["b"], [["b"], ["c"]]).outcome == "wrong"
    assert said("none_of_the_known").outcome == said("not_attributable").outcome == "abstained"
    assert said("no_discrepancy").outcome == "missed"
    assert said("no_discrepancy", hidden=()).outcome == "quiet"
    assert said("none_of_the_known", hidden=()).outcome == said("not_attributable", hidden=()).outcome == "false_alarm"
    assert said("named", ["b"], known=False).outcome == "wrong"
    assert said("ambiguous", ["a"], [["a"]], known=False).outcome == "wrong"


def test_what_is_said_to_be_likely_counts_beside_names():
    cases = [
        said("named", ["a"], guess=frozenset("a")),
        said("none_of_the_known", ["a"], guess=frozenset("a"), likely=True),
        said("none_of_the_known", ["a"], guess=frozenset("a")),
        said("none_of_the_known", ["b"], guess=frozenset("b"), likely=True),
        said("none_of_the_known", ["b"], known=False, guess=frozenset("b"), likely=True),
    ]
    figures = score(cases)
    assert (figures["told_right"]["value"], figures["told_right"]["n"]) == (0.5, 4)
    assert (figures["told_wrong"]["value"], figures["told_wrong"]["n"]) == (0.4, 5)


@pytest.mark.parametrize(
    ("verdict", "share", "likely"),
    [("likely, not proven", 0.7, True), ("likely, not proven", 0.3, False), ("one of", 0.7, False)],
)
def test_the_first_line_of_an_account_is_likely_where_it_closes_much(verdict, share, likely):
    account = {"entries": [{"verdict": verdict, "share": share}]}
    assert says_likely({"verdict": "none_of_the_known", "account": account}) == likely
    assert not says_likely({"verdict": "ambiguous", "account": account})
    assert not says_likely({"verdict": "none_of_the_known"})


def test_figures_of_a_few_verdicts():
    cases = [
        said("named", ["a"], closure=0.9, left=1.1, covers=(True,), chance=0.99),
        said("named", ["b"], chance=0.97),
        said("ambiguous", ["a"], [["a"], ["b"]], chance=0.6),
        said("no_discrepancy", hidden=()),
        said("none_of_the_known", known=False),
        said("named", ["a", "c"], hidden=("a", "b")),
    ]
    figures = score(cases)
    low, high = wilson_interval(1, 3)
    assert figures["named_right"] == {"value": 1 / 3, "n": 3, "ci95_low": low, "ci95_high": high}
    assert figures["named_wrong"]["value"] == pytest.approx(1 / 3)
    assert figures["false_alarm"]["value"] == 0.0
    assert figures["unknown_abstained"]["value"] == 1.0
    assert figures["set_f1"]["value"] == pytest.approx(0.5)
    assert figures["closure_median"] == 0.9
    assert figures["interval_coverage"]["n"] == 1
    assert sum(row["cases"] for row in figures["confusion"]) == len(cases)
    assert [row["right"]["n"] for row in figures["calibration"]] == [1, 2]
    assert figures["brier"] == pytest.approx((0.01**2 + 0.97**2 + 0.4**2) / 3)


def test_sets_that_are_one_equation_count_as_found_and_other_ambiguous_ones_do_not():
    sets = [["a", "c"], ["b", "c"]]
    for twins, value in (([["b", "c"]], 1.0), ((), 0.0)):
        case = said("ambiguous", ["a", "c"], sets, hidden=("a", "c"), twins=twins)
        assert score([case])["set_f1"]["value"] == value


def test_rates_have_wilsons_interval_in_closed_form():
    z = 1.959964
    for successes, total in ((81, 263), (0, 20), (150, 150)):
        share, root = successes / total, z * (successes * (total - successes) / total + z * z / 4) ** 0.5
        expected = [(successes + z * z / 2 + sign * root) / (total + z * z) for sign in (-1, 1)]
        found = rate(successes, total)
        assert found["value"] == share
        assert [found["ci95_low"], found["ci95_high"]] == pytest.approx(expected, abs=1e-6)
    assert rate(0, 0) == {"value": None, "n": 0, "ci95_low": 0.0, "ci95_high": 1.0}


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    contents = ((), (np.linspace(0, 1, 64 * 64 * 3, dtype=np.float32).reshape(64, 64, 3),))
    generate_cases("t4", "development", folder / "cases", folder / "truths", count=3, seed=1, contents=contents)
    return folder


def test_photos_are_cases_like_others(photos, tmp_path):
    keys = case_keys(photos / "cases")
    kinds = {key: read_json(photos / "truths" / f"{key}.json")["kind"] for key in keys}
    assert sorted(kinds.values()) == ["free", "single", "single"]
    for key in keys:
        pairs = read_photos(photos / "cases" / key)
        assert set(pairs) == {"fit", "select", "verify"}
        photo = pairs["fit"].after
        np.testing.assert_allclose(photo * 255, np.round(photo * 255), atol=1e-4)
    (free,) = (key for key, kind in kinds.items() if kind == "free")
    for method in ("gsbridge", "cosine", "sparse"):
        diagnose_cases(photos / "cases", [free], tmp_path / method, tmp_path / "bank", diagnose_photo_case, method=method)
    found = read_json(tmp_path / "gsbridge" / f"{free}.json")
    assert found["verdict"] == "no_discrepancy"


def test_a_baseline_does_not_name_what_a_thrown_body_lacks(tmp_path):
    with pytest.raises(InputError, match="'cosine' cannot name"):
        diagnose_thrown_case(tmp_path, tmp_path, "cosine", 0)


def test_closure_of_photos_is_whole_with_the_truth_and_nothing_without(tmp_path):
    case = draw_image_case(photo_site(5), ("exposure",), 60.0, 4, moving=False)
    write_photos(tmp_path, case.pairs)
    stops = Applied("exposure", "", {"stops": case.hidden["exposure"]})
    closure, _ = photo_closure(tmp_path, case.clean, case.plain, [stops])
    assert closure == pytest.approx(1.0, abs=0.02)
    assert photo_closure(tmp_path, case.clean, case.plain, [])[0] == pytest.approx(0.0, abs=1e-6)
    assert photo_closure(tmp_path, case.plain, case.plain, [])[0] is None


def test_what_remains_in_photos_is_the_mean_over_the_pixels_that_are_compared(tmp_path):
    case = draw_image_case(photo_site(5), ("exposure",), 60.0, 4, moving=False)
    write_photos(tmp_path, case.pairs)
    pairs = read_photos(tmp_path)
    squares = []
    for photos in (case.clean, case.plain):
        shown = replace(pairs["verify"], after=photos.astype(np.float32))
        view = ImageResiduals(shown, learn_noise(list(pairs.values())), compare_noise=False)
        assert 0.3 < view.mask.mean() < 0.9
        squares.append((view.apart(shooting())[view.mask > 0].astype(np.float64) ** 2).mean())
    left = photo_closure(tmp_path, case.clean, case.plain, [])[1]
    assert left == pytest.approx(np.sqrt(squares[0] - squares[1]), rel=1e-6)


def test_baselines_of_photos_name_what_is_plain(tmp_path):
    pairs = draw_image_case(photo_site(5), ("white_balance",), 60.0, 4, moving=False).pairs
    for method in ("largest_change", "training_bic", "cosine", "sparse"):
        found = run_photo_baseline(method, pairs)
        assert found["verdict"] == "named"
        assert {"gain", "rest", "share"} <= set(found["sureness"])
        assert found["sureness"]["gain"] > 0
        if method in ("training_bic", "sparse"):
            assert "white_balance" in [effect["name"] for effect in found["effects"]]
