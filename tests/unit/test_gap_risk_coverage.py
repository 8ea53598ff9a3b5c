"""Risk against coverage, how sure methods are, and the baselines that choose among groups or search."""

import importlib.util

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsbridge.files import read_json
from gsbridge.gap.benchmark.baselines import SEARCHES, held_out
from gsbridge.gap.benchmark.campaign import case_keys, diagnose_cases, generate_cases
from gsbridge.gap.benchmark.group_lasso import _lengths, _path, group_lasso
from gsbridge.gap.benchmark.verdicts import JudgedCase, read_verdicts
from gsbridge.report.scores.risk_coverage import answered, risk_at, risk_coverage


def row(confidence, right, verdict="named"):
    return {"confidence": confidence, "guessed_right": right, "verdict": verdict}


CASES = st.lists(
    st.tuples(st.one_of(st.none(), st.sampled_from([0.0, 0.25, 0.5, 0.9, 1.0])), st.booleans()).map(lambda pair: row(*pair)),
    min_size=1,
    max_size=30,
)


@given(CASES)
def test_the_curve_is_what_every_threshold_gives(cases):
    # Reference: count, threshold by threshold.
    expected = []
    for bar in sorted({case["confidence"] for case in cases if case["confidence"] is not None}, reverse=True):
        kept = [case for case in cases if case["confidence"] is not None and case["confidence"] >= bar]
        wrong = sum(not case["guessed_right"] for case in kept)
        expected.append((len(kept) / len(cases), wrong / len(kept)))
    coverage, risk = risk_coverage(cases)
    np.testing.assert_allclose(np.stack([coverage, risk], axis=1), np.reshape(expected, (-1, 2)))
    for share, wrong in expected:
        assert risk_at(cases, share) == pytest.approx(wrong)
    assert (risk_at(cases, 1.0) is None) == (not expected)


def test_between_two_points_wrong_answers_grow_by_a_straight_line():
    cases = [row(0.9, True), row(0.9, True), row(0.5, False), row(0.5, False)]
    # Of three answered cases one is of the second pair, which is wrong.
    assert risk_at(cases, 0.75) == pytest.approx(1 / 3)
    # Nobody is asked to answer more than there is.
    assert risk_at([*cases, row(None, False)], 1.0) == pytest.approx(0.5)
    assert answered([row(0.9, True), row(0.3, True, "ambiguous")]) == 0.5
    assert answered([]) == 0.0


def test_how_sure_an_explanation_may_be():
    before = np.full(100, 3.0)
    assert held_out(before, np.ones(100), 100) == 1.0
    assert held_out(before, before, 100) == 0.0
    assert held_out(before, 2 * before, 100) == 0.0
    assert held_out(before, np.full(100, np.sqrt(5.0)), 100) == pytest.approx(0.5)


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
    assert not group_lasso(columns, groups, rng.normal(size=(400, 1)) * 1e-6).any() or max(np.abs(found)) > 0


@pytest.mark.parametrize("method", ["group_lasso", *SEARCHES])
def test_fair_baselines_name_what_is_plain_and_say_how_sure_they_are(tmp_path, method):
    if method in SEARCHES and importlib.util.find_spec("cma") is None:
        pytest.skip("the package cma is not installed")
    cases, truths = tmp_path / "cases", tmp_path / "truths"
    generate_cases("t0", "development", cases, truths, count=8)
    diagnose_cases(cases, case_keys(cases), tmp_path / "found", tmp_path / "bank", method=method)
    judged = read_verdicts(cases, truths, [tmp_path / "found"])
    large = [case for case in judged if case.hidden and case.known and case.units >= 5.0]
    assert large
    assert any(case.hidden <= case.guess for case in large)
    for case in judged:
        assert (case.confidence is None) == (not case.guess)
        content = read_json(tmp_path / "found" / f"{case.key}.json")
        assert content["simulations"]["case"] <= 90 * SEARCHES.get(method, 1) + 80
