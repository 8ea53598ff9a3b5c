"""Photos that a calibrated camera cannot have taken, by the record of the keyframes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from gsbridge.cameras import Camera
from gsbridge.capture.keyframes import select_keyframes
from gsbridge.capture.sources import Source
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.errors import InputError
from gsbridge.sfm.photos import Photos
from gsbridge.sfm.stage import _read_input

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
WIDE, CROPPED, LONG = {0x920A: 6.8, 0xA405: 26}, {0x920A: 2.2, 0xA405: 26}, {0x920A: 9.0, 0xA405: 77}


def read(folder: Path, exif_of_photos: list[dict], camera: Camera | None) -> Photos:
    """Photos with these EXIF data (0x920A: focal length, mm; 0xA405: in 35 mm film), as the stage reads their keyframes."""
    (folder / "photos").mkdir()
    for number, values in enumerate(exif_of_photos):
        exif = PIL.Image.Exif()
        exif.get_ifd(0x8769).update(values)
        image = PIL.Image.effect_noise((64, 48), 90).convert("RGB")
        image.save(folder / "photos" / f"{number}.jpg", quality=95, exif=exif)
    record = folder / "keyframes.json"
    select_keyframes(Source("images", folder / "photos"), folder / "frames", record, KeyframeSettings())
    return _read_input(json.loads(record.read_text()), record, folder / "frames", camera)[0]


@pytest.mark.parametrize("other", [CROPPED, LONG, {}], ids=["another lens cropped to the same focal length", "long", "unknown"])
def test_photos_of_two_lenses_are_not_taken_for_those_of_the_calibrated_camera(tmp_path: Path, other: dict) -> None:
    with pytest.raises(InputError, match=r"0\.png and 2\.png come from two lenses"):
        read(tmp_path, [WIDE, WIDE, other, other], CAMERA)


def test_photos_of_two_lenses_have_two_cameras_where_none_is_named(tmp_path: Path) -> None:
    photos = read(tmp_path, [WIDE, WIDE, CROPPED, CROPPED], None)
    assert [names for _, _, names in photos.by_camera()] == [["0.png", "1.png"], ["2.png", "3.png"]]


def test_photos_of_one_lens_are_those_of_the_calibrated_camera(tmp_path: Path) -> None:
    photos = read(tmp_path, [WIDE] * 4, CAMERA)
    assert [names for _, _, names in photos.by_camera()] == [["0.png", "1.png", "2.png", "3.png"]]


def test_photos_that_come_with_cameras_keep_these(tmp_path: Path) -> None:
    """And the record, which says whether there is a calibrated camera, must not name another."""
    own = Camera(64, 48, 70.0, 70.0, 32.0, 24.0)
    (tmp_path / "0.png").touch()
    view = {"camera": own.to_json(), "cam_from_world": np.eye(4).tolist()}
    record = {"frames": [{"name": "0.png"}], "width": 64, "height": 48, "source": {"kind": "colmap"}}
    photos, known = _read_input({**record, "known_cameras": {"0.png": view}}, tmp_path / "keyframes.json", tmp_path, CAMERA)
    assert photos.camera is None
    assert known["0.png"][0] == own
