"""How much of a gap is closed, with and without moments in which something else happened."""

import numpy as np
import pytest

from gsbridge.gap.diagnosis.closure import closed, closed_at_most_times


@pytest.fixture
def noise():
    return np.random.default_rng(0).standard_normal((2000, 3))


def test_what_leaves_noise_closes_all_and_what_leaves_a_part_does_not(noise):
    gap = 20.0 * np.sin(np.arange(2000) / 30.0)[:, None] * np.ones(3)
    assert closed(noise + gap, noise, 1.0) == pytest.approx(1.0, abs=0.02)
    assert closed(noise + gap, noise + 0.3 * gap, 1.0) == pytest.approx(0.7, abs=0.02)
    # A remainder that lasts all the time is no short disturbance, so leaving out the worst moments changes little.
    assert closed_at_most_times(noise + gap, noise + 0.3 * gap, 1.0) == pytest.approx(0.7, abs=0.03)


def test_a_push_for_a_while_is_left_out_and_a_longer_one_is_not(noise):
    gap = 20.0 * np.sin(np.arange(2000) / 30.0)[:, None] * np.ones(3)
    for share, found in ((0.1, True), (0.4, False)):
        push = np.zeros((2000, 3))
        push[700 : 700 + round(2000 * share)] = 30.0
        assert closed(noise + gap + push, noise + push, 1.0) < 0.75
        assert (closed_at_most_times(noise + gap + push, noise + push, 1.0) > 0.95) == found


def test_a_short_record_is_judged_as_a_whole(noise):
    assert closed_at_most_times(5.0 + noise[:20], noise[:20], 1.0) == closed(5.0 + noise[:20], noise[:20], 1.0)
