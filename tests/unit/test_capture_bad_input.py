"""Each bad input ends in one clear line and leaves nothing behind."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from film_maker import pan, write_video

from gsbridge.capture.keyframes import select_keyframes
from gsbridge.capture.sources import Source, Video
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.errors import InputError


def refuse(tmp_path: Path, source: Source, *words: str, **settings: float) -> None:
    """The capture stops with all of `words` in one line and writes no file."""
    out = tmp_path / "out"
    with pytest.raises(InputError) as caught:
        select_keyframes(source, out / "frames", out / "keyframes.json", KeyframeSettings(**settings))
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    left = list(out.rglob("*")) if out.exists() else []
    assert left == []


def moving(count: int = 40) -> list[np.ndarray]:
    return pan([5.0 * i for i in range(count)])


def test_unknown_kind() -> None:
    with pytest.raises(InputError, match="hologram"):
        Source("hologram", Path("x"))


def test_missing_video(tmp_path: Path) -> None:
    refuse(tmp_path, Source("video", tmp_path / "none.mp4"), "none.mp4", "does not exist")


def test_empty_video(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    refuse(tmp_path, Source("video", tmp_path / "empty.mp4"), "empty.mp4", "0 bytes")


def test_text_as_video(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("this is no film\n" * 200)
    refuse(tmp_path, Source("video", tmp_path / "text.mp4"), "text.mp4", "not a video")


def test_truncated_video(tmp_path: Path) -> None:
    data = write_video(tmp_path / "whole.mp4", moving()).read_bytes()
    # The index of an MP4 stands at its end.
    (tmp_path / "half.mp4").write_bytes(data[: len(data) // 2])
    refuse(tmp_path, Source("video", tmp_path / "half.mp4"), "half.mp4", "cut off")


def test_corrupt_middle_of_a_video(tmp_path: Path) -> None:
    data = bytearray(write_video(tmp_path / "whole.avi", moving(), codec="MJPG").read_bytes())
    start, end = len(data) * 3 // 10, len(data) * 7 // 10
    data[start:end] = np.random.default_rng(0).integers(0, 256, end - start, dtype=np.uint8).tobytes()
    (tmp_path / "damaged.avi").write_bytes(bytes(data))
    refuse(tmp_path, Source("video", tmp_path / "damaged.avi"), "damaged.avi", "of 40 declared frames")


def test_black_video(tmp_path: Path) -> None:
    video = write_video(tmp_path / "black.mp4", [np.zeros((240, 320, 3), np.uint8)] * 20)
    refuse(tmp_path, Source("video", video), "black.mp4", "black", "light")


def test_static_video(tmp_path: Path) -> None:
    video = write_video(tmp_path / "still.mp4", pan([0.0] * 20))
    refuse(tmp_path, Source("video", video), "still.mp4", "static")


def test_blurred_video(tmp_path: Path) -> None:
    video = write_video(tmp_path / "soft.mp4", [cv2.GaussianBlur(frame, (0, 0), 7) for frame in moving()])
    refuse(tmp_path, Source("video", video), "soft.mp4", "blurred", "focus")


def photos(folder: Path, count: int) -> Path:
    folder.mkdir()
    for i, frame in enumerate(moving(count)):
        cv2.imwrite(str(folder / f"{i}.png"), frame)
    return folder


def test_two_photos(tmp_path: Path) -> None:
    refuse(tmp_path, Source("images", photos(tmp_path / "two", 2)), "two", "2 usable photos", "at least 3", "40")


def test_no_photos(tmp_path: Path) -> None:
    refuse(tmp_path, Source("images", tmp_path / "nowhere"), "nowhere", "does not exist")
    (tmp_path / "bare").mkdir()
    refuse(tmp_path, Source("images", tmp_path / "bare"), "bare", "no photos")


def test_photos_of_different_sizes(tmp_path: Path) -> None:
    folder = photos(tmp_path / "mixed", 5)
    cv2.imwrite(str(folder / "3.png"), pan([0.0], size=(300, 240))[0])
    refuse(tmp_path, Source("images", folder), "3.png", "0.png", "300 x 240", "320 x 240")


def test_a_photo_that_is_none(tmp_path: Path) -> None:
    folder = photos(tmp_path / "set", 5)
    (folder / "2.png").write_text("no image")
    refuse(tmp_path, Source("images", folder), "2.png", "not a readable image")


def test_blurred_photos(tmp_path: Path) -> None:
    folder = tmp_path / "soft"
    folder.mkdir()
    for i, frame in enumerate(moving(6)):
        cv2.imwrite(str(folder / f"{i}.png"), cv2.GaussianBlur(frame, (0, 0), 7))
    refuse(tmp_path, Source("images", folder), "0 usable photos", "6 more are black or blurred")


def test_two_photos_of_one_name(tmp_path: Path) -> None:
    folder = photos(tmp_path / "set", 4)
    cv2.imwrite(str(folder / "1.jpg"), moving(1)[0])
    refuse(tmp_path, Source("images", folder), "same name")


def colmap_project(folder: Path, count: int = 4) -> Path:
    """A COLMAP project: photos and a model whose poses are made up."""
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(camera_id=1, model="SIMPLE_RADIAL", width=320, height=240, params=[300.0, 160.0, 120.0, 0.01])
    model.add_camera_with_trivial_rig(camera)
    (folder / "images").mkdir(parents=True)
    for i, frame in enumerate(moving(count)):
        cv2.imwrite(str(folder / "images" / f"{i}.png"), frame)
        pose = np.eye(4)[:3]
        pose[0, 3] = -0.1 * i
        model.add_image_with_trivial_frame(pycolmap.Image(f"{i}.png", np.zeros((1, 2)), 1, i + 1), pycolmap.Rigid3d(pose))
    model.add_point3D(np.array([0.0, 0.0, 1.0]), pycolmap.Track())
    (folder / "sparse" / "0").mkdir(parents=True)
    model.write_binary(folder / "sparse" / "0")
    return folder


@pytest.mark.parametrize("below", [".", "sparse/0"])
def test_sound_colmap_project(tmp_path: Path, below: str) -> None:
    folder = colmap_project(tmp_path / "project")
    select_keyframes(Source("colmap", folder / below), tmp_path / "f", tmp_path / "k.json", KeyframeSettings())
    known = json.loads((tmp_path / "k.json").read_text())["known_cameras"]
    assert known["2.png"]["cam_from_world"][0][3] == pytest.approx(-0.2)
    assert known["2.png"]["camera"]["distortion"] == [0.01, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_colmap_model_cut_off(tmp_path: Path, part: str) -> None:
    folder = colmap_project(tmp_path / "project")
    file = folder / "sparse" / "0" / f"{part}.bin"
    file.write_bytes(file.read_bytes()[:-5])
    refuse(tmp_path, Source("colmap", folder), f"{part}.bin", "damaged or cut off")


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_colmap_model_with_an_absurd_count(tmp_path: Path, part: str) -> None:
    folder = colmap_project(tmp_path / "project")
    file = folder / "sparse" / "0" / f"{part}.bin"
    file.write_bytes(struct.pack("<Q", 1 << 60) + file.read_bytes()[8:])
    refuse(tmp_path, Source("colmap", folder), f"{part}.bin", "damaged or cut off")


def test_colmap_model_of_text(tmp_path: Path) -> None:
    folder = colmap_project(tmp_path / "project")
    for part in ("cameras", "images", "points3D"):
        (folder / "sparse" / "0" / f"{part}.bin").write_text("no model " * 10)
    refuse(tmp_path, Source("colmap", folder), "damaged")


def test_colmap_model_without_a_part(tmp_path: Path) -> None:
    folder = colmap_project(tmp_path / "project")
    (folder / "sparse" / "0" / "images.bin").unlink()
    refuse(tmp_path, Source("colmap", folder), "images.bin")
    refuse(tmp_path, Source("colmap", tmp_path / "nowhere"), "nowhere", "does not exist")


def test_colmap_model_without_its_photos(tmp_path: Path) -> None:
    folder = colmap_project(tmp_path / "project")
    (folder / "images" / "1.png").unlink()
    refuse(tmp_path, Source("colmap", folder), "1.png", "do not exist")


def test_damaged_transforms(tmp_path: Path) -> None:
    file = tmp_path / "transforms.json"
    refuse(tmp_path, Source("nerfstudio", file), "transforms.json", "does not exist")
    file.write_text("{")
    refuse(tmp_path, Source("nerfstudio", file), "not valid JSON")
    file.write_text(json.dumps({"frames": [{"file_path": "a.png", "transform_matrix": [[1, 2], [3, 4]]}]}))
    refuse(tmp_path, Source("nerfstudio", file), "transforms.json", "damaged")


def test_damaged_film(tmp_path: Path) -> None:
    refuse(tmp_path, Source("film", tmp_path), "film.json", "does not exist")
    (tmp_path / "film.json").write_text(json.dumps({"frames": [{"name": "0000.png", "time_s": 0.0}]}))
    refuse(tmp_path, Source("film", tmp_path), "film.json", "1 of 1 frames are missing")


def test_photos_in_a_format_that_is_not_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "phone"
    folder.mkdir()
    (folder / "IMG_1.DNG").write_bytes(b"ftypheic")
    refuse(tmp_path, Source("images", folder), "phone", "IMG_1.DNG", "Convert them to JPEG")
    for i, frame in enumerate(moving(4)):
        cv2.imwrite(str(folder / f"{i}.png"), frame)
    select_keyframes(Source("images", folder), tmp_path / "f", tmp_path / "k.json", KeyframeSettings())
    assert "IMG_1.DNG" in caplog.text


def lossy(tmp_path: Path, name: str, codec: str, declared: int) -> Video:
    """A sound video of 40 frames whose container declares another number."""
    video = Video(write_video(tmp_path / name, moving(), codec=codec))
    video.declared = declared
    return video


@pytest.mark.parametrize(("name", "codec"), [("guess.webm", "VP80"), ("guess.mkv", "mp4v")])
def test_an_estimated_count_refuses_no_video(tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str, codec: str) -> None:
    lossy(tmp_path, name, codec, 1000).check(40)
    assert "about 1000 expected" in caplog.text


def test_a_stored_count_refuses_a_video(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="40 of 50 declared"):
        lossy(tmp_path, "counted.mov", "mp4v", 50).check(40)
