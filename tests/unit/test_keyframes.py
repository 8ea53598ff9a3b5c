"""Choice of keyframes against films whose motion and blur are known."""

from __future__ import annotations

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from film_maker import pan, write_video

from gsbridge.cameras import Camera, split_of
from gsbridge.capture.keyframes import choose, select_keyframes
from gsbridge.capture.motion import FrameMotion, image_motion, measure, sharpness_of, small_grey
from gsbridge.capture.sources import Source
from gsbridge.configuration.capture import KeyframeSettings


def select(tmp_path: Path, source: Source, **settings: float) -> dict:
    select_keyframes(source, tmp_path / "frames", tmp_path / "keyframes.json", KeyframeSettings(**settings))
    return json.loads((tmp_path / "keyframes.json").read_text())


def test_motion_is_the_shift_of_the_image() -> None:
    first, second = (cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in pan([0.0, 7.25]))
    assert image_motion(first, second) == pytest.approx(7.25, abs=0.05)


def test_path_adds_up_over_a_film() -> None:
    offsets = [0, 3, 6, 9, 12, 20, 28, 36, 44]
    motions, size = measure([(0.0, frame) for frame in pan(offsets)])
    assert size == (240, 320)
    np.testing.assert_allclose([motion.path_px for motion in motions], offsets, atol=0.3)


def test_path_is_in_pixels_of_the_full_image() -> None:
    motions, _ = measure([(0.0, frame) for frame in pan([0, 40, 80], size=(1280, 400))])
    np.testing.assert_allclose([motion.path_px for motion in motions], [0, 40, 80], rtol=0.03, atol=0.5)


def test_noise_on_a_static_film_adds_up_to_nothing() -> None:
    rng = np.random.default_rng(0)
    still = pan([0.0])[0].astype(np.float32)
    frames = [(0.0, np.clip(still + rng.normal(0, 6, still.shape), 0, 255).astype(np.uint8)) for _ in range(40)]
    motions, _ = measure(frames)
    assert motions[-1].path_px < 1.0


def test_sharpness_falls_with_blur_and_not_with_size() -> None:
    frame = pan([0.0], size=(640, 400))[0]
    sharp = sharpness_of(small_grey(frame))
    values = [sharpness_of(small_grey(cv2.GaussianBlur(frame, (0, 0), sigma))) for sigma in (1.0, 2.0, 4.0)]
    assert sharp > values[0] > values[1] > values[2]
    doubled = cv2.resize(frame, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    assert sharpness_of(small_grey(doubled)) == pytest.approx(sharp, rel=0.5)


def test_choice_takes_the_sharpest_of_each_arc() -> None:
    # Ten frames per arc of 10 px; one of each is sharp, at a place that wanders.
    motions = [FrameMotion(100.0 if i % 10 == (i // 10) % 10 else 20.0, 100.0, float(i)) for i in range(100)]
    chosen = choose(motions, KeyframeSettings(count=10, min_step=0.0), 640)
    assert chosen == [10 * k + k for k in range(10)]


def test_choice_spreads_over_motion_not_over_time() -> None:
    # The camera rests for 50 frames, then moves on steadily: the rest is one place.
    path = [0.0] * 50 + [float(i) for i in range(50)]
    chosen = choose([FrameMotion(50.0, 100.0, value) for value in path], KeyframeSettings(count=10, min_step=0.0), 640)
    assert len(chosen) == 10
    assert sum(i < 50 for i in chosen) <= 1


def test_arcs_in_which_everything_is_blurred_are_left_out_but_never_two_in_a_row():
    """Three frames an arc; all of arcs 4, 8, 9 and 10 are blurred to half of what is seen around, which grows slowly."""
    blurred = {4, 8, 9, 10}
    motions = [FrameMotion((50.0 + i) * (0.5 if i // 3 in blurred else 1.0), 100.0, float(i)) for i in range(60)]
    chosen = choose(motions, KeyframeSettings(count=20, min_step=0.0), 640)
    arcs = {min(i * 20 // 59, 19) for i in chosen}
    left_out = set(range(20)) - arcs
    assert 4 in left_out
    assert left_out <= blurred
    assert not any({arc, arc + 1} <= left_out for arc in range(20))


def test_choice_keeps_the_least_step_and_leaves_out_blurred_arcs() -> None:
    motions = [FrameMotion(50.0 if i < 50 or i > 70 else 1.0, 100.0, float(i)) for i in range(101)]
    chosen = choose(motions, KeyframeSettings(count=50, min_step=0.0), 640)
    assert not [i for i in chosen if 50 <= i <= 70]
    assert len(choose(motions, KeyframeSettings(count=50, min_step=0.05), 640)) <= 3


def test_video(tmp_path: Path) -> None:
    frames = pan([4.0 * i for i in range(40)])
    blurred = [cv2.GaussianBlur(frame, (0, 0), 3) if i % 3 else frame for i, frame in enumerate(frames)]
    video = write_video(tmp_path / "film.mp4", blurred)
    record = select(tmp_path, Source("video", video), count=12)
    assert record["declared"] == record["decoded"] == 40
    assert record["width"] == 320
    assert record["ordered"]
    indices = [frame["index"] for frame in record["frames"]]
    assert indices == sorted(set(indices))
    # Every arc of 13 px holds at least one sharp frame.
    assert all(index % 3 == 0 for index in indices[:-1])
    assert [frame["split"] for frame in record["frames"]] == [split_of(i) for i in range(len(indices))]
    assert [frame["time_s"] for frame in record["frames"]] == pytest.approx([index / 10 for index in indices])
    stored = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert stored == [frame["name"] for frame in record["frames"]]
    image = cv2.imread(str(tmp_path / "frames" / stored[3]))
    assert np.abs(image.astype(int) - blurred[indices[3]]).mean() < 12
    assert sum(frame["motion_px"] for frame in record["frames"]) == pytest.approx(4.0 * indices[-1], rel=0.05)


def test_photos_are_kept_scaled_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for i, frame in enumerate(pan([10.0 * i for i in range(24)], size=(400, 300))):
        cv2.imwrite(str(folder / f"IMG_{i:02d}.JPG"), frame)
    cv2.imwrite(str(folder / "IMG_05.JPG"), np.full((300, 400, 3), 90, np.uint8))
    record = select(tmp_path, Source("images", folder), max_side=200)
    assert (record["width"], record["height"]) == (200, 150)
    assert len(record["frames"]) == 23
    assert record["status"] == "degraded"
    assert "IMG_05.JPG" in record["reasons"][0]
    assert record["frames"][0]["name"] == "IMG_00.png"
    assert cv2.imread(str(tmp_path / "frames" / "IMG_00.png")).shape == (150, 200, 3)
    assert not record["ordered"]


def film(tmp_path: Path, offsets: list[float], kind: str) -> Path:
    folder = tmp_path / "film"
    (folder / "frames").mkdir(parents=True)
    frames = [{"name": f"{i:04d}.png", "index": 3 * i, "time_s": i / 10, "spp": 8} for i in range(len(offsets))]
    for item, image in zip(frames, pan(offsets), strict=True):
        cv2.imwrite(str(folder / "frames" / item["name"]), image)
    (folder / "film.json").write_text(json.dumps({"frames": frames, "kind": kind}))
    return folder


def test_frames_of_a_film_are_its_keyframes(tmp_path: Path) -> None:
    folder = film(tmp_path, [20.0 * i for i in range(24)], "object")
    record = select(tmp_path, Source("film", folder), count=5)
    assert record["status"] == "pass"
    assert len(record["frames"]) == 24
    assert record["frames"][2]["time_s"] == pytest.approx(0.2)
    same = (tmp_path / "frames" / "0007.png").read_bytes() == (folder / "frames" / "0007.png").read_bytes()
    assert same


def test_dense_film_is_selected_from(tmp_path: Path) -> None:
    folder = film(tmp_path, [2.0 * i for i in range(60)], "dense")
    record = select(tmp_path, Source("film", folder), count=10)
    assert len(record["frames"]) == 10
    assert record["decoded"] == 60


def test_nerfstudio_axes_are_converted(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    frames = []
    for i, image in enumerate(pan([20.0 * i for i in range(4)])):
        cv2.imwrite(str(folder / f"{i}.png"), image)
        matrix = np.eye(4)
        matrix[:3, 3] = [i, 0.0, 2.0]
        frames.append({"file_path": f"photos/{i}.png", "transform_matrix": matrix.tolist()})
    content = {"w": 320, "h": 240, "fl_x": 300.0, "fl_y": 301.0, "cx": 160.0, "cy": 121.0, "k1": 0.02, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    record = select(tmp_path, Source("nerfstudio", tmp_path / "transforms.json"))
    known = record["known_cameras"]["1.png"]
    assert Camera.from_json(known["camera"]) == Camera(320, 240, 300.0, 301.0, 160.0, 121.0, (0.02, 0.0, 0.0, 0.0))
    pose = np.array(known["cam_from_world"])
    # An OpenGL camera at (1, 0, 2) without rotation looks along -z: the world's origin is 2 m ahead and 1 m to its left.
    np.testing.assert_allclose(pose @ [0, 0, 0, 1], [-1, 0, 2, 1], atol=1e-12)
    # The world's y is up; OpenCV's y is down.
    np.testing.assert_allclose(pose[:3, :3] @ [0, 1, 0], [0, -1, 0], atol=1e-12)


def test_portrait_and_landscape_in_one_folder_keep_their_sizes(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for i, image in enumerate(pan([20.0 * i for i in range(6)])):
        cv2.imwrite(str(folder / f"{i}.png"), image if i < 4 else np.rot90(image))
    record = select(tmp_path, Source("images", folder))
    assert [frame.get("size") for frame in record["frames"]] == [None] * 4 + [[240, 320]] * 2
    assert (record["width"], record["height"]) == (320, 240)
    assert cv2.imread(str(tmp_path / "frames" / "5.png")).shape == (320, 240, 3)


def test_nerfstudio_files_of_other_programs_are_read(tmp_path: Path) -> None:
    """No suffix, an opening angle without a size, and a frame whose photo is gone."""
    (tmp_path / "images").mkdir()
    frames = []
    for i, image in enumerate(pan([20.0 * i for i in range(4)])):
        cv2.imwrite(str(tmp_path / "images" / f"{i}.png"), image)
        frames.append({"file_path": f"./images/{i}", "transform_matrix": np.eye(4).tolist()})
    frames.append({"file_path": "./images/gone", "transform_matrix": np.eye(4).tolist()})
    angle = 2 * np.arctan(160 / 300)
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": angle, "frames": frames}))
    record = select(tmp_path, Source("nerfstudio", tmp_path / "transforms.json"))
    assert record["status"] == "degraded"
    assert any("1 of 5 listed photos do not exist: ./images/gone" in reason for reason in record["reasons"])
    camera = Camera.from_json(record["known_cameras"]["2.png"]["camera"])
    assert camera == Camera(320, 240, pytest.approx(300.0), pytest.approx(300.0), 160.0, 120.0, (0.0, 0.0, 0.0, 0.0))


@pytest.mark.capture
@pytest.mark.skipif("GSBRIDGE_CAPTURES" not in os.environ, reason="GSBRIDGE_CAPTURES names no folder of real captures")
def test_real_video_decodes(tmp_path: Path) -> None:
    video = Path(os.environ["GSBRIDGE_CAPTURES"]) / "apple_video" / "apple.mp4"
    record = select(tmp_path, Source("video", video))
    assert record["decoded"] >= 48
    assert record["status"] == "pass"
    assert len(record["frames"]) >= 25
