"""Files that are odd rather than broken: pipes, huge files, formats that belie the suffix, references, impossible names."""

import io
import json
import os
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from gsbridge.capture.keyframes import select_keyframes
from gsbridge.capture.sources import Source, Video, list_photos, read_colmap, read_film, read_nerfstudio
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.environment.trial_log import read_trial_log
from gsbridge.errors import InputError
from gsbridge.files import LARGEST_JSON, read_json
from gsbridge.images import LARGEST_IMAGE_PIXELS, image_size, is_png, read_image_u8, read_mask
from gsbridge.policy.export import load_policy
from gsbridge.policy.format import WEIGHTS
from gsbridge.policy.robot_trials import TrialFile
from gsbridge.splats.ply import LARGEST_PLY, PROPERTIES, read_ply
from tests.fuzz.samples import DATA, READERS, Reader, write_photo
from tests.fuzz.test_readers import read_within

Read = Callable[[Path], object]


def refuse(read: Read, path: Path, words: str | None = None) -> None:
    """Expect one line, with some words, within the time that a reading may take."""

    def told(path: Path) -> None:
        with pytest.raises(InputError, match=words) as caught:
            read(path)
        raise caught.value

    read_within(Reader(lambda folder: folder, told), path)


BY_PATH: dict[str, Read] = {
    "json": read_json,
    "transforms": read_nerfstudio,
    "film": read_film,
    "photos": list_photos,
    "model": lambda path: read_colmap(path, None),
    "video": Video,
    "image": read_image_u8,
    "size": image_size,
    "mask": read_mask,
    "ply": read_ply,
    "trial log": read_trial_log,
    "trials": lambda path: TrialFile(path, "0" * 64),
    "policy": load_policy,
}


@pytest.mark.parametrize("name", BY_PATH)
@pytest.mark.parametrize("kind", ["pipe", "zero", "long", "device"])
def test_names_and_things_that_are_no_files(name, kind, tmp_path):
    odd = {"zero": tmp_path / "a\0b", "long": tmp_path / ("a" * 5000), "device": Path("/dev/zero"), "pipe": tmp_path / "pipe"}
    os.mkfifo(tmp_path / "pipe")
    refuse(BY_PATH[name], odd[kind])


def _json(text: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "a.json").write_text(text)
        return folder / "a.json"

    return write


def _giant(reader: str, size: int) -> Callable[[Path], Path]:
    """A sound file, continued without taking room on the disk."""

    def write(folder: Path) -> Path:
        path = READERS[reader].write(folder)
        os.truncate(path, size)
        return path

    return write


def _ply_of(count: int, kind: str = "float", extra: int = 0, **values: float) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        names = [*PROPERTIES, *(f"more_{number}" for number in range(extra))]
        row = np.ones(len(names), {"float": "<f4", "double": "<f8"}[kind])
        for name, value in values.items():
            row[names.index(name)] = value
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {count}", *(f"property {kind} {n}" for n in names)]
        (folder / "a.ply").write_bytes(("\n".join([*head, "end_header"]) + "\n").encode() + row.tobytes())
        return folder / "a.ply"

    return write


def _tiny_quaternion(folder: Path) -> Path:
    return _ply_of(1, rot_0=1e-38, rot_1=0, rot_2=0, rot_3=0)(folder)


def _named(name: str, content: bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return write


def _beside_a_film(text: str) -> Callable[[Path], Path]:
    """A list that refers to a sound film."""

    def write(folder: Path) -> Path:
        READERS["video"].write(folder)
        (folder / "a.mp4").write_text(text)
        return folder / "a.mp4"

    return write


def _bomb(folder: Path) -> Path:
    """Depths of the right shape by their head, which unpack to gigabytes by the list of the archive."""
    path = READERS["depths"].write(folder)
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": (1024, 1024, 256)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("depths.npy", "w") as file:
        file.write(head.getvalue())
        for _ in range(256):
            file.write(bytes(2**20))
    return path


def _absurd_png(folder: Path, edge: int = 15_000) -> Path:
    path = write_photo(folder, "0.png")
    data = bytearray(path.read_bytes())
    data[16:24] = edge.to_bytes(4, "big") * 2
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    path.write_bytes(bytes(data))
    return path


def _transforms(common: dict[str, object], frame: dict[str, object]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = READERS["transforms"].write(folder)
        content = json.loads(path.read_text())
        content |= common
        content["frames"][1] |= frame
        path.write_text(json.dumps(content))
        return path

    return write


LIST = "#EXTM3U\n#EXT-X-VERSION:3\n#EXTINF:1,\nfilm.mp4\n#EXT-X-ENDLIST\n"
ODD: dict[str, tuple[Callable[[Path], Path], Read, str]] = {
    "deep json": (_json('{"a":' * 100_000), read_json, "nested too deeply"),
    "long number": (_json('{"a": ' + "9" * 5000 + "}"), read_json, "not valid JSON"),
    "giant json": (_giant("json", LARGEST_JSON + 1), read_json, "at most"),
    "deep transforms": (_json('{"a":' * 100_000), read_nerfstudio, "Export it again"),
    "giant splats": (_giant("ply", LARGEST_PLY + 1), read_ply, "at most"),
    "splats that are not there": (_ply_of(10**12), read_ply, "cut off"),
    "thousands of properties": (_ply_of(1, extra=20_000), read_ply, "too long"),
    "beyond a float": (_ply_of(1, "double", x=1e300), read_ply, "too large, as its x"),
    "no turn": (_tiny_quaternion, read_ply, "quaternion"),
    "giant weights": (_giant("weights", 3 * 2**30), lambda path: load_policy(path.parent), f"{WEIGHTS}.*at most"),
    "unpacks to gigabytes": (_bomb, READERS["depths"].read, "unpack to"),
    "absurd size": (_absurd_png, image_size, "million are read"),
    "more than absurd size": (lambda folder: _absurd_png(folder, 21_000), image_size, "Shrink it"),
    "playlist": (_beside_a_film(LIST), Video, "begins like none"),
    "list of films": (_beside_a_film("ffconcat version 1.0\nfile film.mp4\n"), Video, "begins like none"),
    "description of streams": (_named("a.mp4", b"<?xml version='1.0'?><MPD></MPD>"), Video, "begins like none"),
    "photo as video": (_named("a.mp4", (DATA / "turned.heic").read_bytes()[:4] + b"\xff\xd8"), Video, "begins like none"),
    "fisheye": (_transforms({"is_fisheye": True}, {}), read_nerfstudio, "fisheye"),
    "one fisheye": (_transforms({}, {"is_fisheye": True}), read_nerfstudio, "fisheye"),
    "one model": (_transforms({}, {"camera_model": "OPENCV_FISHEYE"}), read_nerfstudio, "OPENCV_FISHEYE"),
    "long photo name": (_transforms({}, {"file_path": "a" * 5000}), read_nerfstudio, "do not exist"),
    "zero in a photo name": (_transforms({}, {"file_path": "a\0b"}), read_nerfstudio, "do not exist"),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_files_end_in_one_line(name, tmp_path):
    write, read, words = ODD[name]
    refuse(read, write(tmp_path), words)


def test_a_photo_s_own_camera_counts(tmp_path):
    own = {"w": 64, "h": 48, "fl_x": 60.0, "fl_y": 61.0, "cx": 30.0, "cy": 20.0}
    focal = [photo.known.camera.fx for photo in read_nerfstudio(_transforms({}, own)(tmp_path))[0]]
    assert focal == [50.0, 60.0, 50.0]
    wide = {"camera_angle_x": np.pi / 2, "camera_angle_y": np.pi / 2}
    cameras = [photo.known.camera for photo in read_nerfstudio(_transforms({}, wide)(tmp_path))[0]]
    assert [round(camera.fx, 6) for camera in cameras] == [50.0, 32.0, 50.0]
    assert [round(camera.fy, 6) for camera in cameras] == [50.0, 24.0, 50.0]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_the_size_of_a_turned_picture_is_that_of_what_is_read(kind, orientation, tmp_path):
    exif = PIL.Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"0.{kind.lower()}"
    PIL.Image.new("RGB", (64, 48)).save(path, kind, exif=exif)
    assert image_size(path) == read_image_u8(path).shape[1::-1]


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.heic"])
def test_what_a_picture_is_its_bytes_say(name, tmp_path):
    path = tmp_path / name
    path.write_bytes((DATA / "turned.heic").read_bytes())
    assert read_image_u8(path).shape == (64, 48, 3)
    assert image_size(path) == (48, 64)
    path.write_bytes(write_photo(tmp_path, "0.jpg").read_bytes())
    assert read_image_u8(path).shape == (48, 64, 3)
    assert not is_png(path)


def test_a_keyframe_called_png_is_one(tmp_path):
    rng = np.random.default_rng(0)
    (tmp_path / "photos").mkdir()
    for number in range(3):
        data = cv2.imencode(".jpg", rng.integers(0, 255, (48, 64, 3), np.uint8))[1].tobytes()
        (tmp_path / f"photos/{number}.png").write_bytes(data)
    source = Source("images", tmp_path / "photos")
    select_keyframes(source, tmp_path / "frames", tmp_path / "keyframes.json", KeyframeSettings())
    assert all(is_png(path) for path in (tmp_path / "frames").iterdir())


def test_the_photos_of_a_phone_with_200_megapixels_are_within_the_limit():
    assert LARGEST_IMAGE_PIXELS >= 16_320 * 12_240
    assert PIL.Image.MAX_IMAGE_PIXELS == LARGEST_IMAGE_PIXELS


def test_a_video_of_one_picture_is_called_so(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "a.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, (64, 48))
    writer.write(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))
    writer.release()
    source = Source("video", tmp_path / "a.mp4")
    with pytest.raises(InputError, match="has one picture"):
        select_keyframes(source, tmp_path / "frames", tmp_path / "keyframes.json", KeyframeSettings())


@pytest.mark.parametrize("name", ["a.mp4", "a.mov", "a.avi", "a.mkv", "a.webm", "a.ts", "a.mpg", "a.wmv", "a.flv", "a.m2ts"])
def test_the_containers_of_cameras_are_read(name, tmp_path):
    codec = {"a.webm": "VP80", "a.mpg": "mpg1", "a.ts": "mpg2", "a.m2ts": "mpg2", "a.flv": "FLV1", "a.wmv": "WMV2"}
    four = cv2.VideoWriter_fourcc(*codec.get(name, "mp4v"))
    writer = cv2.VideoWriter(str(tmp_path / name), four, 25.0, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV does not write it")
    for number in range(6):
        writer.write(np.full((48, 64, 3), 40 * number, np.uint8))
    writer.release()
    assert len(list(Video(tmp_path / name))) >= 5
