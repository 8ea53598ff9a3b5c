"""The diagnosis of pictures on a small site of the benchmark, whose truths know nothing of our effects."""

from dataclasses import replace

import numpy as np
import pytest

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.image_truth import grainy
from gsbridge.gap.benchmark.images import SIZES, STRANGE, draw_image_case, film, site_of
from gsbridge.gap.image.diagnose import diagnose_images, image_findings
from gsbridge.gap.image.floor import Flats, learn_floor
from gsbridge.gap.image.model import ImageCandidate, check, image_candidates
from gsbridge.gap.image.screen import gains_of
from gsbridge.gap.image.shots import REFERENCE, ROLES, Shots
from gsbridge.gap.image.view import View
from gsbridge.gap.system import Applied
from gsbridge.scene.effects import catalogue

UNFINISHED = pytest.mark.xfail(reason="the diagnosis of pictures is not calibrated; no rule uses it", strict=False)


@pytest.fixture(scope="module")
def site():
    return site_of(7, camera=Camera(40, 30, 38.0, 38.0, 20.0, 15.0), photos=4, splats=900, steps=120)


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


def test_floor_whitens_what_splats_leave(site):
    floor = learn_floor(site.model, site.reference)
    view = View(site.model, site.reference, floor)
    table = view.residual()
    count, height = view.shots.photos.shape[:2]
    assert (table[: count * height] ** 2).mean() == pytest.approx(1.0, abs=0.15)


@UNFINISHED
def test_floor_knows_how_much_grain_varies(site):
    view = View(site.model, site.reference, learn_floor(site.model, site.reference))
    count, height = view.shots.photos.shape[:2]
    measured = 3 * (view.flats.counts >= 20).sum()
    assert (view.residual()[count * height :] ** 2).sum() / measured == pytest.approx(1.0, abs=0.4)


def test_too_few_effect_free_photos_are_refused(site):
    with pytest.raises(InputError, match="effect-free"):
        learn_floor(site.model, site.reference.part(np.arange(5)))


def test_unknown_parameters_and_values_out_of_bounds_are_refused():
    check(Applied("exposure", "", {"stops": 0.5}))
    for wrong in (Applied("exposure", "", {"stops": 9.0}), Applied("exposure", "", {}), Applied("magic", "", {})):
        with pytest.raises(InputError):
            check(wrong)


def test_truths_and_catalogue_agree_on_what_may_be_hidden():
    assert set(SIZES) == set(catalogue())
    assert not set(STRANGE) & set(catalogue())
    assert [str(candidate) for candidate in image_candidates(["focal"])] == ["focal"]
    assert ImageCandidate("focal").effect is catalogue()["focal"]


@UNFINISHED
def test_unit_of_an_effect_is_found_and_grows(site):
    sizes = [draw_image_case(site, ("exposure",), units, 5).hidden["exposure"] for units in (2.0, 8.0)]
    assert abs(sizes[1] / sizes[0]) == pytest.approx(4.0, rel=0.25)
    one, other = (draw_image_case(site, (), 0.0, 6) for _ in range(2))
    assert np.array_equal(one.shots["fit"].photos, other.shots["fit"].photos)
    assert one.seal == other.seal


def test_model_with_the_effect_in_it_predicts_the_photos(site):
    """Against the truth's own formulation: the same exposure and latency in the splats take the difference away."""
    for name, values in (("exposure", {"stops": 0.3}), ("latency", {"delay": 0.06})):
        hidden = {name: next(iter(values.values()))}
        track, times = site.reference.track, site.reference.times[:6]
        wanted = site.lens(hidden).photos(track, times)
        plain = site.model.photographer.photos(track, times)
        known = replace(site.model, effects=(Applied(name, "", values),))
        explained = known.photographer.photos(track, times, known.shooting())
        empty = site.lens().photos(track, times)
        floor = ((empty - plain) ** 2).mean()
        assert ((wanted - explained) ** 2).mean() < 1.3 * floor < 0.6 * ((wanted - plain) ** 2).mean()


NAMES = ("exposure", "extrinsics", "noise", "white_balance")


def hidden_case(site, hidden, seed=11):
    """Photos of all roles with sizes that are given, not searched."""
    rng, shots = np.random.default_rng(seed), {REFERENCE: site.reference}
    spin = {"wr": 0.8, "wb": -0.6}
    for role in ROLES:
        track, times = film(int(rng.integers(1 << 30)), site.photos)
        shots[role] = Shots(times, grainy(site.lens(hidden, spin).photos(track, times), hidden, rng), track, role)
    return shots


@UNFINISHED
def test_noise_is_named_by_its_grain(site):
    diagnosis = diagnose_images(site.model, hidden_case(site, {"noise": 0.04}), names=NAMES)
    assert diagnosis.finding.verdict == "named"
    (effect,) = diagnosis.effects
    assert effect.name == "noise"
    assert effect.parameters["read"] == pytest.approx(0.04, rel=0.15)


@UNFINISHED
def test_effect_free_photos_raise_no_alarm(site):
    diagnosis = diagnose_images(site.model, hidden_case(site, {}), names=NAMES)
    assert diagnosis.finding.verdict == "no_discrepancy"
    findings = image_findings(diagnosis, hidden_case(site, {}), seed=0)
    assert "agree" in findings["sentence"]
    assert findings["amended"] == []


@UNFINISHED
def test_exposure_is_found_with_its_size(site):
    diagnosis = diagnose_images(site.model, hidden_case(site, {"exposure": 0.5}), names=NAMES)
    assert diagnosis.finding.best.names == ("exposure",)
    assert diagnosis.finding.best.fit.effects[0].parameters["stops"] == pytest.approx(0.5, abs=0.05)
    assert diagnosis.verification.closure > 0.8
