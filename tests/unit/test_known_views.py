"""Posed photos of other programs: cameras and poses that cannot be are refused, in one line that names the photo."""

import copy
import json

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera
from gsbridge.capture.known_views import KnownView, checked_view
from gsbridge.capture.sources import read_nerfstudio
from gsbridge.errors import InputError

TURN = cv2.Rodrigues(np.array([0.3, -0.2, 0.9]))[0]


@pytest.fixture
def content(tmp_path):
    """A sound file of three views, its poses rounded as exporters do."""
    frames = []
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((48, 64, 3), 90, np.uint8))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = TURN, (number, 0.5, 1)
        frames.append({"file_path": f"{number}.png", "transform_matrix": pose.round(5).tolist()})
    return {"w": 64, "h": 48, "fl_x": 50.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0, "k1": 0.01, "frames": frames}


def read(folder, content):
    (folder / "transforms.json").write_text(json.dumps(content))
    return read_nerfstudio(folder / "transforms.json")


def test_sound_views_are_read(tmp_path, content):
    photos, absent = read(tmp_path, content)
    assert (len(photos), absent) == (3, [])


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("fl_x", float("nan"), "focal length fx"),
        ("fl_x", float("inf"), "focal length fx"),
        ("fl_y", -50.0, "focal length fy"),
        ("fl_y", 0.0, "focal length fy"),
        ("fl_x", 1e-9, "focal length fx"),
        ("cx", float("nan"), "principal point"),
        ("cy", 1e6, "principal point"),
        ("k1", float("nan"), "distortion"),
        ("k1", 1e30, "distortion"),
        ("w", 0, "0 x 48 px"),
        ("w", -64, "-64 x 48 px"),
        ("h", 1e308, "px"),
        ("w", float("inf"), "damaged"),
    ],
)
def test_cameras_that_cannot_be_are_refused(tmp_path, content, key, value, said):
    content[key] = value
    with pytest.raises(InputError, match=said):
        read(tmp_path, content)


def scaled(pose):
    pose[:3, :3] *= 1.5


def sheared(pose):
    pose[0, :3] += 0.2 * pose[1, :3]


def mirrored(pose):
    pose[:3, 0] *= -1


def flat(pose):
    pose[:3, 2] = 0


def weighted(pose):
    pose[3, 3] = 0


def skewed(pose):
    pose[3, 0] = 0.3


def without_a_number(pose):
    pose[1, 3] = float("nan")


@pytest.mark.parametrize("spoil", [scaled, sheared, mirrored, flat, weighted, skewed, without_a_number])
def test_poses_that_cannot_be_are_refused(tmp_path, content, spoil):
    content = copy.deepcopy(content)
    pose = np.array(content["frames"][1]["transform_matrix"])
    spoil(pose)
    content["frames"][1]["transform_matrix"] = pose.tolist()
    with pytest.raises(InputError) as refused:
        read(tmp_path, content)
    assert "\n" not in str(refused.value)
    assert "damaged" in str(refused.value)


def test_a_view_names_its_photo():
    view = KnownView(Camera(64, 48, -1.0, 50.0, 32.0, 24.0), np.eye(4))
    with pytest.raises(InputError, match=r"the view of 7\.png is damaged: a focal length fx of -1 px"):
        checked_view(view, "model", "7.png")
