"""The mirror's lens: its warp against OpenCV's projection, its exposure against the sensor it states."""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.images import srgb_from_linear
from gsbridge.reality.mirror.lens import SENSOR_NOISE, PhoneLens, phone


def test_phone_keeps_its_field_of_view_at_every_size():
    large, small = phone(640, 480), phone(320, 240)
    assert np.isclose(np.degrees(2 * np.arctan(320 / large.fx)), 62.0)
    assert np.isclose(small.fx * 2, large.fx)
    assert np.isclose(small.cx * 2, large.cx)
    assert small.distortion == large.distortion


def test_warp_is_the_projection_of_opencv():
    lens = PhoneLens.of(phone(640, 480))
    film, pinhole = lens.film, lens.pinhole
    rays = np.stack(
        [(lens.x + 0.5 - pinhole.cx) / pinhole.fx, (lens.y + 0.5 - pinhole.cy) / pinhole.fy, np.ones_like(lens.x)], axis=-1
    ).astype(np.float64)
    pixels, _ = cv2.projectPoints(
        rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), film.intrinsics, np.array(film.distortion, dtype=np.float64)
    )
    pixels = pixels.reshape(480, 640, 2)
    u, v = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    assert np.abs(pixels - np.stack([u, v], axis=-1)).max() < 1e-3
    # The distortion is one that matters: without it the corners would be off by pixels.
    straight = rays[..., :2] * [film.fx, film.fy] + [film.cx, film.cy]
    assert np.abs(straight - np.stack([u, v], axis=-1)).max() > 3


def test_warp_keeps_a_linear_ramp_and_stays_inside():
    lens = PhoneLens.of(phone(320, 240))
    h, w = lens.pinhole.height, lens.pinhole.width
    assert lens.x.min() > 4
    assert lens.y.min() > 4
    assert lens.x.max() < w - 5
    assert lens.y.max() < h - 5
    ramp = np.tile(np.arange(w, dtype=np.float32), (h, 1))
    assert np.abs(lens.warp(ramp) - lens.x).max() < 0.06  # OpenCV interpolates at steps of 1/32 px


def test_exposure_encodes_and_adds_the_stated_noise():
    lens = PhoneLens.of(phone(320, 240))
    grey = np.full((lens.pinhole.height, lens.pinhole.width, 3), 0.2, np.float32)
    photo = lens.expose(grey, np.random.default_rng(1))
    assert photo.dtype == np.uint8
    assert abs(photo.mean() / 255 - srgb_from_linear(np.array(0.2))) < 2e-4
    expected = np.sqrt((255 * SENSOR_NOISE) ** 2 + 1 / 12)  # noise and rounding
    assert abs(photo.std() - expected) < 0.05
    assert np.array_equal(photo, lens.expose(grey, np.random.default_rng(1)))
    assert lens.expose(10 * grey, np.random.default_rng(1)).min() > 250
