"""The study's table: seeds counted together, equal steps, intervals."""

import pytest
from policy_files import trial_rows, write_policy, write_trials
from scipy.stats import binomtest

from gsbridge.errors import InputError
from gsbridge.report.figures.study import write_study
from gsbridge.report.scores.measured_policies import study_figures
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import read_rows


def cell(variant):
    return CellPaths("grasp", "bear", "foam_pad", variant=variant)


def policies(folder, variant, successes, *, offset=0.0, evaluations=3, algo="sacwb"):
    """Trainings and trials of one variant: successes of 64 by seed."""
    trainings, trials = [], []
    for seed, good in enumerate(successes, start=1):
        more = {"algo": algo, "controller_offset": [0.0, offset, 0.0, 0.0], "controller_success": 0.34 if offset else 1.0}
        more |= {"cpu_seconds": {"update": 120.0, "environment": 60.0}}
        training, _ = write_policy(folder, cell(variant), [0.5] * evaluations, seed=seed, **more)
        trainings.append(training)
        split = {"fixed": min(good, 32), "unseen": max(good - 32, 0)}
        # Starts outside the training square are tried, too, and count in no row of the study.
        rows = [*trial_rows(split), *trial_rows({"outside": 0}, count=16)]
        trials.append(write_trials(folder, cell(variant), "sim", rows, seed=seed))
    return trainings, trials


def test_seeds_are_counted_together(tmp_path):
    first, second = policies(tmp_path, "sacwb", [64, 60, 32]), policies(tmp_path, "biased_bc", [20, 22, 24], offset=0.03)
    rows, page = tmp_path / "study.csv", tmp_path / "study.md"
    write_study(first[0] + second[0], first[1] + second[1], rows, page)
    sacwb, biased = read_rows(rows)
    assert (sacwb["variant"], sacwb["seeds"], sacwb["trials"], sacwb["successes"]) == ("sacwb", "3", "192", "156")
    # Trainings of 64, 60 and 32 of 64 say little of a fourth: the interval is far wider than that of as many trials of one.
    interval = binomtest(156, 192).proportion_ci(method="wilson")
    low, high = float(sacwb["ci95_low"]), float(sacwb["ci95_high"])
    assert low < 0.6 < interval.low
    assert high > 0.95 > interval.high
    assert (float(sacwb["seed_low"]), float(sacwb["seed_high"])) == (0.5, 1.0)
    assert (biased["teacher"], biased["controller_success_rate"], biased["cpu_min"]) == (
        "y 30 mm",
        "0.3400",
        "3.0000",
    )
    assert "156/192" in page.read_text()


def test_unequal_steps_are_no_comparison(tmp_path):
    first, second = policies(tmp_path, "sacwb", [64]), policies(tmp_path, "bc", [64], evaluations=5)
    with pytest.raises(InputError, match="stop_after"):
        write_study(first[0] + second[0], first[1] + second[1], tmp_path / "study.csv", tmp_path / "study.md")
    assert not (tmp_path / "study.csv").exists()


BIASED = {"biased": 0.03, "other": 0.015}


def rows_of(tmp_path, **successes):
    """Rows of a study: successes of 64 by variant and seed; `BIASED` ones learned from a controller that is off."""
    found = [
        policies(tmp_path, name, good, offset=BIASED.get(name.split("_")[0], 0.0), algo=name.split("_")[-1])
        for name, good in successes.items()
    ]
    trainings, trials = ([path for paths in parts for path in paths] for parts in zip(*found, strict=True))
    write_study(trainings, trials, tmp_path / "study.csv", tmp_path / "study.md")
    return read_rows(tmp_path / "study.csv")


def test_leads_are_over_the_controller_and_over_the_better_imitation(tmp_path):
    ways = {"sacwb": [64, 64, 64], "bc": [64, 64, 64], "dagger": [64, 60, 62], "sac": [1, 2, 3]}
    biased = {"biased_sacwb": [48, 48, 48], "biased_bc": [32, 32, 32], "biased_dagger": [40, 40, 40]}
    found = study_figures(rows_of(tmp_path, **ways, **biased))
    # The controllers of these files succeed in 100 and 34 %.
    assert found["study_lead_min"]["value"] == pytest.approx(0.0)
    assert found["study_lead_min"]["interval"] == pytest.approx([0.0, 75 - 34])
    assert found["study_imitation_good"]["value"] == pytest.approx(0.0)
    assert found["study_imitation_biased"]["value"] == pytest.approx(75 - 62.5)
    assert {figure["seeds"] for figure in found.values()} == {3}
    page = (tmp_path / "study.md").read_text()
    assert "With the right teacher, SACwB **is not told apart from**" in page
    assert "With 1 wrong teachers, SACwB **beats**" in page


def test_every_wrong_teacher_counts(tmp_path):
    ways = {"biased_sacwb": [48] * 3, "biased_bc": [32] * 3, "biased_dagger": [40] * 3}
    ways |= {"other_sacwb": [16] * 3, "other_bc": [60] * 3, "other_dagger": [64] * 3}
    found = study_figures(rows_of(tmp_path, **ways))
    assert found["study_imitation_biased"]["value"] == pytest.approx(100 * ((48 - 40) + (16 - 64)) / 2 / 64)
    page = (tmp_path / "study.md").read_text()
    assert "SACwB **loses to** the better of behaviour cloning and DAgger: −31.2 points" in page
    assert "ahead with 1 of 2" in page


def test_half_a_study_has_no_lead(tmp_path):
    found = study_figures(rows_of(tmp_path, sacwb=[64], bc=[64]))
    assert found == {}
