"""The look of the bundle against photos that are rendered here from the splats themselves."""

import numpy as np
import pytest

from gsbridge.asset.photos import AssetPhotos, compare_with_photos
from gsbridge.cameras import Camera, View, Views, look_at
from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.geometry import Similarity
from gsbridge.images import write_image
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.evaluate import evaluate_cloud, render_cloud
from gsbridge.splats.targets import object_targets

CAMERA = Camera(48, 40, 60.0, 60.0, 24.0, 20.0)


@pytest.fixture
def scene(tmp_path):
    """Splats in the table frame, and what `compare_with_photos` needs of their photos."""
    rng = np.random.default_rng(0)
    quats = np.tile([1.0, 0, 0, 0], (400, 1))
    means = rng.uniform(-0.04, 0.04, (400, 3)) + np.array([0.1, 0.05, 0.04])
    cloud = Cloud(means, quats, np.full((400, 3), 0.006), np.full(400, 0.95), rng.random((400, 3)))
    views = []
    for folder in ("images", "masks"):
        (tmp_path / folder).mkdir()
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, 4, endpoint=False)):
        pose = look_at((0.1 + 0.2 * np.cos(angle), 0.05 + 0.2 * np.sin(angle), 0.15), (0.1, 0.05, 0.04))
        colours, alphas = render_cloud(cloud, CAMERA, pose)
        write_image(tmp_path / "images" / f"{index}.png", colours)
        write_image(tmp_path / "masks" / f"{index}.png", alphas)
        views.append(View(f"{index}.png", CAMERA, pose, "held_out" if index == 1 else "train"))
    registered = Views(tmp_path / "images", tuple(views))
    metrics = evaluate_cloud(cloud, object_targets(registered, tmp_path / "masks", 12), kind="object")
    write_json(tmp_path / "splats.json", {"metrics": metrics})
    return cloud, AssetPhotos(registered, tmp_path / "masks", tmp_path / "splats.json")


def body_from_table(shift) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = shift
    return pose


def test_moving_to_the_body_frame_loses_nothing(scene):
    cloud, photos = scene
    pose = body_from_table((-0.1, -0.05, 0.0))
    looks = compare_with_photos(
        cloud.transformed(Similarity.from_matrix(pose)), pose, photos, kind="object", visual="unused.ply"
    )
    assert looks["kept"]
    assert (looks["split"], looks["views"]) == ("held_out", 1)
    assert looks["psnr"] == pytest.approx(looks["stage_psnr"], abs=0.01)


def test_a_shift_of_two_millimetres_shows(scene):
    cloud, photos = scene
    looks = compare_with_photos(cloud, body_from_table((0.002, 0, 0)), photos, kind="object", visual="unused.ply")
    assert not looks["kept"]


def test_missing_masks_and_metrics_are_refused(scene, tmp_path):
    cloud, photos = scene
    with pytest.raises(InputError, match="need masks"):
        compare_with_photos(
            cloud, np.eye(4), AssetPhotos(photos.views, None, photos.record), kind="object", visual="unused.ply"
        )
    write_json(tmp_path / "splats.json", {})
    with pytest.raises(InputError, match="no metrics"):
        compare_with_photos(cloud, np.eye(4), photos, kind="object", visual="unused.ply")
