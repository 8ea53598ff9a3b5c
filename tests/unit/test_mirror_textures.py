"""Noise of the mirror: repeatable, smooth, without period, and of the strength it promises."""

from __future__ import annotations

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.reality.mirror.backgrounds import TABLE_SIZE_M, make_plate, table_texture
from gsbridge.reality.mirror.textures import blend, cells, octaves, paint_strokes, pick, plane_noise, step, value_noise


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-0.1, 0.1, (4000, 3))


def test_value_noise_depends_on_place_and_seed_only(points):
    whole = value_noise(points, 5e-3, 3)
    assert np.array_equal(whole[::-1], value_noise(points[::-1], 5e-3, 3))
    assert np.abs(whole).max() <= 1
    assert abs(np.corrcoef(whole, value_noise(points, 5e-3, 4))[0, 1]) < 0.1


def test_value_noise_is_smooth_and_has_no_period(points):
    cell = 5e-3
    near = value_noise(points + np.array([1e-6, 0, 0]), cell, 3) - value_noise(points, cell, 3)
    assert np.abs(near).max() < 5e-3
    for shift in (3, 8, 16, 64):
        moved = value_noise(points + np.array([shift * cell, 0, 0]), cell, 3)
        assert abs(np.corrcoef(moved, value_noise(points, cell, 3))[0, 1]) < 0.15


def test_octaves_have_unit_deviation(points):
    assert 0.7 < octaves(points, 10e-3, 4, 1).std() < 1.3


def test_cells_agree_with_a_search_among_all_points():
    p = np.random.default_rng(1).uniform(0, 0.02, (300, 3))
    nearest, second, name = cells(p, 4e-3, 5)
    assert (nearest <= second).all()
    # Points of one cell share its name, and its centre: two points nearer to each other than to any border share a cell.
    twin = cells(p + 1e-9, 4e-3, 5)
    assert np.allclose(twin[0], nearest, atol=1e-5)
    assert np.array_equal(twin[2], name)
    # The distance to the nearest feature point is 1-Lipschitz (in cells).
    far = cells(p[::-1], 4e-3, 5)[0]
    assert (np.abs(nearest - far) <= np.linalg.norm(p - p[::-1], axis=1) / 4e-3 + 1e-9).all()


def test_blend_step_and_pick():
    assert np.allclose(blend(np.zeros((3, 3)), [1, 1, 1], np.array([-1, 0.25, 2])), [[0] * 3, [0.25] * 3, [1] * 3])
    assert step(np.array([0.0, 1.0, 2.0]), 1.0, 0.5).tolist() == [0.0, 0.5, 1.0]
    assert pick([[0, 0, 0], [1, 1, 1]], np.array([0.1, 0.9, 1.0])).tolist() == [[0] * 3, [1] * 3, [1] * 3]


def test_strokes_stay_within_their_length():
    grid = np.stack(np.meshgrid(np.linspace(0, 0.02, 81), np.linspace(0, 0.02, 81), [0.0]), axis=-1).reshape(-1, 3)
    normals = np.tile([0.0, 0, 1], (len(grid), 1))
    out = paint_strokes(
        np.zeros((len(grid), 3)),
        grid,
        normals,
        count=1,
        length=(4e-3, 4e-3),
        width=(1e-3, 1e-3),
        palette=[[1.0, 0, 0]],
        rng=np.random.default_rng(2),
    )
    painted = grid[out[:, 0] > 0.5]
    assert 10 < len(painted) < 200
    assert np.ptp(painted, axis=0).max() < 5.3e-3


def test_plane_noise_has_unit_variance_and_its_scale():
    for sigma in (1.0, 30.0):
        noise = plane_noise((400, 500), sigma, np.random.default_rng(0))
        assert noise.shape == (400, 500)
        assert 0.6 < noise.std() < 1.4
        shift = int(sigma)
        assert np.corrcoef(noise[:, :-shift].ravel(), noise[:, shift:].ravel())[0, 1] > 0.6


@pytest.mark.parametrize("name", ["foam_pad", "tablecloth"])
def test_tables_are_textured_everywhere_and_do_not_repeat(name):
    image = table_texture(name, 1)
    assert image.shape == (round(TABLE_SIZE_M[1] * 2000), round(TABLE_SIZE_M[0] * 2000), 3)
    assert image.min() > 0.0
    assert image.max() < 0.85
    grey = image.mean(-1)
    blocks = grey.reshape(20, 100, 24, 100).std(axis=(1, 3)) / grey.mean()
    assert blocks.min() > 0.04
    # Blocks a tenth of the table apart are different pictures, even on the checked cloth.
    first, second = grey[200:500, 200:500], grey[200:500, 504:804]
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] < 0.9


def test_unknown_background_is_refused():
    with pytest.raises(InputError, match="unknown"):
        table_texture("marble", 1)


def test_plate_is_closed_and_has_its_size():
    plate, normals = make_plate(1, detail=3.0)
    assert plate.is_watertight()
    assert plate.volume() > 0
    assert np.allclose(np.ptp(plate.vertices, axis=0)[:2], 0.2, atol=3e-3)
    assert np.isclose(plate.vertices[:, 2].max(), 0.02, atol=1e-3)
    assert plate.vertices[:, 2].min() == 0.0
    well = (np.hypot(plate.vertices[:, 0], plate.vertices[:, 1]) < 0.04) & (plate.vertices[:, 2] > 0.003)
    assert (normals[well, 2] > 0.99).all()
    assert plate.colours.min() > 0
    assert plate.colours.max() < 0.8
