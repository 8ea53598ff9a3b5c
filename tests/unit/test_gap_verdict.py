"""Probabilities of explanations and tails of p-values, against values that are known by construction."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from gsbridge.gap.diagnosis.results import EffectFit, Finding, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import decide, third_opinion, told_apart
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.detect import REPLICATES, JointNull

SHAPE = (400, 3)


def trial(name, values, select, fitted):
    candidate = JointCandidate(name, "axis")
    square = float((fitted**2).sum())
    fit = EffectFit(
        (candidate,), (candidate.from_vector(np.array(values)),), square, True, np.zeros(len(values)), 0.0, len(values)
    )
    return Hypothesis(fit, select, fitted, float((select**2).sum()), 1.0)


def decided(noises, apart, floor):
    """The verdict over the truth, which leaves noise, and a rival that is apart from it by some shape."""
    rivals = trial("viscous", [0.1], *noises), trial("coulomb", [0.1], *(noise + apart for noise in noises))
    return decide(rivals, Rules(), floor)


def shape_of(size):
    """A motion of some squared length on both records together. [T, C]."""
    shape = np.sin(np.arange(SHAPE[0]) / 7.0)[:, None] * np.array([1.0, -0.5, 0.3])
    return shape * np.sqrt(0.5 * size / (shape**2).sum())


@pytest.mark.parametrize("size", [2.0, 6.0, 12.0])
def test_stated_probabilities_hold_in_white_noise(size):
    rng, apart, stated, held = np.random.default_rng(1), shape_of(size), [], []
    for _ in range(600):
        found = decided(rng.standard_normal((2, *SHAPE)), apart, float(np.prod(SHAPE)))
        stated.append(found.chances[0])
        held.append(found.trials[0].names == ("viscous:axis",))
        assert found.chances.sum() == pytest.approx(1.0)
    # By likelihood, the truth is best with this probability (Neyman and Pearson: half the distance, in deviations).
    assert np.mean(held) == pytest.approx(norm.cdf(0.5 * np.sqrt(size)), abs=0.05)
    assert np.mean(stated) == pytest.approx(np.mean(held), abs=0.05)


def test_coloured_noise_makes_less_sure():
    rng, apart, wrong, sure = np.random.default_rng(2), shape_of(12.0), 0, 0
    for _ in range(600):
        noises = lfilter([1.0], [1.0, -0.85], rng.standard_normal((2, SHAPE[0] + 100, SHAPE[1])), axis=1)[:, 100:]
        found = decided(noises * np.sqrt(1 - 0.85**2), apart, float(np.prod(SHAPE)))
        if found.chances[0] >= Rules().sure and not found.near:
            sure += 1
            wrong += found.trials[0].names != ("viscous:axis",)
    # If the noise were taken for white, 435 of the verdicts would be sure, and 78 of these wrong.
    assert sure > 0
    assert wrong <= 0.08 * sure


def test_a_simpler_explanation_stands_until_the_richer_one_has_earned_its_parameters():
    rng = np.random.default_rng(3)
    noises = rng.standard_normal((2, *SHAPE))
    for size, best in ((6.0, "coulomb:axis"), (40.0, "coulomb_asym:axis")):
        # The rival fits part of the noise, so it leaves less than the noise by `size`.
        closer = [noise - noise * 0.5 * size / (2 * (noise**2).sum()) for noise in noises]
        rivals = trial("coulomb", [0.1], *noises), trial("coulomb_asym", [0.1, 0.01], *closer)
        found = decide(rivals, Rules(), float(np.prod(SHAPE)))
        assert found.trials[0].names == (best,)


def test_one_effect_more_must_be_as_sure_as_a_name():
    """It explains much of slow noise, on both records, without being there; where it is there, it stays."""
    rng, rules, alone, named, both = np.random.default_rng(6), Rules(), 0, 0, 0
    # A slow motion, as the noise is.
    shape = np.sin(np.arange(SHAPE[0]) / 40.0)[:, None] * np.array([1.0, -0.5, 0.3])
    shape /= np.sqrt((shape**2).sum())

    def rival(names, select, fitted):
        who = tuple(JointCandidate(name, "axis") for name in names)
        effects = tuple(candidate.from_vector(np.array([0.1])) for candidate in who)
        size = len(names)
        fit = EffectFit(who, effects, float((fitted**2).sum()), True, np.full(size, 0.01), 0.0, size)
        return Hypothesis(fit, select, fitted, float((select**2).sum()), 1.0)

    for hidden in (0.0, 60.0):
        for _ in range(100):
            slow = lfilter([1.0], [1.0, -0.92], rng.standard_normal((2, SHAPE[0] + 100, SHAPE[1])), axis=1)[:, 100:]
            noises = slow * np.sqrt(1 - 0.92**2) + hidden * shape
            # What the further effect, of whatever size fits both records best, takes away.
            size = float((noises * shape).sum() / (2 * (shape**2).sum()))
            rivals = rival(["viscous"], *noises), rival(["viscous", "coulomb"], *(noises - size * shape))
            found = decide(rivals, rules, float(np.prod(SHAPE)))
            single = found.trials[0].names == ("viscous:axis",)
            if hidden:
                both += not single and found.chances[0] >= rules.sure
            else:
                earned = rivals[0].score - rivals[1].score > rules.earn
                alone += earned
                named += earned and single and not found.near
    # By the sum of squares alone, the further effect would be accepted every time.
    assert alone > 30
    assert named > 0.7 * alone
    assert both > 95


def test_p_values_go_on_where_replicates_end():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(200):
        null = JointNull(np.zeros((REPLICATES, 1)), rng.standard_normal(REPLICATES), 1.0)
        found.append([null.p_gain(value) for value in (0.0, 1.0, 2.0, 3.0)])
    middle = np.median(found, axis=0)
    np.testing.assert_allclose(middle[:3], norm.sf([0.0, 1.0, 2.0]), rtol=0.3)
    # An exponential tail falls more slowly than a normal one, so the p-value errs on the safe side, and not by much.
    assert norm.sf(3.0) <= middle[3] <= 6.0 * norm.sf(3.0)
    assert null.p_gain(1e9) == pytest.approx(1e-6)
    assert JointNull(np.zeros((3, 1)), np.zeros(0), 1.0).p_gain(5.0) == 1.0


def test_of_two_explanations_as_good_as_each_other_none_is_preferred():
    """Both err by half of what lies between them, in noise that is louder for a while and remembers itself."""
    rng, apart, found = np.random.default_rng(8), 0.5 * shape_of(60.0), []
    loud = np.where(np.sin(np.arange(SHAPE[0]) / 30.0) > 0.0, 8.0, 1.0)[:, None]
    for _ in range(400):
        noises = lfilter([1.0], [1.0, -0.6], rng.standard_normal((3, SHAPE[0] + 50, SHAPE[1])), axis=1)[:, 50:]
        noises *= loud * np.sqrt(1 - 0.6**2)
        found.append(told_apart([noise - apart for noise in noises], [noise + apart for noise in noises]))
    assert abs(np.mean(found)) < 0.15
    assert np.mean(np.abs(found) > norm.isf(0.05)) < 0.13


def test_what_is_loud_for_a_while_does_not_hide_who_errs_more_in_quiet():
    rng = np.random.default_rng(9)
    quiet = np.sin(np.arange(SHAPE[0]) / 30.0)[:, None] <= 0.0
    noises = [rng.standard_normal(SHAPE) * np.where(quiet, 1.0, 30.0) for _ in range(3)]
    apart = shape_of(120.0) * quiet
    # Weighed by the noise as it is, half of what lies between them in deviations: Neyman and Pearson.
    best = 0.5 * np.sqrt(3 * (apart**2).sum())
    assert told_apart(noises, [noise + apart for noise in noises]) > 0.6 * best
    assert told_apart([noise + apart for noise in noises], noises) < -0.6 * best


def opinion(apart, third, ambiguous=("viscous:axis", "coulomb:axis"), seed=4):
    """A finding that is open between the truth and a rival, and what a third record makes of it.

    Args:
        apart: What the rival leaves beyond the noise, on each of two records. [T, C].
        third: The same on the third. [T, C].
    """
    noises = np.random.default_rng(seed).standard_normal((3, *SHAPE))
    rivals = trial("viscous", [0.1], *noises[:2]), trial("coulomb", [0.1], *(noises[:2] + apart))
    floor = float(np.prod(SHAPE))
    seen = tuple((one, 0.5) for one in sorted(rivals, key=lambda one: one.score))
    finding = Finding("ambiguous", seen[0][0], seen, tuple(ambiguous), False, 0.0, 1.0, 2.0, 1.0, 0)
    left = {"viscous:axis": noises[2], "coulomb:axis": noises[2] + third}
    return third_opinion(finding, lambda one: left[one.names[0]], Rules(), floor)


def test_a_third_record_names_what_two_prefer():
    weak, strong = shape_of(4.0), shape_of(60.0)
    named = opinion(weak, strong)
    assert (named.verdict, named.ambiguous) == ("named", ())
    assert named.best.names == ("viscous:axis",)
    assert opinion(weak, 0.0 * strong).verdict == "ambiguous"
    # An effect that was never fitted is not ruled out by any record.
    assert opinion(weak, strong, ("viscous:axis", "coulomb:axis", "lag")).verdict == "ambiguous"


def test_a_third_record_puts_nothing_in_the_place_of_what_two_prefer():
    """Noise may prefer the wrong one on two records: the third then leaves it open."""
    strong, open_ones = shape_of(60.0), 0
    for seed in range(40):
        found = opinion(shape_of(0.5), strong, seed=seed)
        if found.best.names == ("coulomb:axis",):
            open_ones += 1
            assert found.verdict == "ambiguous"
    assert open_ones > 5


def test_names_by_a_third_record_are_as_sure_as_they_say():
    names = [opinion(shape_of(6.0), shape_of(3.0), seed=seed) for seed in range(600)]
    named = [found.best.names for found in names if found.verdict == "named"]
    assert len(named) > 50
    assert sum(name == ("coulomb:axis",) for name in named) <= 0.05 * len(named)


@pytest.mark.parametrize(("count", "larger"), [(400, True), (40_000, False)])
def test_a_larger_law_must_gain_what_the_number_of_residuals_asks(count, larger):
    """Schwarz: 9.5 are enough for one parameter among ten thousand numbers, and not among eighty thousand."""
    one, other = np.zeros((2, count, 1)), np.zeros((2, count, 1))
    one[:, 0], other[:, 0] = np.sqrt(count), np.sqrt(count - 9.5 / 2)
    simple, rich = trial("coulomb", [0.1], *one), trial("coulomb_asym", [0.1, 0.01], *other)
    assert (decide([simple, rich], Rules(), float(count)).trials[0] is rich) == larger
