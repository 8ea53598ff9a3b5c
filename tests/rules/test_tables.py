"""Which tables a configuration asks for."""

import pytest


@pytest.mark.parametrize(("preset", "tables"), [("toy", ["grasping"]), ("desktop", ["grasping", "pick_and_place"])])
def test_policies_of_the_preset_have_tables(snakemake, tmp_path, preset, tables):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--config", f"preset={preset}", "--", "results/tables").stdout
    for table in tables:
        assert f"Collect the successes: {table}" in plan
    for rule in ("collect_failures", "collect_training", "draw_learning_curves", "draw_success"):
        assert rule in plan


def test_without_cells_the_page_is_about_splats_alone(snakemake, config, write_config, tmp_path):
    config["cells"] = []
    plan = snakemake(*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), "--", "results/tables").stdout
    assert "assemble_tables" in plan
    for rule in ("collect_success", "collect_training", "draw_success"):
        assert rule not in plan


def test_pages_of_further_worlds_try_the_policies_that_are_meant(snakemake, tmp_path):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", "results/worlds.md", "results/picture_gap.md").stdout
    assert "in mirror_2: pick_and_place cake on plate, gs" in plan
    assert "in mirror_3: grasp bear on tablecloth, gs" in plan
    assert "in mirror_2: grasp bear on foam_pad, mesh" not in plan
    assert "Try the policy no_jitter in mirror_tint: grasp bear on foam_pad, gs" in plan
    assert "Try the policy no_jitter in mirror_moved: grasp bear on foam_pad, gs" in plan
    assert "Try the policy default in mirror: grasp bear on foam_pad, gs" in plan
    assert "Try the policy default in mirror: grasp banana" not in plan
