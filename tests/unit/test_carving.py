"""Carving against analytic solids."""

import cv2
import numpy as np
import pytest
import trimesh
from scipy import ndimage
from table_scene import CENTRE, RADIUS, cameras, trace

from gsbridge.cameras import Camera, look_at
from gsbridge.photogrammetry.carving import (
    Grid,
    Silhouette,
    carve,
    largest_component,
    mesh_depth,
    mesh_of_field,
    signed_distances,
)

CAMERA = Camera(160, 120, 184.0, 184.0, 80.0, 60.0)


def sphere_field(grid, centre, radius):
    return (radius - np.linalg.norm(grid.points() - centre, axis=1)).reshape(grid.shape)


@pytest.mark.parametrize("threads", [1, 2])
def test_distances_are_exact_whatever_the_threads(threads):
    """Not a bit off scipy's, which are roots of whole numbers; with cv2's own roots hulls differed by threads."""
    rng = np.random.default_rng(0)
    mask = ndimage.gaussian_filter(rng.random((311, 407)), 9) > 0.5
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    try:
        found = signed_distances(mask)
    finally:
        cv2.setNumThreads(before)
    within, beyond = (ndimage.distance_transform_edt(part).astype(np.float32) for part in (mask, ~mask))
    np.testing.assert_array_equal(found, np.where(mask, within - np.float32(0.5), np.float32(0.5) - beyond), strict=True)


def test_signed_distance_of_a_disc():
    y, x = np.mgrid[:80, :100] + 0.5
    radius = np.hypot(x - 50, y - 40)
    distances = signed_distances(radius < 25)
    assert np.abs(distances - (25 - radius)).max() < 0.8
    near = np.abs(25 - radius) < 4
    assert abs((distances - (25 - radius))[near].mean()) < 0.15


def test_grid_covers_its_box():
    grid = Grid.covering([0, 0, 0], [1.0, 0.5, 0.25], 0.1)
    assert grid.shape == (11, 6, 4)
    points = grid.points().reshape(*grid.shape, 3)
    np.testing.assert_allclose(points[3, 2, 1], [0.3, 0.2, 0.1])


@pytest.fixture(scope="module")
def ball_silhouettes():
    views = cameras(24, CAMERA)
    # The whole ball, without the table that cuts it: every line of sight nearer to the centre than the radius.
    out = []
    for view in views:
        rays = CAMERA.pixel_rays() @ view.cam_from_table[:3, :3]
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        reach = np.linalg.norm(np.cross(rays, CENTRE - view.centre), axis=-1)
        out.append(Silhouette(signed_distances(reach < RADIUS), CAMERA, view.cam_from_table))
    return out


def test_hull_holds_the_ball_and_touches_it_where_seen(ball_silhouettes):
    grid = Grid.covering(CENTRE - 0.045, CENTRE + 0.045, 0.0015)
    mesh = mesh_of_field(grid, carve(grid, ball_silhouettes, vote=1.0))
    radius = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    assert radius.min() > RADIUS - 0.001
    # Lines of sight from 25 to 55 degrees touch the ball at 35 to 65 degrees on either side of its equator.
    latitude = np.degrees(np.arcsin((mesh.vertices[:, 2] - CENTRE[2]) / radius))
    assert np.percentile(radius[np.abs(latitude - 48) < 10], 90) < RADIUS + 0.0015


def test_a_wrong_silhouette_is_outvoted(ball_silhouettes):
    grid = Grid.covering(CENTRE - 0.045, CENTRE + 0.045, 0.002)
    broken = list(ball_silhouettes)
    broken[5] = Silhouette(np.full_like(broken[5].distances, -50.0), CAMERA, broken[5].cam_from_table)
    assert mesh_of_field(grid, carve(grid, broken, vote=1.0)) is None
    kept = carve(grid, broken, vote=0.93)
    full = carve(grid, ball_silhouettes, vote=1.0)
    assert (kept > 0).sum() >= (full > 0).sum()


@pytest.mark.parametrize("percent", [95, 90, 85, 80, 75, 70, 60])
@pytest.mark.parametrize("count", [5, 10, 20])
def test_as_many_silhouettes_may_be_wrong_as_the_vote_says(percent, count):
    """In whole numbers: of `count` views all but a share of `percent` may contradict a point, and not one more."""
    grid = Grid(np.full(3, -0.01), 0.01, (3, 3, 3))
    views = [look_at((np.cos(a), np.sin(a), 0.5), np.zeros(3)) for a in np.linspace(0, 2 * np.pi, count, endpoint=False)]
    allowed = (100 - percent) * count // 100
    for wrong in (allowed, allowed + 1):
        outlines = [np.full((120, 160), -5.0 if index < wrong else 20.0, np.float32) for index in range(count)]
        silhouettes = [Silhouette(outline, CAMERA, view) for outline, view in zip(outlines, views, strict=True)]
        assert (carve(grid, silhouettes, vote=percent / 100)[1, 1, 1] > 0) == (wrong == allowed)


def test_coarse_pass_changes_nothing_near_the_surface(ball_silhouettes):
    grid = Grid.covering(CENTRE - 0.05, CENTRE + 0.05, 0.002)
    fast = carve(grid, ball_silhouettes, vote=0.9)
    slow = carve(grid, ball_silhouettes, vote=0.9, coarse=False, threads=2)
    assert np.array_equal(fast > 0, slow > 0)
    near = np.abs(slow) < 0.004
    np.testing.assert_array_equal(fast[near], slow[near])


def test_points_outside_all_pictures_are_outside(ball_silhouettes):
    grid = Grid.covering(CENTRE + 10.0, CENTRE + 10.02, 0.002)
    assert (carve(grid, ball_silhouettes, vote=0.5) < 0).all()


def test_surface_of_a_field_is_a_closed_sphere():
    grid = Grid.covering([-0.05] * 3, [0.05] * 3, 0.002)
    mesh = mesh_of_field(grid, sphere_field(grid, np.zeros(3), 0.04))
    reference = mesh.trimesh()
    assert reference.is_watertight
    assert reference.is_winding_consistent
    assert reference.volume == pytest.approx(4 / 3 * np.pi * 0.04**3, rel=0.01)
    # A solid that leaves the grid is closed at the grid's border.
    cut = mesh_of_field(grid, sphere_field(grid, np.array([0.05, 0, 0]), 0.04))
    assert cut.trimesh().is_watertight


def test_component_with_the_seeds_is_kept():
    grid = Grid.covering([-0.06] * 3, [0.06] * 3, 0.003)
    field = np.maximum(sphere_field(grid, np.array([0.03, 0, 0]), 0.025), sphere_field(grid, np.array([-0.04, 0, 0]), 0.012))
    seeds = (np.array([[-0.04, 0, 0.0]]) - grid.origin) / grid.spacing
    big, small = largest_component(field), largest_component(field, seeds)
    x = grid.points().reshape(*grid.shape, 3)[..., 0]
    assert (x[big > 0] > 0).all()
    assert (x[small > 0] < 0).all()


def test_mesh_depth_is_the_depth_of_the_ball():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    view = cameras(3, CAMERA)[1]
    depth = mesh_depth(ball.vertices + CENTRE, np.asarray(ball.faces), CAMERA, view.cam_from_table)
    _, true, on = trace(view)
    both = np.isfinite(depth) & on
    assert both.sum() > 0.97 * on.sum()
    assert np.abs(depth - true)[both].max() < 5e-4
