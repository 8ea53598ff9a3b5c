"""Spheres for bodies, light from shadows, and pictures dimmed by them, against geometry by hand and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from gsbridge.cameras import Camera, look_at
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.scene.light import WIDTH, SkyLight, directions, fit_light
from gsbridge.scene.occlusion import moved, spheres_in, transmittances
from gsbridge.scene.shading import BARE, LANES, LIT, OWN, TILE, _gather, _light, tile_order
from gsbridge.scene.shadows import Shadows

UP = np.array([[0.0, 0.0, 1.0]])


def box(size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    import trimesh

    made = trimesh.creation.box(extents=size)
    return Mesh(np.asarray(made.vertices) + centre, np.asarray(made.faces))


def test_spheres_fill_a_box_and_stand_out_by_less_than_half_a_cell():
    found = spheres_in(box((0.10, 0.04, 0.04)), 12)
    inside = np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 3)) * (0.10, 0.04, 0.04)
    held = (np.linalg.norm(inside[:, None] - found[None, :, :3], axis=-1) < found[:, 3]).any(1)
    # Balls leave the edges and corners of a box.
    assert held.mean() > 0.7
    assert (np.abs(found[:, 1:3]) + found[:, 3:] < 0.02 + 0.004).all()
    assert len(found) <= 12


def test_a_mesh_without_an_inside_gives_no_spheres():
    flat = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    assert spheres_in(flat, 5).shape == (0, 4)


def test_spheres_move_with_their_body():
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = 1, 2, 3
    np.testing.assert_allclose(moved(np.array([[1.0, 0, 0, 0.5]]), turn), [[1.0, 3.0, 3.0, 0.5]])


def blocked_by_rays(sphere: Array, width: float) -> float:
    """Share of a disc of directions round straight up that a sphere hides from the origin: many rays."""
    rng = np.random.default_rng(1)
    radius, heading = width * np.sqrt(rng.uniform(size=40000)), rng.uniform(0, 2 * np.pi, 40000)
    rays = np.stack([np.tan(radius) * np.cos(heading), np.tan(radius) * np.sin(heading), np.ones_like(radius)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along = rays @ sphere[:3]
    return float((sphere[:3] @ sphere[:3] - along**2 < sphere[3] ** 2).mean())


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 0.15), st.floats(0.1, 0.6), st.floats(0.01, 0.08))
def test_what_a_sphere_hides_of_a_small_lamp_is_what_rays_say(aside, height, radius):
    sphere = np.array([aside, 0.0, height, radius])
    found = 1.0 - float(transmittances(np.zeros((1, 3)), sphere[None], UP, WIDTH)[0, 0])
    # A straight ramp stands for the true curve of a disc behind a disc.
    assert found == pytest.approx(blocked_by_rays(sphere, WIDTH), abs=0.13)


def test_what_lies_behind_or_holds_a_point_does_not_shade_it():
    behind = np.array([[0.0, 0.0, -0.3, 0.1]])
    around = np.array([[0.0, 0.0, 0.05, 0.1]])
    for spheres in (behind, around):
        assert transmittances(np.zeros((1, 3)), spheres, UP, WIDTH)[0, 0] == 1.0


def hidden_light() -> SkyLight:
    shares = np.zeros(len(directions()))
    shares[[0, 9, 20]] = 0.3, 0.4, 0.2
    return SkyLight(0.1, shares)


def table_points() -> Array:
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 60), np.linspace(-0.2, 0.2, 60))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def test_the_light_is_found_from_the_shadow_of_a_box():
    light, spheres = hidden_light(), spheres_in(box((0.06, 0.06, 0.08), (0, 0, 0.04)), 40)
    through = transmittances(table_points(), spheres, directions(), WIDTH)
    rng = np.random.default_rng(2)
    ratios = light.floor + through @ light.shares + 0.05 * rng.standard_normal(len(through))
    # A pattern's edges that do not fall on each other.
    ratios[::50] += rng.uniform(0.5, 1.5, len(ratios[::50]))
    found, scatter = fit_light(through, ratios)
    assert found.floor + found.shares.sum() == pytest.approx(1.0)
    assert scatter == pytest.approx(0.05, rel=0.2)
    outside = np.linalg.norm(table_points()[:, :2], axis=1) > 0.05
    said, true = (one.floor + through @ one.shares for one in (found, light))
    assert np.abs(said - true)[outside].max() < 0.05
    assert found.shares[[0, 9, 20]].sum() > 0.75


def test_too_few_places_are_refused():
    with pytest.raises(InputError, match="Film it from more sides"):
        fit_light(np.ones((20, len(directions()))), np.ones(20))


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"floor": 0.1, "shares": [1.0]},
        {"floor": 30.0, "shares": [-1.0] * 29},
        {"floor": float("nan"), "shares": [0.0] * 29},
        {"floor": 0.5, "shares": [0.0] * 29},
    ],
)
def test_a_damaged_light_is_refused(content):
    with pytest.raises(InputError, match=r"light\.json"):
        SkyLight.of(content, "light.json")


def flat_picture(camera: Camera, cam_from_table: Array, height: float = 0.0) -> tuple[Array, Array, Array]:
    """Grey picture, summed depth and alpha of a level plane that fills the view."""
    table_from_cam = np.linalg.inv(cam_from_table)
    rays = camera.pixel_rays() @ table_from_cam[:3, :3].T
    depths = ((height - table_from_cam[2, 3]) / rays[..., 2]).astype(np.float32)
    shape = (camera.height, camera.width)
    return np.full((*shape, 3), 0.5, np.float32), depths, np.ones(shape, np.float32)


def test_a_pixel_is_as_dark_as_the_light_that_its_place_still_gets():
    """Every pixel of a table under a ball, against the transmittances of its own point and sRGB's own curve."""
    from gsbridge.images import linear_from_srgb

    camera = Camera(96, 96, 120.0, 120.0, 48.0, 48.0)
    pose = look_at(np.array([0.02, -0.05, 0.5]), np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    ball, light = np.array([[0.0, 0.0, 0.12, 0.05]]), hidden_light()
    image, depths, alphas = flat_picture(camera, pose)
    Shadows(light, {"link": ball}, ("object", np.zeros((0, 4)))).dim(
        image, depths, alphas, camera, pose, {"link": np.eye(4), "object": np.eye(4)}
    )
    table_from_cam = np.linalg.inv(pose)
    points = depths[..., None] * camera.pixel_rays() @ table_from_cam[:3, :3].T + table_from_cam[:3, 3]
    through = transmittances(points.reshape(-1, 3), ball, directions(), WIDTH)
    wanted = (light.floor + through @ light.shares).reshape(96, 96)
    found = linear_from_srgb(image[..., 0].astype(np.float64)) / linear_from_srgb(np.array(0.5))
    assert wanted.min() < 0.6
    assert wanted.max() > 0.99
    # The grid blurs edges of shadows.
    assert np.abs(found - wanted).mean() < 0.01
    assert np.quantile(np.abs(found - wanted), 0.99) < 0.08


def test_what_stands_far_below_the_object_is_shaded_and_the_robot_is_left_alone():
    camera = Camera(64, 64, 60.0, 60.0, 32.0, 32.0)
    pose = look_at(np.array([0.0, -0.01, 0.5]), np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    ball, far = np.array([[0.0, 0.0, 0.2, 0.03]]), np.array([[5.0, 5.0, 5.0, 0.01]])
    poses = {"link": np.eye(4), "object": np.eye(4)}

    def darkest(height: float, robot: Array, item: Array) -> float:
        image, depths, alphas = flat_picture(camera, pose, height)
        Shadows(hidden_light(), {"link": robot}, ("object", item)).dim(image, depths, alphas, camera, pose, poses)
        return float(image.min())

    assert darkest(0.0, far, ball) < 0.45
    # A plate, for instance.
    assert darkest(0.05, far, ball) < 0.45
    assert darkest(0.05, ball, far) < 0.45
    # A surface inside the robot's spheres is the robot.
    assert darkest(0.05, np.array([[0.0, 0.0, 0.05, 3.0]]), far) == pytest.approx(0.5, abs=1e-6)


def test_what_is_not_drawn_stays_as_it_is():
    camera = Camera(64, 64, 60.0, 60.0, 32.0, 32.0)
    pose = look_at(np.array([0.0, -0.01, 0.5]), np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    image, depths, alphas = flat_picture(camera, pose)
    alphas[:, :32], depths[:, :32] = 0.0, 0.0
    ball = np.array([[0.0, 0.0, 0.2, 0.03]])
    Shadows(hidden_light(), {"link": ball}, ("object", np.zeros((0, 4)))).dim(
        image, depths, alphas, camera, pose, {"link": np.eye(4), "object": np.eye(4)}
    )
    np.testing.assert_array_equal(image[:, :32], 0.5)
    assert np.isfinite(image).all()
    assert image[:, 34:].min() < 0.45


def test_a_box_shades_the_table_but_not_its_own_sides():
    """The splats of an object carry its own shade; only its outline may take some of the table's."""
    camera = Camera(128, 128, 164.0, 164.0, 64.0, 64.0)
    pose = look_at(np.array([0.02, -0.12, 0.25]), np.array([0.0, 0.0, 0.02]), np.array([0.0, 1.0, 0.0]))
    table_from_cam = np.linalg.inv(pose)
    rays, eye = camera.pixel_rays() @ table_from_cam[:3, :3].T, table_from_cam[:3, 3]
    low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.06])
    ends = np.sort(np.stack([(low - eye) / rays, (high - eye) / rays]), axis=0)
    enter, leave = ends[0].max(-1), ends[1].min(-1)
    hit = enter < leave
    depths = np.where(hit, enter, -eye[2] / rays[..., 2]).astype(np.float32)
    image = np.full((128, 128, 3), 0.5, np.float32)
    spheres = spheres_in(box((0.06, 0.06, 0.06), (0, 0, 0.03)), 40)
    Shadows(hidden_light(), {"link": np.array([[5.0, 5.0, 5.0, 0.01]])}, ("object", spheres)).dim(
        image, depths, np.ones((128, 128), np.float32), camera, pose, {"link": np.eye(4), "object": np.eye(4)}
    )
    inside = ndimage.binary_erosion(hit, iterations=2)
    assert hit.sum() > 2000
    assert np.quantile(image[inside][:, 0], 0.02) > 0.47
    assert image[inside].mean() > 0.495
    assert image[~hit].min() < 0.42


def test_a_light_of_another_robot_is_refused():
    camera, pose = (
        Camera(64, 64, 60.0, 60.0, 32.0, 32.0),
        look_at(np.array([0.0, -0.01, 0.5]), np.zeros(3), np.array([0.0, 1.0, 0.0])),
    )
    image, depths, alphas = flat_picture(camera, pose)
    shadows = Shadows(hidden_light(), {"wrist": np.array([[0.0, 0, 0.2, 0.03]])}, ("object", np.zeros((0, 4))))
    with pytest.raises(InputError, match="wrist is no body of this world"):
        shadows.dim(image, depths, alphas, camera, pose, {"object": np.eye(4)})


@given(seed=st.integers(0, 10_000), rows=st.integers(1, 11), columns=st.integers(1, 11), robot=st.integers(0, 19))
@settings(max_examples=60, deadline=None)
def test_light_in_tiles_is_the_sum_over_all_spheres(seed, rows, columns, robot):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-0.2, -0.2, 0.0), (0.2, 0.2, 0.05), (rows * columns, 3)).astype(np.float32)
    spheres = np.concatenate([rng.uniform((-0.3, -0.3, 0.0), (0.3, 0.3, 0.4), (19, 3)), rng.uniform(0.005, 0.06, (19, 1))], 1)
    spheres, sources = spheres.astype(np.float32), directions()[::7].astype(np.float32)
    shares, kinds = (
        rng.uniform(size=len(sources)).astype(np.float32),
        rng.choice([BARE, OWN, LIT], len(points)).astype(np.int8),
    )
    order = tile_order(rows, columns)
    tiles = len(order) // TILE
    tiled, balls, lit = np.empty(3 * len(order), np.float32), np.empty((tiles, 4), np.float32), np.zeros(tiles, bool)
    _gather(points, kinds, order, tiled, balls, lit)
    sums = np.full(2 * len(order), np.float32(0.25))
    _light(tiled, balls, lit, spheres, robot, sources, shares, np.zeros(4 * (len(spheres) + LANES), np.float32), sums)
    found = np.full((2, len(points)), np.nan)
    found[:, order] = sums.reshape(2, -1)
    whole, alone = (0.25 + transmittances(points, some, sources, WIDTH) @ shares for some in (spheres, spheres[:robot]))
    np.testing.assert_allclose(found[:, kinds != BARE], np.stack([alone, whole])[:, kinds != BARE], atol=1e-4)
