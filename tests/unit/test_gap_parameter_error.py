"""What the error of a fit's parameters leaves on another record is no effect more."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.diagnose import views_of
from gsbridge.gap.joints.fit import derivatives, fit, polish
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.parameter_error import BesideParameterError, beside_parameter_error
from gsbridge.gap.joints.verify import verify


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    system, plant = axis_plant(tmp_path_factory.mktemp("axis"))
    return Mechanism(system), plant


def fitted_case(axis, name, units, seed, who, start):
    """Residuals by role with one effect hidden, and the fit of candidates to the record `fit`."""
    case = draw_case(axis[1], (name,), units, seed, 41)
    views = views_of(axis[0], case.records)
    return views, polish(views["fit"], fit(views["fit"], who, start))


def test_it_is_what_parameters_fitted_to_both_records_leave(axis):
    who = JointCandidate("coulomb", "axis"), JointCandidate("viscous", "axis")
    views, fitted = fitted_case(axis, "viscous", 20.0, 3, who, ({"torque": 0.01}, {"coefficient": 0.02}))

    def residual(values, role):
        coulomb, viscous = values
        effects = Applied("coulomb", "axis", {"torque": coulomb}), Applied("viscous", "axis", {"coefficient": viscous})
        return views[role].residual(effects).ravel()

    def both(values):
        return np.concatenate([residual(values, "fit"), residual(values, "verify")])

    begin = [fitted.values[0]["torque"], fitted.values[1]["coefficient"]]
    best = least_squares(both, begin, x_scale=np.abs(begin), diff_step=1e-3).x
    found = BesideParameterError(views["verify"], views["fit"], derivatives)(fitted).ravel()
    alone, together = residual(begin, "verify"), residual(best, "verify")
    assert np.linalg.norm(together - alone) > 0.3
    assert np.linalg.norm(found - together) < 0.1 * np.linalg.norm(together - alone)


def test_an_error_of_its_parameters_is_no_alarm_and_what_is_missing_besides_is(axis):
    views, fitted = fitted_case(axis, "viscous", 20.0, 7, (JointCandidate("viscous", "axis"),), ({"coefficient": 0.02},))
    view, rng = views["verify"], np.random.default_rng(0)
    null = joint_null(view, rng)
    slow = 2.0 * np.sin(np.arange(len(view.record.time)) / 15.0)[:, None]
    here, there = (derivatives(one, fitted) for one in (view, views["fit"]))
    left = beside_parameter_error(view.residual(fitted.effects), here, there)
    assert null.p_value(left) > 0.01
    assert null.p_value(left + view.project(slow * np.ones_like(left))) < 1e-4


def test_right_effects_are_seldom_refused_for_the_error_of_their_sizes(axis):
    refused, before = [], []
    for seed in range(24):
        who = (JointCandidate("gravcomp", ""),)
        views, fitted = fitted_case(axis, "gravcomp", 6.0, 100 + seed, who, ({"change": -0.01},))
        plain = verify(views["verify"], fitted.effects, np.random.default_rng(seed))
        allowed = verify(views["verify"], fitted.effects, np.random.default_rng(seed), (views["fit"], fitted), 0.05)
        before.append(plain.p_remaining)
        refused.append(allowed.p_remaining < 0.05)
        # It is asked where there is an alarm alone, and raises none.
        assert allowed.p_remaining == plain.p_remaining or plain.p_remaining < min(0.05, allowed.p_remaining)
    assert sum(refused) < sum(p < 0.05 for p in before) <= 5
