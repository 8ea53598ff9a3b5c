"""The page of the blind benchmark, its figures against the floors, and its chunks."""

import json
from pathlib import Path

import pytest
import yaml
from gap_scores import method_scores, rate, tier_scores
from matplotlib.axes import Axes

from gsbridge.experiment.gap_benchmark import AREAS
from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark import chunks, score
from gsbridge.gap.benchmark.baselines import METHODS
from gsbridge.report.gap.benchmark_figures import confusion_cells, draw_calibration, draw_confusion, effect_title
from gsbridge.report.gap.benchmark_page import headline, write_gap_benchmark
from gsbridge.report.scores.measured_gap import (
    arm_figures,
    baseline_figures,
    gap_figures,
    logged_figures,
    mismatch_figures,
    pooled,
    real_figures,
    write_gap_figures,
)
from gsbridge.report.scores.score import read_floors, score_figure

FLOORS = Path(__file__).resolve().parents[2] / "benchmarks/floors.yaml"


def test_calibration_draws_every_tier(monkeypatch):
    drawn, draw = [], Axes.errorbar

    def errorbar(axis, *args, label, **more):
        drawn.append(label)
        return draw(axis, *args, label=label, **more)

    monkeypatch.setattr(Axes, "errorbar", errorbar)
    draw_calibration({tier: method_scores() for tier in ("t0", "t1", "t2", "t5", "t6", "t7", "t9", "t10")})
    assert len(set(drawn)) == 8


def write_tiers(folder, **tiers):
    """Files of scores, one per tier."""
    out = []
    for tier, content in tiers.items():
        out.append(folder / f"{tier}.json")
        out[-1].write_text(json.dumps(content))
    return out


def test_the_page_shows_floors_ways_and_wrong_names(tmp_path):
    files = write_tiers(tmp_path, t0=tier_scores("t0"), t1=tier_scores("t1"), t2=tier_scores("t2", right=30, wrong=8))
    write_gap_benchmark(files, FLOORS, "desktop", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for said in (
        "Of 240 hidden effects of at least five times the detection limit, 88.3 %",
        *("signature cosine alone", "t2-007", "gain_d:a2", "no effort", "outside the floor", "Brier scores"),
        "Not run: fit everything, name the largest change",
        "viscous friction (viscous)",
    ):
        assert said in text
    # Three pictures for all tiers; a race and a matrix for each.
    assert text.count("<img") == 3 + 2 * 3
    assert 'src="http' not in text
    # A figure without a floor is shown as reported, not as met.
    coverage = text.split("in which this package names something", 1)[1].split("</tr>", 1)[0]
    assert ">reported<" in coverage


def test_one_tier_of_one_way_makes_a_page(tmp_path):
    content = tier_scores("t0", "development")
    content["methods"].pop("cosine")
    content["methods"]["gsbridge"] |= {"set_f1": {"value": None, "n": 0}, "unknown_abstained": rate(0, 0), "list": []}
    write_gap_benchmark(write_tiers(tmp_path, t0=content), FLOORS, "toy", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "not the one that counts" in text
    assert "No wrong name" in text
    # A run that no floors are set for is not said to miss any.
    assert "No floor is judged here" in text
    assert "not measured" in text
    assert ">unmet<" not in text


def turn(*labels, explained=(0.7, 0.8, 0.9)):
    """An exchange of `benchmarks/gap_so101.py`."""
    account = [{"label": label} for label in labels]
    judged = [{"explained": share} for share in explained]
    return {"account": account, "judged": judged, "median": sorted(explained)[1], "worst": min(explained)}


def mismatched(right=("lag",), outcome="right", first="lag", verdict="named", held=None):
    """A line of `benchmarks/gap_mismatch.py`."""
    return {
        "kind": "single" if right else "free", "right": list(right), "outcome": outcome if right else "quiet",
        "first_right": first in right, "first_verdict": verdict, "held": held or {},
    }  # fmt: skip


def test_laws_that_are_not_ours_are_counted_as_the_floors_want_it():
    cases = [
        mismatched(held={"lag": True}),
        mismatched(outcome="wrong", first="clock_offset"),
        mismatched(outcome="mute", verdict="likely, not proven", held={"lag": False}),
        # A first entry that may as well be another effect does not count as right.
        mismatched(outcome="covered", verdict="one of"),
        mismatched(right=()),
        {**mismatched(right=()), "outcome": "false_alarm"},
    ]
    found = {name: (figure["value"], figure["n"]) for name, figure in mismatch_figures({"cases": cases}).items()}
    assert found == {
        "gap_first_right_t6": (50.0, 4),
        "gap_named_right_t6": (25.0, 4),
        "gap_wrong_t6": (25.0, 4),
        "gap_false_alarm_t6": (50.0, 2),
        "gap_interval_coverage_t6": (50.0, 2),
    }


def test_machines_are_counted_without_bodies_and_photos_wherever_figures_are_gathered(tmp_path):
    """The page holds all tiers, a record those of its area; one floor means one thing in both."""
    tiers = {tier: tier_scores(tier) for tier in ("t0", "t1")}
    others = {tier: tier_scores(tier, right=0, wrong=30) for tier in ("t4", "t5")}
    names = ("gap_false_alarm", "gap_interval_coverage", "gap_simulations_most", "gap_bank_most")
    alone, together = gap_figures(tiers), gap_figures(tiers | others)
    assert [alone[name] for name in names] == [together[name] for name in names]
    # Machines with laws of their own (T6) count with the others in the rate of false alarms.
    write_json(tmp_path / "laws.json", {"cases": [{**mismatched(right=()), "outcome": "false_alarm"}] * 3})
    files = [tmp_path / f"{tier}.json" for tier in tiers]
    for path, content in zip(files, tiers.values(), strict=True):
        write_json(path, content)
    write_gap_figures(tmp_path / "out.json", files, preset="desktop", mismatch=tmp_path / "laws.json")
    found, before = read_json(tmp_path / "out.json")["figures"]["gap_false_alarm"], alone["gap_false_alarm"]
    assert found["n"] == found["cases"] == before["n"] + 3
    assert found["value"] * found["n"] == pytest.approx(before["value"] * before["n"] + 300.0)


def test_every_floor_of_the_areas_can_be_measured():
    floors = {name: entry for name, entry in read_floors(FLOORS).items() if entry["area"] in AREAS}
    tiers = {tier: tier_scores(tier) for tier in ("t0", "t1", "t2", "t4", "t5", "t7")}
    for content in tiers.values():
        content["methods"] |= {name: method_scores(right=20, wrong=20) for name in METHODS[1:]}
    tosses = {
        "tosses": {"verify": 240},
        "verdict": "named",
        "effects": [{"name": "contact_friction"}],
        "verify": {"removed": 0.85},
    }
    measured = gap_figures(tiers) | real_figures({"tosses": tosses, "pendulum": {"verdict": "none_of_the_known"}})
    measured |= arm_figures({"turns": [turn("a", "b", "c")] * 3})
    measured |= mismatch_figures({"cases": [mismatched(held={"lag": k > 0}) for k in range(10)] + [mismatched(right=())] * 40})
    scores = {name: score_figure(entry, measured.get(name), "desktop") for name, entry in floors.items()}
    assert all(score["met"] for score in scores.values()), {n: s["reason"] for n, s in scores.items() if not s["met"]}


@pytest.mark.parametrize(
    ("figure", "change", "reason"),
    [
        ("gap_named_right_t2", {"named_right": rate(70, 80)}, "outside the floor"),
        ("gap_wrong_t2", {"named_wrong": rate(9, 160)}, "outside the floor"),
        ("gap_false_alarm", {"false_alarm": rate(0, 10)}, "measured on 20 of 150 cases only"),
        ("gap_interval_coverage_upper", {"interval_coverage": rate(119, 120)}, "outside the floor"),
        ("gap_closure_tenth", {"closure_tenth": 0.7}, "outside the floor"),
        ("gap_simulations_most", {"simulations_most": 101}, "outside the floor"),
        ("gap_set_f1", {"set_f1": {"value": 0.8, "n": 30}}, "outside the floor"),
    ],
)
def test_a_figure_outside_its_floor_is_unmet(figure, change, reason):
    tiers = {tier: tier_scores(tier) for tier in ("t1", "t2")}
    for content in tiers.values():
        content["methods"]["gsbridge"] |= change
    floor = yaml.safe_load(FLOORS.read_text())[figure]
    assert score_figure(floor, gap_figures(tiers).get(figure), "desktop")["reason"] == reason


def test_the_development_split_counts_for_nothing():
    assert gap_figures({"t2": tier_scores("t2", "development")}) == {}


def test_pooled_rates_count_cases():
    found = pooled([rate(1, 10), rate(9, 90), rate(0, 0)])
    assert (found["value"], found["n"]) == (0.1, 100)
    assert found == {**rate(10, 100), "value": 0.1}
    assert pooled([rate(0, 0)])["value"] is None


def test_sets_and_wrong_joints_have_columns_of_their_own():
    cells = confusion_cells(method_scores()["confusion"])
    assert cells["coulomb", "ambiguous"] == 3
    assert cells["coulomb", "other joint"] == 2
    assert cells["viscous", "viscous"] == 7
    assert sum(cells.values()) == 199


def test_effects_have_their_titles_and_those_of_pictures_are_not_taken_for_those_of_joints(monkeypatch):
    drawn = []
    monkeypatch.setattr("gsbridge.report.gap.benchmark_figures.data_uri", lambda figure: drawn.append(figure) or "data:,")
    draw_confusion(method_scores()["confusion"], "t1")
    labels = [label.get_text() for label in drawn[0].axes[0].get_yticklabels()]
    assert {"Coulomb friction", "viscous friction"} <= set(labels)
    assert effect_title("saturation", "t1") == "a limit of the motor's torque"
    assert effect_title("saturation", "t4") == "saturation"
    assert effect_title("not_attributable", "t1") == "not attributable"


def test_the_headline_leaves_out_what_was_not_tried():
    scores = {"t0": {**method_scores(), "false_alarm": rate(0, 0), "unknown_abstained": rate(0, 0)}}
    assert len(headline(scores)) == 1


def test_a_killed_chunk_goes_on_where_it_was_and_leaves_no_half(tmp_path):
    """Four cases, and a diagnosis that notes what it is asked for and dies at the third."""
    cases, out, asked, fails = tmp_path / "cases", tmp_path / "out", list[str](), True
    cases.mkdir()

    def write_manifest(seed):
        rows = [{"key": f"c{number}", "courses": 0} for number in (2, 0, 3, 1)]
        (cases / "manifest.json").write_text(json.dumps({"seed": seed, "cases": rows}))

    def diagnose(folder, bank, method, seed):
        if fails and folder.name == "c2":
            raise KeyboardInterrupt
        asked.append(folder.name)
        return {"folder": str(folder), "bank": str(bank), "method": method, "seed": seed}

    def run():
        chunks.diagnose_chunk(cases, 0, 1, diagnose, "cosine", tmp_path / "bank", tmp_path / "state", out, 3)

    write_manifest(1)
    with pytest.raises(KeyboardInterrupt):
        run()
    assert not out.exists()
    fails = False
    run()
    assert asked == ["c0", "c1", "c2", "c3"]
    assert {path.name: json.loads(path.read_text()) for path in out.iterdir()} == {
        f"{key}.json": {"folder": str(cases / key), "bank": str(tmp_path / "bank"), "method": "cosine", "seed": 3}
        for key in asked
    }
    # Different cases with the same names are diagnosed again.
    write_manifest(2)
    run()
    assert len(asked) == 8


def test_folders_of_findings_are_handed_to_their_methods(tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr(score, "score_findings", lambda cases, truths, findings: seen.update(findings) or {}, raising=False)
    folders = [tmp_path / name for name in ("a-0", "a-1", "b-0", "b-1")]
    score.score_tier(tmp_path, tmp_path, folders, ["a", "b"], 2, tmp_path / "scores.json")
    assert {name: [folder.name for folder in found] for name, found in seen.items()} == {
        "a": ["a-0", "a-1"],
        "b": ["b-0", "b-1"],
    }


def rates(right, wrong, count=40, cases=()):
    return {
        "named_right": {"value": right, "n": count, "ci95_low": 0.0, "ci95_high": 1.0},
        "named_wrong": {"value": wrong, "n": count, "ci95_low": 0.0, "ci95_high": 1.0},
        "list": list(cases),
    }


def listed(right, wrong, silent):
    """Cases as scores list them: the wrong answers are those that a method is least sure of."""
    sure = [{"sureness": {"gain": 9.0}, "guessed_right": True, "verdict": "named"}] * right
    unsure = [{"sureness": {"gain": 5.0}, "guessed_right": False, "verdict": "named"}] * wrong
    return sure + unsure + [{"sureness": {}, "guessed_right": False, "verdict": "no_discrepancy"}] * silent


def test_a_baseline_is_beaten_that_names_more_wrongly_and_no_more_rightly():
    tiers = {
        "t1": {
            "methods": {
                "gsbridge": rates(0.9, 0.05),
                "shy": rates(0.5, 0.0),
                "bold": rates(0.95, 0.4),
                "worse": rates(0.8, 0.2),
            }
        },
        "t2": {
            "methods": {
                "gsbridge": rates(0.9, 0.05),
                "shy": rates(0.5, 0.0),
                "bold": rates(0.95, 0.4),
                "worse": rates(0.8, 0.2),
            }
        },
    }
    found = baseline_figures(tiers)
    assert found["gap_baselines_beaten"]["value"] == 1.0
    assert found["gap_baselines_wrong"]["value"] == 0.0
    assert found["gap_baselines_right"]["by_scene"]["bold"] == pytest.approx(95.0)
    # A method that did not run in every tier is not judged, and there are no figures if no other method ran.
    del tiers["t2"]["methods"]["worse"]
    assert "worse" not in baseline_figures(tiers)["gap_baselines_wrong"]["by_scene"]
    assert baseline_figures({"t1": {"methods": {"gsbridge": rates(0.9, 0.05)}}}) == {}
    # Nor are there any for a split without large effects.
    nothing = rates(None, 0.05, 0)
    assert baseline_figures({"t1": {"methods": {"gsbridge": nothing, "worse": nothing}}}) == {}


@pytest.mark.parametrize(("verdict", "names", "named"), [("named", ["contact_friction"], 1.0), ("ambiguous", [], 0.0)])
def test_real_logs_are_told_as_they_were_diagnosed(verdict, names, named):
    tosses = {
        "tosses": {"fit": 60, "select": 100, "verify": 240},
        "verdict": verdict,
        "effects": [{"name": name} for name in names],
        "verify": {"removed": 0.85} if names else None,
    }
    found = real_figures({"tosses": tosses, "pendulum": {"verdict": "none_of_the_known"}})
    assert found["gap_tosses_named"]["value"] == named
    assert ("gap_tosses_closed" in found) == bool(names)
    assert found["gap_pendulum_unnamed"]["value"] == 1.0
    assert real_figures({}) == {}


def test_a_real_arm_counts_by_its_worst_exchange(tmp_path):
    turns = [turn("a", "b", "c", "d"), turn("c", "b", "a", explained=(0.3, 0.7, 0.8)), turn("a", "b", "d", "c")]
    path = tmp_path / "arm.json"
    path.write_text(json.dumps({"turns": turns}))
    found = logged_figures(None, path)
    assert {name: figure["value"] for name, figure in found.items()} == pytest.approx(
        {"gap_so101_median": 70.0, "gap_so101_worst": 30.0, "gap_so101_kept": 2.0}
    )
    assert all((figure["n"], figure["turns"]) == (3, 3) for figure in found.values())
    assert logged_figures(None, None) == arm_figures({"turns": [{"judged": []}]}) == {}


def test_at_equal_coverage_a_method_is_beaten_that_is_clearly_wrong_more_often():
    def figures(**methods):
        return baseline_figures({"t1": {"methods": {name: rates(0.9, 0.05, cases=cases) for name, cases in methods.items()}}})

    ours = listed(20, 0, 20)
    found = figures(
        gsbridge=ours, worse=listed(12, 20, 8), lucky=listed(18, 20, 2), mute=listed(0, 0, 40), sure=listed(20, 20, 0)
    )
    assert found["gap_coverage"]["value"] == 50.0
    assert found["gap_risk_at_coverage"]["by_scene"] == pytest.approx(
        {"gsbridge": 0.0, "worse": 40.0, "lucky": 10.0, "sure": 0.0}
    )
    # Only `worse` is beaten: two wrong of twenty may be chance, `mute` gives no answer, and `sure`, with a threshold set in
    # hindsight, is as good as gsbridge's.
    assert found["gap_risks_beaten"]["value"] == 1.0
    # A method that answers fewer cases is compared at its own largest coverage: one wrong of five, where gsbridge has none.
    assert figures(gsbridge=ours, shy=listed(4, 1, 35))["gap_risks_beaten"]["value"] == 0.0
    assert figures(gsbridge=ours, shy=listed(0, 5, 35))["gap_risks_beaten"]["value"] == 1.0
    # If gsbridge's own method answers nothing, it has beaten no other.
    assert figures(gsbridge=listed(0, 0, 40), worse=listed(12, 20, 8))["gap_risks_beaten"]["value"] is None
