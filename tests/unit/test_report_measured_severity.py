"""Figures of success at severity and of what splats are worth, against arithmetic by hand, numpy and scipy."""

import itertools
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from severity_files import SIM, both_sets, lab, row, write

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.scores.measured_severity import write_severity_figures, write_worth_figures
from gsbridge.report.scores.score import read_floors, write_scores
from gsbridge.statistics import limits, redrawn_rates

FLOORS = Path(__file__).resolve().parents[2] / "benchmarks/floors.yaml"
AREAS = ("severity", "worth")
PAIRS = [(item, table) for table in ("foam_pad", "tablecloth") for item in ("small_cube", "cake", "banana", "bear")]
GRASPS = [("grasp", item, table) for item, table in PAIRS]
PLACE = ("pick_and_place", "cake", "plate")
WORTH = [("grasp", "small_cube", "foam_pad"), ("grasp", "bear", "tablecloth"), PLACE]


@pytest.fixture(scope="module")
def floors(tmp_path_factory):
    """Those of the two areas, since the whole file takes a while to read."""
    path = tmp_path_factory.mktemp("floors") / "floors.yaml"
    write_json(path, {name: entry for name, entry in read_floors(FLOORS).items() if entry["area"] in AREAS})
    return path


@pytest.fixture
def scores(tmp_path, floors):
    """Scores of an area from rows."""
    return partial(scores_of, tmp_path, floors)


def scores_of(tmp_path, floors, area, severity=None, worth=None, graded=None, preset="desktop"):
    files = {"severity": severity, "worth": worth, "graded": graded}
    paths = {name: None if rows is None else write(tmp_path / f"{name}.csv", rows) for name, rows in files.items()}
    if area == "severity":
        write_severity_figures(tmp_path / "measured.json", paths["severity"], preset)
    else:
        write_worth_figures(tmp_path / "measured.json", worth=paths["worth"], graded=paths["graded"], preset=preset)
    write_scores(
        floors, [tmp_path / "measured.json"], tmp_path / "scores.json", area=area, preset=preset, provenance={"code": {}}
    )
    return read_json(tmp_path / "scores.json")["figures"]


def cell_rows(at_2, at_3):
    """Rows of all policies of the tables: successes of 64 of the grasp cells at both severities."""
    out = []
    for place, second, third in zip(GRASPS, at_2, at_3, strict=True):
        out += both_sets(place, "gs", 64) + both_sets(place, "gs", second, world=lab(2))
        out += both_sets(place, "gs", third, world=lab(3))
        out += [row(place, "gs", 4, world=lab(level), pose_set="outside", trials=16) for level in (2, 3)]
    for level, good in ((2, 56), (3, 40)):
        out += both_sets(PLACE, "gs", good, world=lab(level))
        for place in (GRASPS[0], GRASPS[3]):
            out += both_sets(place, "mesh", 16 * level, world=lab(level))
    return out


def test_policies_of_the_tables_are_judged_at_each_severity(scores):
    at_2, at_3 = [64, 60, 58, 62, 56, 60, 64, 50], [64, 40, 48, 50, 32, 60, 20, 50]
    found = scores("severity", cell_rows(at_2, at_3))
    # Every figure that is asked for is measured.
    assert {name for name, score in found.items() if score["value"] is None} == set()
    assert found["severity_grasp_2"]["value"] == pytest.approx(100 * np.mean(at_2) / 64)
    assert found["severity_grasp_2"]["met"]
    assert not found["severity_grasp_2"]["stretch_met"]
    assert found["severity_grasp_2"]["n"] == 8 * 64
    assert found["severity_grasp_3"]["value"] == pytest.approx(100 * np.mean(at_3) / 64)
    assert found["severity_grasp_3"]["reason"] == "outside the floor"
    assert found["severity_grasp_3"]["by_scene"]["grasp/banana+tablecloth"] == pytest.approx(100 * 20 / 64)
    assert found["severity_grasp_3"]["beside"]["the same in simulation"]["grasp/banana+tablecloth"] == 100
    # Of one training of one cell, Wilson's interval: scipy's.
    wilson = stats.binomtest(56, 64).proportion_ci(method="wilson")
    assert found["severity_place_2"]["value"] == pytest.approx(87.5)
    assert found["severity_place_2"]["interval"] == pytest.approx([100 * wilson.low, 100 * wilson.high])
    assert found["severity_place_3"]["floor"] is None
    assert [found[f"severity_mesh_{level}"]["value"] for level in (2, 3)] == pytest.approx([50, 75])
    assert found["severity_grasp_outside_2"]["value"] == pytest.approx(25)
    # With one training per cell only the starts scatter, less than if all cells had the same rate.
    low, high = found["severity_grasp_3"]["interval"]
    wilson = stats.binomtest(sum(at_3), 8 * 64).proportion_ci(method="wilson")
    np.testing.assert_allclose((low, high), (100 * wilson.low, 100 * wilson.high), atol=1e-6)


def test_worlds_of_one_severity_and_trainings_count_together(scores):
    rows = []
    for place in GRASPS:
        for training, good in ((1, 64), (2, 48)):
            rows += both_sets(place, "gs", good, training=training, world=lab(2))
            rows += both_sets(place, "gs", good - 16, training=training, world=("other", 2, 2))
        # Worlds whose severities of look and physics differ count for no floor.
        rows += both_sets(place, "gs", 1, world=("dim", 3, 1))
    found = scores("severity", rows)
    assert found["severity_grasp_2"]["value"] == pytest.approx(100 * (64 + 48 + 48 + 32) / (4 * 64))
    assert (found["severity_grasp_2"]["seeds"], found["severity_grasp_2"]["n"]) == (2, 8 * 4 * 64)
    assert found["severity_grasp_3"]["reason"] == "not measured"


def test_what_is_missing_is_unmet(scores):
    rows = [one for one in cell_rows([64] * 8, [64] * 8) if one["object"] != "bear" and one["look"] != 3]
    found = scores("severity", rows)
    assert found["severity_grasp_2"]["reason"] == "measured on 6 of 8 cells only"
    assert {name for name, score in found.items() if score["reason"] == "not measured"} == {
        name for name in found if name.endswith("_3")
    }
    half = [one for one in cell_rows([64] * 8, [64] * 8) if one["pose_set"] != "unseen"]
    assert scores("severity", half)["severity_grasp_2"]["reason"] == "measured on 32 of 64 trials only"
    assert {score["reason"] for score in scores("severity").values()} == {"not measured"}
    toy = scores("severity", cell_rows([64] * 8, [64] * 8), preset="toy")
    assert toy["severity_grasp_2"]["reason"] == "measured with preset toy, asked for preset desktop"


RENDERERS = ("gs", "gs_soft", "mesh_vertex_shaded", "mesh_shaded")


def worth_rows(success, *, seeds=3, levels=(0, 1, 2, 3, 4), renderers=RENDERERS, places=WORTH):
    """Rows of the deciding table.

    Args:
        success: Successes of 64 by renderer, variant, severity, number of the cell and training.
        seeds, levels, renderers, places: What was run.
    """
    out = []
    for (number, place), renderer, variant, level in itertools.product(
        enumerate(places), renderers, ("no_jitter", "default"), levels
    ):
        for training in range(1, seeds + 1):
            good = success(renderer, variant, level, number, training)
            more = {"variant": variant, "training": training, "world": lab(level)}
            out += both_sets(place, renderer, good, **more)
            if place != PLACE:
                out.append(row(place, renderer, good // 4, pose_set="outside", trials=16, **more))
    return out


def success(renderer, variant, level, number, training):
    """Splats lead the mesh with vertex colours, that leads the mesh in one colour; worse days and cells cost."""
    best = {"gs": 62, "gs_soft": 58, "mesh_vertex_shaded": 50, "mesh_shaded": 38}[renderer]
    return best - 5 * level - 2 * number - training + 2 * (variant == "default")


def test_leads_are_those_of_the_means_over_cells(scores):
    found = scores("worth", worth=worth_rows(success))
    every = list(itertools.product(range(3), (1, 2, 3)))
    for level in (1, 2):
        by_hand = [success("gs", "no_jitter", level, *one) - success("mesh_shaded", "no_jitter", level, *one) for one in every]
        score = found[f"worth_lead_one_colour_no_jitter_{level}"]
        assert score["value"] == pytest.approx(100 * np.mean(by_hand) / 64)
        assert score["met"]
        assert (score["seeds"], score["n"]) == (3, 2 * 9 * 64)
        assert score["interval"][0] < score["value"] < score["interval"][1]
    # The best mesh is the one with colours, at equal jitter.
    for name in ("jitter", "no_jitter"):
        score = found[f"worth_lead_best_mesh_{name}_3"]
        assert score["value"] == pytest.approx(100 * 12 / 64)
        assert set(score["beside"]) == {"success of splats", "success of the best mesh (mesh, vertex colours and shadows)"}
    assert found["worth_splats_jitter_4"]["value"] == pytest.approx(
        np.mean([100 * success("gs", "default", 4, *one) / 64 for one in every])
    )
    # Pick and place has no starts outside.
    beyond = [success("gs", "default", 2, *one) // 4 / 16 for one in every if one[0] < 2]
    assert found["worth_splats_jitter_outside_2"]["value"] == pytest.approx(100 * np.mean(beyond))
    assert found["graded_r_2"]["reason"] == "not measured"


def test_the_interval_of_a_lead_is_that_of_a_bootstrap_one_by_one_and_students_where_that_is_wider(scores):
    counts = {"gs": (60, 50, 40), "mesh_shaded": (30, 34, 10)}
    rows = worth_rows(lambda renderer, *_: counts[renderer][_[-1] - 1], renderers=tuple(counts), levels=(1,))
    low, high = scores("worth", worth=rows)["worth_lead_one_colour_no_jitter_1"]["interval"]
    rng = np.random.default_rng(3)
    starts = {name: np.array([np.r_[np.ones(k), np.zeros(64 - k)] for k in good]) for name, good in counts.items()}

    def means(name):
        # Trainings of each of three cells with replacement, then the single starts of each. [redraw, cell, training, start].
        trainings = rng.integers(3, size=(2000, 3, 3, 1))
        return starts[name][trainings, rng.integers(64, size=(2000, 3, 3, 64))].mean((1, 2, 3))

    leads = means("gs") - means("mesh_shaded")
    ours, theirs = (
        np.mean([redrawn_rates([(k, 64) for k in good], 3 * side + cell) for cell in range(3)], axis=0)
        for side, good in enumerate(counts.values())
    )
    np.testing.assert_allclose(limits(ours - theirs), np.quantile(leads, [0.025, 0.975]), atol=0.015)
    # Six cells, of which each has three trainings: their variances add up, by Welch with two degrees of freedom each.
    each = np.repeat([np.var(np.array(good) / 64, ddof=1) / 3 / 9 for good in counts.values()], 3)
    half = stats.t.ppf(0.975, each.sum() ** 2 / np.sum(each**2 / 2)) * np.sqrt(each.sum())
    lead = (np.mean(counts["gs"]) - np.mean(counts["mesh_shaded"])) / 64
    np.testing.assert_allclose((low, high), (100 * (lead - half), 100 * (lead + half)))


def test_a_smaller_study_says_what_it_rests_on(scores):
    smaller = worth_rows(success, seeds=1, levels=(2, 3), renderers=("gs", "mesh_shaded"), places=WORTH[:2])
    found = scores("worth", worth=smaller)
    score = found["worth_lead_one_colour_no_jitter_2"]
    assert score["value"] == pytest.approx(100 * 24 / 64)
    assert score["reason"] == "measured on 2 of 3 cells and 1 of 3 seeds only"
    assert found["worth_lead_one_colour_no_jitter_1"]["reason"] == "not measured"
    # The only mesh is the best one.
    assert "success of the best mesh (mesh, shadows)" in found["worth_lead_best_mesh_jitter_3"]["beside"]
    without = worth_rows(success, renderers=("gs", "gs_soft"))
    assert scores("worth", worth=without)["worth_lead_best_mesh_jitter_3"]["reason"] == "not measured"
    assert {score["reason"] for score in scores("worth").values()} == {"not measured"}


def test_a_lead_is_over_the_cells_that_both_sides_have(scores):
    rows = worth_rows(success)
    kept = [one for one in rows if (one["renderer"], one["object"]) != ("mesh_shaded", "bear")]
    score = scores("worth", worth=kept)["worth_lead_one_colour_no_jitter_1"]
    assert score["value"] == pytest.approx(100 * 24 / 64)
    assert set(score["by_scene"]) == {"grasp/small_cube+foam_pad", "pick_and_place/cake+plate"}
    assert score["reason"] == "measured on 2 of 3 cells only"


def graded_rows(pairs, level=2):
    """Rows of graded policies: successes of 64 in simulation and at a severity."""
    out = []
    for number, (sim, there) in enumerate(pairs):
        for good, world in ((sim, SIM), (there, lab(level))):
            out += both_sets(WORTH[0], "gs", good, variant=f"steps_{number}", world=world)
    return out


def violation(sim, real):
    """MMRV by loops."""
    worst = [0.0] * len(sim)
    for i, j in itertools.permutations(range(len(sim)), 2):
        if (sim[i] > sim[j]) != (real[i] > real[j]):
            worst[i] = max(worst[i], abs(real[i] - real[j]))
    return sum(worst) / len(sim)


def test_graded_policies_tell_what_simulation_foretells(scores):
    sim = [12, 16, 20, 26, 30, 36, 40, 44, 50, 54, 60, 64]
    real = [8, 14, 12, 22, 30, 28, 36, 40, 44, 52, 54, 61]
    found = scores("worth", graded=graded_rows(zip(sim, real, strict=True)))
    expected = stats.pearsonr(sim, real)
    assert found["graded_r_2"]["value"] == pytest.approx(expected.statistic)
    # Fisher's z by hand.
    z, half = np.arctanh(expected.statistic), 1.959964 / np.sqrt(len(sim) - 3)
    assert found["graded_r_2"]["interval"] == pytest.approx(np.tanh([z - half, z + half]), abs=1e-6)
    assert found["graded_r_2"]["met"]
    assert found["graded_mmrv_2"]["value"] == pytest.approx(violation(np.array(sim) / 64, np.array(real) / 64))
    assert found["graded_mmrv_2"]["met"] == (found["graded_mmrv_2"]["value"] <= 0.03)
    assert found["graded_spread"]["value"] == pytest.approx(100 * 52 / 64)
    assert found["graded_spread"]["interval"] == pytest.approx([100 * 12 / 64, 100])
    assert found["graded_r_3"]["reason"] == "not measured"


def test_a_correlation_without_spread_means_nothing(scores):
    sim = [52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 64]
    found = scores("worth", graded=graded_rows(zip(sim, sim, strict=True)))
    assert found["graded_r_2"]["value"] == pytest.approx(1)
    assert found["graded_r_2"]["reason"] == "measured on 19 of 70 points of spread only"
    few = scores("worth", graded=graded_rows([(8, 8), (40, 41), (64, 60)]))
    assert few["graded_mmrv_2"]["reason"] == "measured on 3 of 12 policies only"
    assert few["graded_r_2"]["interval"] is None
    # Where all succeed alike there is no correlation.
    alike = scores("worth", graded=graded_rows([(64, 64)] * 12))
    assert alike["graded_r_2"]["reason"] == "not measured"


def test_damaged_rows_are_refused(tmp_path):
    path = write(tmp_path / "rows.csv", worth_rows(success, seeds=1, levels=(2,)))
    path.write_text(path.read_text().replace(",fixed,32,", ",fixed,many,"))
    with pytest.raises(InputError, match="splats are worth are damaged"):
        write_worth_figures(tmp_path / "out.json", worth=path, preset="desktop")
    with pytest.raises(InputError, match="different severities are damaged"):
        write_severity_figures(tmp_path / "out.json", path, "desktop")
    assert not (tmp_path / "out.json").exists()


def test_floors_are_those_that_were_asked_for(floors):
    asked = {name: entry["floor"] for name, entry in read_floors(floors).items()}
    assert {name: floor for name, floor in asked.items() if floor is not None} == {
        "severity_grasp_2": 90, "severity_grasp_3": 75, "severity_place_2": 85,
        "worth_lead_one_colour_no_jitter_1": 30, "worth_lead_one_colour_no_jitter_2": 30,
        "graded_r_2": 0.9, "graded_mmrv_2": 0.03,
    }  # fmt: skip
