"""Pictures of any camera as the policy takes them, against what a pinhole would see."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.cameras import Camera
from gsbridge.environment.rendering import FIELD_OF_VIEW, wrist_camera
from gsbridge.errors import InputError
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.policy.rectify import Rectifier

TARGET = wrist_camera(64)


def light(rays):
    """A smooth pattern over directions: linear light 0..1 of three colours. [..., 3] -> [..., 3]."""
    x, y = rays[..., 0], rays[..., 1]
    return 0.5 + 0.35 * np.stack([np.sin(9 * x + 4 * y), np.cos(7 * y - 3 * x), np.sin(5 * x) * np.cos(6 * y)], axis=-1)


def undistorted(camera):
    """Directions of all pixels of a camera with distortion, by fixed-point iteration. [H, W, 3]."""
    rays = camera.undistorted().pixel_rays()
    wanted = rays[..., :2].copy()
    for _ in range(25):
        seen = (camera.project(rays) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        rays[..., :2] += wanted - seen
    return rays


def photo(camera):
    """What a camera sees of the pattern. uint8 [H, W, 3]."""
    return np.rint(255 * srgb_from_linear(light(undistorted(camera)))).astype(np.uint8)


@cache
def by_pinhole(target):
    """Mean of the pattern over each pixel of a pinhole, by 9 x 9 samples. sRGB 0..1 [H, W, 3]."""
    k = 9
    fine = Camera(k * target.width, k * target.height, k * target.fx, k * target.fy, k * target.cx, k * target.cy)
    mean = light(fine.pixel_rays()).reshape(target.height, k, target.width, k, 3).mean((1, 3))
    return srgb_from_linear(mean)


@settings(max_examples=6, deadline=None)
@given(
    st.sampled_from([(320, 240, 290.0), (200, 260, 230.0)]),
    st.floats(-0.04, 0.04),
    st.floats(-0.03, 0.03),
    st.tuples(st.floats(-0.12, 0.08), st.floats(-0.03, 0.03), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3)),
)
def test_is_what_the_policys_pinhole_sees(size, right, down, distortion):
    width, height, focal = size
    shift = 0.1 * min(width, height)
    camera = Camera(width, height, focal, 1.01 * focal, width / 2 + right * shift, height / 2 + down * shift, distortion)
    found = Rectifier(camera, TARGET)(photo(camera))
    # Rounding alone is 0.29 of a level; half a pixel beside the place it would be 0.55.
    error = (found - 255.0 * by_pinhole(TARGET))[1:-1, 1:-1]
    assert np.sqrt((error**2).mean()) < 0.36
    assert np.abs(error).max() < 1.2
    assert found.dtype == np.uint8
    assert found.shape == (64, 64, 3)


def test_the_field_of_view_of_a_realsense_is_cropped_from_the_middle():
    """640 x 480 px at 42.5 degrees of height: columns 80 to 560, 7.5 px each, by plain averaging."""
    camera = wrist_camera(480)
    camera = Camera(640, 480, camera.fx, camera.fy, 320.0, 240.0)
    rng = np.random.default_rng(0)
    blocks = rng.integers(0, 256, (32, 32, 3)).repeat(15, 0).repeat(15, 1).astype(np.uint8)
    image = np.full((480, 640, 3), 255, np.uint8)
    image[:, 80:560] = blocks
    found = Rectifier(camera, TARGET)(image)
    # Each block of 15 px is two pixels wide; interpolation blurs the edges of blocks by half a source pixel.
    expected = blocks[::15, ::15].repeat(2, 0).repeat(2, 1)
    assert np.abs(found.astype(int) - expected).mean() < 6
    assert 2 * np.arctan(0.5 * 480 / camera.fx) == pytest.approx(FIELD_OF_VIEW)


def test_light_is_averaged_not_code_values():
    camera = wrist_camera(512)
    image = np.zeros((512, 512, 3), np.uint8)
    image[::2] = 255
    half = 255 * srgb_from_linear(np.array(0.5))
    np.testing.assert_allclose(Rectifier(camera, TARGET)(image), half, atol=1.0)
    assert linear_from_srgb(half / 255) == pytest.approx(0.5)


def test_the_policys_own_camera_passes_bit_by_bit():
    image = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    np.testing.assert_array_equal(Rectifier(wrist_camera(64), TARGET)(image), image)


@pytest.mark.parametrize(
    ("camera", "problem"),
    [
        (Camera(640, 480, 700.0, 700.0, 320.0, 240.0), "misses"),
        (Camera(640, 480, 612.0, 612.0, 420.0, 280.0), "misses"),
        (Camera(640, 480, 400.0, 400.0, 320.0, 240.0, (-2.5, 0.0, 0.0, 0.0)), "folds"),
    ],
)
def test_a_camera_that_sees_too_little_is_refused(camera, problem):
    with pytest.raises(InputError, match=problem):
        Rectifier(camera, TARGET)


def test_a_picture_of_another_kind_is_refused():
    rectify = Rectifier(Camera(640, 480, 612.0, 612.0, 320.0, 240.0), TARGET)
    for wrong in (np.zeros((480, 640, 3)), np.zeros((480, 640), np.uint8), np.zeros((640, 480, 3), np.uint8)):
        with pytest.raises(InputError, match="intrinsics"):
            rectify(wrong)
