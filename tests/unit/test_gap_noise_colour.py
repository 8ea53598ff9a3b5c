"""Autocorrelated noise: its estimated law against the process that made it, and findings in its presence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.joints.diagnose import diagnose_joints
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.noise_colour import NoiseColour, forgetful
from gsbridge.gap.joints.residuals import JointResiduals


def filtered(memory, shape, seed):
    """Noise of unit variance of which each sample is `memory` times the last one and something new."""
    fresh = np.random.default_rng(seed).standard_normal((shape[0] + 400, *shape[1:]))
    return lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], fresh, axis=0)[400:]


def five_deviations(memory, samples):
    """Of the relative size of what is new in each sample, as so many of them tell it: that of a first autocorrelation is
    sqrt((1 - memory^2) / samples) (Bartlett, 1946), and what is new is sqrt(1 - its square)."""
    return 5.0 * (abs(memory) / np.sqrt((1.0 - memory**2) * samples) + 1.0 / np.sqrt(2.0 * samples))


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    return (*axis_plant(folder), folder)


@given(st.floats(0.1, 0.95), st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_the_law_is_that_of_the_process(memory, seed):
    noise = filtered(memory, (18000, 2), seed)
    law = NoiseColour.of([noise[:9000], noise[9000:]])
    np.testing.assert_allclose(law.coefficients, [[memory] * 2, [0.0] * 2], atol=0.05)
    np.testing.assert_allclose(law.innovation, np.sqrt(1.0 - memory**2), rtol=five_deviations(memory, 18000))
    np.testing.assert_allclose(law.memory, -1.0 / np.log(memory), rtol=0.25, atol=0.5)


@given(st.floats(-0.9, 0.95), st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_whitening_leaves_white_noise_of_unit_variance_and_can_be_undone(memory, seed):
    noise = filtered(memory, (20000, 1), seed)
    law = NoiseColour.of([noise])
    white = law.whiten(noise)
    assert white.std() == pytest.approx(1.0, abs=five_deviations(memory, 20000))
    assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 0.03
    np.testing.assert_allclose(law.colour(white), noise, atol=1e-9)


def test_what_lasts_becomes_what_it_is_in_units_of_what_is_new_in_each_sample():
    law = NoiseColour(np.array([[0.8], [0.0]]), np.array([0.6]), 200)
    assert law.steady == pytest.approx(0.2 / 0.6)
    assert law.whiten(np.ones((200, 1)))[-1] == pytest.approx(0.2 / 0.6)


@pytest.mark.parametrize(("memory", "size", "period", "told"), [
    (0.7, 1.8, 0.01, True),
    # The noise is as large as neighbouring samples show: there is nothing to explain.
    (0.7, 1.0, 0.01, False),
    # This correlation lasts a quarter of a second, within which an arm may move, so it does not count as noise.
    (0.96, 4.0, 0.01, False),
    (0.96, 4.0, 0.001, True),
])  # fmt: skip
def test_noise_of_a_filter_is_large_and_soon_forgotten(memory, size, period, told):
    law = NoiseColour.of([filtered(memory, (4000, 3), 7)])
    assert forgetful(law, np.full(3, size), period) is told


@given(st.floats(0.3, 0.93), st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_a_short_record_makes_no_memory_longer_than_it_may_be(memory, seed):
    law = NoiseColour.of([filtered(memory, (400, 2), seed)])
    assert (law.least_memory < law.memory).all()
    # Two standard deviations are taken off, and few samples shorten memories. The largest of 6000 was 1.63 times the truth.
    assert (law.least_memory < -2.0 / np.log(memory)).all()


def test_residuals_of_coloured_noise_are_white_and_unit_and_orthogonal_to_the_initial_state(axis):
    case = draw_case(axis[1], (), 0.0, 3, 4)
    record = case.records["fit"]
    rng, sigma = np.random.default_rng(5), axis[1].noise
    noisy = {
        kind: v + 3.0 * sigma[kind] * filtered(0.8, v.shape, int(rng.integers(2**31))) for kind, v in record.measured.items()
    }
    view = JointResiduals.of(Mechanism(axis[0]), replace(record, measured=noisy, sigma={}))
    plain = view.residual()
    sizes, law = np.sqrt((plain**2).mean(axis=0)), NoiseColour.of([plain])
    view.set_noise(view.sigma * sizes, 1, law)
    white = view.residual()
    assert np.sqrt((white**2).mean()) == pytest.approx(1.0, abs=0.08)
    products = (white[1:] * white[:-1]).mean(axis=0) / (white**2).mean(axis=0)
    assert np.abs(products).max() < 0.15
    for nudge in view.frame.nudges:
        moved = view.whiten(view._columns(nudge))
        assert np.abs(moved).max() < 1e-6 * np.abs(view._columns(nudge) / view.sigma).max()
    np.testing.assert_allclose(view.decoloured(view.coloured(white)), white, atol=1e-9)


@pytest.mark.parametrize(("hidden", "verdict"), [("coulomb", "named"), ("shaking", "none_of_the_known")])
def test_an_effect_is_named_beside_filtered_noise_and_what_is_in_no_catalogue_is_not(axis, hidden, verdict):
    case = draw_case(axis[1], (hidden,), 20.0, 40, 41, spoil="coloured")
    result = diagnose_joints(axis[0], case.records, axis[2] / "bank", seed=1)
    assert result.finding.verdict == verdict
    if verdict == "named":
        assert result.finding.best.names == (f"{hidden}:axis",)
        value, deviation = result.finding.best.fit.values[0]["torque"], result.finding.best.fit.deviations[0]
        assert abs(value - case.hidden[hidden]) < 4.0 * deviation
        assert result.verification.closure > 0.9
        assert any("remembers itself" in warning for warning in result.warnings)


@pytest.mark.parametrize(("hidden", "seed"), [(("coulomb", "encoder_scale"), 43), (("armature", "coulomb"), 44)])
def test_two_effects_are_named_together_beside_filtered_noise(axis, hidden, seed):
    case = draw_case(axis[1], hidden, 20.0, seed, 41, spoil="coloured")
    result = diagnose_joints(axis[0], case.records, axis[2] / "bank", seed=1)
    assert result.finding.verdict == "named"
    assert set(result.finding.best.names) == {f"{name}:axis" for name in hidden}
    assert result.account.explained > 0.85
    assert len(result.account.entries) == 2
    assert result.runs <= 200
    assert result.seconds > 0.0


def test_a_small_motion_that_two_records_do_not_prove_shows_on_three(axis):
    """It is no coloured noise, though nothing that was learnt from one record holds on another."""
    case = draw_case(axis[1], ("detent",), 4.0, 62, 63)
    found = diagnose_joints(axis[0], case.records, axis[2] / "bank", seed=1).finding
    assert (found.verdict, found.best, found.something_remains) == ("none_of_the_known", None, True)
