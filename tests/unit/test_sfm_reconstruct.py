"""The whole sfm stage, and align behind it, on a dozen drawn photos with known cameras."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
from posed_scene import BOARD, names, photos

from gsbridge.align import AlignSettings, align_scene
from gsbridge.cameras import Camera, camera_centre, read_views
from gsbridge.capture.keyframes import select_keyframes
from gsbridge.capture.sources import Source
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.errors import InputError, StageError
from gsbridge.geometry import Array
from gsbridge.images import read_image, write_image
from gsbridge.sfm import SfmSettings, reconstruct


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Camera, list[Array]]:
    """A folder of drawn photos, their camera and poses."""
    folder = tmp_path_factory.mktemp("drawn")
    camera, poses = photos(folder)
    return folder, camera, poses


def run(
    folder: Path,
    frames: Path,
    keyframes: Path,
    camera: Camera | None = None,
    board: bool = True,
    settings: SfmSettings = SfmSettings(max_features=1000),  # noqa: B008  (frozen)
    seed: int = 0,
) -> dict:
    reconstruct(
        frames=frames,
        keyframes_json=keyframes,
        out_model=folder / "model",
        out_images=folder / "images",
        out_json=folder / "sfm.json",
        out_tags=folder / "tags.json",
        settings=settings,
        camera=camera,
        board=BOARD if board else None,
        workspace=folder / "work",
        seed=seed,
        threads=1,
    )
    return json.loads((folder / "sfm.json").read_text())


def align(folder: Path) -> dict:
    align_scene(
        sfm_json=folder / "sfm.json",
        model=folder / "model",
        tags=folder / "tags.json",
        out_json=folder / "align.json",
        out_views=folder / "views.json",
        out_points=folder / "points.npz",
        settings=AlignSettings(),
        board=BOARD,
        known_length=None,
        seed=0,
    )
    return json.loads((folder / "align.json").read_text())


@functools.cache
def keyframes_of(source: Source, folder: Path) -> tuple[Path, Path]:
    select_keyframes(source, folder / "frames", folder / "keyframes.json", KeyframeSettings())
    return folder / "frames", folder / "keyframes.json"


@pytest.mark.slow
def test_photos_to_metric_cameras(tmp_path: Path, capture: tuple[Path, Camera, list[Array]]) -> None:
    folder, camera, poses = capture
    frames, keyframes = keyframes_of(Source("images", folder), tmp_path)
    record = run(tmp_path, frames, keyframes, camera)
    assert record["status"] == "pass"
    assert record["registered"] == record["total"] == len(poses)
    assert record["mapper"] == "incremental"
    assert record["tag_refinement"]["used"]
    aligned = align(tmp_path)
    assert aligned["scale_source"] == "tags"
    assert aligned["tilt_deg"] < 0.3
    views = read_views(tmp_path / "views.json", tmp_path / "images")
    assert [view.name for view in views] == names(len(poses))
    assert views[4].split == "held_out"
    errors = [1e3 * np.linalg.norm(view.centre - camera_centre(pose)) for view, pose in zip(views, poses, strict=True)]
    assert np.mean(errors) < 1.0
    points = np.load(tmp_path / "points.npz")
    assert points["points"].shape[0] == points["errors"].shape[0] == points["colours"].shape[0]
    assert points["point_index"].max() < len(points["points"])
    assert points["view_index"].max() < len(views)
    # The block is 6 x 6 x 4 cm: points on its top must be there.
    top = (np.abs(points["points"][:, :2]) < 0.028).all(1)
    assert np.median(points["points"][top, 2]) == pytest.approx(0.04, abs=0.001)
    # A view's colours at the points it sees are the points' colours.
    image = read_image(views.path(views[0]))
    assert image.shape[:2] == (views[0].camera.height, views[0].camera.width)


def posed(path: Path, folder: Path, camera: Camera, poses: list[Array]) -> Path:
    """Write a `transforms.json` for the drawn photos."""
    frames = []
    for name, pose in zip(names(len(poses)), poses, strict=True):
        matrix = np.linalg.inv(pose)
        matrix[:3, 1:3] *= -1
        frames.append({"file_path": str(folder / name), "transform_matrix": matrix.tolist()})
    k1, k2, p1, p2 = camera.distortion
    content = {"w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
    content |= {"k1": k1, "k2": k2, "p1": p1, "p2": p2, "frames": frames}
    path.write_text(json.dumps(content))
    return path


@pytest.mark.slow
def test_known_cameras_are_kept(tmp_path: Path, capture: tuple[Path, Camera, list[Array]]) -> None:
    folder, camera, poses = capture
    transforms = posed(tmp_path / "transforms.json", folder, camera, poses)
    record = run(tmp_path, *keyframes_of(Source("nerfstudio", transforms), tmp_path))
    assert record["mapper"] == "known"
    assert record["registered"] == len(poses)
    assert record["points"] > 200
    aligned = align(tmp_path)
    assert aligned["scale"] == pytest.approx(1.0, abs=0.002)
    assert aligned["residual_mm"] < 0.6


@pytest.mark.slow
def test_rough_poses_give_the_unit_only(tmp_path: Path, capture: tuple[Path, Camera, list[Array]]) -> None:
    """Poses of a phone's tracking, a centimetre and a degree off, in units of half a metre."""
    folder, camera, poses = capture
    rng = np.random.default_rng(5)
    off = []
    for pose in poses:
        turn, _ = cv2.Rodrigues(np.deg2rad(rng.normal(0, 1, 3)))
        moved = np.eye(4)
        moved[:3, :3] = turn @ pose[:3, :3]
        moved[:3, 3] = -moved[:3, :3] @ (2 * (camera_centre(pose) + rng.normal(0, 0.005, 3)))
        off.append(moved)
    transforms = posed(tmp_path / "transforms.json", folder, camera, off)
    record = run(tmp_path, *keyframes_of(Source("nerfstudio", transforms), tmp_path))
    assert record["attempt"] == "known poses, refined"
    assert record["registered"] == len(poses)
    assert record["reprojection_px"] < 1.0
    # The board, which the reconstruction has not looked at, knows the unit.
    aligned = align(tmp_path)
    assert aligned["scale"] == pytest.approx(0.5, rel=0.02)
    assert aligned["residual_mm"] < 0.6


def test_unrelated_photos_fail_with_advice(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    (tmp_path / "photos").mkdir()
    for name in names(4):
        write_image(tmp_path / "photos" / name, np.kron(rng.random((24, 32, 3)), np.ones((6, 6, 1))).astype(np.float32))
    frames, keyframes = keyframes_of(Source("images", tmp_path / "photos"), tmp_path)
    out = tmp_path / "sfm"
    with pytest.raises(StageError, match=r"of 4 images registered.*60 % are needed.*more photos"):
        run(out, frames, keyframes, board=False)
    assert not (out / "sfm.json").exists()
    assert not (out / "images").exists()


def test_camera_of_another_size_is_refused(tmp_path: Path, capture: tuple[Path, Camera, list[Array]]) -> None:
    folder, camera, _ = capture
    frames, keyframes = keyframes_of(Source("images", folder), tmp_path)
    with pytest.raises(InputError, match=r"400 x 300 pixels, the calibrated camera 200 x 150"):
        run(tmp_path, frames, keyframes, camera.scaled(0.5))
    (frames / "0003.png").unlink()
    with pytest.raises(InputError, match=r"0003\.png: a keyframe is missing"):
        run(tmp_path, frames, keyframes)


@pytest.mark.slow
def test_portrait_and_landscape_photos_are_one_capture_with_a_camera_each(
    tmp_path: Path, capture: tuple[Path, Camera, list[Array]]
) -> None:
    folder, camera, poses = capture
    turned = names(len(poses))[::3]
    (tmp_path / "photos").mkdir()
    for name in names(len(poses)):
        image = read_image(folder / name)
        write_image(tmp_path / "photos" / name, np.ascontiguousarray(np.rot90(image)) if name in turned else image)
    record = run(tmp_path, *keyframes_of(Source("images", tmp_path / "photos"), tmp_path))
    assert record["registered"] == len(poses)
    # The first photo is turned, so the others are those of the other camera.
    assert sorted(record["other_cameras"]) == sorted(set(names(len(poses))) - set(turned))
    other = Camera.from_json(next(iter(record["other_cameras"].values())))
    assert (other.width, other.height) == (camera.width, camera.height)
    aligned = align(tmp_path)
    assert aligned["scale_source"] == "tags"
    views = read_views(tmp_path / "views.json", tmp_path / "images")
    errors = [1e3 * np.linalg.norm(view.centre - camera_centre(pose)) for view, pose in zip(views, poses, strict=True)]
    assert np.mean(errors) < 4.0


@pytest.mark.slow
def test_photos_of_two_lenses_at_one_size_have_a_camera_each(tmp_path: Path, capture: tuple[Path, Camera, list[Array]]) -> None:
    """Every third photo is the middle of what it was, enlarged to the same size: a lens 1.4 times as long."""
    folder, camera, poses = capture
    far = set(names(len(poses))[1::3])
    (tmp_path / "photos").mkdir()
    for name in names(len(poses)):
        with PIL.Image.open(folder / name) as image:
            zoom = 1.4 if name in far else 1.0
            beside, above = (0.5 * side * (1 - 1 / zoom) for side in image.size)
            box = (beside, above, image.width - beside, image.height - above)
            exif = PIL.Image.Exif()
            # 36 mm of film are as wide as the photo.
            exif.get_ifd(0x8769)[0xA405] = round(36 * zoom * camera.fx / camera.width)
            image.resize(image.size, PIL.Image.Resampling.LANCZOS, box).save(
                (tmp_path / "photos" / name).with_suffix(".jpg"), quality=98, exif=exif
            )
    frames, keyframes = keyframes_of(Source("images", tmp_path / "photos"), tmp_path)
    chosen = json.loads(keyframes.read_text())["frames"]
    assert {frame["name"] for frame in chosen if "focal_prior_px" in frame} == far
    record = run(tmp_path, frames, keyframes)
    assert record["registered"] == len(poses)
    assert set(record["other_cameras"]) == far
    longer = Camera.from_json(next(iter(record["other_cameras"].values())))
    assert longer.fx / Camera.from_json(record["camera"]).fx == pytest.approx(1.4, rel=0.01)
    align(tmp_path)
    views = read_views(tmp_path / "views.json", tmp_path / "images")
    errors = [1e3 * np.linalg.norm(view.centre - camera_centre(pose)) for view, pose in zip(views, poses, strict=True)]
    assert np.mean(errors) < 4.0
