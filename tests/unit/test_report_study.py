"""The study's table: seeds counted together, equal steps, intervals."""

import numpy as np
import pytest
from policy_files import trial_rows, write_policy, write_trials
from scipy.stats import binomtest

from gsbridge.errors import InputError
from gsbridge.report.places import Cell
from gsbridge.report.rows import read_rows
from gsbridge.report.study import write_study


def cell(variant):
    return Cell("grasp", "bear", "foam_pad", variant=variant)


def policies(folder, variant, successes, *, offset=0.0, evaluations=3):
    """Trainings and trials of one variant: successes of 64 by seed."""
    trainings, trials = [], []
    for seed, good in enumerate(successes, start=1):
        more = {"controller_offset": [offset, 0.0], "controller_success": 0.34 if offset else 1.0}
        more |= {"cpu_seconds": {"update": 120.0, "environment": 60.0}}
        training, _ = write_policy(folder, cell(variant), [0.5] * evaluations, seed=seed, **more)
        trainings.append(training)
        split = {"fixed": min(good, 32), "unseen": max(good - 32, 0)}
        trials.append(write_trials(folder, cell(variant), "sim", trial_rows(split), seed=seed))
    return trainings, trials


def test_seeds_are_counted_together(tmp_path):
    first, second = policies(tmp_path, "sacwb", [64, 60, 32]), policies(tmp_path, "biased_bc", [20, 22, 24], offset=0.03)
    rows, page = tmp_path / "study.csv", tmp_path / "study.md"
    write_study(first[0] + second[0], first[1] + second[1], rows, page)
    sacwb, biased = read_rows(rows)
    assert (sacwb["variant"], sacwb["seeds"], sacwb["trials"], sacwb["successes"]) == ("sacwb", "3", "192", "156")
    interval = binomtest(156, 192).proportion_ci(method="wilson")
    np.testing.assert_allclose([float(sacwb["ci95_low"]), float(sacwb["ci95_high"])], [interval.low, interval.high], atol=1e-4)
    assert (float(sacwb["seed_low"]), float(sacwb["seed_high"])) == (0.5, 1.0)
    assert (biased["controller_offset_mm"], biased["controller_success_rate"], biased["cpu_min"]) == (
        "30.0000",
        "0.3400",
        "3.0000",
    )
    assert "156/192" in page.read_text()


def test_unequal_steps_are_no_comparison(tmp_path):
    first, second = policies(tmp_path, "sacwb", [64]), policies(tmp_path, "bc", [64], evaluations=5)
    with pytest.raises(InputError, match="stop_after"):
        write_study(first[0] + second[0], first[1] + second[1], tmp_path / "study.csv", tmp_path / "study.md")
    assert not (tmp_path / "study.csv").exists()
