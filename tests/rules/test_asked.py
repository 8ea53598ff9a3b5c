"""Errors that the user can mend are told in one line before any job starts, without snakemake's traceback."""

import re

import pytest

MODEL = "urdf: axis.urdf\ncontroller: {mode: free}\n"


def last_words(process):
    """The one line that tells what is wrong, which must be the last of the error stream."""
    assert process.returncode == 1
    said = process.stdout + process.stderr
    assert not re.search(r'Traceback|^ +File "|Error in file|Exception', said, re.MULTILINE), said
    line = process.stderr.splitlines()[-1]
    assert line.startswith("ERROR ")
    return line


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        ("results/tabels", "ERROR results/tabels: no rule makes this. Did you mean 'results/tables'? "),
        ("results/scenes/mug/mesh.json", "no rule makes this. Did you mean 'results/scenes/mug/mesh/mesh.json'? "),
        (
            "mesh_object",
            "ERROR mesh_object: this rule makes a file for each scene, policy or case. Ask for one of them: results/scenes/",
        ),
        ("results/scenes/mugg/mesh/mesh.json", "'mugg' is no scene. Did you mean 'mug'? Scenes of the config: "),
    ],
)
def test_a_misspelt_target_is_told_in_one_line(snakemake, tmp_path, target, sentence):
    process = snakemake("--dry-run", "--directory", str(tmp_path), "--", target, check=False)
    assert sentence in last_words(process)


@pytest.mark.parametrize(("kind", "name"), [("video", "mug.mp4"), ("images", "photos")])
def test_a_missing_capture_is_told_in_one_line(snakemake, config, write_config, tmp_path, kind, name):
    """Whether it is asked for by the preset or by its file alone, which is found while snakemake plans."""
    config["scenes"]["own"] = {"kind": "object", "source": {kind: str(tmp_path / name)}}
    sentence = (
        f"ERROR config: scenes.own.source.{kind}: there is no {tmp_path / name}. Correct the path, or put the capture there"
    )
    for scenes, targets in ((["cake"], ["results/scenes/own/sfm/sfm.json"]), (["cake", "own"], ["all"])):
        config["presets"]["desktop"]["scenes"] = scenes
        call = [*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), "--", *targets]
        assert last_words(snakemake(*call, check=False)) == sentence


def test_a_damaged_list_of_photos_is_told_before_any_job(snakemake, config, write_config, tmp_path):
    """Without the advice to delete it, which is for what stages make."""
    path = tmp_path / "transforms.json"
    path.write_text('{"frames": [')
    config["scenes"]["own"] = {"kind": "object", "source": {"nerfstudio": str(path)}}
    call = [*write_config(config), "--dry-run", "--directory", str(tmp_path), "--", "results/scenes/own/sfm/sfm.json"]
    line = last_words(snakemake(*call, check=False))
    assert "transforms.json: this is not valid JSON" in line
    assert line.endswith(". Export it again from the program that made it, or name another file")


def test_a_real_run_leaves_no_lock_behind(snakemake, config, write_config, tmp_path):
    config["scenes"]["own"] = {"kind": "object", "source": {"video": "lost.mp4"}}
    folder = tmp_path / "run"
    call = [*write_config(config), "--cores", "1", "--directory", str(folder), "--", "results/scenes/own/sfm/sfm.json"]
    assert "lost.mp4" in last_words(snakemake(*call, check=False))
    assert not list((folder / ".snakemake/locks").iterdir())


def test_a_case_or_a_model_that_is_missing_is_told_in_one_line(snakemake, tmp_path):
    case = tmp_path / "axis" / "case.yaml"
    call = ["--dry-run", "--directory", str(tmp_path), "--config", f"gap_case={case}", "--", "gap"]
    assert last_words(snakemake(*call, check=False)).startswith(f"ERROR config: gap_case: there is no {case}. Correct the path")
    case.parent.mkdir()
    case.write_text("model: model.yaml\nrecords: {fit: a.csv, select: b.csv, verify: c.csv}\n")
    problem = f"the model is missing: there is no {case.parent / 'model.yaml'}"
    remedy = f"Correct the line `model:`, whose path starts from {case.parent}"
    assert last_words(snakemake(*call, check=False)) == f"ERROR {case}: {problem}. {remedy}"
    (case.parent / "model.yaml").mkdir()
    assert f"the model is a folder: {case.parent / 'model.yaml'}" in last_words(snakemake(*call, check=False))


def test_a_model_that_the_workflow_makes_first_is_not_missed(snakemake, tmp_path):
    """A case may diagnose the model that another case amends."""
    for name, model in (("first", "model.yaml"), ("second", "../results/gap/first/model.yaml")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "case.yaml").write_text(f"model: {model}\nrecords: {{fit: a.csv}}\n")
        (tmp_path / name / "a.csv").write_text("time [s],position.axis [rad]\n")
    (tmp_path / "first/model.yaml").write_text(MODEL)
    cases = f"gap={{cases: {{first: {tmp_path}/first/case.yaml, second: {tmp_path}/second/case.yaml}}}}"
    plan = snakemake(
        "--dry-run", "--directory", str(tmp_path), "--config", cases, "--", "results/gap/second/report.html"
    ).stdout
    assert "results/gap/first/model.yaml" in plan


def test_a_seal_that_is_no_number_is_told_in_one_line(snakemake, tmp_path):
    process = snakemake("--dry-run", "--directory", str(tmp_path), check=False, GSBRIDGE_SEAL="abc")
    assert last_words(process) == "ERROR GSBRIDGE_SEAL: 'abc' is no seal. Set it to a whole number, e.g. 4711"
