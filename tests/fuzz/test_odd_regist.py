"""Files of a user with an arm that are well formed but say something impossible."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera, View, read_views, write_views
from gsbridge.configuration.whole import Configuration, read_configuration
from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.reading import load_yaml, refusing
from gsbridge.registration.capture import read_board_capture
from gsbridge.registration.result import read_registration

CAMERA = Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
POSE = "x,y,z,qw,qx,qy,qz"


def board_capture(folder: Path) -> Path:
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), np.zeros((8, 8, 3), np.uint8))
    return folder


@pytest.mark.parametrize(
    ("table", "said"),
    {
        "surplus cell": ("image,q1,q2\na.png,0,0\nb.png,0,0,0\n", "line 3 has 4 cells"),
        "missing cell": ("image,q1,q2\na.png,0\n", "line 2 holds no number"),
        "decimal commas": ("image,q1,q2\na.png,0,5,1,5\n", "commas between the cells, points in the numbers"),
        "quoted decimal commas": ('image,q1,q2\na.png,"0,5","1,5"\n', "line 2 holds no number"),
        "semicolons": ("image;q1;q2\na.png;0;0\n", "with commas between them"),
        "an empty line before": ("image,q1\na.png,0\n\nb.png,left\n", "line 4 holds no number"),
        "one photo twice": ("image,q1\na.png,0\na.png,0.1\n", "named twice"),
        "one column twice": ("image,q1,q1\na.png,0,0\n", "its columns are"),
        "a pose's column twice": (f"image,{POSE},x\na.png,0,0,0,1,0,0,0,0\n", "its columns are"),
        "other digits": ("image,q\u00b2\na.png,0\n", "its columns are"),
        "NaN": ("image,q1\na.png,nan\n", "not finite"),
        "endless": ("image,q1\na.png,-inf\n", "not finite"),
        "millimetres": (f"image,{POSE}\na.png,0,0,650,1,0,0,0\n", "millimetres"),
        "no turn": (f"image,{POSE}\na.png,0,0,0,0,0,0,0\n", "the quaternion of line 2"),
        "no turn but in one": (f"image,{POSE}\na.png,0,0,nan,1,0,0,0\nb.png,0,0,0,1,1,0,0\n", "the quaternion of line 3"),
        "turn of NaN": (f"image,{POSE}\na.png,0,0,0,nan,0,0,0\n", "the quaternion of line 2"),
        "an open quote": ('image,q1\n"a.png,0\n', "no table with commas"),
        "nothing": ("", "its columns are missing"),
    }.values(),
)  # fmt: skip
def test_odd_tables_of_an_arm_are_refused(tmp_path, table, said):
    (board_capture(tmp_path) / "arm.csv").write_text(table)
    with pytest.raises(InputError, match=said):
        read_board_capture(tmp_path)


@pytest.mark.parametrize("table", [b"image,q1\nb\xe4r.png,0\n", b"image,q1\na.png,\x00\n"])
def test_tables_of_an_arm_that_are_no_text_are_refused(tmp_path, table):
    (board_capture(tmp_path) / "arm.csv").write_bytes(table)
    with pytest.raises(InputError, match=r"arm\.csv"):
        read_board_capture(tmp_path)


def test_a_table_that_a_spreadsheet_wrote_is_read(tmp_path):
    (board_capture(tmp_path) / "arm.csv").write_bytes(b'\xef\xbb\xbfimage, q1\r\n"a.png", 0.5\r\n\r\nb.png,1e-1\r\n,\r\n')
    np.testing.assert_array_equal(read_board_capture(tmp_path).joints, [[0.5], [0.1]])


@pytest.mark.parametrize(
    "table",
    [
        "image,q1,q2,,\na.png,0.5,0.2,,\nb.png,0.1,0.3,,\n",
        "image,q1,q2\na.png,0.5,0.2,\nb.png,0.1,0.3,\n",
        "image,q1,q2,note,note\na.png,0.5,0.2\nb.png,0.1,0.3,good,\n",
    ],
    ids=["empty columns", "commas at the ends of lines", "notes that are left out"],
)
def test_cells_that_nothing_needs_may_be_empty_or_missing(tmp_path, table):
    (board_capture(tmp_path) / "arm.csv").write_text(table)
    np.testing.assert_array_equal(read_board_capture(tmp_path).joints, [[0.5, 0.2], [0.1, 0.3]])


SKEWED, MIRRORED, FAR = np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), np.eye(4)
SKEWED[0, 1], FAR[:3, 3] = 0.1, 300.0
ODD_POSES = {
    "skewed": SKEWED.tolist(),
    "mirrored": MIRRORED.tolist(),
    "millimetres": FAR.tolist(),
    "in a row": np.eye(4).ravel().tolist(),
    "3x3": np.eye(3).tolist(),
    "zero": np.zeros((4, 4)).tolist(),
    "NaN": [[float("nan")] * 4] * 4,
    "ragged": [[1.0], [2.0, 3.0]],
    "text": "abc",
    "nothing": None,
    "a block": {"x": 1},
    "huge": [[10**400] * 4] * 4,
    "true": True,
}


@pytest.mark.parametrize("name", ODD_POSES)
def test_odd_poses_are_refused(tmp_path, name):
    (board_capture(tmp_path) / "arm.json").write_text(
        json.dumps({"poses": [{"image": "a.png", "base_from_flange": ODD_POSES[name]}]})
    )
    with pytest.raises(InputError):
        read_board_capture(tmp_path)
    for key in ("base_from_table", "flange_from_camera"):
        sound = {"base_from_table": np.eye(4).tolist(), "flange_from_camera": np.eye(4).tolist(), "reasons": []}
        (tmp_path / "registration.json").write_text(json.dumps({**sound, key: ODD_POSES[name]}))
        with pytest.raises(InputError):
            read_registration(tmp_path / "registration.json")


@pytest.mark.parametrize(
    "poses",
    [
        [{"image": "a.png", "joints": 0.1}], [{"image": "a.png", "joints": []}], [{"image": "a.png", "joints": [[0.1, 0.2]]}],
        [{"image": "a.png", "joints": ["left"]}], [{"image": "a.png", "joints": [float("inf")]}],
        [{"image": "a.png", "joints": [0.1]}, {"image": "b.png", "joints": [0.1, 0.2]}], [{"image": "a.png"}],
        [{"image": "a.png", "joints": [10**400]}], [], {}, {"image": "a.png"}, "ab", [1], None, 5,
    ],
)  # fmt: skip
def test_odd_lists_of_an_arm_are_refused(tmp_path, poses):
    (board_capture(tmp_path) / "arm.json").write_text(json.dumps({"poses": poses}))
    with pytest.raises(InputError):
        read_board_capture(tmp_path)


ODD_CAMERAS = [
    {"width": 0}, {"width": -640}, {"width": True}, {"width": float("inf")}, {"width": 10**9}, {"width": "wide"},
    {"fx": -600.0}, {"fy": float("nan")}, {"fx": 0}, {"fx": 1e9}, {"fy": 10**400}, {"cx": 1e5}, {"cy": float("nan")},
    {"distortion": [1e6, 0, 0, 0]}, {"distortion": [0, 0, 0, float("nan")]}, {"distortion": [0, 0]}, {"distortion": None},
]  # fmt: skip


@pytest.mark.parametrize("odd", ODD_CAMERAS)
def test_odd_cameras_are_refused(tmp_path, odd):
    content = {**CAMERA.to_json(), **odd}
    (board_capture(tmp_path) / "arm.csv").write_text("image,q1\na.png,0\n")
    (tmp_path / "camera.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="or delete the file to have them estimated"):
        read_board_capture(tmp_path)
    poses = {"base_from_table": np.eye(4).tolist(), "flange_from_camera": np.eye(4).tolist()}
    (tmp_path / "registration.json").write_text(json.dumps({**poses, "reasons": [], "camera": content}))
    with pytest.raises(InputError, match="register again"):
        read_registration(tmp_path / "registration.json")


@pytest.mark.parametrize("text", ["[1]", "{", '{"camera": []}', '{"camera": null}', "null", '{"camera": {"camera": 1}}'])
def test_a_damaged_camera_of_the_user_is_not_to_be_made_by_a_stage(tmp_path, text):
    (board_capture(tmp_path) / "arm.csv").write_text("image,q1\na.png,0\n")
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(InputError, match="or delete the file to have them estimated"):
        read_board_capture(tmp_path)


@pytest.mark.parametrize("reasons", ["typed", None, 5, {"a": 1}, [1], [None]])
def test_odd_reasons_of_a_registration_are_refused(tmp_path, reasons):
    poses = {"base_from_table": np.eye(4), "flange_from_camera": np.eye(4)}
    write_json(tmp_path / "registration.json", {**poses, "reasons": reasons})
    with pytest.raises(InputError, match="register again"):
        read_registration(tmp_path / "registration.json")


@pytest.mark.parametrize(
    "odd",
    [
        *({"cam_from_table": pose} for name, pose in ODD_POSES.items() if name != "millimetres"),
        *({"camera": {**CAMERA.to_json(), **camera}} for camera in ODD_CAMERAS),
        *({"camera": None}, {"name": "b.png"}, {"split": "other"}, {"split": None}),
    ],
)
def test_odd_views_are_refused(tmp_path, odd):
    board_capture(tmp_path)
    write_views(tmp_path / "views.json", [View(name, CAMERA, np.eye(4)) for name in ("a.png", "b.png")])
    assert len(read_views(tmp_path / "views.json", tmp_path)) == 2
    content = json.loads((tmp_path / "views.json").read_text())
    content["views"][0].update(odd)
    (tmp_path / "views.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="run the align stage again"):
        read_views(tmp_path / "views.json", tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3\n", "'a' stands twice, in lines 1 and 3"),
        ("a: {b: 1, b: 2}\n", r"'a\.b' stands twice"),
        ("a:\n  - b: 1\n    b: 1\n", r"'a\.b' stands twice"),
        ('a: 1\n"a": 3\n', "in lines 1 and 2"),
    ],
)
def test_a_key_of_yaml_that_stands_twice_is_refused(tmp_path, text, said):
    (tmp_path / "case.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        load_yaml(tmp_path / "case.yaml", "case", "-")


def test_a_key_of_yaml_may_be_laid_over_what_an_alias_brings(tmp_path):
    (tmp_path / "case.yaml").write_text("a: &a {x: 1, y: 1}\nb: {<<: *a, x: 2}\nc: {x: 1}\n")
    assert load_yaml(tmp_path / "case.yaml", "case", "-")["b"] == {"x": 2, "y": 1}


def test_several_aliases_may_be_merged_and_keys_of_two_kinds_differ(tmp_path):
    (tmp_path / "case.yaml").write_text("a: &a {x: 1}\nb: &b {y: 1}\nc:\n  <<: *a\n  <<: *b\nd: {1: one, '1': text}\n")
    assert load_yaml(tmp_path / "case.yaml", "case", "-")["c"] == {"x": 1, "y": 1}


def test_a_slip_of_ours_is_no_fault_of_the_file(tmp_path):
    slip = compile("undefined", "slip.py", "eval")
    with pytest.raises(NameError), refusing(tmp_path, "it cannot be read", "-"):
        eval(slip, {"__name__": "gsbridge.readers"})
    with pytest.raises(InputError, match="undefined"), refusing(tmp_path, "it cannot be read", "-"):
        eval(slip, {"__name__": "readers_of_others"})


@pytest.mark.parametrize("seed", [2**32, -1, 10**30, True, "1e9", float("nan")])
def test_seeds_that_a_stage_would_refuse_are_refused_before_a_run(seed):
    values = {"preset": "toy", "scenes": {"a": {"kind": "object", "source": {"images": "a"}}}, "presets": {}}
    assert Configuration(**values, seed=2**32 - 1).seed == 2**32 - 1
    with pytest.raises(InputError, match="seed"):
        Configuration(**values, seed=seed)


def test_a_zero_byte_in_a_path_is_refused():
    with pytest.raises(InputError, match=r"config: scenes\.a\.source\.images: .* holds a zero byte"):
        read_configuration({"scenes": {"a": {"kind": "object", "source": {"images": "a\0"}}}})
