"""Closing the loop: one target makes all from the trials to the amended policy, and only the worlds' rules know the truth."""

import re

import pytest

CHAIN = {
    "describe_arm": 1,
    "log_trials": 2,
    "write_loop_case": 2,
    "calibrate_arm": 1,
    "read_gap_records": 2,
    "identify_gap": 2,
    "report_gap": 2,
    "amend_simulation": 1,
    "train_policy": 21,
    "try_policy_in_mirror": 24,
    "try_policy_in_sim": 6,
    "film_board_of_world": 1,
    "register_world": 1,
    "calibrate_wrist_camera_of_world": 1,
    "amend_arm_wrongly": 1,
    "collect_loop": 1,
}


@pytest.fixture(scope="module")
def plan(snakemake, tmp_path_factory):
    """Dry run of the table on an empty folder."""
    folder = tmp_path_factory.mktemp("loop")
    return snakemake("--dry-run", "--directory", str(folder), "--", "results/rows/loop.csv").stdout


def test_one_target_makes_the_whole_way(plan):
    counts = dict(re.findall(r"^(\w+) +(\d+)$", plan.split("Job stats:")[1].split("total")[0], re.MULTILINE))
    for rule, count in CHAIN.items():
        assert counts[rule] == str(count), rule


def test_the_amended_policy_waits_for_the_findings(plan):
    jobs = re.split(r"\n(?=Job \d+:)", plan)
    amended = [job for job in jobs if "Train the policy amended" in job]
    assert len(amended) == 3
    assert "results/loop/model.yaml" in amended[0]


def test_who_diagnoses_reads_no_truth(plan):
    jobs = re.split(r"\n(?=Job \d+:)", plan)
    told = [job for job in jobs if re.search(r"Calibrate the arm|Find what the model|Put what was found|Write the case", job)]
    assert len(told) == 6
    for job in told:
        assert "truth" not in job
        assert "hidden" not in job


def test_an_unknown_world_is_refused(snakemake, config, write_config, tmp_path):
    config["loop"]["changed"] = "mirror_lat"
    process = snakemake("--dry-run", "--directory", str(tmp_path), *write_config(config), check=False)
    assert process.returncode != 0
    assert "'mirror_lat' is not configured" in process.stdout + process.stderr
