"""What changed between photos of two days, on a small site of the benchmark, whose truths share no code with the effects."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.image_truth import READ, SHOT, grainy
from gsbridge.gap.benchmark.images import SIZES, STRANGE, draw_image_case, film, hidden_pairs, image_site
from gsbridge.gap.diagnosis.results import ROLES, Rules
from gsbridge.gap.image.diagnose import UNSTEADY, ImageAccount, diagnose_images, unsteady
from gsbridge.gap.image.expect import Expectation
from gsbridge.gap.image.model import ImageCandidate, image_candidates, shooting
from gsbridge.gap.image.noise_model import Flats
from gsbridge.gap.image.null import SCALES, ImageNull, _blocks
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, compared, learn_noise
from gsbridge.gap.image.screen import gains_of
from gsbridge.scene.track import Track

SPIN = {"wr": 0.8, "wb": -0.6, "x": 0.6, "y": 0.8, "z": 0.0, "a": 0.0, "b": 0.0, "c": 1.0}


STILL = ("black_level", "defocus", "exposure", "extrinsics", "focal", "noise", "vignetting", "white_balance")
NAMES = (*STILL, "flicker", "latency", "motion_blur", "rolling_shutter")


@pytest.fixture(scope="module")
def site():
    return image_site(7, camera=Camera(64, 48, 60.0, 60.0, 32.0, 24.0), photos=5)


@pytest.fixture(scope="module")
def fine():
    """Photos of twice the size at which they are compared, as geometry asks."""
    return image_site(7, camera=Camera(128, 96, 120.0, 120.0, 64.0, 48.0), photos=4)


def hidden_case(site, hidden, seed=11, moving=False):
    """Photos of all roles with sizes that are given, not searched."""
    rng = np.random.default_rng(seed)
    films = {role: film(int(rng.integers(1 << 30)), site.photos) for role in ROLES}
    return hidden_pairs(site, hidden, films, SPIN, rng, moving=moving)


def test_gains_are_those_of_least_squares():
    rng = np.random.default_rng(0)
    shapes, residual = rng.normal(size=(3, 50)), rng.normal(size=50)
    factors = np.linalg.lstsq(shapes.T, residual, rcond=None)[0]
    gain, found = gains_of(shapes @ residual, shapes @ shapes.T, np.full(3, -np.inf))
    assert found == pytest.approx(factors)
    assert gain == pytest.approx((residual**2).sum() - ((residual - factors @ shapes) ** 2).sum())


def test_grain_is_the_variance_of_noise_and_blind_to_slopes():
    rng = np.random.default_rng(0)
    x = np.linspace(0.2, 0.8, 64, dtype=np.float32)
    pictures = np.broadcast_to(x[None, None, :, None], (4, 48, 64, 3)).copy()
    flats = Flats.of(pictures, np.zeros((4, 48, 64), np.float32), np.ones((4, 48, 64), bool))
    slope = (0.3 * pictures).astype(np.float32)
    found = flats.variances(slope + rng.normal(0, 0.02, pictures.shape).astype(np.float32))
    assert np.nanmean(found) == pytest.approx(4e-4, rel=0.05)


def test_noise_is_that_of_the_sensor(site):
    noise = learn_noise(list(hidden_case(site, {}).values()))
    # Counting, reading, and rounding to 8 bits.
    assert noise.at(0.5) == pytest.approx(READ**2 + 0.5 * SHOT + 1 / (12 * 255**2), rel=0.1)


def test_places_where_something_may_hide_are_not_compared(site):
    pairs = hidden_case(site, {})["fit"]
    flat = replace(pairs, depths=np.full_like(pairs.depths, 0.4))
    step = flat.depths.copy()
    step[:, :, 30:] = 0.5
    step[:, 5, 5] = np.nan
    kept, held = (compared(views)[0] for views in (flat, replace(flat, depths=step)))
    assert kept[10:-10, 10:-10].all()
    assert not kept[0].any()
    assert not held[:, 29:31].any()
    assert held[24, 40]
    assert held[24, 20]


@pytest.mark.parametrize(
    ("hidden", "effect", "values", "moving"),
    [
        ({"exposure": 0.3}, "exposure", {"stops": 0.3}, False),
        ({"extrinsics": 0.006}, "extrinsics", None, False),
        ({"focal": 0.03}, "focal", {"change": 0.03}, False),
        ({"latency": 0.06}, "latency", {"delay": 0.06}, True),
        ({"rolling_shutter": 1e-3}, "rolling_shutter", {"row_time": 1e-3}, True),
    ],
)
def test_an_effect_in_the_expectation_predicts_the_photos(fine, hidden, effect, values, moving):
    """Against the truth's own formulation, by rays: the same effect on the earlier photo takes the difference away."""
    if values is None:
        # The truth says where the camera is in the frame of where it is thought to be.
        values = {"x": 0.6 * 0.006, "y": 0.8 * 0.006, "z": 0.0, "about_x": 0.0, "about_y": 0.0, "about_z": 0.012}
    pairs = hidden_case(fine, hidden, moving=moving)["fit"]
    view = ImageResiduals(pairs, learn_noise([pairs]))
    plain, known = ((view.residual(effects) ** 2).sum() / view.numbers for effects in ((), (Applied(effect, "", values),)))
    assert plain > 4.0
    assert known - 1.0 < 0.05 * (plain - 1.0)


def test_blurring_effects_win_nothing_by_smoothing_noise(site):
    pairs = hidden_case(site, {})["fit"]
    view = ImageResiduals(pairs, learn_noise([pairs]))
    squares = [(view.residual(effects) ** 2).sum() for effects in ((), (Applied("defocus", "", {"sigma": 0.25}),))]
    assert squares[1] > squares[0] - 9.0


def test_photos_with_nothing_changed_are_rarely_odd_and_changed_ones_are(site):
    found = []
    for seed in range(8):
        pairs = hidden_case(site, {}, seed=100 + seed)["fit"]
        view = ImageResiduals(pairs, learn_noise([pairs]))
        found.append(ImageNull.of(view, np.random.default_rng(seed), 99).p_value(view, view.residual()))
    # Edges weigh less than their noise alone would justify, so the p-values of unchanged photos are rarely small.
    assert min(found) > 0.02
    changed = ImageResiduals(hidden_case(site, {"exposure": 0.02}, seed=100)["fit"], view.noise)
    assert ImageNull.of(changed, np.random.default_rng(0), 99).p_value(changed, changed.residual()) < 1e-3


def compressed(photos, quality):
    """Photos as a JPEG file of a quality gives them back. [N, H, W, 3]."""
    out = []
    for photo in photos:
        _, file = cv2.imencode(".jpg", np.round(255.0 * photo).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])
        out.append(cv2.imdecode(file, cv2.IMREAD_COLOR))
    return np.stack(out).astype(np.float32) / 255.0


@pytest.mark.parametrize("quality", [None, 90])
def test_large_photos_with_nothing_changed_are_not_odd(quality):
    """Photos of four times the size at which they are compared, as the sensor gives them or as JPEG files."""
    site = image_site(8, camera=Camera(256, 192, 240.0, 240.0, 128.0, 96.0), photos=5)
    track, times = film(21, site.photos)
    rng, poses = np.random.default_rng(5), track.at(times)
    stops = Track(np.arange(len(poses), dtype=float), poses)
    plain = site.lens().photos(stops, stops.times)
    shots = [grainy(plain, {}, rng) for _ in range(6)]
    if quality is not None:
        shots = [compressed(shot, quality) for shot in shots]
    again = np.mean(shots[1:5], axis=0).astype(np.float32)
    pairs = Pairs(site.camera, shots[0], again, shots[5], site.depths(poses, rng), poses, repeats=4)
    view = ImageResiduals(pairs, learn_noise([pairs]))
    assert ImageNull.of(view, np.random.default_rng(0), 99).p_value(view, view.residual()) > 0.02
    lighter = replace(pairs, after=np.clip(1.03 * pairs.after, 0.0, 1.0))
    changed = ImageResiduals(lighter, view.noise)
    assert ImageNull.of(changed, np.random.default_rng(0), 99).p_value(changed, changed.residual()) < 1e-3


def test_photos_that_make_no_sense_are_refused(site):
    pairs = hidden_case(site, {})["fit"]
    with pytest.raises(InputError, match="views"):
        Pairs(**{**vars(pairs), **{k: getattr(pairs, k)[:3] for k in ("before", "again", "after", "depths", "poses")}})
    with pytest.raises(InputError, match="'after' is 5 x 48 x 60 x 3"):
        replace(pairs, after=pairs.after[:, :, :60])
    with pytest.raises(InputError, match="no poses"):
        replace(pairs, poses=np.full_like(pairs.poses, np.nan))
    with pytest.raises(InputError, match="'verify'"):
        diagnose_images({"fit": pairs, "select": pairs})


def test_unknown_parameters_and_values_out_of_bounds_are_refused():
    shooting([Applied("exposure", "", {"stops": 0.5})])
    for wrong in (Applied("exposure", "", {"stops": 9.0}), Applied("exposure", "", {}), Applied("magic", "", {})):
        with pytest.raises(InputError):
            shooting([wrong])


def test_truths_and_catalogue_agree_on_what_may_be_hidden():
    assert set(SIZES) == set(IMAGE_EFFECTS)
    assert not set(STRANGE) & set(IMAGE_EFFECTS)
    assert [str(candidate) for candidate in image_candidates(["focal"])] == ["focal"]
    assert ImageCandidate("focal").effect is IMAGE_EFFECTS["focal"]


def test_unit_of_an_effect_is_found_and_grows(site):
    sizes = [draw_image_case(site, ("exposure",), units, 5).hidden["exposure"] for units in (2.0, 8.0)]
    assert abs(sizes[1] / sizes[0]) == pytest.approx(4.0, rel=0.25)
    one, other = (draw_image_case(site, (), 0.0, 6) for _ in range(2))
    assert np.array_equal(one.pairs["fit"].after, other.pairs["fit"].after)
    assert one.seal == other.seal


def test_light_of_a_photo_is_moved_only_where_geometry_changes(site):
    pairs = hidden_case(site, {})["fit"]
    expectation = Expectation(pairs)
    np.testing.assert_allclose(expectation.photos(shooting()), pairs.before, atol=1e-6)
    lit = expectation.photos(shooting([Applied("exposure", "", {"stops": 0.2})]))
    assert (lit > pairs.before).mean() > 0.95


def test_effect_free_photos_raise_no_alarm(site):
    pairs = hidden_case(site, {})
    diagnosis = diagnose_images(pairs)
    assert diagnosis.finding.verdict == "no_discrepancy"
    findings = ImageAccount().findings_of(diagnosis, pairs, seed=0)
    assert "agree" in findings["sentence"]
    assert findings["amended"] == []
    assert unsteady(pairs) == ()


def test_unsteady_light_is_told(site):
    pairs = {role: replace(views, again=np.clip(views.again * 1.05, 0, 1)) for role, views in hidden_case(site, {}).items()}
    assert unsteady(pairs) == (UNSTEADY,)


def test_sums_over_blocks_are_those_of_every_block_by_itself():
    """Of a size that no scale divides."""
    values = np.random.default_rng(0).normal(size=(2, 21, 35, 3))
    for scale, found in zip(SCALES, _blocks(values), strict=True):
        for row, column in np.ndindex(found.shape[1:3]):
            block = values[:, row * scale : (row + 1) * scale, column * scale : (column + 1) * scale]
            np.testing.assert_allclose(found[:, row, column], block.sum(axis=(1, 2)), atol=1e-12)


def test_residuals_are_kept_and_what_moves_the_picture_leaves_its_grain(fine):
    """A residual that was asked for before is the same array, and equals one of a fresh view."""
    pairs = hidden_case(fine, {"extrinsics": 0.005})["fit"]
    view = ImageResiduals(pairs, learn_noise([pairs]))
    moved = (Applied("extrinsics", "", {p.name: 0.002 for p in IMAGE_EFFECTS["extrinsics"].parameters}),)
    assert view.residual(moved) is view.residual(moved)
    again = ImageResiduals(pairs, view.noise, expectation=view.expectation)
    np.testing.assert_array_equal(again.residual(moved), ImageResiduals(pairs, view.noise).residual(moved))
    expected = view._flats.variances(view.expectation.flat(shooting(moved)))
    np.testing.assert_array_equal(view._still, expected)


def test_exposure_is_named_with_its_size(site):
    diagnosis = diagnose_images(hidden_case(site, {"exposure": 0.1}), names=NAMES)
    assert diagnosis.finding.verdict == "named"
    (effect,) = diagnosis.effects
    assert effect.name == "exposure"
    assert effect.parameters["stops"] == pytest.approx(0.1, abs=0.01)
    assert diagnosis.verification.closure > 0.8
    # Without time stamps flicker is no candidate, and effects that only motion shows cannot be seen.
    assert {"flicker", "latency", "motion_blur", "rolling_shutter"} <= set(diagnosis.finding.unseen)


def test_noise_is_named_by_its_grain(site):
    diagnosis = diagnose_images(hidden_case(site, {"noise": 0.02}), names=STILL)
    assert diagnosis.finding.verdict == "named"
    (effect,) = diagnosis.effects
    assert effect.name == "noise"
    assert effect.parameters["read"] == pytest.approx(0.02, rel=0.2)


def test_a_cast_and_dark_corners_are_named_together(site):
    diagnosis = diagnose_images(hidden_case(site, {"white_balance": 0.04, "vignetting": 0.3}), names=NAMES)
    assert diagnosis.finding.verdict == "named"
    assert diagnosis.finding.best.names == ("vignetting", "white_balance")


def test_a_moved_camera_is_named_with_its_shift(fine):
    diagnosis = diagnose_images(hidden_case(fine, {"extrinsics": 0.005}), names=NAMES)
    assert diagnosis.finding.verdict == "named"
    assert diagnosis.finding.best.names == ("extrinsics",)
    values = diagnosis.finding.best.fit.effects[0].parameters
    assert values["x"] == pytest.approx(0.003, abs=0.0006)
    assert values["y"] == pytest.approx(0.004, abs=0.0006)


def test_what_is_in_no_catalogue_is_not_named(site):
    diagnosis = diagnose_images(hidden_case(site, {"ghost": 0.08}), names=NAMES)
    assert diagnosis.finding.verdict == "none_of_the_known"
    assert diagnosis.finding.p_value < Rules().alarm
