"""The comparison figure: choice of crop and detail, and a picture from fabricated splats."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera, View, look_at, write_views
from gsbridge.errors import InputError
from gsbridge.images import read_image_u8, write_image
from gsbridge.report.figures.rendering_comparison import ASPECT, _crop, _detail, compared_scene, write_rendering_comparison
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import write_ply

CAMERA = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)


def test_the_crop_holds_the_object_and_keeps_the_aspect() -> None:
    weight = np.zeros((120, 160), np.float32)
    weight[50:70, 130:155] = 1
    left, top, width, height = _crop(weight)
    assert left <= 130
    assert left + width >= 155
    assert top <= 50
    assert top + height >= 70
    assert left + width <= 160
    assert width / height == pytest.approx(ASPECT, abs=0.08)
    assert _crop(np.zeros((120, 160), np.float32)) == (0, 0, 160, 120)


def test_the_detail_shows_texture_rather_than_the_rim() -> None:
    rng = np.random.default_rng(0)
    photo = np.full((90, 120, 3), 0.5, np.float32)
    photo[20:70, 20:100] = 0.1
    photo[40:60, 60:85] = rng.random((20, 25, 3))
    weight = np.zeros((90, 120), np.float32)
    weight[20:70, 20:100] = 1
    left, top, width, height = _detail(photo, weight)
    assert left <= 62
    assert left + width >= 83
    assert top <= 42
    assert top + height >= 58


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene with five views of three coloured blobs; the photo of every view is grey with a red spot."""
    scene = tmp_path / "scenes" / "blobs"
    views = []
    for index in range(5):
        angle = 0.4 * index
        pose = look_at(np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.3]), np.zeros(3))
        views.append(View(f"{index:04d}.png", CAMERA, pose, "held_out" if index == 4 else "train"))
        photo = np.full((120, 160, 3), 0.3, np.float32)
        cv2.circle(photo, (80, 60), 20, (0.9, 0.1, 0.1), -1)
        write_image(scene / "sfm" / "images" / views[-1].name, photo)
        mask = np.zeros((120, 160), np.uint8)
        cv2.circle(mask, (80, 60), 20, 255, -1)
        write_image(scene / "masks" / "images" / views[-1].name, mask)
    write_views(scene / "align" / "views.json", views)
    means = np.array([[0.0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]])
    quats = np.tile([1.0, 0, 0, 0], (3, 1))
    cloud = Cloud(means, quats, np.full((3, 3), 0.02), np.full(3, 0.9), np.eye(3))
    for binding in ("soft", "games"):
        write_ply(scene / "splats" / binding / "splats.ply", cloud)
    return scene


def test_the_figure_has_a_column_for_each_binding(folder: Path, tmp_path: Path) -> None:
    scene = compared_scene(folder)
    assert sorted(scene.splats) == ["games", "soft"]
    assert scene.masks is not None
    write_rendering_comparison([scene], tmp_path / "figure.png")
    image = read_image_u8(tmp_path / "figure.png").astype(float)
    # Five columns of two lines: photo, soft, GaMeS, and two differences.
    assert image.shape[1] / image.shape[0] == pytest.approx(5 * ASPECT / 2, rel=0.12)
    # The same splats stand behind both bindings: their columns agree below the titles, and differ from the photo.
    columns = np.array_split(image[image.shape[0] // 2 + 10 : -10, : image.shape[1] // 5 * 5], 5, axis=1)
    means = [column.mean((0, 1)) for column in columns]
    np.testing.assert_allclose(means[1], means[2], atol=6)
    np.testing.assert_allclose(means[3], means[4], atol=6)
    assert np.abs(means[0] - means[1]).max() > 12


def test_no_scene_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no scene"):
        write_rendering_comparison([], tmp_path / "figure.png")
    assert not list(tmp_path.iterdir())
