"""Calibration, undistortion, gates and refinement against models whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from posed_scene import BOARD, LENS, cloud, local, model_of, moved, names, orbit, sightings

from gsbridge.cameras import Camera, camera_centre
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Array, Similarity, align_similarity
from gsbridge.images import write_image
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix, quiet, read_model
from gsbridge.sfm import gates
from gsbridge.sfm.calibrate import MIN_VIEWS, calibrate_camera, solve
from gsbridge.sfm.known_poses import drop_contradicted
from gsbridge.sfm.mapping import MappingOutcome, drop_weak_images, ladder
from gsbridge.sfm.matching import ring
from gsbridge.sfm.numbering import number_images
from gsbridge.sfm.photos import Photos
from gsbridge.sfm.refine import is_flat, refine_with_tags
from gsbridge.sfm.undistort import pinhole_of, undistort_image, undistort_pixels, undistorted_model

POSES = orbit(24)
AWAY = Similarity(7.3, np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, -2.0, 0.5]))


def centre_errors(model: pycolmap.Reconstruction, poses: list[Array]) -> Array:
    """Distance of camera centres from the truth, m."""
    truth = dict(zip(names(len(poses)), poses, strict=True))
    images = [model.image(i) for i in model.reg_image_ids()]
    return np.array([np.linalg.norm(camera_centre(pose_matrix(i)) - camera_centre(truth[i.name])) for i in images])


def matches(poses: list[Array], noise: float, lens: Camera = LENS) -> list[tuple[Array, Array]]:
    layout = BOARD.corners()
    seen = sightings(lens, poses, noise)
    return [(np.concatenate([layout[i] for i in tags]), np.concatenate(list(tags.values()))) for tags in seen.values()]


def test_calibration_recovers_the_camera() -> None:
    camera, rms, kept = solve(matches(POSES, 0.0), (640, 480))
    assert kept == len(POSES)
    assert rms < 1e-3
    for key in ("fx", "fy", "cx", "cy"):
        assert getattr(camera, key) == pytest.approx(getattr(LENS, key), abs=0.02)
    np.testing.assert_allclose(camera.distortion, LENS.distortion, atol=2e-4)


def test_calibration_leaves_out_a_view_that_does_not_fit() -> None:
    views = matches(POSES, 0.05)
    views[5] = (views[5][0], views[5][1] + np.random.default_rng(0).normal(0, 6, views[5][1].shape))
    camera, rms, kept = solve(views, (640, 480))
    assert kept == len(POSES) - 1
    assert rms < 0.1
    assert camera.fx == pytest.approx(LENS.fx, rel=0.005)


@pytest.mark.parametrize(("zoom", "said"), [(1.0, None), (1.2, "zoom, lens or stabiliser"), (1.7, "no camera fits the board")])
def test_captures_of_two_zooms_make_no_camera(tmp_path: Path, monkeypatch, zoom: float, said: str | None) -> None:  # type: ignore[no-untyped-def]
    far = replace(LENS, fx=zoom * LENS.fx, fy=zoom * LENS.fy)
    found = matches(POSES, 0.15) + matches(POSES, 0.15, far)
    monkeypatch.setattr("gsbridge.sfm.calibrate._find_matches", lambda folders, board: (found, (640, 480)))
    record = tmp_path / "camera.json"
    if zoom > 1.5:
        with pytest.raises(StageError, match=said):
            calibrate_camera([(tmp_path, tmp_path)], BOARD, record)
    else:
        calibrate_camera([(tmp_path, tmp_path)], BOARD, record)
        reasons = read_json(record)["reasons"]
        assert not reasons if said is None else any(said in reason for reason in reasons)


def test_calibration_knows_more_from_more_views() -> None:
    """Figures scatter with the root of the views, also of those that are too many to be solved together."""
    errors = {}
    for count in (90, 270):
        found = [solve(shaken(count, seed), (640, 480)) for seed in range(4)]
        assert {kept for _, _, kept in found} == {count}
        errors[count] = np.mean(
            [np.square([c.fx - LENS.fx, c.fy - LENS.fy, c.cx - LENS.cx, c.cy - LENS.cy]) for c, _, _ in found]
        )
    assert errors[270] < 0.6 * errors[90]


def shaken(count: int, seed: int) -> list[tuple[Array, Array]]:
    """Views with noise of half a pixel."""
    rng = np.random.default_rng(seed)
    return [(board, pixels + rng.normal(0, 0.5, pixels.shape)) for board, pixels in matches(orbit(count), 0.0)]


def blank_capture(folder: Path, count: int, size: tuple[int, int] = (64, 48)) -> tuple[Path, Path]:
    for name in names(count):
        write_image(folder / "frames" / name, np.full((size[1], size[0], 3), 0.5, np.float32))
    write_json(folder / "keyframes.json", {"frames": [{"name": name} for name in names(count)]})
    return folder / "frames", folder / "keyframes.json"


def test_calibration_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=f"{MIN_VIEWS} are needed"):
        calibrate_camera([blank_capture(tmp_path / "a", 4)], BOARD, tmp_path / "camera.json")
    assert not (tmp_path / "camera.json").exists()


def test_calibration_refuses_captures_of_two_sizes(tmp_path: Path) -> None:
    folders = [blank_capture(tmp_path / "a", 2), blank_capture(tmp_path / "b", 2, (80, 48))]
    with pytest.raises(InputError, match=r"0000\.png.*80 x 48"):
        calibrate_camera(folders, BOARD, tmp_path / "camera.json")


def test_undistortion_undoes_the_lens() -> None:
    rng = np.random.default_rng(0)
    points = np.c_[rng.uniform(-0.5, 0.5, 200), rng.uniform(-0.38, 0.38, 200), np.ones(200)]
    seen = undistort_pixels(LENS.project(points), LENS)
    np.testing.assert_allclose(seen, LENS.undistorted().project(points), atol=1e-5)


@pytest.mark.parametrize("k1", [0.08, 0.0, -0.15])
def test_undistorted_image_has_no_border(k1: float) -> None:
    camera = Camera(320, 240, 300.0, 300.0, 165.0, 118.0, (k1, 0.0, 0.001, -0.001))
    pinhole = pinhole_of(camera)
    assert pinhole.is_pinhole
    assert (pinhole.fx, pinhole.fy) == (camera.fx, camera.fy)
    source = camera.project(pinhole.pixel_rays())
    assert (source > -0.5).all()
    assert (source < [320.5, 240.5]).all()
    assert pinhole.width * pinhole.height > 0.9 * 320 * 240


def test_undistorted_image_shows_each_ray_where_the_pinhole_sees_it() -> None:
    camera = Camera(320, 240, 300.0, 300.0, 165.0, 118.0, (-0.15, 0.02, 0.001, -0.001))
    # A photo whose value is its own column lets every resampled pixel tell where it came from.
    ramp = np.tile((np.arange(320) + 0.5).astype(np.float32), (240, 1))
    pinhole = pinhole_of(camera)
    out = undistort_image(ramp, camera, pinhole)
    expected = camera.project(pinhole.pixel_rays())[..., 0]
    inner = (slice(4, -4), slice(4, -4))
    np.testing.assert_allclose(out[inner], expected[inner], atol=0.05)


def test_undistorted_model_has_the_same_residuals() -> None:
    model = model_of(LENS, POSES, cloud(), noise=0.5)
    model.update_point_3d_errors()
    out = undistorted_model(model, {1: pinhole_of(LENS)})
    out.update_point_3d_errors()
    assert out.num_points3D() == model.num_points3D()
    assert out.compute_mean_reprojection_error() == pytest.approx(model.compute_mean_reprojection_error(), rel=0.03)
    image = out.image(3)
    point = next(p for p in image.points2D if p.has_point3D())
    assert np.linalg.norm(image.project_point(out.points3D[point.point3D_id].xyz) - point.xy) < 3.0


def photos_of(count: int, *, ordered: bool = True) -> Photos:
    return Photos(Path("frames"), names(count), ordered, LENS, None, (640, 480))


def test_ladder_begins_cheap_and_ends_with_the_global_mapper() -> None:
    film = ladder(photos_of(60), SfmSettings())
    assert [a.exhaustive for a in film] == [False, False, True, True, True]
    assert [a.mapper for a in film] == ["incremental"] * 4 + ["global"]
    assert not [a for a in ladder(photos_of(400), SfmSettings()) if a.exhaustive]
    assert all(a.exhaustive for a in ladder(photos_of(30, ordered=False), SfmSettings()))
    many = ladder(photos_of(60, ordered=False), SfmSettings())
    # Their names promise nothing: with one photo missing all pairs are tried.
    assert [a.exhaustive for a in many] == [False, True, True, True]
    assert many[0].enough == 1.0


@pytest.mark.parametrize(("count", "overlap"), [(7, 10), (20, 3), (16, 4), (53, 10)])
def test_neighbours_on_a_ring(count: int, overlap: int) -> None:
    wanted = set()
    for a in range(count):
        for b in range(a + 1, count):
            apart = min(b - a, count - (b - a))
            if apart <= overlap or apart & (apart - 1) == 0:
                wanted.add((names(count)[a], names(count)[b]))
    pairs = ring(names(count), overlap)
    assert len(pairs) == len(set(pairs))
    assert set(pairs) == wanted


def test_images_are_numbered_in_the_order_of_their_names(tmp_path: Path) -> None:
    """As one thread would have numbered them, whichever was ready first; features stay with their image."""
    path = tmp_path / "database.db"
    order = ["b.png", "c.png", "a.png"]
    database = pycolmap.Database.open(path)
    camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=64, height=48, params=[50.0, 32.0, 24.0, 0.0])
    camera.camera_id = database.write_camera(camera)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(camera.sensor_id)
    rig.rig_id = database.write_rig(rig)
    for index, name in enumerate(order):
        image = pycolmap.Image(name=name, camera_id=camera.camera_id)
        image.image_id = database.write_image(image)
        frame = pycolmap.Frame()
        frame.rig_id = rig.rig_id
        frame.add_data_id(image.data_id)
        database.write_frame(frame)
        database.write_keypoints(image.image_id, np.full((2, 2), index, np.float32))
    descriptors = pycolmap.FeatureDescriptors(data=np.zeros((2, 128), np.uint8))
    for image in database.read_all_images():
        database.write_descriptors(image.image_id, descriptors)
    database.close()
    number_images(path, sorted(order))
    database = pycolmap.Database.open(path)
    for number, name in enumerate(sorted(order), 1):
        image = database.read_image_with_name(name)
        assert (image.image_id, image.frame_id, image.camera_id) == (number, number, camera.camera_id)
        assert (database.read_keypoints(number)[:, :2] == order.index(name)).all()
        assert database.read_frame(number).rig_id == rig.rig_id
    assert database.num_images() == database.num_frames() == database.num_descriptors() / 2 == 3
    database.close()


def outcome(registered: int, total: int) -> tuple[MappingOutcome, Photos]:
    model = model_of(LENS, orbit(total)[:registered], cloud()) if registered else None
    return MappingOutcome(model, "incremental", "sequential", []), photos_of(total)


def test_gate_passes_degrades_and_fails() -> None:
    assert gates.check(*outcome(20, 20), SfmSettings(), "sfm") == []
    assert gates.check(*outcome(19, 20), SfmSettings(), "sfm") == []
    reasons = gates.check(*outcome(15, 20), SfmSettings(), "sfm")
    assert "15 of 20 images registered (75 %)" in reasons[0]
    assert "0015.png to 0019.png (5 images)" in reasons[0]
    with pytest.raises(StageError, match=r"sfm of x: 8 of 20 .*60 % are needed.*film that part again"):
        gates.check(*outcome(8, 20), SfmSettings(), "sfm of x")
    with pytest.raises(StageError, match="0 of 20"):
        gates.check(*outcome(0, 20), SfmSettings(), "sfm")


def test_gaps() -> None:
    assert gates.gaps(list("abcdef"), {"a", "d"}) == [("b", "c", 2), ("e", "f", 2)]
    assert gates.gaps(list("ab"), {"a", "b"}) == []


def test_board_confirms_a_right_model_and_refuses_a_wrong_one() -> None:
    tags = sightings(LENS, POSES, noise=0.2)
    model = moved(model_of(LENS, POSES, cloud()), AWAY)
    assert gates.doubt(model, tags, BOARD) is None
    assert gates.doubt(model, tags, None) is not None
    assert "fewer than 3 tags" in str(gates.doubt(model, {}, BOARD))
    # Half of the cameras in the wrong place, as global mappers leave them: each residual of SIFT may still be small.
    wrong = [pose if i < 12 else POSES[(i + 7) % 24] for i, pose in enumerate(POSES)]
    assert "miss their layout" in str(gates.doubt(model_of(LENS, wrong, cloud()), tags, BOARD))


def test_weak_images_lose_their_pose() -> None:
    points = cloud()
    model = model_of(LENS, POSES, points)
    image = model.image(3)
    for index in [k for k, p in enumerate(image.points2D) if p.has_point3D()][20:]:
        model.delete_observation(3, index)
    drop_weak_images(model)
    assert model.num_reg_images() == len(POSES) - 1
    assert not model.image(3).has_pose


def test_given_poses_that_nothing_agrees_with_are_left_out_and_said() -> None:
    model = model_of(LENS, POSES, cloud())
    assert drop_contradicted(model) == []
    for wrong in (3, 9):
        for index in [k for k, p in enumerate(model.image(wrong).points2D) if p.has_point3D()][2:]:
            model.delete_observation(wrong, index)
    (reason,) = drop_contradicted(model)
    assert reason.startswith("the poses of 2 of 24 photos")
    assert all(names(24)[wrong - 1] in reason for wrong in (3, 9))
    assert model.num_reg_images() == 22
    # Where hardly any photo has points, none is the odd one out.
    assert drop_contradicted(model_of(LENS, POSES, cloud()[:20])) == []


def test_tags_mend_intrinsics_and_bring_metres() -> None:
    tags = sightings(LENS, POSES, noise=0.05)
    points = cloud()
    # What a calibration from the board alone leaves: a principal point that is off, with poses that fit it.
    off = Camera(640, 480, 599.0, 600.0, 323.0, 238.5, LENS.distortion)
    model = model_of(LENS, POSES, points, noise=0.3)
    model.cameras[1].params = [off.fx, off.fy, off.cx, off.cy, *off.distortion]
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = options.refine_extra_params = False
    pycolmap.bundle_adjustment(model, options)
    model = moved(model, AWAY)
    refined, record = refine_with_tags(model, tags, BOARD, 0)
    assert record["used"]
    camera = camera_from_colmap(refined.cameras[1], "test")
    assert camera.cy == pytest.approx(LENS.cy, abs=0.9)
    assert camera.fx == pytest.approx(LENS.fx, abs=0.6)
    errors = 1e3 * centre_errors(refined, POSES)
    assert errors.mean() < 0.6
    # Before, aligned by the same tags, the cameras were farther off.
    corners, layout = gates.model_corners(model, tags), BOARD.corners()
    fit = align_similarity(np.concatenate([corners[i] for i in corners]), np.concatenate([layout[i] for i in corners]))
    assert errors.mean() < 0.5 * 1e3 * centre_errors(moved(model, fit), POSES).mean()


def test_a_bent_board_does_not_bend_the_model() -> None:
    model = model_of(LENS, POSES, cloud(), noise=0.3)
    layout = BOARD.corners()
    tags = {}
    for name, pose in zip(names(len(POSES)), POSES, strict=True):
        tags[name] = {}
        for tag, corners in layout.items():
            lift = np.array([0.0, 0.0, 0.02 if tag % 4 == 0 else 0.0])
            tags[name][tag] = LENS.project(local(pose, corners + lift))
    refined, record = refine_with_tags(model, tags, BOARD, 0)
    assert not record["used"]
    assert refined is model


def test_too_few_tags_leave_the_model_as_it_is() -> None:
    model = model_of(LENS, POSES, cloud())
    refined, record = refine_with_tags(model, {}, BOARD, 0)
    assert refined is model
    assert not record["used"]


@pytest.mark.parametrize(
    ("model", "params", "expected"),
    [
        ("SIMPLE_PINHOLE", [500.0, 320.0, 240.0], Camera(640, 480, 500.0, 500.0, 320.0, 240.0)),
        ("RADIAL", [500.0, 320.0, 240.0, 0.1, 0.2], Camera(640, 480, 500.0, 500.0, 320.0, 240.0, (0.1, 0.2, 0.0, 0.0))),
        ("OPENCV", [500.0, 501.0, 320.0, 240.0, 0.1, 0.2, 0.01, 0.02], None),
    ],
)
def test_colmap_cameras_project_as_ours(model: str, params: list[float], expected: Camera | None) -> None:
    theirs = pycolmap.Camera(camera_id=1, model=model, width=640, height=480, params=params)
    ours = camera_from_colmap(theirs, "test")
    if expected is not None:
        assert ours == expected
    points = np.random.default_rng(0).uniform([-0.3, -0.2, 0.9], [0.3, 0.2, 1.5], (20, 3))
    np.testing.assert_allclose(ours.project(points), theirs.img_from_cam(points), atol=1e-9)


def test_fisheye_is_refused() -> None:
    camera = pycolmap.Camera(camera_id=1, model="OPENCV_FISHEYE", width=64, height=48, params=[50, 50, 32, 24, 0, 0, 0, 0])
    with pytest.raises(InputError, match="OPENCV_FISHEYE is not supported"):
        camera_from_colmap(camera, "model")


def test_model_survives_the_disk(tmp_path: Path) -> None:
    model = model_of(LENS, POSES, cloud())
    model.write_binary(tmp_path)
    back = read_model(tmp_path)
    np.testing.assert_allclose(pose_matrix(back.image(5)), POSES[4], atol=1e-12)


def test_quiet_sends_the_libraries_words_to_a_file(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with quiet(tmp_path / "log" / "colmap.log"):
        pycolmap.logging.warning("a word of COLMAP")
    assert "a word of COLMAP" in (tmp_path / "log" / "colmap.log").read_text()
    pycolmap.logging.warning("a second word")
    assert "a word of COLMAP" not in capfd.readouterr().err


@pytest.mark.parametrize(("raised", "flat"), [(0, True), (2, True), (10, False)])
def test_a_table_with_little_on_it_is_flat(raised, flat):
    """100 points within a millimetre of the table, the last `raised` of them 20 mm above it."""
    model = pycolmap.Reconstruction()
    for index in range(100):
        height = 0.02 if index >= 100 - raised else 0.001 * (index % 2)
        model.add_point3D(np.array([0.01 * index, 0.0, height]), pycolmap.Track())
    assert is_flat(model) is flat
