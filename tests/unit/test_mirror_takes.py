"""Takes of a film: where the pixels of a turned phone lie, a walk at one height, exposures that change."""

from __future__ import annotations

import numpy as np
import pytest

from gsbridge.cameras import camera_centre
from gsbridge.configuration.films import FilmSettings
from gsbridge.errors import InputError
from gsbridge.reality.mirror.film import DENSE, film_scene
from gsbridge.reality.mirror.lens import PhoneLens, phone
from gsbridge.reality.mirror.takes import take_camera, take_gains, take_path

HEIGHT = 0.09


def _poses(take):
    return take_path(take, 24, HEIGHT, np.random.default_rng(3))


def _project(camera, pose, points):
    return camera.project(points @ pose[:3, :3].T + pose[:3, 3])


def test_a_portrait_camera_is_the_phone_turned_by_a_quarter():
    """What the level phone sees at (u, v) of a scene that lies on its side, the upright one sees at (H - v, u)."""
    level, upright = take_camera(None, 640, 480), take_camera("portrait", 640, 480)
    assert (upright.width, upright.height) == (480, 640)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (200, 3)) + np.array([0, 0, 1.0])
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    seen = level.project(points)
    np.testing.assert_allclose(
        upright.project(points @ quarter.T), np.stack([480 - seen[:, 1], seen[:, 0]], axis=-1), atol=1e-9
    )


def test_a_turned_film_shows_the_same_walk_on_its_side():
    plain, aside = _poses(None), _poses("turned")
    np.testing.assert_allclose(camera_centre(aside), camera_centre(plain), atol=1e-12)
    assert np.allclose(np.linalg.det(aside[:, :3, :3]), 1)
    camera = phone(640, 480)
    for pose in aside:
        foot, head = _project(camera, pose, np.array([[0.0, 0.185, 0.0], [0.0, 0.185, 0.1]]))
        assert abs(head[0] - foot[0]) > 5 * abs(head[1] - foot[1])


def test_a_walk_at_one_height_stays_there():
    for take, spread in (("one_height", 4.0), (None, 20.0)):
        ways = camera_centre(_poses(take)) - [0.0, 0.66 * 0.185, 0.35 * HEIGHT]
        elevation = np.degrees(np.arcsin(ways[:, 2] / np.linalg.norm(ways, axis=1)))
        assert (np.ptp(elevation) < spread + 4) == (take == "one_height")
    np.testing.assert_array_equal(_poses("re_exposing"), _poses(None))


def test_exposures_change_and_stay_within_what_a_phone_does():
    np.testing.assert_array_equal(take_gains(None, 5, np.random.default_rng(0)), np.ones((5, 3)))
    for seed in range(5):
        gains = take_gains("re_exposing", 40, np.random.default_rng(seed))
        stops = np.log2(gains[:, 1])
        assert 0.4 < np.ptp(stops) <= 1.1 + 1e-9
        assert np.abs(np.log2(gains[:, ::2] / gains[:, 1:2])).max() < 0.08


def test_exposure_scales_linear_light():
    lens = PhoneLens.of(phone(64, 48))
    grey = np.full((lens.pinhole.height, lens.pinhole.width, 3), 0.2, np.float32)
    photo = lens.expose(grey, np.random.default_rng(0), np.array([1.0, 0.5, 2.0])).astype(float) / 255
    linear = np.where(photo <= 0.04045, photo / 12.92, ((photo + 0.055) / 1.055) ** 2.4).mean((0, 1))
    np.testing.assert_allclose(linear, [0.2, 0.1, 0.4], atol=0.004)


@pytest.mark.parametrize("scene", ["foam_pad", DENSE])
def test_tables_and_the_dense_film_have_no_takes(tmp_path, scene):
    out = (tmp_path / "frames", tmp_path / "film.json", tmp_path / "truth")
    with pytest.raises(InputError, match="has no takes"):
        film_scene(scene, FilmSettings(), *out, state=tmp_path / "state", threads=1, seed=1, take="turned")
