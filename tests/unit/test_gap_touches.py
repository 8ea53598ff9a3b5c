"""Moments in which something touches a mechanism: found, left out and reported; a fault of a single joint is no such moment."""

import numpy as np
import pytest

from gsbridge.gap.benchmark import machines
from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.joints.bank import make_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints, views_of
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.touches import leave_out_touches, touches, touches_told

ARM = "arm3"
NAMES = ("viscous", "coulomb", "payload", "command_delay")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    return *machines.machine_plant(ARM, folder), folder


def drawn(arm, names, touched, units=20.0, seed=3):
    return draw_case(arm[1], names, units, seed, 2, touched=touched)


def views(arm, case):
    return views_of(Mechanism(arm[0]), {role: case.records[role] for role in ROLES})


def diagnosed(arm, case):
    diagnosis = diagnose_joints(arm[0], case.records, arm[2] / "bank", names=NAMES, seed=1)
    return diagnosis, JointAccount().findings_of(diagnosis, case.records, seed=1)


def joint_of(arm):
    return arm[0].joints[1]


def test_a_push_is_found_where_it_was(arm):
    case = drawn(arm, (f"viscous:{joint_of(arm)}",), True)
    found = touches(views(arm, case))
    assert set(found) == set(ROLES)
    record, noise = case.records["verify"], arm[1].noise["effort"]
    # Samples that the push changed, by comparison with the true motion without it.
    pushed = (np.abs(record.measured["effort"] - case.clean["effort"]) > 6.0 * noise).any(axis=1)
    inside = np.zeros(len(pushed), bool)
    for first, last in found["verify"]:
        inside[first:last] = True
    assert pushed.sum() > 10
    assert (inside[pushed]).mean() > 0.97
    assert inside.mean() < 0.4


def test_what_is_hidden_is_named_beside_a_push_which_is_told(arm):
    name = f"viscous:{joint_of(arm)}"
    pushed, alone = (diagnosed(arm, drawn(arm, (name,), touched)) for touched in (True, False))
    for diagnosis, found in (pushed, alone):
        assert found["verdict"] == "named"
        assert diagnosis.finding.best.names == (name,)
    assert "left_out" not in alone[1]
    assert set(pushed[1]["left_out"]) == set(ROLES)
    assert pushed[1]["status"] == "degraded"
    assert "several joints at once" in pushed[1]["reasons"][0]
    value, span = (pushed[1]["effects"][0]["parameters"]["coefficient"][key] for key in ("value", "interval90"))
    other = alone[1]["effects"][0]["parameters"]["coefficient"]["value"]
    assert value == pytest.approx(other, rel=0.1)
    assert span[0] < other < span[1] or value == pytest.approx(other, rel=0.05)


def test_a_push_alone_is_no_effect(arm):
    diagnosis, found = diagnosed(arm, drawn(arm, (), True, 0.0))
    assert found["verdict"] == "none_of_the_known"
    assert diagnosis.finding.best is None
    assert found["sentence"] == touches_told(diagnosis.left_out, alone=True)
    assert "At all other times, simulation and measurement differ by no more" in found["sentence"]
    assert found["amended"] == []


@pytest.mark.parametrize("hidden", ["stop:yaw", "detent:elbow", "coulomb:lift"])
def test_what_one_joint_does_alone_is_left_in(arm, hidden):
    """A stop, cogs and friction act in a few moments, too."""
    case = drawn(arm, (hidden,), False)
    seen = views(arm, case)
    first = seen["fit"]
    bank = make_bank(first, candidates(first, ("saturation", "backlash", "viscous", "coulomb"), (seen["select"],)))
    assert leave_out_touches(seen, bank) == {}
    assert first.kept is None


def test_nothing_is_a_touch_where_one_joint_moves(tmp_path):
    system, plant = machines.machine_plant("axis", tmp_path)
    case = draw_case(plant, (), 0.0, 3, 2, touched=True)
    seen = views_of(Mechanism(system), {role: case.records[role] for role in ROLES})
    assert np.sqrt((seen["fit"].residual() ** 2).mean()) > 1.5
    assert touches(seen) == {}


def test_samples_that_do_not_count_count_nowhere(arm):
    view = views(arm, drawn(arm, (), False, 0.0))["fit"]
    whole = view.freedom
    view.leave_out([(50, 120)])
    residual = view.residual()
    assert not residual[50:120].any()
    assert residual[:50].any()
    assert view.freedom == whole - 70 * len(view.channels)
    assert (residual**2).sum() / view.freedom == pytest.approx(1.0, abs=0.15)
    # Values in the moments that are left out change nothing, however large they are.
    moved = view.record.measured["position"].copy()
    moved[60:110] += 1.0
    other = JointResiduals.of(Mechanism(arm[0]), view.record.with_measured({**view.record.measured, "position": moved}))
    other.sigma = view.sigma
    other.leave_out([(50, 120)])
    np.testing.assert_allclose(other.residual(), residual, atol=1e-9)
