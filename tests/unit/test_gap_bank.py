"""Signatures: kept on disk, compared before any fit, and used as first derivatives in fits that need few simulations."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import JointCandidate, candidates
from gsbridge.gap.joints.fit import fit, polish
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen, cosines

NAMES = ("coulomb", "viscous", "armature", "stribeck", "base_tilt", "saturation")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    system, plant = axis_plant(folder)
    record = draw_case(plant, (), 0.0, 1, 2).records["fit"]
    view = JointResiduals.of(Mechanism(system), record, folder=folder / "bank")
    bank = signature_bank(view, candidates(view, NAMES), folder / "bank")
    return system, record, view, bank, Screen(view, bank), folder


def planted(view, effects):
    """A record that the mechanism itself would leave with some effects, without noise."""
    outputs = view.simulate(effects)
    measured = {kind: outputs[kind] for kind in view.record.measured}
    other = JointResiduals.of(view.mechanism, view.record.with_measured(measured))
    other.set_noise(view.sigma, 1)
    return other


def test_bank_and_frame_are_made_once(site):
    system, record, view, bank, _, folder = site
    mechanism = Mechanism(system)
    again = JointResiduals.of(mechanism, record, folder=folder / "bank")
    found = signature_bank(again, candidates(again, NAMES), folder / "bank")
    assert mechanism.runs == 1  # the nominal replay of this record
    np.testing.assert_array_equal(again.sigma, view.sigma)
    assert [s.values for s in found.signatures] == [s.values for s in bank.signatures]
    np.testing.assert_array_equal(found.signatures[-1].change, bank.signatures[-1].change)


def test_other_sizes_make_another_bank(site, monkeypatch):
    _, _, view, _, _, folder = site
    who = (JointCandidate("viscous", "axis"),)
    before = view.mechanism.runs
    signature_bank(view, who, folder / "bank")
    made = view.mechanism.runs
    assert made > before
    monkeypatch.setattr(type(who[0].effect), "sizes", (1.0, 2.0))
    signature_bank(view, who, folder / "bank")
    assert view.mechanism.runs > made


def test_planted_effect_screens_first_and_no_fit_could_gain_more_than_the_bound(site):
    _, _, view, _, screen, _ = site
    seen = planted(view, [Applied("coulomb", "axis", {"torque": 0.05})])
    residual = seen.residual()
    matches = screen.matches(residual)
    assert str(matches[0].candidate) == "coulomb:axis"
    assert matches[0].starts[0]["torque"] == pytest.approx(0.05, rel=0.1)
    total = float((residual**2).sum())
    for match in matches:
        # Axes that hardly differ are left out of the projection, and signatures are kept in single precision.
        assert match.gain <= 1.01 * match.bound + 1.0
        assert match.bound <= 1.001 * total


def test_two_planted_effects_are_the_best_pair(site):
    _, _, view, _, screen, _ = site
    effects = [Applied("coulomb", "axis", {"torque": 0.04}), Applied("armature", "axis", {"inertia": 0.006})]
    best = screen.mixtures(planted(view, effects).residual(), 2, 4)[0]
    assert {str(candidate) for candidate in best.who} == {"coulomb:axis", "armature:axis"}


def test_cosines_of_a_signature_with_itself_are_one(site):
    _, _, view, bank, _, _ = site
    table = cosines(view, bank.signatures[:4])
    np.testing.assert_allclose(np.diag(table), 1.0, atol=1e-6)
    np.testing.assert_allclose(table, table.T)


def test_columns_are_derivatives(site):
    _, _, view, _, screen, _ = site
    who, size = JointCandidate("armature", "axis"), 0.003
    near = [view.residual([who.applied({"inertia": value})]).ravel() for value in (size * 0.98, size * 1.02)]
    slope = (near[1] - near[0]) / (0.04 * size)
    column = -screen.columns(who, {"inertia": size})[:, 0]
    cosine = slope @ column / np.linalg.norm(slope) / np.linalg.norm(column)
    assert cosine > 0.98
    assert np.linalg.norm(column) == pytest.approx(np.linalg.norm(slope), rel=0.2)
    # Signatures give no derivative for parameters of shape, nor for effects that begin at a threshold.
    assert np.isnan(screen.columns(JointCandidate("stribeck", "axis"), {"torque": 0.1, "speed": 0.05})[:, 1]).all()
    assert np.isnan(screen.columns(JointCandidate("saturation", "axis"), {"weakness": 0.3})).all()


@pytest.mark.parametrize(
    ("name", "values", "start"),
    [
        ("viscous", {"coefficient": 0.08}, {"coefficient": 0.05}),
        ("stribeck", {"torque": 0.2, "speed": 0.08}, {"torque": 0.1, "speed": 0.05}),
    ],
)
def test_fit_agrees_with_scipy_and_takes_few_simulations(site, name, values, start):
    _, _, view, _, screen, _ = site
    who = JointCandidate(name, "axis")
    seen = planted(view, [who.applied(values)])
    rng = np.random.default_rng(0)
    noisy = {kind: v + view.sigma[k] * rng.standard_normal(v.shape) for k, (kind, v) in enumerate(seen.record.measured.items())}
    seen = JointResiduals.of(view.mechanism, seen.record.with_measured(noisy))
    before = seen.mechanism.runs
    found = polish(seen, fit(seen, (who,), (start,), screen=screen))
    assert seen.mechanism.runs - before <= 14
    assert found.converged
    bounds = np.array([(p.low, p.high) for p in who.effect.parameters]).T
    reference = least_squares(
        lambda x: seen.residual([who.from_vector(x)]).ravel(), who.vector(start), bounds=bounds, x_scale=who.vector(start)
    )
    assert found.chi2 <= 2 * reference.cost + 1.0
    for value, other, spread in zip(who.vector(found.values[0]), reference.x, found.deviations, strict=True):
        assert abs(value - other) < spread
        assert abs(value - values[who.effect.parameters[list(reference.x).index(other)].name]) < 5 * spread
