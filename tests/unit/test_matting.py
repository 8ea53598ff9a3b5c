"""Unmixing of outlines, on discs whose coverage is known from supersampling."""

import cv2
import numpy as np
import pytest

from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.photogrammetry.matting import estimate_alpha, unmix

SIZE, FINE = 96, 8


def disc(centre=(48.3, 47.6), radius=25.4):
    """Coverage of a disc by area, 0..1. [H, W]."""
    y, x = (np.mgrid[0 : SIZE * FINE, 0 : SIZE * FINE] + 0.5) / FINE
    inside = (np.hypot(x - centre[0], y - centre[1]) < radius).astype(np.float32)
    return cv2.resize(inside, (SIZE, SIZE), interpolation=cv2.INTER_AREA)


def composed(alpha, front, back, noise=0.0):
    """sRGB photo of a mixture in linear light. [H, W, 3] uint8."""
    rng = np.random.default_rng(0)
    linear = alpha[..., None] * np.array(front) + (1 - alpha[..., None]) * np.array(back)
    linear = np.clip(linear + noise * rng.normal(size=linear.shape), 0, 1)
    return np.rint(255 * srgb_from_linear(linear)).astype(np.uint8)


FRONT, BACK = (0.5, 0.06, 0.05), (0.25, 0.28, 0.33)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_share_follows_the_colours(noise):
    alpha = disc()
    found = estimate_alpha(composed(alpha, FRONT, BACK, noise), (alpha > 0.5).astype(np.float32))
    outline = (alpha > 0) & (alpha < 1)
    hard = np.abs((alpha > 0.5) - alpha)[outline].mean()
    assert np.abs(found - alpha)[outline].mean() < 0.4 * hard
    np.testing.assert_array_equal(found[np.abs(alpha - 0.5) == 0.5] > 0.5, alpha[np.abs(alpha - 0.5) == 0.5] > 0.5)


def test_mask_that_is_half_a_pixel_off_is_pulled_back():
    alpha, shifted = disc(), disc((48.8, 47.6))
    found = estimate_alpha(composed(alpha, FRONT, BACK), (shifted > 0.5).astype(np.float32))
    outline = (alpha > 0) & (alpha < 1) | (np.abs(shifted - alpha) > 0)
    assert np.abs(found - alpha)[outline].mean() < 0.7 * np.abs((shifted > 0.5) - alpha)[outline].mean()


def test_equal_colours_leave_the_smooth_outline():
    alpha = disc()
    found = estimate_alpha(composed(alpha, FRONT, FRONT), (alpha > 0.5).astype(np.float32))
    outline = (alpha > 0) & (alpha < 1)
    assert np.abs(found - alpha)[outline].mean() < 0.2
    assert found.sum() == pytest.approx(alpha.sum(), rel=0.01)


def test_unmixing_takes_the_background_off_the_rim():
    alpha = disc()
    photo = composed(alpha, FRONT, BACK)
    clean = unmix(photo, alpha)
    rim = (alpha > 0.2) & (alpha < 1)
    wanted = srgb_from_linear(np.array(FRONT)) * 255
    before = np.abs(photo[rim] - wanted).mean()
    assert np.abs(clean[rim] - wanted).mean() < 0.15 * before
    np.testing.assert_array_equal(clean[alpha == 1], photo[alpha == 1])
    np.testing.assert_array_equal(clean[alpha == 0], photo[alpha == 0])


def test_mixture_is_kept():
    """What is unmixed, mixed again with the true background, is the photo."""
    alpha = disc()
    photo = composed(alpha, FRONT, BACK)
    rim = alpha > 0.2
    linear = linear_from_srgb(unmix(photo, alpha).astype(np.float64) / 255)
    again = alpha[..., None] * linear + (1 - alpha[..., None]) * np.array(BACK)
    assert np.abs(255 * srgb_from_linear(again) - photo)[rim].max() < 4


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_masks_without_an_outline_stay(value):
    mask = np.full((20, 30), value, np.float32)
    photo = np.full((20, 30, 3), 90, np.uint8)
    np.testing.assert_array_equal(estimate_alpha(photo, mask), mask)
    np.testing.assert_array_equal(unmix(photo, mask), photo)
