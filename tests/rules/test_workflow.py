"""The workflow as users see it: lint, dry runs, configuration."""

import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from gsbridge.digests import import_closure

ROOT = Path(__file__).resolve().parents[2]
RULE_FILES = sorted((ROOT / "rules").glob("*.smk"))

FURTHER_TRAININGS = {"train_comparison", "train_by_recipe"}
"""Rules that train splats as `train_splats` does, with other seeds or another budget."""


def rules() -> dict[str, str]:
    """Text of each rule."""
    found = {}
    for path in RULE_FILES:
        for text in re.split(r"^rule ", path.read_text(), flags=re.MULTILINE)[1:]:
            found[text.split(":")[0]] = text
    return found


def test_lint_is_clean(snakemake):
    snakemake("--lint")


def test_rule_files_are_formatted():
    subprocess.run([sys.executable, "-m", "snakefmt", "--check", "Snakefile", "rules"], cwd=ROOT, check=True)


WORKING_RULES = {name: text for name, text in rules().items() if "output:" in text}


@pytest.mark.parametrize("name", WORKING_RULES)
def test_each_rule_has_a_log_an_environment_and_a_script_of_its_name(name):
    text = WORKING_RULES[name]
    assert "log:" in text
    assert "conda:" in text
    assert "message:" in text
    if "shell:" not in text:
        script = re.search(r'"\.\./scripts/(\w+)\.py"', text)
        assert script, f"{name} has no script"
        assert (ROOT / "scripts" / f"{script.group(1)}.py").is_file()


@pytest.mark.parametrize("name", WORKING_RULES)
def test_a_rules_log_and_benchmark_carry_its_name_and_its_wildcards(name):
    text = WORKING_RULES[name]
    log = re.search(r'log:\n +f?"results/logs/(\w+)(.*)\.log"', text)
    benchmark = re.search(r'benchmark:\n +f?"results/benchmarks/(\w+)/(.+)\.jsonl"', text)
    assert log
    assert benchmark
    assert log[1] == benchmark[1] == name
    assert log[2].removeprefix("/") == benchmark[2].removesuffix("all")
    if "localrule: True" not in text:
        assert "resources:" in text
        assert {"mem_mb", "runtime"} <= set(re.findall(r"\w+(?==)", text.split("resources:")[1]))
    script = re.search(r'"\.\./scripts/(\w+)\.py"', text)
    # One script trains splats, for the scenes and for their comparison.
    assert script is None or script[1] == ("train_splats" if name == "train_comparison" else name)


def test_what_rules_look_up_is_short():
    """Decisions belong to gsbridge/experiment, where they are tested without snakemake."""
    files = sorted((ROOT / "rules").glob("common*.smk"))
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files) <= 400


def test_what_rules_look_up_names_its_arguments():
    """Snakemake hands input, output, threads and resources to a function that takes any keyword: they would be settings."""
    text = "".join(path.read_text(encoding="utf-8") for path in RULE_FILES)
    assert not re.findall(r"(?:def \w+\(|lambda )[^):]*\*\*", text)
    assert re.findall(r"def \w+\(wildcards\)", text)


def test_jobs_ask_for_what_they_use_wherever_the_run_was_started():
    """On a cluster, the cores of the submitting host mean nothing, and a job without a GPU in its request gets none."""
    assert not [name for name, text in rules().items() if "workflow.cores" in text]
    assert {name for name, text in rules().items() if "gpu=" in text} == {"train_splats", *FURTHER_TRAININGS, "train_policy"}


@pytest.mark.parametrize("preset", ["toy", "desktop", "paper"])
def test_every_preset_plans(snakemake, tmp_path, preset):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--config", f"preset={preset}", "--", "results/tables").stdout
    for rule in ("film_scene", "reconstruct_cameras", "align_scene", "segment_object", "mesh_object", "train_splats"):
        assert rule in plan
    begin, table = plan.split("Job stats:")
    assert "Jobs by stage:" in begin
    assert len(begin.splitlines()) < 25
    assert plan.rindex("Jobs by stage:") > plan.index("Reasons:")
    assert "Job stats:" not in table


def test_the_catalogs_snakefile_is_the_same_workflow(snakemake, tmp_path):
    """Planned beside one another: paths that depend on where the file lies would differ."""
    call = ["--dry-run", "--directory", str(tmp_path), "--config", "preset=toy", "--", "results/scenes/small_cube/sfm/sfm.json"]
    plans = [snakemake("--snakefile", str(ROOT / name), *call).stdout for name in ("Snakefile", "workflow/Snakefile")]
    jobs = [sorted(re.findall(r"^Job \d+: (.*)$", plan, re.MULTILINE)) for plan in plans]
    assert len(jobs[0]) > 5
    assert jobs[0] == jobs[1]


def test_stages_can_be_asked_for_alone(snakemake, tmp_path):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", "results/scenes/cake/sfm/sfm.json").stdout
    assert "reconstruct_cameras" in plan
    assert "align_scene" not in plan


@pytest.mark.parametrize(("preset", "scene"), [("toy", "small_cube"), ("desktop", "bear")])
def test_the_figure_of_edits_takes_the_presets_object(snakemake, tmp_path, preset, scene):
    target = "results/figures/gs_editing.png"
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--config", f"preset={preset}", "--", target).stdout
    for binding in ("soft", "games", "refined"):
        assert f"Train the {binding} splats of {scene}" in plan


def test_policies_know_the_mirror_by_its_films_and_the_registration_alone(snakemake, tmp_path):
    policy = "results/policies/pick_and_place/cake+plate/gs/default/seed1/policy.json"
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", policy).stdout
    stats = plan.split("Job stats:")[1].split("total")[0]
    planned = {line.split()[0] for line in stats.splitlines() if re.match(r"\w+ +\d+$", line)}
    assert "train_policy" in planned
    mentioning = {name for name in planned if re.search(r"reality|mirror", script_of(name))}
    scripts = {name: re.search(r'"\.\./scripts/(\w+)\.py"', rules()[name]) for name in planned}
    reaching = {
        name
        for name, script in scripts.items()
        if script and any(module.startswith("gsbridge.reality") for module in import_closure([f"scripts.{script[1]}"]))
    }
    assert mentioning == reaching == {"film_scene", "film_board"}


def script_of(rule):
    """Text of a rule's script."""
    name = re.search(r'"\.\./scripts/(\w+)\.py"', rules()[rule])
    return (ROOT / "scripts" / f"{name.group(1)}.py").read_text() if name else ""


def test_truth_is_read_by_scoring_rules_only():
    """Neither as an input nor as a parameter; that no stage opens it either is shown in tests/e2e, which hides it."""

    def without_outputs(text: str) -> str:
        return re.sub(r"    output:\n(?:        .*\n)+", "", text)

    readers = {name for name, text in rules().items() if re.search(r"results/truth|truth=", without_outputs(text))}
    assert readers == {"score_scene", "score_keyframes", "score_registration", "score_gap_cases"}


def misspell(config):
    config["spalts"] = {}
    return "spalts"


def wrong_type(config):
    config["seed"] = "one"
    return "seed"


def out_of_range(config):
    config["object_splats"] = {"steps": -5}
    return "steps"


def nested_misspelling(config):
    config["scenes"]["cake"]["bord"] = "a4"
    return "bord"


def name_with_space(config):
    config["scenes"]["my cake"] = config["scenes"]["cake"]
    return "my cake"


def name_with_slash(config):
    config["scenes"]["a/b"] = config["scenes"]["cake"]
    return "a/b"


def two_sources(config):
    config["scenes"]["cake"]["source"] = {"film": "cake", "video": "a.mp4"}
    return "source"


def unknown_film(config):
    config["scenes"]["cake"]["source"] = {"film": "bananna"}
    return "bananna"


def camera_without_board(config):
    config["cameras"]["mirror_phone"]["board"] = None
    return "board"


def points_without_an_image(config):
    config["scenes"]["cake"]["known_length"] = {"metres": 0.2, "between": [[412, 301, "a.png"], ["a.png", 1, 2]]}
    return "known_length"


def length_of_nothing(config):
    config["scenes"]["cake"]["known_length"] = {"metres": 0.2}
    return "between"


@pytest.mark.parametrize(
    "spoil",
    [
        misspell,
        wrong_type,
        out_of_range,
        nested_misspelling,
        name_with_space,
        name_with_slash,
        two_sources,
        unknown_film,
        camera_without_board,
        points_without_an_image,
        length_of_nothing,
    ],
)
def test_bad_configuration_stops_before_any_job_and_names_the_key(snakemake, config, write_config, tmp_path, spoil):
    key = spoil(config)
    process = snakemake(*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), check=False)
    assert process.returncode != 0
    assert key in process.stdout + process.stderr
    assert not (tmp_path / "run" / "results").exists()


@pytest.mark.parametrize(
    ("section", "key", "value", "named"),
    [
        ("scenes", "cake", {"camera": "none"}, "none"),
        ("presets", "desktop", {"scenes": ["cake", "cupcake"]}, "cupcake"),
        ("presets", "desktop", {"editing": {"scene": "teddy"}}, "teddy"),
        ("presets", "desktop", {"editing": {"scene": "foam_pad"}}, "foam_pad"),
    ],
)
def test_names_that_point_nowhere_are_refused(snakemake, config, write_config, tmp_path, section, key, value, named):
    config[section][key].update(value)
    process = snakemake(*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), check=False)
    assert process.returncode != 0
    assert named in process.stdout + process.stderr


def test_numbers_of_a_section_may_be_given_in_the_call(snakemake, tmp_path):
    """Snakemake reads them as text."""
    figure = ["--", "results/figures/gs_editing.png"]
    call = ["--dry-run", "--directory", str(tmp_path), "--config"]
    plan = snakemake(*call, "editing={scene: cake, azimuth_deg: 90}", *figure).stdout
    assert "Train the soft splats of cake" in plan
    process = snakemake(*call, "editing={scene: cake, azimuth_deg: left}", *figure, check=False)
    assert "config: editing.azimuth_deg: 'left' is no number. Direction from which" in process.stdout + process.stderr


def test_a_second_block_of_scenes_is_refused(snakemake, config, write_config, tmp_path):
    arguments = write_config(config)
    with (tmp_path / "config.yaml").open("a") as file:
        file.write("scenes:\n  mug: {kind: object, source: {video: mug.mp4}}\n")
    process = snakemake(*arguments, "--dry-run", "--directory", str(tmp_path / "run"), check=False)
    assert process.returncode != 0
    assert "the key 'scenes' stands twice" in process.stdout + process.stderr


def test_a_capture_that_is_gone_stops_stages_whose_inputs_are_there(snakemake, config, write_config, tmp_path):
    """Snakemake alone would go on with the frames of the capture before."""
    config["scenes"]["mug"] = {"kind": "object", "source": {"video": "mug.mp4"}}
    stage = tmp_path / "run" / "results" / "scenes" / "mug" / "capture"
    (stage / "frames").mkdir(parents=True)
    (stage / "keyframes.json").write_text("{}")
    target = "results/scenes/mug/sfm/sfm.json"
    process = snakemake(*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), "--", target, check=False)
    assert process.returncode != 0
    assert "config: scenes.mug.source.video: there is neither " in process.stdout + process.stderr


def test_refused_photos_leave_earlier_results_as_they_were(snakemake, config, write_config, tmp_path):
    photos, made = tmp_path / "photos", tmp_path / "run/results/scenes/mug/capture"
    photos.mkdir()
    rng = np.random.default_rng(0)
    for number in range(4):
        cv2.imwrite(str(photos / f"{number}.png"), rng.integers(0, 255, (64, 64, 3), np.uint8))
    config["scenes"]["mug"] = {"kind": "object", "source": {"images": str(photos)}}
    call = [*write_config(config), "--cores", "1", "--directory", str(tmp_path / "run"), "--"]
    call.append("results/scenes/mug/capture/keyframes.json")

    def files():
        found = [path for path in made.rglob("*.*") if not path.name.startswith(".")]
        return {path.relative_to(made): (path.read_bytes(), path.stat().st_mtime_ns) for path in found}

    sound = (photos / "2.png").read_bytes()
    (photos / "2.png").write_text("no image")
    first = snakemake(*call, check=False)
    assert "photos/2.png: this is not a readable image" in first.stdout + first.stderr
    assert "restore" not in first.stdout + first.stderr
    assert not made.exists() or files() == {}
    (photos / "2.png").write_bytes(sound)
    snakemake(*call)
    before = files()
    assert len(before) == 5
    # Left by a job that was killed.
    left = tmp_path / "run/.snakemake/backups/results/scenes/mug/capture/frames"
    left.mkdir(parents=True)
    (left / "0.png").touch()
    (photos / "2.png").write_text("no image")
    for _ in range(2):  # What was put back must not count as made from the photos that were refused.
        second = snakemake(*call, check=False)
        assert second.returncode != 0
        assert "photos/2.png: this is not a readable image" in second.stdout + second.stderr
        assert files() == before
    (photos / "2.png").write_bytes(sound)
    last = snakemake(*call)
    assert "Nothing to be done" in last.stdout + last.stderr
    assert files() == before


def test_a_damaged_board_capture_is_told_before_any_job(snakemake, config, write_config, tmp_path):
    (tmp_path / "board").mkdir()
    (tmp_path / "board/arm.csv").write_text("image,q1\n0.png,half\n")
    config["workspace"]["source"] = {"capture": str(tmp_path / "board")}
    config["workspace"]["background"] = None
    target = "results/workspace/registration.json"
    call = [*write_config(config), "--dry-run", "--directory", str(tmp_path / "run"), "--", target]
    process = snakemake(*call, check=False)
    assert process.returncode != 0
    said = process.stdout + process.stderr
    assert "line 2 holds no number where one is due" in said
    assert "Traceback" not in said


def test_missing_capture_is_named(snakemake, config, write_config, tmp_path):
    config["scenes"]["mug"] = {"kind": "object", "source": {"video": "mug.mp4"}}
    process = snakemake(
        *write_config(config),
        "--dry-run",
        "--directory",
        str(tmp_path / "run"),
        "--",
        "results/scenes/mug/sfm/sfm.json",
        check=False,
    )
    assert process.returncode != 0
    assert "mug.mp4" in process.stdout + process.stderr
