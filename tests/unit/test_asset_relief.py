"""Objects that stand up from a table, found on height fields made here."""

import numpy as np
import pytest

from gsbridge.asset.relief import COLLISION_FACES, Relief, find_relief, simplified
from gsbridge.meshes import Mesh


def table(*bumps, size: float = 0.5, step: float = 0.005) -> Mesh:
    """A height field; each bump is a function of x and y, m."""
    x = np.arange(-size, size, step)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    height = np.max([np.zeros(len(grid)), *(bump(*grid.T) for bump in bumps)], axis=0)
    count = len(x)
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate([np.c_[a, a + count, a + 1], np.c_[a + 1, a + count, a + count + 1]])
    return Mesh(np.c_[grid, height], faces)


def plate(x0: float, y0: float, radius: float = 0.10):
    """Flat middle at 4 mm, a rim that rises to 20 mm."""

    def height(x, y):
        r = np.hypot(x - x0, y - y0)
        return np.where(r < radius, 0.004 + 0.016 * np.clip((r / radius - 0.5) / 0.5, 0, 1), 0.0)

    return height


def test_plate_is_found_with_place_size_and_height():
    relief, surface = find_relief(table(plate(0.1, -0.05)))
    assert (relief.x, relief.y) == pytest.approx((0.1, -0.05), abs=1e-3)
    assert relief.radius == pytest.approx(0.10, abs=4e-3)
    assert relief.height == pytest.approx(0.004, abs=5e-4)
    assert relief.highest == pytest.approx(0.02, abs=1e-3)
    # The part keeps its foot on the table, and nothing far away.
    assert surface.vertices[:, 2].min() == 0.0
    assert np.hypot(*(surface.vertices[:, :2] - [0.1, -0.05]).T).max() < 0.125
    assert surface.faces.max() == len(surface.vertices) - 1


def test_the_larger_of_two_is_taken():
    relief, _ = find_relief(table(plate(-0.2, 0.0, 0.05), plate(0.2, 0.1, 0.12)))
    assert relief.x == pytest.approx(0.2, abs=2e-3)


@pytest.mark.parametrize("bumps", [(), (lambda x, y: 0.002 * np.cos(9 * x),), (plate(0.0, 0.0, 0.02),)])
def test_unevenness_and_crumbs_are_no_relief(bumps):
    assert find_relief(table(*bumps)) is None


def test_from_a_record():
    relief = Relief(0.1, 0.2, 0.1, 0.004, 0.02)
    assert Relief.from_json({"x": 0.1, "y": 0.2, "radius": 0.1, "height": 0.004, "highest": 0.02}) == relief
    assert Relief.from_json(None) is None
    with pytest.raises(TypeError):
        Relief.from_json({"x": 0.1})


def test_the_body_has_few_triangles_and_stays_where_the_surface_is():
    surface = find_relief(table(plate(0.1, -0.05), step=0.003))[1]
    body = simplified(surface)
    assert len(surface.faces) > 3 * COLLISION_FACES >= 3 * len(body.faces)
    x, y, z = body.vertices.T
    # The rim falls off steeply, which a height cannot tell.
    inside = np.hypot(x - 0.1, y + 0.05) < 0.09
    assert inside.sum() > 20
    np.testing.assert_allclose(z[inside], plate(0.1, -0.05)(x, y)[inside], atol=5e-4)


def test_a_surface_of_few_triangles_stays_as_it_is():
    surface = find_relief(table(plate(0.0, 0.0), step=0.02))[1]
    assert simplified(surface) is surface
