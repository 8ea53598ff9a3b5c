"""Statistics of successes: tests, and how well one world foretells another.

Arguments are named by world, because two of the definitions are not symmetric: the relative change divides by the rate in
simulation, and the mean maximum rank violation weighs by differences in reality.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from statistics import fmean

import numpy as np
from scipy import stats

from gsbridge.geometry import Array
from gsbridge.statistics import CONFIDENCE, Tally, check_counts, limits, redrawn_rates, trainings_interval, wilson_interval

WIDEST = "95 %, widest of bootstrap, Student and Wilson"
"""Name of the kind of interval that `mean_interval` gives for more than one training."""


def fisher_p(sim_successes: int, sim_trials: int, real_successes: int, real_trials: int) -> float:
    """Two-sided p of Fisher's exact test that both worlds have the same success rate.

    Args:
        sim_successes, sim_trials: Successful and all trials in simulation.
        real_successes, real_trials: Successful and all trials in the other world.

    Raises:
        ValueError: The counts make no sense.
    """
    check_counts(sim_successes, sim_trials)
    check_counts(real_successes, real_trials)
    table = np.array([[sim_successes, sim_trials - sim_successes], [real_successes, real_trials - real_successes]])
    return float(stats.fisher_exact(table).pvalue)


def relative_change(sim_rate: float, real_rate: float) -> float | None:
    """Change of a success rate from simulation to reality, as a share of the rate in simulation; negative for a drop.

    None where nothing succeeds in simulation: there the change is not defined.

    Source: RL-GSBridge, experiments: 96.88 % to 87.50 % is called a drop of 10 %, and 6.6 % is the mean of such drops.
    """
    return (real_rate - sim_rate) / sim_rate if sim_rate > 0.0 else None


def mean_relative_drop(changes: Sequence[float | None]) -> float | None:
    """Mean of the relative drops of several cells, that is of the changes with their sign turned; positive for a loss.

    Every cell counts the same, and a gain lowers the mean. None without cells or where one change is not defined.
    """
    known = [change for change in changes if change is not None]
    return -sum(known) / len(known) if known and len(known) == len(changes) else None


def pearson(sim_rates: Sequence[float], real_rates: Sequence[float]) -> float | None:
    """Pearson's correlation of the cells' success rates in two worlds, -1..1.

    None for fewer than two cells, or where all cells of a world have the same rate: r is not defined there.

    Raises:
        ValueError: There are not as many rates in both worlds.
    """
    sim, real = _paired(sim_rates, real_rates)
    if len(sim) < 2 or np.ptp(sim) == 0.0 or np.ptp(real) == 0.0:
        return None
    return float(np.clip(np.corrcoef(sim, real)[0, 1], -1.0, 1.0))


def mean_maximum_rank_violation(sim_rates: Sequence[float], real_rates: Sequence[float]) -> float | None:
    """MMRV of SIMPLER: how much success in reality is misjudged by the ranks of simulation; 0 is best.

    For each cell, take the largest difference in reality to any cell that simulation ranks the other way round; the mean
    maximum rank violation (MMRV) averages it over the cells. A tie in one world alone counts as a violation for one cell of the
    pair, as in SIMPLER's code. None without cells.

    Args:
        sim_rates: Success rates in simulation, 0..1. [N].
        real_rates: Success rates of the same cells in reality, which weigh the violations. [N].

    Raises:
        ValueError: There are not as many rates in both worlds.

    Source: Li et al., Evaluating Real-World Robot Manipulation Policies in Simulation (SIMPLER), 2024.
    """
    sim, real = _paired(sim_rates, real_rates)
    if len(sim) == 0:
        return None
    violated = (sim[:, None] > sim[None, :]) != (real[:, None] > real[None, :])
    return float((violated * np.abs(real[:, None] - real[None, :])).max(axis=1).mean())


def mean_rate(cells: Collection[Sequence[Tally]]) -> float:
    """Mean success rate over cells, each counting the same; a cell lists successes and trials of its trainings."""
    return fmean(sum(good for good, _ in cell) / sum(tried for _, tried in cell) for cell in cells)


def mean_interval(cells: Collection[Sequence[Tally]]) -> tuple[float, float]:
    """95 % interval of `mean_rate`.

    For one training of one cell it is Wilson's interval, which says nothing about other trainings. Otherwise it is the widest
    of three: a hierarchical bootstrap's (it redraws each cell's trainings, then their starts); Wilson's for as many trials,
    because the bootstrap hardly varies where nearly all trials end alike; and Student's of the trainings' own rates, because
    redrawing three trainings shows only two thirds of the variance between trainings.

    Source: Davison and Hinkley, Bootstrap Methods and their Application, 1997, sections 2.3 and 3.8.
    """
    if [len(cell) for cell in cells] == [1]:
        return trainings_interval([tally for cell in cells for tally in cell])
    rate, half = mean_rate(cells), _student(_spread(cells))
    sides = [limits(_redrawn_mean(cells, 0)), _wilson(cells), (max(0.0, rate - half), min(1.0, rate + half))]
    return min(low for low, _ in sides), max(high for _, high in sides)


def interval_kind(cells: Collection[Sequence[Tally]]) -> str:
    """Name the kind of interval that `mean_interval` gives for these cells."""
    return "95 % (Wilson)" if [len(cell) for cell in cells] == [1] else WIDEST


def lead_interval(ours: Collection[Sequence[Tally]], others: Collection[Sequence[Tally]]) -> tuple[float, float]:
    """95 % interval of the difference of two means over the same cells: the widest of the three kinds in `mean_interval`.

    The distances of both means to their Wilson limits are combined as the root of the sum of squares.

    Source: Newcombe, Interval estimation for the difference between independent proportions, 1998, method 10.
    """
    means, wilson = [mean_rate(ours), mean_rate(others)], [_wilson(ours), _wilson(others)]
    lead, half = means[0] - means[1], _student([*_spread(ours), *_spread(others)])
    below = np.hypot(means[0] - wilson[0][0], wilson[1][1] - means[1])
    above = np.hypot(wilson[0][1] - means[0], means[1] - wilson[1][0])
    redrawn = limits(_redrawn_mean(ours, 1) - _redrawn_mean(others, 2))
    low, high = min(redrawn[0], float(lead - max(below, half))), max(redrawn[1], float(lead + max(above, half)))
    return max(low, -1.0), min(high, 1.0)


def _wilson(cells: Collection[Sequence[Tally]]) -> tuple[float, float]:
    """Wilson's interval of a mean over cells, for the number of trials whose rate would vary as much as the mean does."""
    trials = [sum(tried for _, tried in cell) for cell in cells]
    count, rate = round(len(trials) ** 2 / sum(1.0 / tried for tried in trials)), mean_rate(cells)
    low, high = wilson_interval(round(rate * count), count)
    return min(low, rate), max(high, rate)


def _spread(cells: Collection[Sequence[Tally]]) -> list[tuple[float, int]]:
    """Variance that each cell of several trainings adds to the mean, from its trainings' rates, and its degrees of freedom."""
    rates = [[good / tried for good, tried in cell] for cell in cells if len(cell) > 1]
    return [(float(np.var(cell, ddof=1)) / len(cell) / len(cells) ** 2, len(cell) - 1) for cell in rates]


def _student(parts: Sequence[tuple[float, int]]) -> float:
    """Half width of the 95 % interval of a sum of independent means with these variances and degrees of freedom; 0 for none.

    Source: Welch, The generalization of Student's problem when several different population variances are involved, 1947.
    """
    whole = sum(variance for variance, _ in parts)
    if whole == 0.0:
        return 0.0
    freedom = whole**2 / sum(variance**2 / count for variance, count in parts)
    return float(stats.t.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(whole))


def _redrawn_mean(cells: Collection[Sequence[Tally]], stream: int) -> Array:
    """Redraw the mean over cells by bootstrap; each `stream` has random numbers of its own. [REDRAWS]."""
    drawn = [redrawn_rates(cell, 1000 * stream + number) for number, cell in enumerate(cells)]
    return np.asarray(np.mean(drawn, axis=0))


def _paired(sim_rates: Sequence[float], real_rates: Sequence[float]) -> tuple[Array, Array]:
    """Convert both to arrays, and refuse unequal lengths. [N], [N]."""
    sim, real = np.asarray(sim_rates, dtype=np.float64), np.asarray(real_rates, dtype=np.float64)
    if sim.shape != real.shape or sim.ndim != 1:
        raise ValueError(f"rates of {sim.shape} and of {real.shape} cells are no pairs")
    return sim, real
