"""Alarms: calibrated on replicates, and not raised by coloured noise; and estimates of the noise's size."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.benchmark.noises import NOISES, spoiled
from gsbridge.gap.benchmark.trajectories import course
from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.formats.quantum import quantum_of
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.coherence import _pairs, coherence_p, line_p, related, without_witness
from gsbridge.gap.joints.detect import SCALES, block_means, excess, joint_null
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.noise import pooled, white_noise
from gsbridge.gap.joints.residuals import JointResiduals


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    system, plant = axis_plant(folder)
    mechanism = Mechanism(system)
    quiet, shaken = draw_case(plant, (), 0.0, 1, 2), draw_case(plant, ("shaking",), 4.0, 1, 2)
    return [[JointResiduals.of(mechanism, case.records[role]) for role in ("fit", "select")] for case in (quiet, shaken)]


def test_noise_is_told_from_motion_and_jumps():
    rng = np.random.default_rng(0)
    time = np.arange(2000) / 100
    values = np.sin(5 * time) + 0.3 * (time > 7) + 1e-3 * rng.normal(size=2000)
    assert white_noise(values[:, None])[0] == pytest.approx(1e-3, rel=0.06)


@given(st.floats(1e-6, 1e3), st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_noise_scales_with_the_values(scale, seed):
    values = np.random.default_rng(seed).normal(size=(400, 2))
    np.testing.assert_allclose(white_noise(scale * values), scale * white_noise(values), rtol=1e-6)


def test_noise_is_pooled_only_where_records_agree():
    found = pooled([np.array([1.0, 1.0]), np.array([1.1, 3.0])], [400, 400])
    assert found[0][0] == found[1][0] == pytest.approx(np.sqrt((1 + 1.21) / 2))
    assert [row[1] for row in found] == [1.0, 3.0]


@pytest.mark.parametrize("count", [60, 400, 4000])
def test_one_noise_is_taken_for_one_however_short_the_records(count):
    """Twenty-one channels on three records, as an arm of seven joints logs them."""
    rng, apart = np.random.default_rng(count), 0
    for _ in range(100):
        found = pooled([white_noise(rng.standard_normal((count, 21))) for _ in range(3)], [count] * 3)
        apart += not np.array_equal(found[0], found[1])
    assert apart <= 1


@pytest.mark.parametrize(("count", "ratio"), [(400, 1.5), (4000, 1.3)])
def test_noises_are_taken_for_two_from_the_ratio_that_the_documentation_states(count, ratio):
    """Docs state 1.5 for 400 samples; long records keep 1.3."""
    for factor, same in ((ratio - 0.02, True), (ratio + 0.02, False)):
        found = pooled([np.array([1.0]), np.array([factor])], [count, count])
        assert (found[0] == found[1]).all() == same


def test_twice_the_noise_is_not_taken_for_one():
    rng = np.random.default_rng(5)
    sizes = np.ones((3, 21))
    sizes[2, 4] = 2.0
    found = pooled([white_noise(size * rng.standard_normal((400, 21))) for size in sizes], [400] * 3)
    assert found[2][4] == pytest.approx(2.0, rel=0.2)
    assert found[0][4] == pytest.approx(1.0, rel=0.2)


def test_block_means_keep_the_size_of_white_noise():
    noise = np.random.default_rng(0).normal(size=(20000, 1))
    for scale in (1, 4, 16):
        assert block_means(noise, scale).std() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("count", [11, 63, 64, 65])
def test_records_shorter_than_the_longest_block_are_judged_by_shorter_blocks(count):
    # The mean of n squared normal variables has mean 1 and standard deviation sqrt(2 / n).
    rng = np.random.default_rng(count)
    found = np.stack([excess(rng.standard_normal((count, 2))) for _ in range(4000)])
    assert found.shape[1] == 3 * sum(scale <= count for scale in SCALES)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.08)
    np.testing.assert_allclose(found.std(axis=0), 1.0, atol=0.12)


def test_p_values_of_noise_are_those_of_chance_and_small_for_a_trend(views):
    view = views[0][0]
    null = joint_null(view, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    shape = view.residual().shape
    found = []
    for _ in range(60):
        noise = rng.normal(size=shape)
        found.append(null.p_value(view.project(noise / white_noise(noise))))
    assert np.mean(np.array(found) < 0.1) < 0.25
    assert min(found) < 0.3
    trend = 1.0 * np.sin(np.arange(shape[0]) / 40.0)[:, None]
    assert null.p_value(view.project(rng.normal(size=shape) + trend)) <= 0.01


def test_channels_that_move_together_are_motion(views):
    assert coherence_p(views[1], [view.residual() for view in views[1]], np.random.default_rng(0)) <= 0.01


def test_coloured_noise_is_no_motion(views):
    rng = np.random.default_rng(0)
    shape = views[0][0].residual().shape
    found = []
    for _ in range(10):
        noises = [lfilter([1.0], [1.0, -0.9], rng.normal(size=shape), axis=0) for _ in views[0]]
        found.append(coherence_p(views[0], noises, rng))
    assert np.mean(np.array(found) < 0.05) <= 0.3
    assert np.median(found) > 0.1


def test_what_was_computed_from_a_position_bears_no_witness(views):
    # A speed from differences repeats the noise of the position; so does the effort of a controller that reads the position.
    pair = views[0]
    rng, system = np.random.default_rng(3), pair[0].mechanism.system
    for smooth in (0.0, 0.6):
        residuals = []
        for view in pair:
            place = {kind: column for column, (kind, _) in enumerate(view.channels)}
            values = rng.normal(size=view.residual().shape) * view.sigma
            position = 1e-4 * rng.normal(size=len(values))
            speed = lfilter([1 - smooth], [1, -smooth], np.gradient(position, view.record.period))
            effort = -system.controller.stiffness[0] * position - system.controller.damping[0] * speed
            own = 0.1 * np.std(effort) * rng.normal(size=len(values))
            values[:, place["position"]], values[:, place["velocity"]] = position, speed
            values[:, place["effort"]] = effort + own
            residuals.append(values / view.sigma)
        assert all(related(*both) == [] for both in zip(pair, residuals, strict=True))
        assert all(without_witness(*both).all() for both in zip(pair, residuals, strict=True))
        assert coherence_p(pair, residuals, rng) == 1.0


def test_sensors_of_their_own_bear_witness(views):
    for group in views:
        for view in group:
            assert related(view, view.residual()) == [("velocity", 0), ("effort", 0)]
            assert not without_witness(view, view.residual()).any()


def test_a_vibration_is_told_from_hum_and_coloured_noise(views):
    # A motion of one frequency shows in position, speed and effort of the axis with the phases of one motion.
    rng, pair = np.random.default_rng(5), views[0]
    system = pair[0].mechanism.system
    stiffness, damping = system.controller.stiffness[0], system.controller.damping[0]
    found: dict[str, list[float]] = {"noise": [], "hum": [], "motion": []}
    for _ in range(12):
        for kind, out in found.items():
            residuals = []
            for view in pair:
                shape = view.residual().shape
                values = lfilter([1.0], [1.0, -0.8], rng.normal(size=(shape[0] + 100, shape[1])), axis=0)[100:]
                wave = np.exp(2j * np.pi * (3.3 * view.record.time + rng.random()))
                if kind == "hum":
                    values += 5.0 * (wave[:, None] * np.exp(2j * np.pi * rng.random(shape[1]))).real
                if kind == "motion":
                    rate = 2j * np.pi * 3.3
                    gains = {"position": 1.0, "velocity": rate, "effort": -stiffness - damping * rate}
                    moved = np.stack([(gains[name] * wave).real for name, _ in view.channels], axis=1) / view.sigma
                    # As strong against the noise in the weakest channel as hum is.
                    values += 5.0 * moved / moved.std(axis=0).min()
                residuals.append(values)
            out.append(line_p(pair, residuals, rng))
    assert max(found["motion"]) < 0.001
    assert min(found["noise"]) > 0.01
    assert np.mean(np.array(found["hum"]) < 0.002) <= 0.1


def test_surrogates_are_the_record_when_no_phase_is_turned(views):
    for pair in _pairs(views[1][0], views[1][0].residual()):
        again = pair.ahead @ pair.raw + pair.back @ pair.raw.conj()
        assert np.abs(again - pair.one).max() < 1e-4 * np.abs(pair.one).max()


def test_a_gain_by_chance_does_not_transfer():
    rng = np.random.default_rng(0)
    plain = lfilter([1.0], [1.0, -0.9], rng.normal(size=(4000, 2)), axis=0)
    shape = np.sin(np.arange(4000) / 50.0)[:, None] * np.ones(2)
    assert transfer(plain, plain - 0.3 * shape) < 3.0
    assert transfer(plain + 2.0 * shape, plain) > 5.0


def test_noise_that_remembers_itself_over_blocks_of_time_does_not_transfer():
    rng, found = np.random.default_rng(4), []
    for _ in range(300):
        plain, taught = (lfilter([1.0], [1.0, -0.95], rng.normal(size=(600, 2)), axis=0)[300:] for _ in range(2))
        wave = np.sin(np.arange(300)[:, None] * rng.uniform(0.02, 0.1, 2) + rng.uniform(0.0, 6.3, 2))
        part = (taught * wave).sum(axis=0) / (wave**2).sum(axis=0) * wave
        found.append(transfer(plain, plain - part))
    assert np.mean(np.array(found) > 3.0) <= 0.015


@pytest.mark.parametrize("kind", NOISES)
def test_spoiled_noise_has_the_stated_size(kind):
    clean = np.zeros((20000, 2))
    sigma = np.array([0.5, 2.0])
    noise = spoiled(clean, sigma, kind, np.random.default_rng(0))
    # Rounding to two spreads adds a twelfth of its step's square.
    wanted = sigma * (np.sqrt(1 + 4 / 12) if kind == "quantised" else 1.0)
    np.testing.assert_allclose(noise.std(axis=0), wanted, rtol=0.08)
    neighbours = np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]
    assert (neighbours > 0.3) == (kind == "coloured")


def sparse(plant, rate, hidden, seed, rounding=0.0):
    """Records of an axis whose commands run smoothly, logged a few times a second, perhaps by an encoder with a step."""
    rng, times = np.random.default_rng(seed), np.arange(round(8.0 * rate)) / rate
    wanted = course("multisine", plant.centre, plant.reach, 8.0, np.random.default_rng(5))
    moved = plant.truth(wanted, 8.0, times, hidden)
    measured = {kind: moved[kind] + rng.normal(0.0, 1.0, moved[kind].shape) * plant.noise[kind] for kind in ("position",)}
    if rounding:
        measured = {"position": rounding * np.round(moved["position"] / rounding)}
    sent = np.array([wanted(time) for time in times])
    quantum = {kind: quantum_of(values) for kind, values in measured.items()}
    return Record("sparse", times, plant.joints, {"command": sent}, measured, quantum=quantum)


def test_commands_that_ran_on_between_their_samples_raise_no_alarm(tmp_path):
    system, plant = axis_plant(tmp_path)
    mechanism, rng = Mechanism(system), np.random.default_rng(0)
    for seed in range(3):
        view = JointResiduals.of(mechanism, sparse(plant, 25.0, {}, seed))
        assert joint_null(view, rng).p_value(view.residual()) >= 0.01
        # An effect that the model lacks still raises the alarm.
        view = JointResiduals.of(mechanism, sparse(plant, 25.0, {"coulomb": 0.5}, seed))
        assert joint_null(view, rng).p_value(view.residual()) < 0.01
    held = Mechanism(replace(system, controller=replace(system.controller, between="hold")))
    assert not JointResiduals.of(held, sparse(plant, 25.0, {}, 0)).frame.curving.any()


def test_what_an_encoder_rounds_asks_for_no_explanation(tmp_path):
    system, plant = axis_plant(tmp_path)
    view = JointResiduals.of(Mechanism(system), sparse(plant, 50.0, {}, 0, rounding=2e-3))
    assert view.tolerance() == pytest.approx(2e-3 / np.sqrt(12) / view.sigma)
    # Noise larger than the step turns the rounding into independent noise.
    record = view.record
    noisy = record.measured["position"] + np.random.default_rng(1).normal(0.0, 5e-3, record.measured["position"].shape)
    noisy = 2e-3 * np.round(noisy / 2e-3)
    other = replace(record, measured={"position": noisy}, quantum={"position": quantum_of(noisy)})
    assert other.quantum["position"] == pytest.approx(2e-3)
    assert JointResiduals.of(view.mechanism, other).tolerance() == pytest.approx(0.0)
