"""Distance of paths, against closed forms and a shortest path on a graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from gsbridge.report.figures.path_distance import SPACING, path_distance, resample, warped_distance

LINE = np.c_[np.linspace(0, 0.5, 40), np.zeros(40), np.zeros(40)]
PATHS = arrays(np.float64, st.tuples(st.integers(1, 7), st.just(3)), elements=st.floats(-0.125, 0.125, width=16))


def by_graph(one, two):
    """The same mean by Dijkstra: an edge to a matched pair costs what it adds; the first pair is reached along both paths."""
    n, m = len(one), len(two)
    apart = np.linalg.norm(one[:, None] - two[None], axis=-1) + 1e-9
    rows, columns, costs = [], [], []
    for i in range(n):
        for j in range(m):
            for di, dj in ((1, 0), (0, 1), (1, 1)):
                if i + di < n and j + dj < m:
                    rows.append(i * m + j)
                    columns.append((i + di) * m + j + dj)
                    costs.append((di + dj) * apart[i + di, j + dj])
    graph = coo_array((costs, (rows, columns)), shape=(n * m, n * m)).tocsr()
    return (2 * apart[0, 0] + dijkstra(graph, indices=0)[-1]) / (n + m)


@given(PATHS, PATHS)
def test_the_matching_is_the_best_there_is(one, two):
    assert warped_distance(one, two) == pytest.approx(by_graph(one, two), abs=1e-7)


@settings(max_examples=40, deadline=None)
@given(PATHS, PATHS)
def test_it_is_symmetric_and_knows_its_bounds(one, two):
    value = path_distance(one, two)
    assert value == pytest.approx(path_distance(two, one), abs=1e-9)
    apart = np.linalg.norm(resample(one)[:, None] - resample(two)[None], axis=-1)
    assert apart.min() - 1e-9 <= value <= apart.max() + 1e-9
    assert path_distance(one, one) == pytest.approx(0.0, abs=1e-9)


def test_straight_paths_side_by_side_are_as_far_apart_as_they_are():
    assert path_distance(LINE, LINE + np.array([0.0, 0.012, 0.005])) == pytest.approx(0.013, abs=1e-9)


def test_speed_and_pauses_do_not_count():
    curve = np.c_[0.1 * np.cos(LINE[:, 0] * 6), 0.1 * np.sin(LINE[:, 0] * 6), LINE[:, 0]]
    slow = np.concatenate([curve[:10], np.repeat(curve[10:11], 30, axis=0), curve[10:]])
    assert path_distance(curve, slow) == pytest.approx(0.0, abs=1e-9)
    dense = np.stack([np.interp(np.linspace(0, 39, 500) ** 2 / 39, range(40), column) for column in curve.T], axis=1)
    assert path_distance(curve, dense) < 1e-4


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
def test_a_path_that_ends_early_misses_the_rest(share):
    # Whole: L, short: l. The rest, L - l, lies (L - l) / 2 away on average and counts once, all else is zero and counts twice.
    whole, short = 0.5, share * 0.5
    value = path_distance(LINE, LINE * share)
    assert value == pytest.approx((whole - short) ** 2 / (2 * (whole + short)), rel=0.02, abs=0.25 * SPACING)


def test_a_point_against_a_ring_is_its_radius_away():
    angle = np.linspace(0, 2 * np.pi, 200)
    ring = np.c_[0.07 * np.cos(angle), 0.07 * np.sin(angle), np.zeros(200)]
    assert path_distance(ring, np.zeros((3, 3))) == pytest.approx(0.07, rel=1e-3)


def test_points_lie_at_equal_distances_along_the_path():
    corner = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0, 0], [0.3, 0.1, 0]])
    found = resample(corner, 0.1)
    np.testing.assert_allclose(found, [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0], [0.3, 0.1, 0]], atol=1e-12)
    np.testing.assert_allclose(resample(np.ones((4, 3)), 0.1), np.ones((1, 3)))


@pytest.mark.parametrize("path", [np.empty((0, 3)), np.full((2, 3), np.nan), np.zeros(3)])
def test_no_path_is_refused(path):
    with pytest.raises(ValueError, match="empty or not finite"):
        path_distance(path, LINE)
