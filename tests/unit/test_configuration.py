"""Settings that the schema accepts, but that would fail hours later, are refused at once."""

import copy
from pathlib import Path

import pytest
import yaml

from gsbridge.configuration.checks import check_asked, check_capture, check_configuration
from gsbridge.configuration.files import check_files
from gsbridge.configuration.whole import read_configuration
from gsbridge.errors import InputError

ROOT = Path(__file__).resolve().parents[2]

SCENE = {
    "kind": "object",
    "source": {"film": "cake"},
    "camera": "phone",
    "board": "a4",
    "require_scale": True,
    "known_length": None,
}
CONFIG = {
    "preset": "toy",
    "presets": {"toy": {"scenes": ["cake"]}},
    "cameras": {"phone": {"calibrate_from": ["cake"], "board": "a4"}},
    "scenes": {"cake": SCENE},
    "masks": {"backend": "grabcut", "sam2_weights": None},
    "object_splats": {"lpips_weights": None},
    "background_splats": {"lpips_weights": None},
}
FOAM_PAD = {**SCENE, "kind": "background", "source": {"film": "foam_pad"}}
BETWEEN = [["0001.png", 10, 20], ["0001.png", 30, 40]]


def test_a_consistent_configuration_passes():
    check_configuration(CONFIG)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("preset",), "big", "big"),
        (("presets", "toy", "scenes"), ["mug"], "mug"),
        (
            ("presets", "toy", "scenes"),
            ["cakes"],
            r"toy\.scenes: 'cakes' is not configured\. Did you mean 'cake'\? Use one of: cake$",
        ),
        (("scenes", "cake", "camera"), "tablet", "tablet"),
        (("scenes", "m" + "ab" * 30), SCENE, r"scenes\.mabab.*: the name has 61 letters, and 60 are the most"),
        (("scenes", "x" * 20), SCENE, "the name ends in twenty times the same letters. Rename it"),
        (("cameras", "phone", "calibrate_from"), ["mug"], "mug"),
        (("scenes", "cake", "board"), None, "require_scale"),
        (("scenes", "cake", "board"), "letter", "letter"),
        (("scenes", "cake", "known_length"), {"metres": 0.2}, "between"),
        (("scenes", "cake", "known_length"), {"metres": 0.2, "object": "longest", "between": BETWEEN}, "once"),
        (("scenes", "foam_pad"), {**FOAM_PAD, "known_length": {"metres": 0.2, "object": "longest"}}, "background"),
        (("scenes", "mug"), SCENE, "scenes.mug.source.film: the film 'cake'"),
        (("masks", "backend"), "sam2", "masks.sam2_weights"),
        (("masks",), {"backend": "sam2", "sam2_weights": "nowhere"}, "nowhere"),
        (("presets", "toy", "masks"), {"backend": "sam2"}, "masks.sam2_weights"),
        (("background_splats", "lpips_weights"), "nowhere.pth", "background_splats.lpips_weights: the file nowhere.pth"),
    ],
)
def test_a_setting_that_cannot_work_is_named(path, value, named):
    config = copy.deepcopy(CONFIG)
    target = config
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = value
    with pytest.raises(InputError, match=named):
        check_configuration(config)


@pytest.mark.parametrize("length", [{"metres": 0.2, "object": "longest"}, {"metres": 0.2, "between": BETWEEN}])
def test_a_complete_known_length_passes(length):
    check_configuration({**CONFIG, "scenes": {"cake": {**SCENE, "known_length": length}}})


def test_weights_that_are_there_pass(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "lpips.pth").touch()
    check_configuration(
        {
            **CONFIG,
            "masks": {"backend": "sam2", "sam2_weights": str(tmp_path)},
            "object_splats": {"lpips_weights": str(tmp_path / "lpips.pth")},
        }
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenes:\n  cake: {}\nseed: 1\nscenes:\n  mug: {}\n", ["'scenes'", "lines 1 and 4"]),
        ("scenes:\n  mug: {kind: object,\n    kind: background}\n", ["'scenes.mug.kind'", "lines 2 and 3"]),
    ],
)
def test_a_key_that_stands_twice_is_named(tmp_path, text, words):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        check_files([path])
    for word in ["config.yaml", *words]:
        assert word in str(caught.value)


def test_configurations_without_duplicates_pass(tmp_path):
    (tmp_path / "config.json").write_text('{\n\t"seed": 1\n}')
    (tmp_path / "empty.yaml").touch()
    check_files([ROOT / "config.yaml", tmp_path / "config.json", tmp_path / "empty.yaml"])


def test_broken_yaml_is_told_with_its_line(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("seed: 1\nscenes:\n  mug: {kind: object\nboard: a4\n")
    with pytest.raises(InputError, match=r"config\.yaml: line 4, column \d+"):
        check_files([path])


def test_a_file_in_another_code_than_utf8_is_told_to_be_saved_anew(tmp_path):
    path = tmp_path / "config.yaml"
    text = "seed: 1  # f\u00fcr\n"
    for code in ("utf-16", "utf-16-le", "utf-16-be", "latin-1"):
        path.write_bytes(text.encode(code))
        with pytest.raises(InputError, match=r"config\.yaml: .* it is not stored as UTF-8\. Save it as UTF-8; in Notepad: "):
            check_files([path])
    for code in ("utf-8", "utf-8-sig"):
        path.write_bytes(text.encode(code))
        check_files([path])


def test_a_character_that_yaml_forbids_is_told_in_one_line(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("seed: 1\a\n")
    with pytest.raises(InputError, match=r"config\.yaml: .*control characters are not allowed") as caught:
        check_files([path])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("scenes", "cake", "bord"), "a4", "scenes.cake: 'bord' is no key. Did you mean 'board'"),
        (("scenes", "cake", "board"), "A4", "scenes.cake.board: 'A4' is not possible. Did you mean 'a4'"),
        (("scenes", "cake", "known_length"), {"meters": 0.2}, "known_length: 'meters' is no key. Did you mean 'metres'"),
        (("scenes", "cake", "known_length"), 0.2, "known_length: 0.2 is no block of keys"),
        (("scenes", "cake", "source"), {"film": "cake", "video": "a.mp4"}, "source: exactly one of these is wanted"),
        (("scenes", "cake", "source"), {}, "and none given. Keep one of: video"),
        (("scenes", "cake", "source"), {"film": "bananna"}, "source.film: 'bananna' is not possible. Did you mean 'banana'"),
        (("scenes", "my cake"), {"kind": "object"}, "scenes.my cake: the name becomes a folder"),
        (
            ("scenes", "cake"),
            {"kind": "object"},
            "scenes.cake: the key 'source' is missing. Add it: Where the photos",
        ),
        (("seed",), "one", "seed: 'one' is no integer. The one random seed"),
        (("seed",), "1e3", "seed: '1e3' is no integer. Write it out: 1000. The one random seed"),
        (("seed",), "1e400", "seed: '1e400' is no integer. The one random seed"),
        (("seed",), 5e9, "seed: 5000000000 is greater than the maximum of 4294967295. The one random seed"),
        (("recipe",), {"max_splats": "1e6"}, "recipe.max_splats: '1e6' is no integer. Write it out: 1000000. Upper limit"),
        (("capture",), {"min_step": float("nan")}, "capture.min_step: nan is no number. Least image motion"),
        (("capture",), {"min_step": 1.5}, "capture.min_step: 1.5 is greater than the maximum of 1. Least image motion"),
        (
            ("scenes", True),
            {"kind": "object", "source": {"film": "cake"}},
            "config: scenes: YAML reads yes, on or true without quotes as a switch",
        ),
        (
            ("scenes", False),
            {"kind": "object", "source": {"film": "cake"}},
            "YAML reads no, off or false without quotes as a switch, and text is wanted. Put it",
        ),
        (
            ("scenes", None),
            {"kind": "object", "source": {"film": "cake"}},
            "config: scenes: YAML reads null or ~ without quotes as nothing",
        ),
        (
            ("scenes", 1),
            {"kind": "object", "source": {"film": "cake"}},
            "config: scenes: a name here is 1, which is no text. Choose a name that begins with",
        ),
        (("presets", "toy", "scenes"), [True], "presets.toy.scenes.0: YAML reads yes, on or true without quotes as a switch"),
        (("seed",), -1, "seed: -1 is less than the minimum of 0"),
        (("mesh",), {"min_agree": 0}, "mesh.min_agree: 0 is less than the minimum of 1"),
        (("spalts",), {}, "config: 'spalts' is no key"),
    ],
)
def test_faults_of_the_schema_take_one_line(path, value, said):
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    block = config
    for key in path[:-1]:
        block = block[key]
    block[path[-1]] = value
    with pytest.raises(InputError) as raised:
        read_configuration(config)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_the_projects_own_configuration_fits_its_schema():
    read_configuration(yaml.safe_load((ROOT / "config.yaml").read_text()))


def test_captures_are_looked_for_before_anything_runs(tmp_path):
    (tmp_path / "mug").mkdir()
    (tmp_path / "mug.mp4").write_bytes(b"x")
    check_capture("mug", {"video": "mug.mp4"}, [tmp_path / "none" / "mug.mp4", tmp_path / "mug.mp4"])
    check_capture("mug", {"images": "mug"}, [tmp_path / "mug"])
    places = [tmp_path / "a" / "cup.mp4", tmp_path / "b" / "cup.mp4"]
    with pytest.raises(InputError, match=r"mug\.source\.video: there is neither .*a/cup.mp4 nor .*b/cup.mp4"):
        check_capture("mug", {"video": "cup.mp4"}, places)
    with pytest.raises(InputError, match=r"is a folder, a file is wanted. .*images:"):
        check_capture("mug", {"video": "mug"}, [tmp_path / "mug"])
    with pytest.raises(InputError, match=r"is a file, a folder is wanted. .*video:"):
        check_capture("mug", {"images": "mug.mp4"}, [tmp_path / "mug.mp4"])


def test_the_mirrors_camera_is_no_camera_of_real_captures():
    config = copy.deepcopy(CONFIG)
    config["scenes"]["mug"] = {**SCENE, "source": {"video": "mug.mp4"}}
    with pytest.raises(InputError, match=r"scenes\.mug\.camera: 'phone' is the mirror's virtual camera"):
        check_configuration(config)
    config["scenes"]["mug"]["camera"] = None
    check_configuration(config)
    config["scenes"]["mug"]["camera"] = "mine"
    config["cameras"]["mine"] = {"calibrate_from": ["mug"], "board": "a4"}
    check_configuration(config)
    config["scenes"]["cake"]["camera"] = "mine"
    with pytest.raises(InputError, match="'mine' is a real camera, which cannot have taken a film of the mirror"):
        check_configuration(config)


@pytest.mark.parametrize("source", [{"colmap": "mug"}, {"nerfstudio": "mug/transforms.json"}])
def test_photos_with_cameras_of_their_own_take_no_shared_one(source):
    mug = {**SCENE, "source": source, "camera": "mine"}
    config = {**CONFIG, "scenes": {**CONFIG["scenes"], "mug": mug}}
    config["cameras"] = {**CONFIG["cameras"], "mine": {"calibrate_from": ["mug"], "board": "a4"}}
    with pytest.raises(InputError, match=r"scenes\.mug\.camera: the photos come with cameras of their own"):
        check_configuration(config)
    mug["camera"] = None
    check_configuration(config)


def test_the_table_under_the_board_must_be_the_one_that_the_arm_sees():
    """Colours of another table would be taken for the camera's."""
    mine = {"foam_pad": FOAM_PAD, "desk": {**FOAM_PAD, "source": {"video": "desk.mp4"}, "camera": None}}
    config = {**CONFIG, "scenes": {**CONFIG["scenes"], **mine}}
    capture = {"source": {"capture": "board"}}
    for workspace in ({}, {"background": "foam_pad"}, {**capture, "background": "desk"}, {**capture, "background": None}):
        check_configuration({**config, "workspace": workspace})
    check_configuration({**config, "workspace": {"source": {"typed": {}}, "background": "foam_pad"}})
    for workspace, said in (
        ({"background": "cake"}, "workspace.background: 'cake'"),
        ({"background": "mug"}, "Use one of: desk, foam_pad"),
        ({**capture, "background": "foam_pad"}, "your arm cannot see the mirror's table"),
        ({"background": "desk"}, "the mirror's arm cannot see a table of yours"),
    ):
        with pytest.raises(InputError, match=said):
            check_configuration({**config, "workspace": workspace})
    loose = {**config["scenes"], "desk": {**mine["desk"], "require_scale": False}}
    with pytest.raises(InputError, match=r"scenes\.desk\.require_scale"):
        check_configuration({**config, "scenes": loose, "workspace": {**capture, "background": "desk"}})


@pytest.mark.parametrize("scene", ["foam_pad", "mug"])
def test_the_light_is_shown_by_an_object(scene):
    scenes = {**CONFIG["scenes"], "foam_pad": FOAM_PAD}
    check_configuration({**CONFIG, "scenes": scenes, "workspace": {"light": "cake"}})
    with pytest.raises(InputError, match=r"workspace\.light.*cake"):
        check_configuration({**CONFIG, "scenes": scenes, "workspace": {"light": scene}})


def test_a_target_of_an_unknown_scene_is_refused():
    check_asked(["-n", "results/scenes/cake/sfm/sfm.json", "results/tables"], ["cake"])
    with pytest.raises(InputError, match=r"results/scenes/cakes/sfm/sfm.json: 'cakes' is no scene. Did you mean 'cake'"):
        check_asked(["results/scenes/cakes/sfm/sfm.json"], ["cake", "bear"])
