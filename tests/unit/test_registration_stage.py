"""The registration from files to record: gates, reasons, typed poses, bad input."""

import csv
import json
import re

import cv2
import numpy as np
import pytest
from board_sight import BOARD, CAMERA, sight, table_from_cameras
from scipy.spatial.transform import Rotation

from gsbridge.configuration.registration import RegistrationSettings
from gsbridge.errors import InputError, StageError
from gsbridge.geometry import quat_from_rotation
from gsbridge.registration import stage
from gsbridge.registration.asked import check_board_capture
from gsbridge.registration.capture import read_board_capture, write_arm_table, write_camera
from gsbridge.registration.result import pose_error, read_registration
from gsbridge.registration.typed import typed_pose
from gsbridge.robot import nominal


def write_capture(folder, capture, camera=CAMERA):
    """Files of a capture whose arm reports flange poses; the photos are black."""
    folder.mkdir()
    names = [f"{index:02d}.png" for index in range(len(capture.tags))]
    black = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    for name in names:
        cv2.imwrite(str(folder / name), black)
    with (folder / "arm.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["image", "x", "y", "z", "qw", "qx", "qy", "qz"])
        for name, pose in zip(names, capture.base_from_flange, strict=True):
            writer.writerow([name, *pose[:3, 3], *quat_from_rotation(pose[:3, :3])])
    if camera is not None:
        write_camera(folder / "camera.json", camera)
    return folder


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Write a capture, register it, return the record."""

    def register(capture, *, scale="board", camera=CAMERA, settings=None):
        folder = write_capture(tmp_path / "capture", capture, camera)
        waiting = iter(capture.tags)
        monkeypatch.setattr(stage, "find_tags", lambda image, board: next(waiting))
        out = tmp_path / "registration.json"
        stage.register(
            source={"capture": str(folder)}, capture=folder, out_json=out, board=BOARD, scale=scale,
            settings=settings or RegistrationSettings(), seed=0,
        )  # fmt: skip
        return json.loads(out.read_text()), read_registration(out)

    return register


def test_a_good_capture_passes_and_is_right(run):
    capture = sight(0)
    record, found = run(capture)
    assert record["status"] == "pass", record["reasons"]
    for pose, truth in (
        (found.flange_from_camera, capture.flange_from_camera), (found.base_from_table, capture.base_from_board),
    ):  # fmt: skip
        shift, turn = pose_error(pose, truth)
        assert shift < 5e-4
        assert np.rad2deg(turn) < 0.06
    assert record["residual_px"] < 0.3
    assert record["residuals_mm"]["rms"] < 0.7
    assert len(record["residuals_mm"]["by_photo"]) == record["poses"]["used"] == 12
    assert record["standard_errors"]["base_from_table"]["position_total_mm"] < 0.5
    assert record["scale"] == {"value": 1.0, "source": "board", "se": None}


def test_the_arm_gives_the_boards_size(run):
    record, _ = run(sight(1, scale=0.95), scale="robot")
    assert record["scale"]["value"] == pytest.approx(0.95, rel=2e-3)
    assert abs(record["scale"]["value"] - 0.95) < 5 * record["scale"]["se"]
    # Films are measured by the same board.
    assert any(re.search(r"\+5\.[1-4] % off", reason) for reason in record["reasons"])


def test_a_board_of_the_right_size_is_not_doubted(run):
    record, _ = run(sight(1), scale="robot")
    assert record["reasons"] == []


def test_intrinsics_can_come_from_the_board_but_are_doubted(run):
    capture = sight(2, count=14, noise_px=0.05)
    record, found = run(capture, camera=None)
    assert record["camera"]["source"] == "estimated"
    assert record["camera"]["fx"] == pytest.approx(CAMERA.fx, rel=0.01)
    assert any("intrinsics" in reason for reason in record["reasons"])
    assert pose_error(found.base_from_table, capture.base_from_board)[0] < 3e-3


def test_seven_poses_are_too_few(run):
    with pytest.raises(StageError, match="7 poses show the board, 8 are needed"):
        run(sight(0, count=7))


def test_photos_without_the_board_do_not_count(run):
    capture = sight(0, count=10)
    for index in (1, 4, 7):
        capture.tags[index] = {}
    with pytest.raises(StageError, match=r"7 poses show the board, 8 are needed \(3 left out\)"):
        run(capture)


def test_turns_about_one_axis_are_too_little(run):
    views = table_from_cameras(12, np.random.default_rng(0), tilt=1e-3, turn=0.4)
    with pytest.raises(StageError, match="about a second axis"):
        run(sight(0, views=views))


def test_exchanged_lines_are_found_and_said(run):
    capture = sight(2, count=14)
    capture.base_from_flange[[3, 9]] = capture.base_from_flange[[9, 3]]
    record, found = run(capture)
    assert set(record["poses"]["left_out"]) == {"03.png", "09.png"}
    assert "2 photos contradict" in record["reasons"][0]
    assert pose_error(found.base_from_table, capture.base_from_board)[0] < 5e-4


def test_a_loose_arm_degrades(run):
    capture, rng = sight(3), np.random.default_rng(1)
    capture.base_from_flange[:, :3, 3] += rng.normal(0, 0.004, (12, 3))
    record, _ = run(capture)
    assert record["status"] == "degraded"
    assert any("disagree by" in reason for reason in record["reasons"])


def typed(**changes):
    both = {
        "base_from_table": {"position": [0.6, -0.265, -0.18]},
        "flange_from_camera": {"position": [-0.085, 0.0, 0.02], "rpy_deg": [-12.0, 0.0, -90.0]},
    }
    return {**both, **changes}


def write_typed(tmp_path, content):
    out = tmp_path / "registration.json"
    stage.register(
        source={"typed": content}, capture=None, out_json=out, board=BOARD, scale="board",
        settings=RegistrationSettings(), seed=0,
    )  # fmt: skip
    return json.loads(out.read_text()), read_registration(out)


def test_typed_poses_are_taken_and_degraded(tmp_path):
    record, found = write_typed(tmp_path, typed())
    assert record["status"] == "degraded"
    assert "typed, not measured" in found.reasons[0]
    np.testing.assert_allclose(found.base_from_table[:3, 3], [0.6, -0.265, -0.18])
    # The example of the guide is the nominal layout.
    np.testing.assert_allclose(found.flange_from_camera, nominal.flange_from_camera(), atol=1e-12)
    np.testing.assert_allclose(found.base_from_table, nominal.base_from_table(), atol=1e-12)
    wanted = Rotation.from_euler("xyz", [-12.0, 0.0, -90.0], degrees=True).as_matrix()
    np.testing.assert_allclose(found.flange_from_camera[:3, :3], wanted, atol=1e-12)


def test_quaternions_are_wxyz():
    pose = typed_pose({"position": [0, 0, 0], "quaternion": [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]}, "here")
    np.testing.assert_allclose(pose[:3, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ({"rpy_deg": [0, 0, 0]}, "rpy_deg"),
        ({"position": [600, -265, -180]}, "millimetres"),
        ({"position": [0, 0]}, "3 finite numbers"),
        ({"position": [0, 0, float("nan")]}, "3 finite numbers"),
        ({"position": "here"}, "no numbers"),
        ({"position": [0, 0, 0], "quaternion": [2, 0, 0, 0]}, "not 1"),
        ({"position": [0, 0, 0], "quaternion": [1, 0, 0, 0], "rpy_deg": [0, 0, 0]}, "Give `position"),
    ],
)
def test_typed_nonsense_is_refused_and_named(tmp_path, pose, words):
    with pytest.raises(InputError, match=words) as caught:
        write_typed(tmp_path, typed(base_from_table=pose))
    assert "base_from_table" in str(caught.value)


def test_a_missing_typed_pose_is_named(tmp_path):
    with pytest.raises(InputError, match="flange_from_camera is missing"):
        write_typed(tmp_path, {"base_from_table": {"position": [0.6, 0, 0]}})


def joint_capture(folder, header="image,q1,q2,q3,q4,q5,q6,q7", row="a.png,0,0.7,0,-1.5,0,0.9,0"):
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / "a.png"), np.zeros((8, 8, 3), np.uint8))
    (folder / "arm.csv").write_text(f"{header}\n{row}\n")
    return folder


def test_arm_tables_come_back(tmp_path):
    folder = joint_capture(tmp_path / "capture")
    joints = np.array([[0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7]])
    write_arm_table(folder / "arm.csv", ["a.png"], joints)
    found = read_board_capture(folder)
    assert found.images == ("a.png",)
    assert found.camera is None
    np.testing.assert_allclose(found.joints, joints, rtol=1e-8)


def test_degrees_and_lists_are_read(tmp_path):
    header = "image," + ",".join(f"q{k}_deg" for k in range(1, 8))
    found = read_board_capture(joint_capture(tmp_path / "capture", header, "a.png,90,0,0,0,0,0,-45"))
    np.testing.assert_allclose(found.joints[0], [np.pi / 2, 0, 0, 0, 0, 0, -np.pi / 4])
    (tmp_path / "capture" / "arm.csv").unlink()
    content = {"poses": [{"image": "a.png", "joints": [0.1] * 7}]}
    (tmp_path / "capture" / "arm.json").write_text(json.dumps(content))
    np.testing.assert_allclose(read_board_capture(tmp_path / "capture").joints, [[0.1] * 7])
    content = {"poses": [{"image": "a.png", "base_from_flange": np.eye(4).tolist()}]}
    (tmp_path / "capture" / "arm.json").write_text(json.dumps(content))
    np.testing.assert_array_equal(read_board_capture(tmp_path / "capture").base_from_flange, [np.eye(4)])


@pytest.mark.parametrize(
    ("header", "row", "words"),
    [
        ("image,q1,q3", "a.png,0,0", "its columns are"),
        ("photo,q1", "a.png,0", "its columns are"),
        ("image,x,y,z", "a.png,0,0,0", "its columns are"),
        ("image,q1,q2", "a.png,0,left", "line 2"),
        ("image,q1,q2", "a.png,0", "line 2"),
        ("image,q1,q2", "b.png,0,0", "the photo is missing"),
        ("image,q1,q2", "a.png,0,nan", "not finite"),
        ("image,q1", "a.png,0\na.png,0", "named twice"),
        ("image,q1", "", "names no photo"),
        ("image,x,y,z,qw,qx,qy,qz", "a.png,0,0,0,1,1,0,0", "unit length"),
        ("image,x,y,z,qw,qx,qy,qz", "a.png,400,0,650,1,0,0,0", "650 m away: it looks like millimetres"),
    ],
)
def test_damaged_arm_tables_are_refused(tmp_path, header, row, words):
    with pytest.raises(InputError, match=words):
        read_board_capture(joint_capture(tmp_path / "capture", header, row))


def test_a_folder_without_poses_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        read_board_capture(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"neither arm.csv nor arm.json"):
        read_board_capture(tmp_path)


def test_poses_of_a_tool_are_doubted_where_the_camera_is_far(run):
    """What lies between flange and tool goes into the mount without a residual."""
    capture, tool = sight(0), np.eye(4)
    tool[:3, 3], tool[:3, :3] = [0.0, 0.0, 0.20], Rotation.from_euler("z", 45, degrees=True).as_matrix()
    capture.base_from_flange[:] = capture.base_from_flange @ tool
    record, _ = run(capture)
    assert record["residuals_mm"]["rms"] < 0.7
    assert record["status"] == "degraded"
    assert "set the controller's tool to zero" in record["reasons"][0]


@pytest.mark.parametrize("key", ["coeffs", "dist_coeffs", "distorsion", "k1", "P2"])
def test_a_distortion_under_another_key_is_refused(tmp_path, key):
    folder = joint_capture(tmp_path / "capture")
    content = {"width": 640, "height": 480, "fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0, "model": "brown"}
    (folder / "camera.json").write_text(json.dumps(content))
    assert read_board_capture(folder).camera.distortion == (0.0, 0.0, 0.0, 0.0)
    beside = {"distortion_model": "plumb_bob", "focus_distance": 0.6, "distance": 1.0, "undistorted": False, key: [9.0]}
    (folder / "camera.json").write_text(json.dumps(content | beside | {"distortion": [0.1, -0.2, 0.0, 0.0]}))
    assert read_board_capture(folder).camera.distortion == (0.1, -0.2, 0.0, 0.0)
    (folder / "camera.json").write_text(json.dumps({"camera": content | {key: [0.1, -0.2, 0.0, 0.0]}}))
    with pytest.raises(InputError, match=f"'{key}' looks like the lens's distortion"):
        read_board_capture(folder)


def test_a_damaged_camera_is_refused(tmp_path):
    folder = joint_capture(tmp_path / "capture")
    (folder / "camera.json").write_text('{"width": 640}')
    with pytest.raises(InputError, match="the camera is damaged or incomplete"):
        read_board_capture(folder)


def test_degrees_without_their_name_are_refused(tmp_path, monkeypatch):
    folder = joint_capture(tmp_path / "capture", row="a.png,0,40,0,-90,0,50,0")
    monkeypatch.setattr(stage, "build_robot", lambda _: __import__("robot_fixture").robot())
    with pytest.raises(InputError, match=r"arm\.csv: .*outside its limits.*q1_deg"):
        stage._flange_poses(read_board_capture(folder))
    (folder / "arm.csv").unlink()
    for joints, said in (([0, 40, 0, -90, 0, 50, 0], r"outside its limits\. Give radians$"), ([0.1] * 6, "6 joints per photo")):
        (folder / "arm.json").write_text(json.dumps({"poses": [{"image": "a.png", "joints": joints}]}))
        with pytest.raises(InputError, match=rf"arm\.json: .*{said}"):
            stage._flange_poses(read_board_capture(folder))


@pytest.mark.parametrize(
    ("file", "content", "told"),
    [
        (
            "camera.json",
            '{"camera": {"width": 4, "height": 4, "fx": NaN, "fy": 5, "cx": 3, "cy": 2}}',
            "a focal length fx of nan px",
        ),
        (
            "camera.json",
            '{"camera": {"width": 64, "height": 48, "fx": -5, "fy": 5, "cx": 3, "cy": 2}}',
            "a focal length fx of -5 px",
        ),
        # A whole number of JSON has as many digits as somebody writes.
        (
            "camera.json",
            f'{{"camera": {{"width": 1{"0" * 400}, "height": 4, "fx": 5, "fy": 5, "cx": 3, "cy": 2}}}}',
            "a side of more than 100000 px",
        ),
        ("camera.json", "[" * 200_000, "nested too deeply"),
        ("arm.csv", "image,q1\n\xff.png,1\n".encode("latin-1"), "no table with commas"),
        ("arm.csv", "image,q1\n0.png," + "9" * 200_000, "field larger"),
        ("arm.csv", "image,q1\n0.png,nan\n", "the pose of 0.png is not finite"),
    ],
)
def test_a_capture_is_looked_at_before_any_job(tmp_path, file, content, told):
    """Whatever is wrong with it becomes one line."""
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((48, 64, 3), np.uint8))
    (tmp_path / "arm.csv").write_text("image,q1\n0.png,0.5\n")
    assert check_board_capture(tmp_path).images == ("0.png",)
    (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=told) as caught:
        check_board_capture(tmp_path)
    assert "\n" not in str(caught.value)
