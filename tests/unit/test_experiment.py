"""Scenes, policies, trials and loops of an experiment, and where their results lie."""

import base64
import json
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from gsbridge.errors import InputError
from gsbridge.experiment.given_files import GivenFiles
from gsbridge.experiment.loops import JointLoop, PictureLoop, closed_loops
from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import ANY, PolicyFiles, policy_files, training_memory, training_minutes
from gsbridge.experiment.result_dates import restore_dates
from gsbridge.experiment.tables import Tables


def scene(kind, source, **more):
    return {"kind": kind, "source": source, "example": False, "require_scale": True, "density": 500, **more}


CUBE = {"task": "grasp", "object": "cube", "background": "pad", "renderer": "gs", "robot_trials": None}


@pytest.fixture
def config():
    return {
        "seed": 3,
        "preset": "small",
        "captures": "captures",
        "scenes": {
            "cube": scene("object", {"film": "cube"}),
            "pad": scene("background", {"film": "pad"}),
            "mug": scene("object", {"video": "mug.mp4"}, example=True),
            "desk": scene("background", {"images": "desk"}, require_scale=False),
        },
        "cells": [
            CUBE,
            {**CUBE, "renderer": "mesh"},
            {**CUBE, "object": "mug", "background": "desk", "robot_trials": "mug.csv"},
        ],
        "presets": {"small": {"scenes": ["cube", "pad", "mug", "desk"], "trials": {"policies": 2}}},
        "trials": {"policies": 5, "worlds": ["mirror", "mirror_2"]},
        "comparison": {"seeds": 2, "hull": True},
        "editing": {"scene": None},
        "variants": {
            "default": {"model": None, "policy": {}},
            "after": {"model": "results/loop/model.yaml", "policy": {}},
            "other": {"model": "x.yaml", "policy": {"steps": 1}},
        },
        "loop": {
            "cell": CUBE,
            "reference": "mirror",
            "changed": "mirror_heavy",
            "variant": "after",
            "controls": [],
            "trainings": 1,
        },
        "study": {
            "cell": CUBE,
            "seeds": 2,
            "variants": ["default", "other"],
            "worlds": ["mirror_2"],
            "picture_gap": {
                "variants": ["other", "default"],
                "worlds": [],
                "reference": "mirror",
                "amended": {"mirror_dark": ["after"]},
                "controls": {},
                "trainings": 1,
                "repeats": 4,
                "postures": 10,
            },
        },
    }


@pytest.fixture
def plan(config, tmp_path, monkeypatch):
    monkeypatch.delenv("GSBRIDGE_CAPTURES", raising=False)
    (tmp_path / "captures/desk").mkdir(parents=True)
    (tmp_path / "captures/desk/1.jpg").write_bytes(b"123")
    return Experiment(config, tmp_path, tmp_path)


def test_paths_of_a_policy_name_all_that_it_is():
    policy = PolicyFiles("pick_and_place", "cake", "plate", "mesh", "other")
    assert policy.file(2, "policy.json") == "results/policies/pick_and_place/cake+plate/mesh/other/seed2/policy.json"
    assert policy.trials("sim", 2, "csv") == "results/trials/pick_and_place/cake+plate/mesh/other/sim/seed2.csv"
    assert policy.item == "pick_and_place-cake+plate-mesh-other"
    assert policy.title == "Pick and place: cake on plate, mesh (RL-sim)"
    assert policy_files([policy], [1, 2], "a") == [policy.file(1, "a"), policy.file(2, "a")]


def test_any_policys_paths_become_each_ones():
    policy = PolicyFiles("grasp", "cube", "pad", "gs", "default")
    wildcards = {"task": "grasp", "object": "cube", "background": "pad", "renderer": "gs", "variant": "default"}
    assert ANY.file("{seed}", "a.json").format(**wildcards, seed=7) == policy.file(7, "a.json")
    assert ANY.trials("{world}", "{seed}", "csv").format(**wildcards, seed=7, world="sim") == policy.trials("sim", 7, "csv")


def test_real_things_are_scored_where_their_captures_are(config, tmp_path, monkeypatch):
    """Films have a truth, and are scored elsewhere."""
    monkeypatch.delenv("GSBRIDGE_CAPTURES", raising=False)
    plan = Experiment({**config, "photos": ["cube", "mug"]}, tmp_path, tmp_path)
    assert plan.photos == []
    (tmp_path / "captures").mkdir()
    (tmp_path / "captures/mug.mp4").touch()
    plan = Experiment({**config, "photos": ["cube", "mug"]}, tmp_path, tmp_path)
    assert plan.photos == ["mug"]
    files = plan.photo_files("mug")
    for binding in ("soft", "games", "games_vertices"):
        trained = [
            f"results/scenes/mug/{place}/splats.json" for place in (f"splats/{binding}", f"comparison/visual-{binding}-seed4")
        ]
        assert plan.photo_records("mug")[binding] == trained
        assert set(trained) < set(files)
    assert {"results/scenes/mug/recipe/soft/splats.json", "results/scenes/mug/mesh/collision.ply"} < set(files)
    assert {f"results/scenes/mug/turned/{degrees}.json" for degrees in (0, 90, 180, 270)} < set(files)


def test_photos_are_turned_where_nothing_but_photos_and_pixels_is_given(config, tmp_path):
    plain = {"kind": "object", "source": {"images": "mug"}}
    bound = [{"camera": "phone"}, {"up": "left"}, {"metres_per_unit": 0.001}, {"masks": {"points": [["a.png", 1, 2, "keep"]]}}]
    bound += [{"known_length": {"metres": 0.2, "object": "longest"}}, {"source": {"colmap": "mug"}}]
    pixels = {"known_length": {"metres": 0.2, "between": [["a.png", 1, 2], ["a.png", 3, 4]]}}
    for change, turns in [({}, True), (pixels, True), *((item, False) for item in bound)]:
        plan = Experiment({**config, "scenes": {**config["scenes"], "mug": {**plain, **change}}}, tmp_path, tmp_path)
        assert plan.may_turn("mug") is turns, change
        assert len(plan.photo_records("mug")["turned"]) == 4 * turns


def test_shapes_are_scored_with_their_longest_sides_and_trials_on_vessels(config, tmp_path):
    films = {name: {"kind": "object", "source": {"film": name}} for name in ("mug", "statue")}
    take = {"kind": "object", "source": {"film": "mug"}, "take": "turned"}
    scenes = {**config["scenes"], **films, "mug_turned": take}
    settings = {"scenes": scenes, "shapes": ["mug", "statue", "mug_turned"], "workspace": {"background": "pad"}}
    plan = Experiment({**config, **settings, "vessels": ["mug"]}, tmp_path, tmp_path)
    assert set(plan.longest_sides) == {"mug", "statue", "cube"}
    assert plan.longest_sides["mug"]["length"] == "results/scenes/mug/align/length.json"
    paths = {"trials": "results/trials/grasp/mug+pad/mirror.json", "asset": "results/scenes/mug/asset/asset.json"}
    assert plan.vessel_trials("mirror") == {"mug+pad": paths}


def test_examples_that_are_not_here_are_left_out(plan):
    assert plan.scenes == ["cube", "pad", "desk"]
    assert plan.left_out == ["mug"]
    assert plan.scenes_of("object") == ["cube"]
    assert plan.scenes_from("real") == ["desk"]
    assert plan.labels["pad"] == {"kind": "background", "origin": "mirror"}
    assert plan.bundled == ["cube", "pad"]
    assert plan.preset_pairs == ["cube+pad"]
    assert plan.edited == "cube"
    assert plan.settings("trials") == {"policies": 2, "worlds": ["mirror", "mirror_2"]}


def test_every_stage_of_a_scene_is_recorded(plan):
    recorded = plan.stage_recordings
    assert "results/rerun/capture/desk.rrd" in recorded
    assert "results/rerun/splats/pad-refined.rrd" in recorded
    assert [name for name in recorded if "/masks/" in name] == ["results/rerun/masks/cube.rrd"]
    assert [name for name in recorded if "/asset/" in name] == ["results/rerun/asset/cube.rrd", "results/rerun/asset/pad.rrd"]
    assert not any("mug" in name for name in recorded)


def test_light_is_measured_where_object_and_table_are_of_one_world(plan, config):
    config["workspace"] = {"light": "cube", "background": "pad"}
    assert plan.workspace_light["masks"] == "results/scenes/cube/masks/images"
    assert plan.workspace_light["background"] == "results/scenes/pad/asset/asset.json"
    for light, background in (("cube", "desk"), ("mug", "pad"), (None, "pad"), ("cube", None)):
        config["workspace"] = {"light": light, "background": background}
        assert plan.workspace_light == {}


def test_jobs_read_the_models_of_the_project_that_variants_name(plan, config):
    assert plan.project_files == {"benchmarks/floors.yaml", "benchmarks/photos.json", "models/nominal.yaml", "x.yaml"}
    config["variants"]["other"]["model"] = "/elsewhere/x.yaml"
    assert "x.yaml" in plan.project_files, "it is looked up once"
    assert Experiment(config, plan.root, plan.working).project_files == {
        "benchmarks/floors.yaml",
        "benchmarks/photos.json",
        "models/nominal.yaml",
    }


def test_trials_start_where_the_arm_is_believed_to_stand(plan, config):
    unmoved = {"registered_in": None, "calibrated_in": None}
    config["variants"] = {"default": unmoved, "after": {**unmoved, "registered_in": "late"}}
    config["worlds"] = {"late": {"severity": 0}, "lab": {"severity": {"look": 0, "physics": 2}}}
    config["workspace"] = {"source": {"mirror": {}}}
    assert plan.trial_registration("late", "default") == "results/workspace/registration.json"
    assert plan.trial_registration("late", "after") == "results/workspace/worlds/late/registration.json"
    assert plan.trial_registration("lab", "after") == "results/workspace/worlds/lab/registration.json"
    config["workspace"] = {"source": {"capture": "board"}}
    assert plan.trial_registration("lab", "default") == "results/workspace/registration.json"


def test_a_training_asks_for_memory_as_its_replay_grows():
    small = {"replay_capacity": 10_000, "image_size": 64, "environments": 1, "steps": 3000}
    assert training_memory(small) == round(2350 + 10_000 * 64 * 64 * 3 / 1e6)
    assert training_memory({**small, "environments": 3}) == training_memory(small) + 800
    assert training_minutes(small) == 60
    assert training_minutes({**small, "steps": 12_000}) == 120


def test_captures_are_named_as_they_may_be_moved(plan, tmp_path):
    assert plan.scene_source("cube") == "results/films/cube/film.json"
    assert plan.scene_source("desk") == "captures/desk"
    (listed,) = GivenFiles(plan).scene("desk")
    assert listed[0] == "1.jpg"
    assert GivenFiles(plan).scene("cube") == []
    below = Experiment(plan.config, tmp_path, tmp_path / "toy")
    assert below.capture_path("desk") == "../captures/desk"
    assert below.portable("/elsewhere/a.csv") == "/elsewhere/a.csv"


def test_a_video_s_contents_count_and_not_its_date(plan, tmp_path):
    video = tmp_path / "mug.mp4"
    video.write_text("first take")
    first = GivenFiles(plan).scene("mug")
    video.write_text("the second take, which was filmed before")
    os.utime(video, (1e9, 1e9))
    assert [[name for name, _ in listing] for listing in (first, GivenFiles(plan).scene("mug"))] == [["mug.mp4"]] * 2
    assert GivenFiles(plan).scene("mug") != first


def test_the_board_s_photos_and_poses_count_unless_a_rule_makes_them(plan, config, tmp_path):
    config["workspace"] = {"source": {"mirror": {}}}
    assert GivenFiles(plan).board == []
    config["workspace"] = {"source": {"capture": "board"}}
    (tmp_path / "board").mkdir()
    (tmp_path / "board/arm.csv").write_text("0.jpg")
    assert [name for name, _ in GivenFiles(plan).board] == ["arm.csv"]


def test_results_are_no_files_of_the_user(plan, tmp_path):
    (tmp_path / "results/loop").mkdir(parents=True)
    for name in ("results/loop/model.yaml", "own.yaml"):
        (tmp_path / name).write_text(name)
    assert [name for name, _ in GivenFiles(plan).files(["own.yaml", "results/loop/model.yaml", "gone.yaml"], ".", "x")] == [
        "own.yaml"
    ]


def test_a_capture_that_is_gone_is_named(plan):
    with pytest.raises(InputError, match=r"scenes\.mug\.source\.video: there is neither .*mug\.mp4 nor "):
        plan.scene_source("mug")


@pytest.mark.parametrize("path", ["~nosuch/x.mp4", "loop", "x" * 5000, "a/" * 2500])
def test_a_path_that_cannot_be_followed_is_told_with_its_scene(config, tmp_path, path):
    (tmp_path / "loop").symlink_to("loop")
    config["scenes"]["mug"]["source"] = {"video": path}
    plan = Experiment(config, tmp_path, tmp_path)
    with pytest.raises(InputError, match=r"^config: scenes\.mug\.source\.video: ") as caught:
        plan.scene_source("mug")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
    if path != "loop":
        with pytest.raises(InputError, match="leads nowhere"):
            assert plan.scenes


@pytest.mark.parametrize("path", ["a {x}.mp4", "a{.mp4", "{b}/a.mp4"])
def test_a_path_with_braces_is_refused(config, tmp_path, path):
    (tmp_path / path).parent.mkdir(exist_ok=True)
    (tmp_path / path).write_bytes(b"x")
    config["scenes"]["mug"]["source"] = {"video": path}
    with pytest.raises(InputError, match=r"^config: scenes\.mug\.source\.video: the path .* holds braces.* Rename it"):
        Experiment(config, tmp_path, tmp_path).scene_source("mug")


def test_a_folder_of_board_photos_that_is_gone_is_named(plan):
    with pytest.raises(InputError, match=r"workspace\.source\.capture: there is neither .*board nor .*arm\.csv"):
        plan.board_folder("board")


def test_comparison_is_of_all_scenes_and_the_hulls_of_filmed_objects(plan):
    seeds = ["visual-games-seed4", "visual-soft-seed4", "visual-games_vertices-seed4"]
    assert plan.comparison_runs("desk") == plan.comparison_runs("pad") == seeds
    assert plan.comparison_runs("cube")[3:] == [f"hull-{way}-seed{seed}" for seed in (3, 4) for way in ("games", "soft")]
    assert len(plan.splat_records) == 3 * 5 + 3 * 3 + 4


def test_controllers_are_tried_once_for_an_object_and_in_mirrors_where_it_was_filmed(plan):
    assert plan.controller_trials("sim") == ["results/trials/grasp/cube+pad/sim.json", "results/trials/grasp/mug+desk/sim.json"]
    assert plan.controller_trials("mirror") == ["results/trials/grasp/cube+pad/mirror.json"]


def test_tables_show_the_policies_of_the_scenes_that_run(plan):
    tables = Tables(plan)
    splats, mesh = tables.policies
    assert (splats.renderer, mesh.renderer) == ("gs", "mesh")
    assert tables.seeds == [3, 4]
    assert tables.shown("grasping") == [splats]
    assert tables.shown("renderer_contrast") == [splats, mesh]
    assert tables.successes == ["grasping", "renderer_contrast"]
    assert tables.world_variants == ["worlds"]
    assert tables.shown_worlds("worlds") == ["sim", "mirror_2"]
    assert len(tables.table_trials("grasping", "csv")) == 3 * 2
    assert [(trial.world, trial.seed) for trial in tables.pictured(splats)] == [
        ("sim", 3),
        ("mirror", 3),
        ("sim", 4),
        ("mirror", 4),
    ]
    assert "results/scenes/cube/masks/masks.json" in tables.table_scenes("grasping")
    assert "results/scenes/pad/masks/masks.json" not in tables.table_scenes("grasping")
    assert tables.study_files("csv", trials=True)[-1] == "results/trials/grasp/cube+pad/gs/other/sim/seed4.csv"


def test_trials_on_a_robot_stand_in_tables_of_successes_alone(plan, tmp_path):
    for name in ("mug.mp4", "mug.csv"):
        (tmp_path / "captures" / name).touch()
    tables = Tables(plan)
    assert tables.table_robot_trials("grasping") == {"grasp/mug+desk/gs/default": "captures/mug.csv"}
    assert tables.table_robot_trials("worlds") == {}
    # The mirrors lack what they did not film.
    mug = [path for path in tables.table_trials("grasping", "csv") if "mug" in path]
    assert [path.split("/")[-2] for path in mug] == ["sim", "sim"]


def test_loops_compare_what_differs_in_the_model_alone(plan):
    joints, pictures = JointLoop(plan), PictureLoop(plan)
    assert joints.model("loop_changed") == "results/loop/arm/calibrated.yaml"
    assert joints.case("loop_reference")["calibration"] == []
    assert len(joints.case_files("loop_changed")) == 5
    assert joints.trainings[1] == "results/policies/grasp/cube+pad/gs/after/seed3/training.json"
    assert pictures.worlds == ["mirror", "mirror_dark"]
    assert (pictures.shots("mirror"), pictures.shots("mirror_dark")) == (6, 1)
    assert (pictures.first_shot("mirror"), pictures.first_shot("mirror_dark")) == (0, 60)
    assert len(pictures.tables) == len(pictures.rows) == 2 * 3 + 2
    assert closed_loops(joints, pictures) == [
        {"table": "loop", "reference": "mirror", "world": "mirror_heavy", "before": "default", "after": "after"},
        {"table": "picture_loop", "reference": "mirror", "world": "mirror_dark", "before": "default", "after": "after"},
    ]


def test_controls_are_tried_in_the_changed_world_and_trained_as_often(config, tmp_path):
    config["loop"] |= {"controls": ["other"], "trainings": 3}
    config["study"]["picture_gap"] |= {"controls": {"mirror_dark": ["other"]}, "trainings": 2}
    plan = Experiment(config, tmp_path, tmp_path)
    joints, pictures = JointLoop(plan), PictureLoop(plan)
    assert joints.rows[-1] == {"variant": "other", "world": "mirror_heavy"}
    assert joints.tables[-3:] == [f"results/trials/grasp/cube+pad/gs/other/mirror_heavy/seed{k}.csv" for k in (3, 4, 5)]
    assert len(joints.trainings) == 9
    assert joints.comparisons == [{"world": "mirror_heavy", "variant": "after", "controls": ["other"]}]
    # It stands in the table already.
    assert len(pictures.rows) == 8
    assert len(pictures.tables) == 16
    assert pictures.comparisons == [{"world": "mirror_dark", "variant": "after", "controls": ["other"]}]


def write_record(working: Path, name: str, end: float, inputs: Sequence[str] = ()) -> None:
    """A record as snakemake keeps it, its name split where it is long."""
    folder = working / ".snakemake/metadata"
    parts = [part.decode() for part in [base64.urlsafe_b64encode(name.encode())]]
    if len(parts[0]) > 40:
        parts = ["@" + parts[0][:40], parts[0][40:]]
    folder.joinpath(*parts[:-1]).mkdir(parents=True, exist_ok=True)
    folder.joinpath(*parts).write_text(json.dumps({"endtime": end, "input": [*inputs]}))


def test_copied_folders_get_back_their_dates(tmp_path):
    working, end = tmp_path / "run", 1.6e9 + 0.25
    for name in ("results/short", "results/a_folder/with_a_name/that_is_long"):
        (working / name).mkdir(parents=True)
        (working / name / ".snakemake_timestamp").touch()
        os.utime(working / name / ".snakemake_timestamp", (end, end))
        write_record(working, name, end)
    (working / "results/file.json").touch()
    write_record(working, "results/file.json", end)
    assert restore_dates(working) == []
    copy = Path(shutil.copytree(working, tmp_path / "copy", copy_function=shutil.copy))
    stamp = copy / "results/short/.snakemake_timestamp"
    assert stamp.stat().st_mtime > end
    assert restore_dates(copy) == ["results/a_folder/with_a_name/that_is_long", "results/short"]
    assert stamp.stat().st_mtime == pytest.approx(end, abs=1e-3)
    # A file's content decides, and snakemake compares it.
    assert (copy / "results/file.json").stat().st_mtime > end
    assert restore_dates(copy) == []
    # One from an archive that rounds dates down would seem older than the folder that it was made from.
    os.utime(copy / "results/file.json", (end - 1, end - 1))
    assert restore_dates(copy) == ["results/file.json"]
    assert (copy / "results/file.json").stat().st_mtime == pytest.approx(end, abs=1e-3)


def test_no_result_is_dated_later_than_now(tmp_path):
    """A clock that was ahead: of a day from now are a file whose record is of today, and another with its record."""
    now = time.time()
    for name, end in (("results/a.json", now - 50), ("results/b.json", now + 86400)):
        (tmp_path / "results").mkdir(exist_ok=True)
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (now + 86400, now + 86400))
        write_record(tmp_path, name, end)
    assert restore_dates(tmp_path) == ["results/a.json", "results/b.json"]
    dates = [(tmp_path / name).stat().st_mtime for name in ("results/a.json", "results/b.json")]
    assert all(now - 1e-3 <= date <= time.time() for date in dates)
    assert restore_dates(tmp_path) == []


@pytest.mark.parametrize("folder", [False, True])
@pytest.mark.parametrize(("content", "given", "kept"), [("one", "old", True), ("two", "old", False), ("one", "new", False)])
def test_what_a_job_made_again_as_it_was_keeps_its_date(tmp_path, folder, content, given, kept):
    """Unless what it was made from is younger: snakemake would make it again at every call."""
    first, second = 1.6e9, 1.6e9 + 500

    def make(text: str, end: float) -> Path:
        name = "results/made" if folder else "results/made.json"
        path = tmp_path / name / "part" if folder else tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        dated = path.parent / ".snakemake_timestamp" if folder else path
        dated.touch()
        os.utime(dated, (end, end))
        write_record(tmp_path, name, end, ["given.txt"])
        return dated

    (tmp_path / "given.txt").touch()
    os.utime(tmp_path / "given.txt", (first - 50, first - 50))
    make("one", first)
    assert restore_dates(tmp_path) == []
    if given == "new":
        os.utime(tmp_path / "given.txt", (second - 50, second - 50))
    dated = make(content, second)
    assert len(restore_dates(tmp_path)) == kept
    assert dated.stat().st_mtime == pytest.approx(first if kept else second)
    assert restore_dates(tmp_path) == []


def test_without_records_nothing_is_dated(tmp_path):
    assert restore_dates(tmp_path) == []
