"""The table of splats against meshes: rows, means, leads and their intervals against made-up input; graded policies."""

from pathlib import Path

import numpy as np
import pytest
from policy_files import trial_rows
from scipy import stats

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.report.figures.worth import write_graded_figure, write_worth_figure
from gsbridge.report.tables.rows import read_rows, write_rows
from gsbridge.report.tables.severity_rows import COLUMNS, doubts, tallies_of, write_severity_rows
from gsbridge.report.tables.statistics import lead_interval, mean_interval, mean_rate
from gsbridge.report.tables.success_rows import TRIAL_COLUMNS
from gsbridge.report.tables.worth import write_graded_page, write_worth_page
from gsbridge.statistics import limits, redrawn_rates, wilson_interval

ROOT = Path(__file__).resolve().parents[2]
PLACE = {"task": "grasp", "object": "small_cube", "background": "foam_pad"}


def row(renderer, training, good, world="lab_3", level=3, **more):
    return {
        **PLACE, "renderer": renderer, "variant": "no_jitter", "training": training, "world": world, "look": level,
        "physics": level, "pose_set": "fixed", "trials": 32, "successes": good, "status": "pass", "reasons": "", **more,
    }  # fmt: skip


def rows_file(tmp_path, rows):
    write_rows(tmp_path / "rows.csv", COLUMNS, rows)
    return tmp_path / "rows.csv"


def test_rows_hold_every_set_of_every_trial_file(tmp_path):
    table = tmp_path / "trials/grasp/small_cube+foam_pad/gs/no_jitter/lab_2/seed3.csv"
    table.parent.mkdir(parents=True)
    write_rows(table, TRIAL_COLUMNS, trial_rows({"fixed": 12, "unseen": 20}, forgiven=3))
    write_json(table.with_suffix(".json"), {"status": "degraded", "reasons": ["policy: young; it learned a day"]})
    write_severity_rows(tmp_path / "rows.csv", [table], {"lab_2": (2, 1)})
    fixed, unseen = read_rows(tmp_path / "rows.csv", COLUMNS)
    # Excess contact is forgiven, three times in each set.
    assert (fixed["pose_set"], fixed["trials"], fixed["successes"]) == ("fixed", "32", "15")
    assert (unseen["pose_set"], unseen["successes"], unseen["look"], unseen["physics"]) == ("unseen", "23", "2", "1")
    assert (fixed["training"], fixed["status"]) == ("3", "degraded")
    # A reason with a semicolon stays one reason.
    assert [line for line in doubts([fixed, unseen]) if "young" in line] == [
        "- trials: policy: young; it learned a day (1 policy)"
    ]
    documented = (ROOT / "docs/mirror.md").read_text().split("### What is it worth?")[1]
    assert all(f"`{name}`" in documented for name in COLUMNS)
    with pytest.raises(InputError, match=r"study.severity.worlds"):
        write_severity_rows(tmp_path / "rows.csv", [table], {})


def test_cells_count_the_same_and_sets_inside_count_together():
    rows = [
        row("gs", "1", "32"), row("gs", "1", "0", pose_set="unseen"), row("gs", "1", "8", pose_set="outside"),
        row("gs", "1", "32", object="bear", trials=64),
    ]  # fmt: skip
    rows = [{name: str(value) for name, value in one.items()} for one in rows]
    cells = tallies_of(rows)["gs", "no_jitter", "lab_3"]
    assert mean_rate(cells.values()) == pytest.approx((32 / 64 + 32 / 64) / 2)
    assert mean_rate(tallies_of(rows, ("outside",))["gs", "no_jitter", "lab_3"].values()) == 0.25


def test_intervals_know_of_trainings():
    alike, apart = [[(16, 32)] * 3], [[(0, 32), (16, 32), (32, 32)]]
    low, high = mean_interval(apart)
    assert high - low > 2 * np.diff(mean_interval(alike))[0]
    # Against draws one by one: trainings with replacement, then the single starts of each.
    rng, means = np.random.default_rng(5), []
    starts = [np.r_[np.ones(good), np.zeros(tried - good)] for good, tried in apart[0]]
    for _ in range(4000):
        chosen = rng.integers(3, size=3)
        means.append(np.mean([rng.choice(starts[k], len(starts[k])).mean() for k in chosen]))
    np.testing.assert_allclose(limits(redrawn_rates(apart[0])), np.quantile(means, [0.025, 0.975]), atol=0.02)
    assert (low, high) == (0.0, 1.0)  # three trainings that differ so much tell next to nothing
    # Nothing scatters where all succeed, but an interval of no width would be a lie.
    assert mean_interval([[(32, 32)] * 3])[0] < 0.97
    assert mean_interval([[(32, 32)] * 3] * 2)[0] < 0.99
    low, high = lead_interval([[(30, 32)] * 3], alike)
    assert low < 14 / 32 < high
    assert low > 0.2
    # Trainings that differ: Welch's interval, as scipy has it.
    good = (30, 20, 25), (12, 4, 20)
    welch = stats.ttest_ind(*(np.array(side) / 32 for side in good), equal_var=False).confidence_interval()
    ours, others = ([(k, 32) for k in side] for side in good)
    np.testing.assert_allclose(lead_interval([ours], [others]), (welch.low, welch.high))
    assert lead_interval([[(1, 32), (30, 32)]], [[(0, 32), (31, 32)]]) == (-1.0, 1.0)
    student = stats.ttest_1samp(np.array(good[1]) / 32, 0.0).confidence_interval()
    np.testing.assert_allclose(mean_interval([others]), (max(0.0, student.low), student.high))


def test_an_interval_does_not_narrow_where_a_trial_is_lost():
    whole, lost = [[(32, 32)]] * 8, [[(31, 32)], *[[(32, 32)]] * 7]
    assert mean_interval(lost)[0] < mean_interval(whole)[0] < 1.0
    np.testing.assert_allclose(mean_interval(whole)[0], wilson_interval(256, 256)[0])
    # Nothing to redraw on either side is no proof that both are equal.
    low, high = lead_interval([[(64, 64)] * 3] * 3, [[(64, 64)] * 3] * 3)
    assert low < -0.005
    assert high > 0.005


@pytest.mark.parametrize(("mean", "spread", "least"), [(0.5, 0.2, 0.92), (0.8, 0.1, 0.92), (0.8, 0.2, 0.85)])
def test_intervals_of_three_trainings_hold_what_they_promise(mean, spread, least):
    """And more than a bootstrap of three trainings; near 100 % rates that differ much still hide how much."""
    rng = np.random.default_rng(6)
    concentration = mean * (1 - mean) / spread**2 - 1
    held = leads = redrawn = 0
    for _ in range(120):
        rates = rng.beta(mean * concentration, (1 - mean) * concentration, (2, 3))
        ours, others = ([(int(good), 64) for good in rng.binomial(64, row)] for row in rates)
        low, high = mean_interval([ours])
        held += low <= mean <= high
        low, high = limits(redrawn_rates(ours))
        redrawn += low <= mean <= high
        low, high = lead_interval([ours], [others])
        leads += low <= 0.0 <= high
    assert held >= least * 120
    assert leads >= 0.92 * 120
    assert redrawn < held - 6


@pytest.mark.parametrize("rate", [0.9, 0.98])
def test_intervals_of_cells_near_the_ceiling_hold_what_they_promise(rate):
    rng = np.random.default_rng(7)
    limits_of = [mean_interval([[(int(good), 32)] for good in rng.binomial(32, rate, 8)]) for _ in range(120)]
    assert sum(low <= rate <= high for low, high in limits_of) >= 111


@pytest.mark.parametrize(("mesh", "words"), [(4, "**holds**"), (31, "**does not hold**"), (27, "**is not decided**")])
def test_the_page_says_whether_the_papers_claim_holds(tmp_path, mesh, words):
    rows = [row("gs", k, 31) for k in (1, 2, 3)] + [row("mesh_shaded", k, mesh) for k in (1, 2, 3)]
    rows += [row("mesh_vertex_shaded", k, 2) for k in (1, 2, 3)]
    rows += [row("gs", 1, 20, pose_set="outside"), row("gs", 1, 30, world="lab_1", level=1)]
    path = rows_file(tmp_path, rows)
    write_worth_page(path, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert words in page.split("###")[0]
    assert "| trained on | colours | lab_1, severity 1 | lab_3, severity 3 |" in page
    assert "97 % (" in page
    assert "outside the training square" in page
    write_worth_figure(path, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("splats", "mesh", "words"),
    [
        (30, 10, "lead of +62 points (95 % interval: "),
        (31, 24, "it is too kind (30 points are asked for)"),
        (12, 8, "the splats are too poor for it (30 points are asked for)"),
    ],
)
def test_the_page_says_whether_the_mirror_tells_splats_from_a_mesh_and_if_not_what_is_to_blame(tmp_path, splats, mesh, words):
    rows = [row(name, k, good, "lab_2", 2) for k in (1, 2, 3) for name, good in (("gs", splats), ("mesh_shaded", mesh))]
    write_worth_page(rows_file(tmp_path, rows), tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert words in page
    assert ("**tells** them apart" in page) == (splats - mesh >= 0.3 * 32)
    assert "Nothing was tried at severity 3" in page
    assert "severity 1:" not in page
    assert "Rests on 1 cell, 3 trainings of each policy, and 32 starts of each training" in page


def test_a_smaller_study_is_a_page_too(tmp_path):
    """One training of splats alone in one world: no lead, and it says on how little it rests."""
    path = rows_file(tmp_path, [row("gs", 1, 30)])
    write_worth_page(path, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert "1 training of each policy" in page
    assert "say nothing of other trainings" in page
    assert "the paper's claim is not judged here" in page
    write_worth_figure(path, tmp_path / "figure.png")


def test_graded_policies_tell_how_well_simulation_foretells(tmp_path):
    sim, real = (4, 12, 20, 32), (2, 14, 10, 31)
    rows = []
    for k, (here, there) in enumerate(zip(sim, real, strict=True)):
        rows.append(row("gs", 1, here, world="sim", level="", variant=f"steps_{k}"))
        rows.append(row("gs", 1, there, world="lab_2", level=2, variant=f"steps_{k}"))
    path = rows_file(tmp_path, rows)
    write_graded_page(path, tmp_path / "page.md")
    r = np.corrcoef(sim, real)[0, 1]
    # Two neighbours are ranked the other way round by 4 of 32; the others are where they belong.
    page = (tmp_path / "page.md").read_text()
    assert f"| lab_2, severity 2 | 4 | 12 to 100 % | 6 to 97 % | {r:.3f} | {2 * 4 / 32 / 4:.3f} |" in page
    write_graded_figure(path, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 3000
    with pytest.raises(InputError, match="simulation"):
        write_graded_page(rows_file(tmp_path, rows[1::2]), tmp_path / "page.md")
