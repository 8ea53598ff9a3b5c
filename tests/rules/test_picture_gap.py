"""The gap of pictures: one target makes everything from the photos to the policies that learn with the amended camera."""

import re

import pytest

CHAIN = {
    "draw_postures": 1,
    "photograph_postures": 4,
    "diagnose_photos": 4,
    "report_photos": 4,
    "amend_camera": 2,
    "train_policy": 27,
    "film_board_of_world": 2,
    "register_world": 2,
    "calibrate_wrist_camera_of_world": 2,
    "amend_camera_wrongly": 2,
    "collect_picture_loop": 1,
}


@pytest.fixture(scope="module")
def plan(snakemake, tmp_path_factory):
    """Dry run of the table on an empty folder."""
    folder = tmp_path_factory.mktemp("picture_gap")
    return snakemake("--dry-run", "--directory", str(folder), "--", "results/rows/picture_loop.csv").stdout


def test_one_target_makes_the_whole_way(plan):
    counts = dict(re.findall(r"^(\w+) +(\d+)$", plan.split("Job stats:")[1].split("total")[0], re.MULTILINE))
    for rule, count in CHAIN.items():
        assert counts[rule] == str(count), rule


def test_policies_that_learn_anew_wait_for_the_findings(plan):
    jobs = re.split(r"\n(?=Job \d+:)", plan)
    for variant, world in (("sees_tint", "mirror_tint"), ("sees_turned", "mirror_turned")):
        training = [job for job in jobs if f"Train the policy {variant} " in job]
        assert len(training) == 3
        assert f"results/picture_gap/{world}/model.yaml" in training[0]


def test_who_diagnoses_reads_photos_and_no_truth(plan):
    jobs = re.split(r"\n(?=Job \d+:)", plan)
    told = [job for job in jobs if re.search(r"Find what changed|Put what changed|Choose the postures", job)]
    assert len(told) == 7
    for job in told:
        assert "truth" not in job
        assert "hidden" not in job


def test_a_model_of_another_world_is_refused(snakemake, config, write_config, tmp_path):
    config["variants"]["sees_tint"]["model"] = "results/picture_gap/mirror_moved/model.yaml"
    process = snakemake("--dry-run", "--directory", str(tmp_path), *write_config(config), check=False)
    assert process.returncode != 0
    assert "it is not what photos of mirror_tint amend" in process.stdout + process.stderr
