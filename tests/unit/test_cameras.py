"""Cameras against OpenCV and hand calculation."""

import cv2
import numpy as np
import pytest

from gsbridge.cameras import HELD_OUT_EVERY, Camera, View, camera_centre, look_at, read_views, split_of, write_views
from gsbridge.errors import InputError
from gsbridge.images import write_image

CAMERA = Camera(640, 480, 530.0, 528.0, 322.5, 238.0, (0.05, -0.03, 0.001, -0.002))


def test_projection_agrees_with_opencv():
    points = np.random.default_rng(0).uniform([-0.3, -0.2, 0.5], [0.3, 0.2, 1.5], size=(50, 3))
    # OpenCV's pixel centres lie at integers: half a pixel off ours.
    intrinsics = CAMERA.intrinsics - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), intrinsics, np.array(CAMERA.distortion))[0].reshape(-1, 2)
    np.testing.assert_allclose(CAMERA.project(points), expected + 0.5, atol=1e-9)


def test_points_behind_the_camera_have_no_pixel():
    assert np.isnan(CAMERA.project(np.array([0.0, 0.0, -1.0]))).all()


def test_rays_run_through_pixel_centres():
    camera = CAMERA.undistorted()
    rays = camera.pixel_rays()
    np.testing.assert_allclose(camera.project(rays[10, 20]), [20.5, 10.5])
    with pytest.raises(ValueError, match="undistorted"):
        CAMERA.pixel_rays()


def test_half_size_camera_sees_a_point_at_half_the_pixel():
    point = np.array([0.1, -0.05, 1.0])
    camera = CAMERA.undistorted()
    np.testing.assert_allclose(camera.scaled(0.5).project(point), camera.project(point) / 2)
    np.testing.assert_allclose(camera.cropped(30, 40, 100, 100).project(point), camera.project(point) - [30, 40])


def test_look_at_puts_the_target_in_the_middle_and_up_upwards():
    pose = look_at([0.3, -0.4, 0.5], [0.1, 0.1, 0.0])
    np.testing.assert_allclose(camera_centre(pose), [0.3, -0.4, 0.5])
    target = pose[:3, :3] @ [0.1, 0.1, 0.0] + pose[:3, 3]
    np.testing.assert_allclose(target[:2], 0, atol=1e-12)
    above = pose[:3, :3] @ [0.1, 0.1, 0.05] + pose[:3, 3]
    assert above[1] < 0
    with pytest.raises(ValueError, match="parallel"):
        look_at([0, 0, 1], [0, 0, 0])


def test_one_keyframe_in_eight_is_held_out_and_the_first_trains():
    splits = [split_of(index) for index in range(4 * HELD_OUT_EVERY)]
    assert splits.count("held_out") == 4
    assert splits[0] == "train"


def test_views_survive_a_round_trip(tmp_path):
    images = tmp_path / "images"
    write_image(images / "a.png", np.zeros((4, 6, 3), np.float32))
    view = View("a.png", Camera(6, 4, 5.0, 5.0, 3.0, 2.0), look_at([1, 0, 1], [0, 0, 0]), "held_out")
    write_views(tmp_path / "views.json", [view])
    found = read_views(tmp_path / "views.json", images)
    assert found[0].camera == view.camera
    assert found.of("held_out")[0].name == "a.png"
    assert found.of("train") == ()
    np.testing.assert_allclose(found[0].cam_from_table, view.cam_from_table)
    (images / "a.png").unlink()
    with pytest.raises(InputError, match="missing"):
        read_views(tmp_path / "views.json", images)
