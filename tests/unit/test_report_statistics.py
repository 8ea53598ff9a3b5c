"""Statistics of successes against other derivations: hand-worked values, scipy, exact enumeration, plain loops."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from gsbridge.report.tables.statistics import (
    fisher_p,
    mean_maximum_rank_violation,
    mean_relative_drop,
    pearson,
    relative_change,
)
from gsbridge.statistics import wilson_interval

COUNTS = st.integers(1, 300).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials)))
RATES = st.lists(st.tuples(st.integers(0, 32), st.integers(0, 32)), min_size=2, max_size=9)


@pytest.mark.parametrize(
    ("successes", "low", "high"), [(31, 0.843, 0.994), (28, 0.719, 0.950), (24, 0.579, 0.867), (22, 0.514, 0.820)]
)
def test_wilson_at_the_papers_counts(successes, low, high):
    assert wilson_interval(successes, 32) == pytest.approx((low, high), abs=1e-3)


@settings(deadline=None)
@given(COUNTS)
def test_wilson_is_scipys(counts):
    interval = stats.binomtest(*counts).proportion_ci(0.95, method="wilson")
    assert wilson_interval(*counts) == pytest.approx((interval.low, interval.high), abs=1e-9)


@given(COUNTS)
def test_wilson_limits_are_the_rates_that_a_score_test_just_allows(counts):
    successes, trials = counts
    rate, z = successes / trials, stats.norm.ppf(0.975)
    for limit in wilson_interval(successes, trials):
        if 0.0 < limit < 1.0:
            assert abs(rate - limit) / math.sqrt(limit * (1 - limit) / trials) == pytest.approx(z, rel=1e-6)
        else:
            assert limit == rate


def test_counts_that_cannot_be_are_refused():
    for successes, trials in ((0, 0), (-1, 4), (5, 4)):
        with pytest.raises(ValueError, match="cannot be"):
            wilson_interval(successes, trials)
    with pytest.raises(ValueError, match="confidence"):
        wilson_interval(1, 2, confidence=95)
    with pytest.raises(ValueError, match="cannot be"):
        fisher_p(1, 2, 3, 2)


def test_fisher_tells_the_papers_drops_from_its_chance():
    # RL-sim's falls are beyond chance; none of RL-GSBridge's changes is, neither the bear's gain nor its fall.
    assert fisher_p(31, 32, 4, 32) < 1e-6
    assert fisher_p(30, 32, 8, 32) < 1e-6
    assert fisher_p(28, 32, 24, 32) > 0.1
    assert fisher_p(28, 32, 32, 32) > 0.1
    assert fisher_p(31, 32, 31, 32) == 1.0


@settings(deadline=None)
@given(st.integers(1, 12), st.integers(1, 12), st.data())
def test_fisher_is_the_sum_over_all_tables_that_are_no_likelier(sim_trials, real_trials, data):
    sim, real = data.draw(st.integers(0, sim_trials)), data.draw(st.integers(0, real_trials))

    def ways(found):
        return math.comb(sim_trials, found) * math.comb(real_trials, sim + real - found)

    possible = range(max(0, sim + real - real_trials), min(sim_trials, sim + real) + 1)
    unlikely = sum(ways(found) for found in possible if ways(found) <= ways(sim))
    expected = unlikely / math.comb(sim_trials + real_trials, sim + real)
    assert fisher_p(sim, sim_trials, real, real_trials) == pytest.approx(expected, rel=1e-9)


def test_relative_change_as_the_paper_prints_it():
    printed = {(31, 28): -10, (32, 30): -6, (32, 31): -3, (28, 24): -14, (28, 32): 14, (31, 4): -87, (30, 8): -73, (22, 23): 4}
    for (sim, real), percent in printed.items():
        # The paper cuts 4.54 to 4 and rounds 9.68 to 10.
        assert 100 * relative_change(sim / 32, real / 32) == pytest.approx(percent, abs=0.6)
    assert relative_change(0.0, 0.5) is None


def test_mean_drops_of_the_paper():
    six = [(32, 32), (32, 30), (31, 28), (32, 30), (32, 31), (28, 24)]
    changes = [relative_change(sim / 32, real / 32) for sim, real in six]
    assert 100 * mean_relative_drop(changes) == pytest.approx(6.6, abs=0.05)
    eight = [*changes, 0.0, relative_change(28 / 32, 1.0)]
    assert 100 * mean_relative_drop(eight) == pytest.approx(3.2, abs=0.05)
    # Means of drops, not the drop of the means.
    sim, real = (sum(column) for column in zip(*six, strict=True))
    assert mean_relative_drop(changes) != pytest.approx(1 - real / sim, abs=1e-4)
    assert mean_relative_drop([]) is None
    assert mean_relative_drop([0.1, None]) is None


@settings(deadline=None)
@given(RATES)
def test_pearson_is_scipys_where_it_is_defined(pairs):
    sim, real = np.array(pairs, dtype=float).T / 32
    found = pearson(sim, real)
    if np.ptp(sim) == 0 or np.ptp(real) == 0:
        assert found is None
    else:
        assert found == pytest.approx(stats.pearsonr(sim, real).statistic, abs=1e-9)


def violation_by_loops(sim, real):
    """SIMPLER's definition, written as it is read."""
    worst = []
    for i in range(len(sim)):
        differences = [0.0]
        for j in range(len(sim)):
            if (sim[i] > sim[j]) != (real[i] > real[j]):
                differences.append(abs(real[i] - real[j]))
        worst.append(max(differences))
    return sum(worst) / len(worst)


@given(RATES)
def test_violation_is_the_definition(pairs):
    sim, real = np.array(pairs, dtype=float).T / 32
    assert mean_maximum_rank_violation(sim, real) == pytest.approx(violation_by_loops(sim, real), abs=1e-12)


def test_violation_by_hand_and_its_argument_order():
    # Simulation swaps the last two, which are 0.1 apart in reality: both are violated by 0.1, the first by nothing.
    sim_rates, real_rates = [0.9, 0.2, 0.6], [0.8, 0.5, 0.4]
    assert mean_maximum_rank_violation(sim_rates=sim_rates, real_rates=real_rates) == pytest.approx(0.2 / 3)
    # Called the other way round the same swap weighs 0.4.
    assert mean_maximum_rank_violation(sim_rates=real_rates, real_rates=sim_rates) == pytest.approx(0.8 / 3)
    assert mean_maximum_rank_violation(real_rates, real_rates) == 0.0
    # A tie in simulation alone is a violation of one of the two.
    assert mean_maximum_rank_violation([0.5, 0.5], [0.3, 0.7]) == pytest.approx(0.2)
    assert mean_maximum_rank_violation([], []) is None


def test_no_violation_means_the_same_order():
    levels = [0.0, 0.5, 1.0]
    for sim in product(levels, repeat=3):
        for real in product(levels, repeat=3):
            same = all((sim[i] > sim[j]) == (real[i] > real[j]) for i in range(3) for j in range(3) if real[i] != real[j])
            assert (mean_maximum_rank_violation(sim, real) == 0.0) == same


def test_rates_must_come_in_pairs():
    for function in (pearson, mean_maximum_rank_violation):
        with pytest.raises(ValueError, match="no pairs"):
            function([0.5, 0.6], [0.5])
