"""What severity does to pictures: shutter, lens, electronics, light, surfaces and litter."""

import numpy as np
import pytest
from robot_fixture import robot

from gsbridge.cameras import Camera
from gsbridge.images import linear_from_srgb
from gsbridge.reality.mirror.backgrounds import WORK_CENTRE_M
from gsbridge.reality.mirror.path_tracer import SCALAR, load_mitsuba
from gsbridge.reality.world import camera as module
from gsbridge.reality.world.camera import Quality, Setting, expose, lamp_line, wrist_camera
from gsbridge.reality.world.electronics import GREY, LAG, Electronics, LensError
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.reality.world.shutter import moments
from gsbridge.reality.world.surfaces import coated
from gsbridge.reality.world.surroundings import lying_about, passer_pose, window_line
from gsbridge.robot.nominal import base_from_table


@pytest.mark.parametrize(("exposure", "readout"), [(0.008, 0.0), (0.012, 0.02), (0.004, 0.028), (0.0, 0.02), (0.016, 0.028)])
def test_each_row_takes_its_light_in_its_own_time(exposure, readout):
    rows = 48
    weights, times = np.zeros(rows), np.zeros(rows)
    for part in moments(exposure, readout, rows):
        weights[part.top : part.bottom] += part.weights
        times[part.top : part.bottom] -= part.weights * part.before
    np.testing.assert_allclose(weights, 1.0, atol=1e-12)
    exposure = max(exposure, 1e-3)
    # The middle of a row's exposure; the last row's ends now.
    middle = -(exposure + readout) + readout * (np.arange(rows) + 0.5) / rows + 0.5 * exposure
    np.testing.assert_allclose(times, middle, atol=4.1e-3)
    assert times.min() >= -(exposure + readout)
    assert (np.diff(times) >= -1e-12).all()


@pytest.mark.parametrize(
    "changes", [{"distortion": 0.03}, {"distortion": -0.03, "focal_error": 0.015}, {"focal_error": -0.015}]
)
def test_a_lens_shows_what_its_true_intrinsics_say(changes):
    calibrated = wrist_camera(64)
    lens, hidden = LensError(calibrated, Hidden(**changes)), Hidden(**changes)
    wide = lens.wide
    assert wide.fx == calibrated.fx
    # A scene whose brightness is the direction it is seen in.
    x, y = (np.mgrid[: wide.height, : wide.width][::-1] + 0.5 - wide.width / 2) / wide.fx
    seen = lens(np.stack([x, y, np.ones_like(x)], axis=-1))
    focal = calibrated.fx * (1 + hidden.focal_error)
    pixels = Camera(64, 64, focal, focal, 32.0, 32.0, (hidden.distortion, 0.0, 0.0, 0.0)).project(seen.astype(np.float64))
    # OpenCV interpolates in steps of a thirty-second of a pixel.
    np.testing.assert_allclose(pixels, np.mgrid[:64, :64][::-1].transpose(1, 2, 0) + 0.5, atol=0.03)


def test_exposure_and_balance_follow_late_and_only_as_far_as_they_do():
    camera = Electronics(Hidden(auto_exposure=0.5, auto_balance=0.25), 0.05)
    camera.begin(1)
    light = np.full((4, 4, 3), [0.4, 0.2, 0.1])
    luminance = np.array([0.4, 0.2, 0.1]) @ [0.2126, 0.7152, 0.0722]
    first = (GREY / luminance) ** 0.5 * (0.2 / np.array([0.4, 0.2, 0.1])) ** 0.25
    np.testing.assert_allclose(camera.gains(light), first, rtol=1e-12)
    # The lamp goes down to a quarter: the gain begins to rise with the picture after, towards twice as much.
    np.testing.assert_allclose(camera.gains(0.25 * light), first, rtol=1e-12)
    for step in range(1, 5):
        gain = first * (2.0 - np.exp(-step * 0.05 / LAG))
        np.testing.assert_allclose(camera.gains(0.25 * light), gain, rtol=1e-9)
    assert Electronics(Hidden(), 0.05).gains(light).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("gain", [0.5, 1.0, 3.0])
def test_a_gain_amplifies_noise_and_less_light_has_less_of_it(gain):
    """Against the statistics of electrons: a mean of n has a variance of n, and amplifying multiplies both."""
    hidden = Hidden(full_well=4000.0, read_noise=0.0, exposure=1.0, vignette=0.0, tint=(1.0, 1.0, 1.0), pedestal=0.0)
    light = np.full((256, 256, 3), 0.2)
    seen = linear_from_srgb(expose(light, hidden, np.random.default_rng(2), np.full(3, gain)) / 255.0)
    electrons = 4000.0 * 0.2 * min(gain, 1.0)
    assert seen.mean() == pytest.approx(0.2 * gain, rel=5e-3)
    assert seen.std() / seen.mean() == pytest.approx(electrons**-0.5, rel=0.03)


def test_pictures_are_late_dropped_and_compressed():
    pictures = [np.full((16, 16, 3), value, np.uint8) for value in (10, 20, 30, 40)]
    late, dropped = Electronics(Hidden(late_frames=1.0), 0.05), Electronics(Hidden(dropped_frames=1.0), 0.05)
    assert [late.delivered(picture)[0, 0, 0] for picture in pictures] == [10, 10, 20, 30]
    assert [dropped.delivered(picture)[0, 0, 0] for picture in pictures] == [10, 10, 10, 10]
    plain = Electronics(Hidden(), 0.05)
    assert plain.delivered(pictures[0]) is pictures[0]
    noisy = np.random.default_rng(0).integers(0, 255, (32, 32, 3)).astype(np.uint8)
    errors = [
        np.abs(Electronics(Hidden(compression=loss), 0.05).delivered(noisy).astype(int) - noisy).mean() for loss in (5, 40, 60)
    ]
    assert 0 < errors[0] < errors[1] < errors[2]


def test_more_things_are_the_same_ones_and_others():
    mi, colours = load_mitsuba(1, SCALAR), np.random.default_rng(0).uniform(size=(50, 3))
    few = lying_about(mi, Hidden(clutter=3, cables=1, decoys=1, clutter_seed=4), colours)
    many = lying_about(mi, Hidden(clutter=7, cables=2, decoys=2, clutter_seed=4), colours)
    assert repr(few) == repr({name: many[name] for name in few})
    assert len({name.split("_")[1] for name in many if name.startswith("clutter")}) == 7
    other = lying_about(mi, Hidden(clutter=3, cables=1, decoys=1, clutter_seed=5), colours)
    assert repr(other) != repr(few)
    assert lying_about(mi, Hidden(), colours) == {}


def test_clutter_lies_beside_the_working_area_and_decoys_low_inside():
    mi, colours = load_mitsuba(1, SCALAR), np.random.default_rng(0).uniform(size=(50, 3))
    for seed in range(6):
        for name, part in lying_about(mi, Hidden(clutter=12, cables=3, decoys=2, clutter_seed=seed), colours).items():
            box = (mi.load_dict(part) if isinstance(part, dict) else part).bbox()
            low, high = np.array(box.min), np.array(box.max)
            assert low[2] > -1e-6
            if name.startswith("decoy"):
                assert (np.abs(low[:2] - WORK_CENTRE_M) < 0.19).all()
                assert 2e-3 < high[2] <= 6e-3
                normals = np.array(mi.traverse(part)["vertex_normals"]).reshape(-1, 3)
                np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
                assert (normals[:, 2] > 0.0).all()
            else:
                # The largest object, of 55 mm, starts anywhere up to 0.165 m from the middle, along both axes.
                nearest = np.maximum(np.maximum(low[:2] - WORK_CENTRE_M, WORK_CENTRE_M - high[:2]), 0.0)
                assert np.hypot(*np.maximum(nearest - 0.165, 0.0)) > 0.0545
                assert nearest.max() < 0.42
                assert high[2] < 0.07


def test_somebody_passes_through_the_lamps_light_once():
    hidden = Hidden(passer=0.3)
    lamp, aim = lamp_line(hidden)
    away = []
    for time in np.arange(0.0, 4.0, 0.05):
        pose = passer_pose(hidden, lamp, aim, 3, time)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        toward = (lamp - aim) / np.linalg.norm(lamp - aim)
        offset = pose[:3, 3] - aim
        away.append(np.linalg.norm(offset - offset @ toward * toward))
    away = np.array(away)
    assert away.min() < 0.05
    # At 0.8 m/s one passes the half metre of one's own width in 0.6 s.
    assert 0.4 < 0.05 * np.count_nonzero(away < 0.3) < 1.1
    assert away[[0, -1]].max() > 0.4


def test_somebody_passes_through_the_windows_light_where_the_lamp_is_out():
    hidden = Hidden(passer=0.3, lamp_dim=1.0, window=0.8, window_heading=0.7)
    window, aim = window_line(hidden)
    places = np.array([passer_pose(hidden, window, aim, 3, time)[:2, 3] - aim[:2] for time in np.arange(0.0, 4.0, 0.05)])
    toward = np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(places @ toward, 0.55 * 1.4, atol=1e-9)
    assert np.abs(places @ [-toward[1], toward[0]]).min() < 0.05


def world(tmp_path, **hidden):
    return build_mirror(
        Setting("small_cube", sheet=None), robot(), base_from_table(), Hidden(**hidden), pieces=tmp_path, quality=Quality(8, 2)
    )


@pytest.fixture
def plain_table(monkeypatch):
    """Painting the true table takes longer than the rest together."""
    monkeypatch.setattr(module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))


@pytest.mark.usefixtures("plain_table")
def test_pictures_remember_where_everything_was(tmp_path):
    moving = world(tmp_path, exposure_time=0.016, readout=0.028)
    physics = moving.physics
    moving.reset([0.02, 0.25, 0.3], 1)
    rest = physics.body_poses()
    for name, pose in physics.moment(0.04)[0].items():
        np.testing.assert_array_equal(pose, rest[name])
    for _ in range(6):
        moving.command([0.10, 0.30, 0.20], 0.3, 0.14)
        before = physics.body_poses()
        moving.step()
    now, past = physics.body_poses(), physics.moment(0.05)
    np.testing.assert_allclose(physics.moment(0.0)[1], physics.camera_pose(), atol=1e-12)
    np.testing.assert_allclose(past[0]["tool"], before["tool"], atol=1e-9)
    middle = physics.moment(0.025)[0]["tool"][:3, 3]
    assert np.linalg.norm(now["tool"] - before["tool"]) > 5e-3
    assert np.linalg.norm(middle - 0.5 * (now["tool"] + before["tool"])[:3, 3]) < 2e-3
    # A picture of what moves is another than one of now; of what stands still it is the same but for noise.
    blurred = moving.image(32)
    np.testing.assert_array_equal(blurred, moving.image(32))
    assert blurred.shape == (32, 32, 3)


@pytest.mark.usefixtures("plain_table")
def test_light_and_surfaces_do_what_they_are_named_after(tmp_path):
    def look(**hidden):
        seen = world(tmp_path, **hidden)
        seen.reset([0.02, 0.25, 0.3], 1)
        seen._move(seen.body_poses(), 0.0)
        return seen.camera.light(wrist_camera(24), seen.camera_pose(), Quality(64, 2), 5)

    plain = look()
    assert look(lamp_dim=1.0).mean() < 0.6 * plain.mean()
    assert look(window=0.5).mean() > 1.05 * plain.mean()
    warm = look(light_hue=0.08).mean((0, 1)) / plain.mean((0, 1))
    np.testing.assert_allclose(warm, np.exp([0.08, 0.0, -0.08]), rtol=0.02)
    # A sheen adds what the surface throws back without colouring it, and changes the rest little.
    glossy = look(gloss_object=0.9, gloss_table=0.4)
    assert np.abs(glossy - plain).mean() > 0.01 * plain.mean()
    assert 0.7 < glossy.mean() / plain.mean() < 1.4
    assert coated({"type": "rgb"}, 0.0)["type"] == "diffuse"


@pytest.mark.usefixtures("plain_table")
def test_who_passes_throws_a_shadow(tmp_path):
    seen = world(tmp_path, passer=0.3)
    seen.reset([0.02, 0.25, 0.3], 1)
    means = []
    for _ in range(8):
        seen._move(seen.body_poses(), 0.0)
        means.append(seen.camera.light(wrist_camera(16), seen.camera_pose(), Quality(32, 2), 5).mean())
        seen._steps += 10
    assert min(means) < 0.8 * max(means)
