"""Stamps that scatter about a steady clock, against clocks and motions that are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.gap.formats.clock import PAUSE, steadied, unbroken
from gsbridge.gap.formats.records import Record

PERIOD = 0.01


def logged(at, stamps, noise=1e-5, moves=True):
    """A record of two joints that were measured at some times and stamped with others."""
    rng = np.random.default_rng(7)
    motion = np.stack([0.8 * np.sin(3 * at) + 0.2 * np.sin(11 * at), np.cos(2 * at)], axis=1) * moves
    position = motion + rng.normal(0.0, noise, motion.shape)
    return Record("log", stamps - stamps[0], ("a", "b"), {"command": motion}, {"position": position})


@given(st.integers(0, 2**31), st.floats(0.0, 0.1), st.floats(0.003, 0.007), st.sampled_from((1.0, 0.97, 1.04)))
@settings(max_examples=25, deadline=None)
def test_late_stamps_of_a_steady_clock_are_put_right(seed, lost, late, rate):
    rng = np.random.default_rng(seed)
    period = PERIOD * rate
    at = (period * np.arange(6000))[rng.random(6000) >= lost]
    record, scatter = steadied(logged(at, at + rng.uniform(0.0, late, len(at))))
    assert scatter == pytest.approx(late / np.sqrt(12), rel=0.1)
    # Five standard deviations of the difference between both ends of a line that was fitted to so many scattered stamps.
    np.testing.assert_allclose(record.time, at - at[0], atol=5.0 * scatter * np.sqrt(8.0 / len(at)))


@pytest.mark.parametrize("lost", [0.0, 0.05])
def test_stamps_of_a_steady_clock_stay_to_the_bit(lost):
    at = (PERIOD * np.arange(3000))[np.random.default_rng(0).random(3000) >= lost]
    record = logged(at, at)
    assert steadied(record) == (record, None)


def test_uneven_sampling_that_is_stamped_rightly_stays():
    rng = np.random.default_rng(1)
    at = PERIOD * np.arange(3000) + rng.uniform(0.0, 0.006, 3000)
    record = logged(at, at)
    assert steadied(record) == (record, None)


@pytest.mark.parametrize("later", [0.5, 500.0])
def test_of_a_log_that_breaks_off_the_longest_part_is_taken(later):
    at = np.concatenate(
        [PERIOD * np.arange(250), 2.5 + later + PERIOD * np.arange(1000), 20.0 + later + PERIOD * np.arange(300)]
    )
    record = logged(at, at)
    part, said = unbroken(record, "log.csv")
    assert part.time[0] == 0.0
    np.testing.assert_array_equal(part.measured["position"], record.measured["position"][250:1250])
    np.testing.assert_array_equal(part.commands["command"], record.commands["command"][250:1250])
    assert f"{2.5 + later:.4g} to" in said


def test_samples_that_are_missing_are_no_break():
    rng = np.random.default_rng(4)
    at = (PERIOD * np.arange(3000))[rng.random(3000) >= 0.4]
    record = logged(at, at)
    assert unbroken(record, "log.csv") == (record, "")


def test_a_log_of_short_parts_is_refused():
    at = np.concatenate([3.0 * k + PERIOD * np.arange(100) for k in range(5)])
    with pytest.raises(InputError, match="no part between lasts 2 s"):
        unbroken(logged(at, at), "log.csv")


def test_a_joint_that_rests_tells_nothing_of_the_clock():
    rng = np.random.default_rng(2)
    at = PERIOD * np.arange(3000)
    record = logged(at, at + rng.uniform(0.0, 0.006, 3000), moves=False)
    assert steadied(record) == (record, None)


def test_no_clock_is_made_up_where_two_samples_share_a_tick():
    rng = np.random.default_rng(3)
    at = np.sort(rng.uniform(0.0, 30.0, 3000))
    record = replace(logged(at, at))
    assert steadied(record)[1] is None


@pytest.mark.parametrize("pause", [5.0, 50.0, 3600.0, 1.7e9])
def test_a_pause_adds_no_rates_to_try(pause):
    """Stamps scatter on both sides of a pause. With a clock that was set to another epoch, no memory held the rates."""
    rng = np.random.default_rng(5)
    at = np.concatenate([PERIOD * np.arange(600), 6.0 + pause + PERIOD * np.arange(600)])
    record = logged(at, at + rng.uniform(0.0, 0.006, len(at)))
    found, scatter = steadied(record)
    if pause > PAUSE:
        # Across so long a pause nobody knows how many ticks went by.
        assert (found, scatter) == (record, None)
    else:
        assert scatter == pytest.approx(0.006 / np.sqrt(12), rel=0.1)
        np.testing.assert_allclose(np.diff(found.time), np.diff(at), atol=1e-4)


@pytest.mark.parametrize("first", [20, 49, 700])
def test_the_clock_is_found_in_the_longest_part_between_pauses(first):
    rng = np.random.default_rng(8)
    at = np.concatenate([PERIOD * np.arange(first), 20.0 + PERIOD * np.arange(3000), 70.0 + PERIOD * np.arange(40)])
    record, scatter = steadied(logged(at, at + rng.uniform(0.0, 0.006, len(at))))
    assert scatter == pytest.approx(0.006 / np.sqrt(12), rel=0.1)
    np.testing.assert_allclose(np.diff(record.time)[:10], PERIOD, atol=1e-4)


def test_pauses_between_runs_are_no_break_where_nothing_is_commanded():
    at = np.concatenate([PERIOD * np.arange(400), 4.0 + 0.9 * PAUSE + PERIOD * np.arange(300)])
    record = logged(at, at)
    assert unbroken(record, "log.csv", PAUSE) == (record, "")
    later = at + np.where(at > 4.0, PAUSE, 0.0)
    part, said = unbroken(logged(later, later), "log.csv", PAUSE)
    assert len(part.time) == 400
    assert "breaks off" in said
