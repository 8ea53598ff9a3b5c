"""The mirror's wrist camera against projection by hand."""

from functools import cache

import cv2
import numpy as np
import pytest
from robot_fixture import kinematics, robot
from scipy.spatial import cKDTree

from gsbridge.errors import InputError
from gsbridge.images import linear_from_srgb
from gsbridge.reality.mirror import path_tracer
from gsbridge.reality.mirror.backgrounds import make_plate
from gsbridge.reality.mirror.objects import make_object
from gsbridge.reality.mirror.studio import SCENES
from gsbridge.reality.world import camera as module
from gsbridge.reality.world.bodies import body_mesh, repainted, shown_mesh
from gsbridge.reality.world.camera import MirrorCamera, Quality, Setting, expose, wrist_camera
from gsbridge.reality.world.hidden import Hidden
from gsbridge.robot.nominal import base_from_table

QUICK = Quality(samples=4, depth=2)
SIZE = 64


def coarse_table(background, seed):
    """A table without pattern: painting the true one takes longer than all these tests."""
    return np.full((10, 12, 3), 0.25, np.float32)


def build(hidden):
    """A small room around the cube."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "table_texture", coarse_table)
        return MirrorCamera(Setting("small_cube", sheet=None), robot(), hidden)


@cache
def room():
    return build(Hidden())


def posed(object_pose, q=None):
    """table_from_body of everything, and cam_from_table, by the robot's own kinematics."""
    x, y, yaw = object_pose
    table_from_base = np.linalg.inv(base_from_table())
    poses = {name: table_from_base @ pose for name, pose in kinematics().fk(kinematics().rest if q is None else q).items()}
    cube = np.eye(4)
    cube[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    cube[:2, 3] = x, y
    return {**poses, "object": cube}, np.linalg.inv(poses["camera"])


def silhouette(camera, cam_from_table, table_from_object):
    """Coverage of the cube by filling the convex hull of its projected vertices. [H, W]."""
    vertices = make_object("small_cube", 0, 4.0)[0].vertices
    # Bodies have the axes of their capture, in which the cube stood turned.
    yaw = np.radians(SCENES["small_cube"][2])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    vertices = vertices @ turn.T
    cam_from_object = cam_from_table @ table_from_object
    pixels = camera.project(vertices @ cam_from_object[:3, :3].T + cam_from_object[:3, 3])
    fine = np.zeros((camera.height * 8, camera.width * 8), np.uint8)
    corners = cv2.convexHull(np.rint(pixels * 8 - 0.5).astype(np.int32))
    cv2.fillConvexPoly(fine, corners, 1)
    return fine.reshape(camera.height, 8, camera.width, 8).mean((1, 3))


def centroid(mask):
    v, u = np.mgrid[: mask.shape[0], : mask.shape[1]] + 0.5
    return np.array([(u * mask).sum(), (v * mask).sum()]) / mask.sum()


@pytest.mark.parametrize("pose", [(0.0, 0.265, 0.0), (0.06, 0.20, 0.6), (-0.02, 0.33, -0.4)])
def test_the_object_is_seen_where_kinematics_and_projection_say(pose):
    poses, cam_from_table = posed(pose)
    camera = wrist_camera(SIZE)
    room().move(poses)
    wanted = silhouette(camera, cam_from_table, poses["object"])
    seen = room().coverage(camera, cam_from_table, ("object",))
    assert wanted.sum() > 60
    np.testing.assert_allclose(centroid(seen), centroid(wanted), atol=0.3)
    assert seen.sum() == pytest.approx(wanted.sum(), rel=0.05)
    # The same from the photo itself: the cube is red, the table and the robot are grey.
    photo = room().photo(camera, cam_from_table, QUICK, 0).astype(float)
    red = (photo[..., 0] > 1.35 * photo[..., 1:].min(-1)) & (photo[..., 0] > 60)
    assert np.linalg.norm(centroid(red) - centroid(wanted)) < 1.5


def test_colours_stay_on_the_object_when_it_moves():
    """Guards against attributes of instances that are looked up in the wrong frame."""
    camera, means = wrist_camera(SIZE), []
    for pose in ((0.0, 0.265, 0.1), (0.05, 0.30, 0.1)):
        poses, cam_from_table = posed(pose)
        room().move(poses)
        inside = room().coverage(camera, cam_from_table, ("object",)) == 1
        means.append(room().light(camera, cam_from_table, QUICK, 0)[inside].mean(0))
    assert means[0][0] > 2 * means[0][2]
    np.testing.assert_allclose(means[0], means[1], rtol=0.25)


def test_moving_gives_what_a_fresh_scene_gives():
    poses, cam_from_table = posed((0.02, 0.25, 0.3))
    fresh = build(Hidden())
    fresh.move(poses)
    room().move(posed((0.1, 0.2, 0.0))[0])
    room().move(poses)
    camera = wrist_camera(32)
    np.testing.assert_array_equal(fresh.light(camera, cam_from_table, QUICK, 1), room().light(camera, cam_from_table, QUICK, 1))


def test_fingers_are_in_the_picture_and_hide_what_is_behind():
    poses, cam_from_table = posed((0.0, 0.265, 0.0))
    room().move(poses)
    camera = wrist_camera(SIZE)
    pads = room().coverage(camera, cam_from_table, ("left_pad", "right_pad"))
    assert 20 < pads.sum() < 0.3 * SIZE * SIZE
    # Fingertips are dark rubber and plastic.
    picture = room().light(camera, cam_from_table, QUICK, 0)
    assert picture[pads == 1].mean() < 0.3 * picture[(pads == 0)].mean()


def test_both_variants_see_the_same_bodies_and_the_same_picture(monkeypatch):
    if path_tracer.variant() != path_tracer.COMPILED:
        pytest.skip("no working libLLVM on this machine")
    poses, cam_from_table = posed((0.02, 0.25, 0.3))
    camera, fine, bodies = wrist_camera(SIZE), Quality(samples=256, depth=2), ("object", "left_pad")

    def seen(of):
        of.move(poses)
        return of.coverage(camera, cam_from_table, bodies), of.light(camera, cam_from_table, fine, 1)

    compiled, picture = seen(room())
    with monkeypatch.context() as patch:
        patch.setattr(module, "load_mitsuba", lambda threads: path_tracer.load_mitsuba(threads, path_tracer.SCALAR))
        scalar, same = seen(build(Hidden()))
    # Mitsuba has one variant at a time.
    path_tracer.load_mitsuba(1)
    assert compiled.sum() > 100
    # Rays go through the middle of a small square in one, somewhere through it in the other.
    assert compiled.sum() == pytest.approx(scalar.sum(), rel=0.01)
    assert abs(compiled - scalar).mean() < 0.005
    assert picture.mean() == pytest.approx(same.mean(), rel=2e-3)
    assert abs(picture - same).mean() < 0.03 * same.mean()


def test_lights_and_shapes_keep_their_order_from_scene_to_scene():
    """Samples go to lights by their order, so that another order is another noise."""
    names = [[shape.id() for shape in build(Hidden(window=0.5, clutter=4))._scene.shapes()] for _ in range(4)]
    assert all(name == names[0] for name in names)


def test_same_seed_same_photo():
    poses, cam_from_table = posed((0.0, 0.265, 0.0))
    room().move(poses)
    camera = wrist_camera(32)
    first, again, other = (room().photo(camera, cam_from_table, QUICK, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_light_and_robot_follow_their_hidden_parameters():
    poses, cam_from_table = posed((0.0, 0.265, 0.0))
    camera, fine = wrist_camera(32), Quality(samples=16, depth=3)
    room().move(poses)
    plain = room().light(camera, cam_from_table, fine, 0)
    changed = build(Hidden(light_power=1.1, light_cast=(1.0, 1.0, 0.8), robot_shade=0.5))
    changed.move(poses)
    other = changed.light(camera, cam_from_table, fine, 0)
    # Everything shines in proportion to the light, but where light comes back from the robot.
    table = room().coverage(camera, cam_from_table, ("object", "left_pad", "right_pad")) == 0
    np.testing.assert_allclose(np.median(other[table] / plain[table], axis=0), [1.1, 1.1, 0.88], rtol=0.02)
    pads = room().coverage(camera, cam_from_table, ("left_pad", "right_pad")) == 1
    assert other[pads].mean() / plain[pads].mean() == pytest.approx(0.5 * 1.1 * 2.8 / 3, rel=0.05)


def test_the_lamp_turns_about_the_table():
    arm = np.array([0.55, -0.45, 1.15])
    swung = module._swing(arm, 0.2, -0.1)
    assert np.linalg.norm(swung) == pytest.approx(np.linalg.norm(arm))
    np.testing.assert_allclose(module._swing(arm, 0.0, 0.0), arm)
    assert np.arctan2(swung[1], swung[0]) - np.arctan2(arm[1], arm[0]) == pytest.approx(0.2)
    assert np.arcsin(swung[2] / np.linalg.norm(arm)) - np.arcsin(arm[2] / np.linalg.norm(arm)) == pytest.approx(-0.1)


def test_sensor_noise_has_the_stated_strength_and_never_wraps():
    hidden = Hidden(full_well=8000.0, read_noise=0.002)
    grey = np.full((200, 200, 3), 0.2)
    noisy = expose(grey, hidden, np.random.default_rng(0)).astype(float)
    # Noise of linear light times the slope of the sRGB curve, plus rounding.
    slope = 1.055 / 2.4 * 0.2 ** (1 / 2.4 - 1)
    wanted = np.hypot(255 * slope * np.sqrt(0.2 / 8000 + 0.002**2), np.sqrt(1 / 12))
    assert noisy.std() == pytest.approx(wanted, rel=0.02)
    assert expose(np.full((4, 4, 3), 7.0), hidden, np.random.default_rng(0)).min() >= 254
    np.testing.assert_array_equal(expose(np.zeros((4, 4, 3)), Hidden(), np.random.default_rng(0)), 0)


def test_tint_and_pedestal_act_on_the_encoded_value():
    grey = np.full((8, 8, 3), 0.2140411)  # 0.5 in sRGB
    out = expose(grey, Hidden(tint=(0.9, 1.0, 1.15), pedestal=0.03), np.random.default_rng(0))
    np.testing.assert_allclose(out[0, 0], 255 * (0.5 * np.array([0.9, 1.0, 1.15]) + 0.03), atol=0.6)


def test_the_lens_darkens_the_corners_and_nothing_else():
    grey = np.full((48, 64, 3), 0.5)
    clear, dark = (expose(grey, Hidden(vignette=lost), np.random.default_rng(0)).astype(float) for lost in (0.0, 0.4))
    linear = linear_from_srgb(dark / 255) / linear_from_srgb(clear / 255)
    # Cosine-fourth law about the middle: cos^4 of the angle whose square cosine is that of the corner in proportion to r^2.
    tangent = np.sqrt(0.6**-0.5 - 1)
    for row, column in ((0, 0), (24, 32), (0, 32), (40, 5)):
        radius = np.hypot(column + 0.5 - 32, row + 0.5 - 24) / np.hypot(32, 24)
        assert linear[row, column, 1] == pytest.approx(np.cos(np.arctan(tangent * radius)) ** 4, abs=0.01)
    with pytest.raises(InputError, match="vignette"):
        Hidden(vignette=1.0)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="background 'sand' is unknown"):
        Setting("small_cube", "sand")
    with pytest.raises(InputError, match="no picture"):
        Quality(samples=0)
    with pytest.raises(InputError, match="no picture"):
        Quality(sampler="magic")
    with pytest.raises(InputError, match="0 px"):
        wrist_camera(0)
    with pytest.raises(InputError, match="'lamp' is not drawn"):
        room().coverage(wrist_camera(8), np.eye(4), ("lamp",))


def test_direct_light_is_what_paths_of_that_length_bring(monkeypatch):
    camera, (poses, cam_from_table) = room(), posed((0.0, 0.265, 0.3))
    camera.move(poses)
    lens = wrist_camera(32)
    direct = camera.light(lens, cam_from_table, Quality(256, 2), 1)
    monkeypatch.setattr(module, "_integrator", lambda depth, glossy: {"type": "path", "max_depth": depth})
    paths = camera.light(lens, cam_from_table, Quality(256, 2), 2)
    # The noise of either is a few per cent of a pixel; that of the mean vanishes.
    assert direct.mean() == pytest.approx(paths.mean(), rel=0.01)
    np.testing.assert_allclose(direct, paths, atol=0.1)


@pytest.mark.parametrize("name", ["cake", "bear"])
def test_an_object_has_the_marks_that_it_had_in_its_film(name):
    """Strokes are drawn at vertices; the mirror's coarser mesh must not have others. Compared at the same places."""
    coarse, _ = shown_mesh(name, 1, 3.0)
    filmed, _ = body_mesh(name, 1, 1.0)
    distances, nearest = cKDTree(filmed.vertices).query(coarse.vertices)
    near = distances < 4e-4
    assert near.mean() > 0.5
    difference = np.abs(coarse.colours[near] - filmed.colours[nearest[near]]).mean(1)
    plain, _ = body_mesh(name, 1, 3.0)
    repainted = np.abs(plain.colours[near] - filmed.colours[nearest[near]]).mean(1)
    assert difference.mean() < 0.5 * repainted.mean()
    # Where a mark ends between two vertices, the average differs from both.
    assert np.quantile(difference, 0.9) < 0.06


def test_the_plate_has_the_paint_that_it_had_in_its_film():
    """Its sprig and rim are painted at vertices, too; only the spacing of the mesh may differ."""
    filmed, (coarse, _) = make_plate(1)[0], make_plate(1, module._DETAIL)
    shown = repainted(coarse, filmed)
    assert len(shown.faces) < 0.3 * len(filmed.faces)
    distances, nearest = cKDTree(filmed.vertices).query(shown.vertices)
    assert distances.max() < 1e-3
    there = filmed.colours[nearest]
    assert np.abs(shown.colours - there).mean() < 0.5 * np.abs(coarse.colours - there).mean()
