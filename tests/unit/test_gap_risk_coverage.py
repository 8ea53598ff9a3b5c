"""Risk against coverage, the confidence of methods, and the baselines that choose among groups or search."""

import importlib.util

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import hypergeom

from gsbridge.files import read_json
from gsbridge.gap.benchmark.baselines import SEARCHES, ahead, sureness
from gsbridge.gap.benchmark.campaign import case_keys, diagnose_cases
from gsbridge.gap.benchmark.drawing import generate_cases
from gsbridge.gap.benchmark.group_lasso import _lengths, _path, group_lasso
from gsbridge.gap.benchmark.joint_diagnosis import diagnose_joint_case
from gsbridge.gap.benchmark.verdicts import JudgedCase, read_verdicts
from gsbridge.report.scores.risk_coverage import (
    answered,
    best_measure,
    measures,
    most_covered,
    risk_at,
    risk_coverage,
    riskier,
)


def row(gain, right, verdict="named", **more):
    return {"sureness": {} if gain is None else {"gain": gain, **more}, "guessed_right": right, "verdict": verdict}


CASES = st.lists(
    st.tuples(st.one_of(st.none(), st.sampled_from([0.0, 0.25, 0.5, 0.9, 1.0])), st.booleans()).map(lambda pair: row(*pair)),
    min_size=1,
    max_size=30,
)


@given(CASES)
def test_the_curve_is_what_every_threshold_gives(cases):
    # Reference: count, threshold by threshold.
    answers = [case for case in cases if case["sureness"]]
    if not answers:
        assert measures(cases) == []
        assert risk_at(cases, 1.0) is None
        return
    expected = []
    for bar in sorted({case["sureness"]["gain"] for case in answers}, reverse=True):
        kept = [case for case in answers if case["sureness"]["gain"] >= bar]
        expected.append((len(kept) / len(cases), sum(not case["guessed_right"] for case in kept) / len(kept)))
    coverage, risk = risk_coverage(cases, "gain")
    np.testing.assert_allclose(np.stack([coverage, risk], axis=1), expected)
    for share, wrong in expected:
        assert risk_at(cases, share) == pytest.approx(wrong)
    assert most_covered(cases) == pytest.approx(expected[-1][0])


def test_between_two_points_wrong_answers_grow_by_a_straight_line():
    cases = [row(0.9, True), row(0.9, True), row(0.5, False), row(0.5, False)]
    # Three of the four cases are answered; one of them is from the second pair, which is wrong.
    assert risk_at(cases, 0.75) == pytest.approx(1 / 3)
    # The coverage is limited to the cases with an answer; at a coverage of zero there is no risk.
    assert risk_at([*cases, row(None, False)], 1.0) == pytest.approx(0.5)
    assert risk_at(cases, 0.0) is None
    assert answered([row(0.9, True), row(0.3, True, "ambiguous")]) == 0.5
    assert answered([]) == most_covered([]) == 0.0


def test_a_method_is_judged_by_the_measure_that_serves_it_best():
    cases = [row(9.0, False, rest=1.0), row(5.0, True, rest=2.0), row(4.0, True, rest=3.0), row(None, False)]
    assert measures(cases) == ["gain", "rest"]
    assert best_measure(cases, 0.5) == "rest"
    assert risk_at(cases, 0.5) == 0.0
    # A measure of confidence that some answers lack cannot be used.
    assert measures([*cases, row(1.0, True)]) == ["gain"]
    assert best_measure([row(None, False)], 0.5) is None


def test_answers_are_clearly_wrong_more_often_where_chance_hardly_explains_it():
    # Reference: Fisher's test by its sum of hypergeometric probabilities.
    ours, theirs = [row(1.0, True)] * 10, [row(1.0, k >= 4) for k in range(10)]
    chance = hypergeom(20, 4, 10).sf(3)
    assert riskier(theirs, ours, 1.0) == (chance < 0.05)
    worse = [row(1.0, k >= 5) for k in range(10)]
    assert hypergeom(20, 5, 10).sf(4) < 0.05
    assert riskier(worse, ours, 1.0)
    assert not riskier(ours, worse, 1.0)
    assert not riskier([row(None, False)] * 10, ours, 1.0)


def test_how_sure_an_explanation_may_be():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(500, 4))
    shape = rng.normal(size=noise.shape)
    shape /= np.linalg.norm(shape)
    beside = rng.normal(size=noise.shape)
    beside -= (beside * shape).sum() * shape
    beside /= np.linalg.norm(beside)

    def said(size, explained, lead=None):
        before = noise + size * shape
        return sureness(before, before - explained, noise.size, lead)

    small, large = said(15.0, 15.0 * shape), said(100.0, 100.0 * (0.98 * shape + 0.199 * beside))
    # A large gap that is explained badly removes more, and leaves more, than a small one that is explained well.
    assert small["gain"] < large["gain"]
    assert small["rest"] > large["rest"]
    assert small["share"] == pytest.approx(1.0, abs=0.4)
    # An explanation that makes a record worse gives no confidence, whatever noise is left.
    nothing = said(0.0, 5.0 * beside)
    assert nothing["gain"] < 0
    assert nothing["share"] < 0
    assert "lead" not in small
    assert said(15.0, 15.0 * shape, 3.0)["lead"] == 3.0
    assert ahead(np.array([1.0, 5.0, 3.0])) == 2.0
    assert ahead(np.array([1.0])) is None


def test_guesses_are_right_by_what_is_hidden_or_the_same_equation():
    def judged(guess, **more):
        return JudgedCase(frozenset({"a"}), 5.0, "none_of_the_known", frozenset(), guess=frozenset(guess), **more)

    assert judged(["a"]).guessed_right
    assert judged(["b"], twins=(frozenset({"b"}),)).guessed_right
    assert not judged(["b"]).guessed_right
    assert not judged([]).guessed_right
    assert not judged(["a"], known=False).guessed_right


def grouped(rng, samples=400, groups=6, size=3):
    """Columns in groups that are neither orthogonal nor of one length. [T, 1, S]."""
    columns = rng.normal(size=(samples, 1, groups * size)) * rng.uniform(0.5, 20.0, groups * size)
    columns[..., 1] = 0.7 * columns[..., 0] + 0.3 * columns[..., 1]
    return columns, [range(k * size, (k + 1) * size) for k in range(groups)]


def test_the_descent_ends_where_the_group_lasso_s_conditions_hold():
    # Conditions of Yuan and Lin: with r = along - gram b, a kept group has r = weight root(size) b over the length of b, and
    # one that is left out an r that is no longer than that.
    rng = np.random.default_rng(2)
    columns, groups = grouped(rng)
    matrix = columns[:, 0] / np.linalg.norm(columns[:, 0], axis=0)
    target = matrix @ rng.normal(size=matrix.shape[1])
    owners = np.repeat(np.arange(len(groups)), 3)
    gram, along, roots = matrix.T @ matrix, matrix.T @ target, np.full(len(groups), np.sqrt(3.0))
    weights = float((_lengths(along, owners) / roots).max()) * np.array([1.01, 0.5, 0.1, 0.01])
    path = _path(gram, along, owners, roots, weights)
    assert not path[0].any()
    for weight, found in zip(weights, path, strict=True):
        left, lengths = along - gram @ found, _lengths(found, owners)
        bound = weight * np.sqrt(3.0)
        for group, length in zip(groups, lengths, strict=True):
            part = left[list(group)]
            if length > 0:
                np.testing.assert_allclose(part, bound * found[list(group)] / length, atol=0.05 * bound)
            else:
                assert np.linalg.norm(part) <= bound * 1.05


@pytest.mark.parametrize("seed", range(3))
def test_cross_validation_keeps_what_is_there(seed):
    rng = np.random.default_rng(seed)
    columns, groups = grouped(rng)
    truth = np.zeros(columns.shape[-1])
    truth[6:9] = 1.0 / columns.std(axis=(0, 1))[6:9]
    found = group_lasso(columns, groups, columns @ truth + rng.normal(size=(400, 1)))
    lengths = [float(np.linalg.norm((found * columns.std(axis=(0, 1)))[list(group)])) for group in groups]
    assert int(np.argmax(lengths)) == 2
    assert lengths[2] > 5 * max(lengths[:2] + lengths[3:])


def test_cross_validation_mostly_keeps_nothing_of_noise():
    rng = np.random.default_rng(9)
    columns, groups = grouped(rng)
    kept = [group_lasso(columns, groups, rng.normal(size=(400, 1))).any() for _ in range(20)]
    assert sum(kept) < 10


@pytest.fixture(scope="module")
def plain_cases(tmp_path_factory):
    """Eight cases of an axis, their truths, and the bank of signatures that all methods share."""
    folder = tmp_path_factory.mktemp("plain")
    generate_cases("t0", "development", folder / "cases", folder / "truths", count=8)
    return folder


@pytest.mark.parametrize("method", ["group_lasso", *SEARCHES])
def test_fair_baselines_name_what_is_plain_and_say_how_sure_they_are(plain_cases, tmp_path, method):
    if method in SEARCHES and importlib.util.find_spec("cma") is None:
        pytest.skip("the package cma is not installed")
    cases, truths = plain_cases / "cases", plain_cases / "truths"
    diagnose_cases(cases, case_keys(cases), tmp_path / "found", plain_cases / "bank", diagnose_joint_case, method=method)
    judged = read_verdicts(cases, truths, [tmp_path / "found"])
    large = [case for case in judged if case.kind == "single" and case.units >= 5.0]
    assert sum(case.guessed_right for case in large) >= 0.5 * len(large) > 0
    assert all(len(case.guess) <= 3 for case in judged)
    for case in judged:
        assert bool(case.sureness) == bool(case.guess)
        assert case.decides
        content = read_json(tmp_path / "found" / f"{case.key}.json")
        assert content["simulations"]["case"] <= 90 * SEARCHES.get(method, 1) + 300
