"""Image effects: each against an independent formulation, and all against what the catalogue promises."""

import cv2
import numpy as np
import pytest
from image_scene import CAMERA, dots, scene, track
from photographer import Photographer

from gsbridge.cameras import Camera, look_at
from gsbridge.effects.images import IMAGE_EFFECTS, base
from gsbridge.effects.images.camera_pipeline import Shooting
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.image_truth import TruthCamera
from gsbridge.gap.benchmark.image_world import ImageWorld
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.scene.photograph import softened, with_noise
from gsbridge.scene.track import Track

NAMES = (
    "black_level", "defocus", "distortion", "exposure", "extrinsics", "flicker", "focal", "hue_cast", "latency", "motion_blur",
    "noise", "response", "rolling_shutter", "saturation", "shadow", "vignetting", "white_balance",
)  # fmt: skip


@pytest.fixture(scope="module")
def photographer():
    return Photographer(scene(), CAMERA)


@pytest.fixture(scope="module")
def path():
    return track()


def shot(name, **values):
    """A way of taking photos with one effect; parameters that are not given are typical shapes or zero."""
    effect = IMAGE_EFFECTS[name]
    out = Shooting()
    effect.apply(out, {p.name: values.get(p.name, 0.0 if p.amplitude else p.typical) for p in effect.parameters})
    return out


def both(photographer, path, name, **values):
    """Linear light before and after, of one photo, float64."""
    times = np.array([1.3])
    before, after = (photographer.photos(path, times, how)[0] for how in (None, shot(name, **values)))
    return tuple(linear_from_srgb(photo.astype(np.float64)) for photo in (before, after))


def test_catalogue_is_complete_and_consistent():
    assert tuple(IMAGE_EFFECTS) == NAMES
    for name, effect in IMAGE_EFFECTS.items():
        assert name == effect.name
        assert effect.hook in base.HOOKS
        assert effect.amplitudes
        assert effect.signature
        assert effect.tell_apart
        assert set(effect.confused_with) | set(effect.contains) <= set(NAMES) - {name}
        assert set(effect.places) <= {p.name for p in effect.parameters if not p.amplitude}
        for values in effect.directions():
            assert effect.clipped(values) == values
    with pytest.raises(InputError, match="magic"):
        IMAGE_EFFECTS.effect("magic")


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_changes_the_output(photographer, path, name):
    effect = IMAGE_EFFECTS[name]
    values = {p.name: 4 * p.typical if p.amplitude else p.typical for p in effect.parameters}
    times = np.array([0.403, 1.307])

    def taken(wanted):
        how = Shooting()
        effect.apply(how, effect.clipped(wanted))
        return with_noise(photographer.photos(path, times, how), how, np.random.default_rng(0)) if effect.noise_only else (
            photographer.photos(path, times, how)
        )  # fmt: skip

    first = taken(values)
    for parameter in effect.parameters:
        step = 0.3 * (abs(values[parameter.name]) or 0.3 * (parameter.high - parameter.low))
        assert np.abs(taken(values | {parameter.name: values[parameter.name] + step}) - first).max() > 2e-3, parameter.name


@pytest.mark.parametrize("name", NAMES)
def test_nothing_happens_at_amplitude_zero(photographer, path, name):
    times = np.array([0.403, 1.307])
    assert np.array_equal(photographer.photos(path, times, shot(name)), photographer.photos(path, times))


def test_track_passes_through_its_poses_and_turns_at_a_steady_rate():
    times = np.linspace(0.0, 1.0, 6)
    angles = 0.6 * times

    def pose(angle):
        out = np.eye(4)
        out[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        out[:3, 3] = -out[:3, :3] @ [angle, 0.2, -1.0]
        return out

    path = Track(times, np.stack([pose(angle) for angle in angles]))
    between = np.array([0.0, 0.13, 0.5, 0.97])
    assert path.at(between) == pytest.approx(np.stack([pose(0.6 * t) for t in between]), abs=1e-6)
    assert path.at(np.array([-1.0, 2.0])) == pytest.approx(path.poses[[0, -1]], abs=1e-12)
    with pytest.raises(ValueError, match="rise"):
        Track(np.zeros(2), np.tile(np.eye(4), (2, 1, 1)))


# ---- light and sensor ----


def test_exposure_doubles_light_per_stop(photographer, path):
    before, after = both(photographer, path, "exposure", stops=-1.0)
    assert after == pytest.approx(before / 2, abs=2e-6)


def test_response_and_black_level_on_encoded_values(photographer, path):
    times = np.array([1.3])
    plain = photographer.photos(path, times).astype(np.float64)
    assert photographer.photos(path, times, shot("response", curve=np.log(1.25))) == pytest.approx(plain**1.25, abs=1e-6)
    assert photographer.photos(path, times, shot("black_level", level=0.04)) == pytest.approx(
        np.minimum(plain + 0.04, 1.0), abs=1e-6
    )


def test_white_balance_changes_ratios_alone(photographer, path):
    before, after = both(photographer, path, "white_balance", red=np.log(0.8), blue=np.log(0.9))
    assert after[..., 0] == pytest.approx(0.8 * before[..., 0], abs=1e-6)
    assert after[..., 1] == pytest.approx(before[..., 1], abs=1e-6)
    assert after[..., 2] == pytest.approx(0.9 * before[..., 2], abs=1e-6)


def test_saturation_scales_colour_differences_of_luma(photographer, path):
    before, after = both(photographer, path, "saturation", change=-0.4)
    # Luma and two colour differences, as video signals carry them.
    luma = np.array([0.2126, 0.7152, 0.0722])
    for light, factor in ((before, 0.6), (after, 1.0)):
        y = light @ luma
        signals = np.stack([y, factor * (light[..., 2] - y), factor * (light[..., 0] - y)])
        if factor == 0.6:
            wanted = signals
        else:
            assert signals == pytest.approx(wanted, abs=2e-6)


def test_vignetting_is_the_fourth_power_of_a_cosine(photographer, path):
    before, after = both(photographer, path, "vignetting", strength=0.3)
    half = 0.5 * np.hypot(CAMERA.width, CAMERA.height)
    for row, column in ((0, 0), (10, 40), (23, 31), (47, 63)):
        angle = np.arctan(np.sqrt(0.3) * np.hypot(column + 0.5 - 32, row + 0.5 - 24) / half)
        assert after[row, column] == pytest.approx(before[row, column] * np.cos(angle) ** 4, abs=2e-6)


def test_coloured_light_adds_a_spot(photographer, path):
    values = {"red": 0.3, "green": 0.1, "blue": 0.6, "x": 0.2, "y": -0.1, "radius": 0.3}
    before, after = both(photographer, path, "hue_cast", **values)
    half = 0.5 * np.hypot(CAMERA.width, CAMERA.height)
    for row, column in ((20, 40), (5, 5), (40, 20)):
        dx, dy = (column + 0.5 - 32) / half - 0.2, (row + 0.5 - 24) / half + 0.1
        spot = 2 * np.pi * 0.3**2 * np.prod([np.exp(-0.5 * (d / 0.3) ** 2) / np.sqrt(2 * np.pi) / 0.3 for d in (dx, dy)])
        expected = np.minimum(before[row, column] * (1 + spot * np.array([0.3, 0.1, 0.6])), 1.0)
        assert after[row, column] == pytest.approx(expected, abs=2e-5)


def test_shadow_lies_on_the_table(photographer, path):
    before, after = both(photographer, path, "shadow", strength=0.5, x=0.05, y=0.12, radius=0.08, softness=0.1)
    pose = path.at(np.array([1.3]))[0]
    for point, share in (((0.05, 0.12), 0.5), ((0.05, 0.16), 0.5), ((0.05, 0.0), 0.0), ((-0.2, 0.12), 0.0)):
        u, v = CAMERA.project((pose @ np.array([*point, 0.0, 1.0]))[:3])
        row, column = int(v), int(u)
        assert after[row, column] / before[row, column] == pytest.approx(np.full(3, 1 - share), abs=0.02)


def test_flicker_follows_time_and_rows(photographer, path):
    before, after = both(photographer, path, "flicker", sine=0.2, cosine=-0.1, frequency=100.0, readout=2e-4)
    for row in (0, 17, 47):
        when = 1.3 + (row + 0.5 - 24) * 2e-4
        wave = np.hypot(0.2, 0.1) * np.sin(2 * np.pi * 100.0 * when + np.arctan2(-0.1, 0.2))
        assert after[row] == pytest.approx(np.minimum(before[row] * (1 + wave), 1.0), abs=5e-5)


def test_noise_has_the_variance_that_it_says():
    how = shot("noise", read=0.01, shot=4e-4)
    for level in (0.2, 0.8):
        noisy = with_noise(np.full((200, 200, 3), level), how, np.random.default_rng(1))
        assert noisy.var() == pytest.approx(1e-4 + 4e-4 * level, rel=0.03)


# ---- geometry and time: where a dot lands, and how wide it is ----

DOT = np.array([0.03, 0.02, 0.0])


def landed(photos):
    """Centre of a dot in linear light, px, and its variances along x and y, px2. [N, H, W, 3] -> [N, 2], [N, 2]."""
    light = linear_from_srgb(photos.astype(np.float64)).sum(axis=-1)
    light = light / light.sum(axis=(1, 2), keepdims=True)
    x, y = np.arange(light.shape[2]) + 0.5, np.arange(light.shape[1]) + 0.5
    centre = np.stack([(light * x).sum(axis=(1, 2)), (light.sum(axis=2) * y).sum(axis=1)], axis=1)
    spread = [
        ((light * (x - centre[:, :1, None]) ** 2).sum(axis=(1, 2))),
        (light.sum(axis=2) * (y - centre[:, 1:]) ** 2).sum(axis=1),
    ]
    return centre, np.stack(spread, axis=1)


def sliding(speed=0.2, still=False):
    """A camera straight above that slides along the table's x."""
    times = np.linspace(-1.0, 1.0, 21)
    base_pose = look_at(np.array([0.0, 0.0, 0.5]), np.zeros(3), up=(0.0, 1.0, 0.0))
    poses = np.tile(base_pose, (21, 1, 1))
    poses[:, 0, 3] -= 0.0 if still else speed * times
    return Track(times, poses)


def placed(point, pose, camera=CAMERA):
    return camera.project((pose @ np.append(point, 1.0))[:3])


def test_focal_length_and_distortion_move_a_dot_as_the_projection_says():
    path, dot = sliding(still=True), np.array([0.2, 0.14, 0.0])
    taker = Photographer(dots(dot), CAMERA)
    pose = path.at(np.zeros(1))[0]
    for how, camera in (
        (shot("focal", change=0.05), Camera(64, 48, 63.0, 63.0, 32.0, 24.0)),
        (shot("distortion", k1=0.3), Camera(64, 48, 60.0, 60.0, 32.0, 24.0, (0.3, 0.0, 0.0, 0.0))),
        (shot("distortion", k2=-0.3), Camera(64, 48, 60.0, 60.0, 32.0, 24.0, (0.0, -0.3, 0.0, 0.0))),
    ):
        (centre,), _ = landed(taker.photos(path, np.zeros(1), how))
        assert centre == pytest.approx(placed(dot, pose, camera), abs=0.06)
        assert np.abs(centre - placed(dot, pose)).max() > 0.2


def test_mount_moves_a_dot_as_the_projection_says():
    path, taker = sliding(still=True), Photographer(dots(DOT), CAMERA)
    pose = path.at(np.zeros(1))[0]
    wrong = np.linalg.inv(pose)
    wrong[:3, 3] += wrong[:3, :3] @ [0.02, -0.01, 0.03]
    (centre,), _ = landed(taker.photos(path, np.zeros(1), shot("extrinsics", x=0.02, y=-0.01, z=0.03)))
    assert centre == pytest.approx(placed(DOT, np.linalg.inv(wrong)), abs=0.03)
    (centre,), _ = landed(taker.photos(path, np.zeros(1), shot("extrinsics", about_z=0.1)))
    x, y = placed(DOT, pose) - [32, 24]
    # A camera that turns clockwise, as seen along its view, shows everything turned counterclockwise.
    turned = [32 + x * np.cos(0.1) + y * np.sin(0.1), 24 - x * np.sin(0.1) + y * np.cos(0.1)]
    assert centre == pytest.approx(turned, abs=0.03)


def test_a_mount_moves_and_turns_as_the_pose_of_the_camera_in_the_benchmark():
    """Each parameter by itself, and all of them: displacements along, and right-handed turns about, the nominal axes."""
    sizes = {"x": 0.02, "y": -0.01, "z": 0.03, "about_x": 0.1, "about_y": -0.15, "about_z": 0.2}
    for values in ({name: size} for name, size in sizes.items()):
        ((name, size),) = values.items()
        # The truth turns by twice its size about a, b and c.
        turned = "about" in name
        spin = {"abc"["xyz".index(name[-1])] if turned else name: 1.0}
        truth = TruthCamera(ImageWorld.draw(0), CAMERA, {"extrinsics": 0.5 * size if turned else size}, spin)
        np.testing.assert_allclose(np.linalg.inv(shot("extrinsics", **values).mount), truth.mount(), atol=1e-12)
    whole = np.linalg.inv(shot("extrinsics", **sizes).mount)
    np.testing.assert_allclose(whole[:3, 3], [0.02, -0.01, 0.03])
    np.testing.assert_allclose(whole[:3, :3], cv2.Rodrigues(np.array([0.1, -0.15, 0.2]))[0], atol=1e-12)
    # To the right, where x points.
    assert np.linalg.inv(shot("extrinsics", about_y=0.1).mount)[0, 2] == pytest.approx(np.sin(0.1))


def test_latency_shows_an_earlier_place():
    path, taker = sliding(), Photographer(dots(DOT), CAMERA)
    (late, now), _ = landed(
        np.concatenate([taker.photos(path, np.zeros(1), shot("latency", delay=0.1)), taker.photos(path, np.zeros(1))])
    )
    assert late - now == pytest.approx([0.2 * 0.1 * 60 / 0.5, 0.0], abs=0.03)


def test_rolling_shutter_leans_a_line():
    line = np.array([[0.0, y, 0.0] for y in (-0.15, 0.15)])
    path, how = sliding(), shot("rolling_shutter", row_time=1e-3)
    centres = [landed(Photographer(dots(point), CAMERA).photos(path, np.zeros(1), how))[0][0] for point in line]
    lean = np.subtract(*[c[0] for c in centres])
    rows = np.subtract(*[c[1] for c in centres])
    assert lean == pytest.approx(-rows * 1e-3 * 0.2 * 60 / 0.5, rel=0.08)


def test_motion_blur_widens_along_the_motion_alone():
    path, taker = sliding(), Photographer(dots(DOT), CAMERA)
    (before,), (after,) = (
        landed(taker.photos(path, np.zeros(1), how))[1] for how in (None, shot("motion_blur", exposure_time=0.1))
    )
    way = 0.2 * 0.1 * 60 / 0.5
    assert after - before == pytest.approx([way**2 / 12, 0.0], abs=0.06 * way**2 / 12 + 0.005)


def test_defocus_adds_its_variance():
    path, taker = sliding(still=True), Photographer(dots(DOT), CAMERA)
    for sigma in (0.3, 0.5, 1.7):
        (before,), (after,) = (landed(taker.photos(path, np.zeros(1), how))[1] for how in (None, shot("defocus", sigma=sigma)))
        assert after - before == pytest.approx([sigma**2] * 2, rel=0.03)


def test_softness_takes_variance_away_and_keeps_flat_areas(photographer, path):
    flat = np.full((20, 20, 3), 0.3, np.float32)
    assert softened(flat, (0.5, 0.3)) == pytest.approx(flat, abs=1e-6)
    light = linear_from_srgb(photographer.photos(path, np.array([1.3]))[0])
    assert softened(light, (0.4, 0.0)).std() > light.std() > softened(light, (-0.4, 0.0)).std()


def test_plain_photos_are_the_scene_as_it_is_drawn(photographer, path):
    photo = photographer.photos(path, np.array([0.7]))[0]
    light, _ = photographer.draw(CAMERA, path.at(np.array([0.7]))[0])
    assert photo == pytest.approx(srgb_from_linear(light), abs=1e-6)
