"""The residual that errors of fitted parameters leave on another record does not count as a further effect."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares

from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.diagnosis.results import Finding, Hypothesis, Rules
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.diagnose import views_of
from gsbridge.gap.joints.fit import derivatives, fit, polish
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.parameter_error import BesideParameterError, beside_parameter_error
from gsbridge.gap.joints.verify import named_by_third, verify


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
    found = BesideParameterError(views["verify"], (views["fit"],), derivatives)(fitted).ravel()
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
        beside = BesideParameterError(views["verify"], (views["fit"],), derivatives)
        allowed = verify(views["verify"], fitted.effects, np.random.default_rng(seed), partial(beside, fitted), 0.05)
        before.append(plain.p_remaining)
        refused.append(allowed.p_remaining < 0.05)
        # The correction is applied only if there is an alarm, and never raises one.
        assert allowed.p_remaining == plain.p_remaining or plain.p_remaining < min(0.05, allowed.p_remaining)
    assert sum(refused) < sum(p < 0.05 for p in before) <= 5


def opinion(views, best, rival, runs=99):
    """What the third record makes of two fits between which two records cannot decide."""
    search = [
        Hypothesis(one, views["select"].residual(one.effects), views["fit"].residual(one.effects), 0.0, 1.0)
        for one in (best, rival)
    ]
    # As alike as the two records found them, whatever they leave.
    search = [
        replace(one, residual=search[0].residual, first=search[0].first, fit=replace(one.fit, chi2=0.0)) for one in search
    ]
    names = tuple(" + ".join(one.names) for one in search)
    finding = Finding("ambiguous", search[0], tuple((one, 0.5) for one in search), names, False, 0.0, 1.0, 2.0, 1.0, 0)
    return named_by_third(finding, tuple(views.values()), Rules(), 1.0 * views["select"].residual().size, runs)


def test_the_error_of_a_parameter_rules_no_rival_out(axis):
    who, start = (JointCandidate("viscous", "axis"),), ({"coefficient": 0.02},)
    views, right = fitted_case(axis, "viscous", 20.0, 3, who, start)
    coulomb = polish(views["fit"], fit(views["fit"], (JointCandidate("coulomb", "axis"),), ({"torque": 0.01},)))
    # Four standard deviations off the best coefficient of all records, as noise may shift a fit to a single record.
    off = right.values[0]["coefficient"] + 4.0 * float(right.deviations[0])
    rival = replace(right, effects=(who[0].applied({"coefficient": off}),))
    pair = replace(
        right,
        who=(*who, JointCandidate("armature", "axis")),
        effects=(*right.effects, JointCandidate("armature", "axis").applied({"inertia": 0.0})),
        deviations=np.array([*right.deviations, 0.001]),
    )
    third = views["verify"]
    assert (third.residual(rival.effects) ** 2).sum() > (third.residual(pair.effects) ** 2).sum() + 9.0
    assert opinion(views, pair, rival).verdict == "ambiguous"
    # The residual of a wrong law is not explained by an error of its parameter.
    assert opinion(views, right, coulomb).verdict == "named"
    assert opinion(views, right, coulomb, runs=3).verdict == "ambiguous"
