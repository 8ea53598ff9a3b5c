"""Fits move in products where parameters act as products: a mass at a place, a spring that rests somewhere."""

import numpy as np
import pytest
from axis_logs import axis_in, records_of, simulated
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import JointCandidate, candidates
from gsbridge.gap.joints.coordinates import Coordinates
from gsbridge.gap.joints.diagnose import views_of
from gsbridge.gap.joints.fit import derivatives, fit, polish
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.mechanism.replay import Mechanism

WHO = (JointCandidate("coulomb", "axis"), JointCandidate("payload"), JointCandidate("spring", "axis"))
"""One parameter, then four of which three are weighed by the first, then two of which one is."""

PLACES = st.floats(-1.0, 1.0)


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_in(tmp_path_factory.mktemp("axis"))


@given(st.tuples(st.floats(0.0, 3.0), st.floats(1e-3, 20.0), PLACES, PLACES, PLACES, st.floats(1e-3, 50.0), PLACES))
@settings(max_examples=50, deadline=None)
def test_coordinates_lead_to_their_parameters_and_back(values):
    parameters, coordinates = np.array(values), Coordinates(WHO)
    vector = coordinates.of(parameters)
    np.testing.assert_allclose(vector[2:5], parameters[1] * parameters[2:5])
    np.testing.assert_allclose(coordinates.parameters(vector), parameters, atol=1e-12)
    low, high = coordinates.bounds(vector)
    assert (low <= vector).all()
    assert (vector <= high).all()
    np.testing.assert_allclose(coordinates.within(vector), vector, atol=1e-12)


@given(st.tuples(st.floats(0.01, 3.0), st.floats(0.01, 20.0), PLACES, PLACES, PLACES, st.floats(0.01, 50.0), PLACES))
@settings(max_examples=50, deadline=None)
def test_slopes_are_the_derivatives_of_the_parameters(values):
    coordinates = Coordinates(WHO)
    vector = coordinates.of(np.array(values))
    steps = 1e-6 * coordinates.scale(vector)
    numeric = [
        (coordinates.parameters(vector + step * unit) - coordinates.parameters(vector - step * unit)) / (2 * step)
        for step, unit in zip(steps, np.eye(len(vector)), strict=True)
    ]
    np.testing.assert_allclose(coordinates.slopes(vector), np.transpose(numeric), rtol=1e-4, atol=1e-6)


def test_what_weighs_nothing_leaves_places_finite():
    coordinates = Coordinates(WHO)
    vector = coordinates.of(np.zeros(7))
    assert np.isfinite(coordinates.parameters(vector)).all()
    assert np.isfinite(coordinates.slopes(vector)).all()
    far = coordinates.within(vector + 1.0)
    assert (np.abs(coordinates.parameters(far)[2:5]) <= 1.0).all()


def test_an_amplitude_grows_where_a_place_would_lie_out_of_reach():
    """Records tell the moment: a mass that is stepped down to nothing takes it along only as far as places may lie."""
    coordinates = Coordinates(WHO)
    vector = coordinates.of(np.array([0.0, 0.1, 0.5, -0.3, 0.0, 1.0, 0.0]))
    vector[1] = -2.0
    found = coordinates.within(vector)
    np.testing.assert_allclose(found[2:5], vector[2:5])
    np.testing.assert_allclose(coordinates.parameters(found)[1:5], [0.05, 1.0, -0.6, 0.0])
    # Where records say so, it is the product that gives way.
    np.testing.assert_allclose(coordinates.within(vector, kept=False)[1:5], 0.0, atol=1e-4)
    vector[2] = 1e3
    np.testing.assert_allclose(coordinates.parameters(coordinates.within(vector))[1:3], [20.0, 1.0])


def test_a_shape_at_its_bound_is_no_rounding_beyond_it():
    """No model may hold what lies outside its range, and 3.0 * 0.4 / 0.4 is more than 3."""
    coordinates = Coordinates(WHO)
    for stiffness in np.linspace(0.1, 2.0, 96):
        found = coordinates.parameters(coordinates.of(np.array([0.0, 0.1, 1.0, -1.0, 0.0, stiffness, 3.0])))
        assert (np.abs(found[2:5]) <= 1.0).all()
        assert found[6] == 3.0


@pytest.mark.parametrize("place", [(0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.3, 0.3)])
def test_a_fit_finds_a_payload_from_wherever_it_begins(axis, place):
    """A first step that takes the mass to nothing is too long, and no end."""
    hidden = {"mass": 0.2, "x": 0.03, "y": 0.0, "z": 0.08}
    view = views_of(Mechanism(axis[0]), simulated(axis, records_of(axis), (WHO[1].applied(hidden),)))["fit"]
    best = float((view.residual((WHO[1].applied(hidden),)) ** 2).sum())
    rough = fit(view, (WHO[1],), ({"mass": 0.05, "x": place[0], "y": 0.0, "z": place[1]},))
    assert rough.chi2 < best + 20.0
    assert polish(view, rough).chi2 < best + 1.0


def diagnosed(axis, name, joint, values):
    """The search for one effect on the axis, and what it finds."""
    records = simulated(axis, records_of(axis), (JointCandidate(name, joint).applied(values),))
    views = views_of(Mechanism(axis[0]), records)
    who = candidates(views["fit"], None, (views["select"],))
    search = JointIdentification(views["fit"], views["select"], signature_bank(views["fit"], who, axis[2] / "bank"), who)
    return search, search.run()


@pytest.mark.parametrize(("mass", "height"), [(0.145, 0.08), (0.3, 0.08), (0.6, 0.05)])
def test_a_payload_on_one_axis_is_named(axis, mass, height):
    """One axis tells the moment well and the mass by its inertia alone: many masses at their heights do nearly as well."""
    search, finding = diagnosed(axis, "payload", "", {"mass": mass, "x": 0.0, "y": 0.0, "z": height})
    assert (finding.verdict, finding.best.names) == ("named", ("payload",))
    assert "payload" not in search.lost
    found = finding.best.fit
    assert found.values[0]["mass"] == pytest.approx(mass, abs=3.0 * found.deviations[0])
    assert found.values[0]["mass"] * found.values[0]["z"] == pytest.approx(mass * height, rel=0.08)


@pytest.mark.parametrize(("stiffness", "rest"), [(0.3, 0.8), (1.0, -1.5), (0.1, 2.5)])
def test_a_spring_that_rests_aside_is_named(axis, stiffness, rest):
    """It pulls one way all along, as a weight would at a lever, or a torque that the log does not show."""
    _, finding = diagnosed(axis, "spring", "axis", {"stiffness": stiffness, "rest": rest})
    assert (finding.verdict, finding.best.names) == ("named", ("spring:axis",))
    found = finding.best.fit.values[0]
    assert found["stiffness"] == pytest.approx(stiffness, rel=0.15)
    assert found["stiffness"] * found["rest"] == pytest.approx(stiffness * rest, rel=0.05)


def test_derivatives_are_by_the_parameters_whatever_a_fit_moves_in(axis):
    records = simulated(axis, records_of(axis), (WHO[1].applied({"mass": 0.2, "x": 0.02, "y": 0.0, "z": 0.08}),))
    view = views_of(Mechanism(axis[0]), records)["fit"]
    fitted = fit(view, (WHO[1],), ({"mass": 0.2, "x": 0.0, "y": 0.0, "z": 0.1},))
    found, values, step = derivatives(view, fitted), fitted.values[0], 1e-3
    for k, name in enumerate(("mass", "x", "y", "z")):
        ends = [view.residual((WHO[1].applied({**values, name: values[name] + sign * step}),)).ravel() for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert np.linalg.norm(found[:, k] - slope) <= 0.02 * np.linalg.norm(slope) + 1e-6
