"""An obstacle in an arm's way is recognised by the residual in the moments in which the arm leans on it."""

import numpy as np
import pytest

from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.looks import Look
from gsbridge.gap.joints.surfaces import heights_between, supports


def leaning(explained):
    """What is left of two records, where an arm leans on something in 30 of the second's moments; and what a surface changes,
    which is this share of it."""
    left, changes = np.random.default_rng(4).normal(size=(2, 1000, 2)), np.zeros((2, 1000, 2))
    left[1, 100:130] += 100.0
    changes[1, 100:130] = 100.0 * explained
    return list(left), list(changes)


@pytest.mark.parametrize(("explained", "taken"), [(1.0, True), (0.6, True), (0.2, False), (2.5, False), (0.0, False)])
def test_a_surface_explains_most_of_what_is_left_where_an_arm_leans_on_it(explained, taken):
    assert supports(*leaning(explained), 1.0) == taken


def test_a_surface_that_explains_next_to_nothing_of_a_gap_is_no_line():
    gone = np.sqrt(60 * 100.0**2 + 4000) - np.sqrt(4000)
    assert supports(*leaning(1.0), 0.9 * gone)
    assert not supports(*leaning(1.0), 1.1 * gone)


def test_a_surface_is_looked_at_halfway_to_the_heights_next_to_the_best():
    who, row = JointCandidate("table"), np.ones(4)
    looks = [
        Look(who, {"stiffness": stiffness, "height": height}, np.full(4, size))
        for stiffness, height, size in ((2e3, -0.05, 0.2), (2e3, -0.03, 0.5), (2e3, 0.0, 0.1), (5e4, -0.031, 0.3))
    ]
    between = heights_between(looks, row)
    assert [values["height"] for values in between] == pytest.approx([-0.04, -0.015])
    assert {values["stiffness"] for values in between} == {2e3}
    assert heights_between([], row) == heights_between(looks[:1], row) == []


def test_where_every_height_that_is_reached_does_harm_a_lower_one_is_looked_at():
    who, row = JointCandidate("table"), np.ones(4)
    looks = [
        Look(who, {"stiffness": 2e3, "height": height}, np.full(4, size))
        for height, size in ((-0.09, 0.0), (-0.06, 0.0), (-0.03, 3.0), (0.0, 5.0))
    ]
    assert [values["height"] for values in heights_between(looks, row)] == pytest.approx([-0.045])
