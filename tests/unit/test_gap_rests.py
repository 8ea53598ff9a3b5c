"""Friction that creeps at rest: only motion shows whether it is there, and it does not hide effects that act at rest alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.axis_truth import AXIS
from gsbridge.gap.benchmark.generate import draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.diagnosis.closure import closed, closed_beside_rest
from gsbridge.gap.joints.diagnose import diagnose_joints
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

ENOUGH = 0.9
"""Share of a gap that a name must close where something remains."""

CREEP = 0.05
"""Speed at which friction holds three quarters of its torque, rad/s: at rest a joint creeps by a centiradian."""


def strokes(count, length, share):
    """Rests that take up a share of each of some equal strokes. [count * length]."""
    return np.tile(np.arange(length) >= round((1 - share) * length), count)


@pytest.fixture
def noise():
    return np.random.default_rng(0).standard_normal((1200, 2))


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_motion_tells_a_closure_however_long_a_record_rests(noise, share):
    rests = strokes(6, 200, share)
    before, after = 20.0 + noise, noise + 15.0 * rests[:, None] * (1.0 if share < 0.5 else 0.6)
    before[rests] -= 0.0 if share < 0.5 else 8.0
    moving = closed(before[~rests], after[~rests], 1.0)
    assert closed(before, after, 1.0) < 0.7 < ENOUGH < moving
    assert closed_beside_rest(before, after, 1.0, rests) == moving


def test_motion_tells_nothing_where_it_is_too_little(noise):
    """Two strokes might be one there and one back; a rest that is worse than before is an error, not an open place."""
    before, after = 20.0 + noise, noise.copy()
    for rests, left in ((strokes(2, 600, 0.4), 15.0), (strokes(6, 200, 0.4), 25.0), (strokes(60, 20, 0.4), 15.0)):
        kept = after + left * rests[:, None]
        assert closed(before[~rests], kept[~rests], 1.0) > ENOUGH
        assert closed_beside_rest(before, kept, 1.0, rests) == closed(before, kept, 1.0) < 0.7


def test_what_acts_at_rest_alone_is_not_left_out(noise):
    """A gap of which most is at rest stays open, though what little shows in motion is closed."""
    rests = strokes(6, 200, 0.4)
    before = noise + np.where(rests, 20.0, 6.0)[:, None]
    after = noise + np.where(rests, 18.0, 0.0)[:, None]
    assert closed(before[~rests], after[~rests], 1.0) > ENOUGH
    assert closed_beside_rest(before, after, 1.0, rests) == closed(before, after, 1.0) < 0.2


def test_a_rest_echoes_until_the_controller_has_pulled_it_in(noise):
    """An error that a rest has left falls by 1/e in 20 samples; what an explanation leaves of motion itself is no echo."""
    rests = strokes(6, 200, 0.4)
    since = np.arange(1200) % 200
    echoes = (since < 20) & ~rests & (np.arange(1200) >= 200)
    before = 20.0 + noise
    after = noise + 18.0 * np.where(rests, 1.0, np.exp(-since / 20.0) * (np.arange(1200) >= 200))[:, None]
    assert closed_beside_rest(before, after, 1.0, rests) < 0.8 < ENOUGH < closed_beside_rest(before, after, 1.0, rests, echoes)
    steady = noise + 18.0 * (rests | (since < 100))[:, None]
    assert closed_beside_rest(before, steady, 1.0, rests, echoes) < 0.6


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rests")
    return (*axis_plant(folder), folder)


def course(role, time):
    """Commanded angles, rad: sines on `fit` and `verify`, strokes with long rests on `select`. [T] -> [T]."""
    begun = np.clip(time / 0.5, 0.0, 1.0) ** 2
    if role == "select":
        stops = np.array([0.0, 0.6, -0.3, 0.4, -0.5, 0.2, 0.7])
        place = np.clip(time / 0.95, 0.0, 5.99)
        share = np.clip((place % 1.0) / 0.3, 0.0, 1.0)
        number = place.astype(int)
        return 0.3 + stops[number] + (stops[number + 1] - stops[number]) * share**3 * (10 - 15 * share + 6 * share**2)
    rates = (0.45, 1.1) if role == "fit" else (0.6, 0.95)
    return 0.3 + begun * (0.5 * np.sin(2 * np.pi * rates[0] * time) + 0.3 * np.sin(2 * np.pi * rates[1] * time + 1.0))


def logged(record, role, friction, sag, rng):
    """A record of the axis by an integrator of its own, with friction that creeps and a torque that acts at rest alone."""
    finest, speed = 2e-4, 0.0
    grid = np.arange(round(record.time[-1] / 1e-3) + 2) * 1e-3
    sent = course(role, record.time)
    wanted = np.interp(grid, record.time, sent)
    still = np.abs(np.gradient(wanted, grid)) < 0.02
    position, rows, weight = wanted[0], [], AXIS["moment"] * AXIS["gravity"]
    for target, rest in zip(wanted, still, strict=True):
        effort = AXIS["stiffness"] * (target - position) - AXIS["damping"] * speed + weight * math.cos(position)
        rows.append((position, speed, effort))
        for _ in range(round(1e-3 / finest)):
            torque = effort - weight * math.cos(position) + sag * rest
            # Friction is implicit in the speed: explicit steps of a slope this steep would swing.
            most = finest * (abs(torque) + friction) / AXIS["inertia"]
            low, high = speed - most, speed + most
            for _ in range(14):
                middle = 0.5 * (low + high)
                error = AXIS["inertia"] * (middle - speed) - finest * (torque - friction * math.tanh(middle / CREEP))
                low, high = (low, middle) if error > 0 else (middle, high)
            speed = 0.5 * (low + high)
            position += finest * speed
    columns = np.array(rows).T
    sizes = {"position": 2e-4, "velocity": 5e-3, "effort": 0.02}
    measured = {
        kind: (np.interp(record.time, grid, column) + sizes[kind] * rng.standard_normal(len(record.time)))[:, None]
        for kind, column in zip(sizes, columns, strict=True)
    }
    return replace(record, commands={"command": sent[:, None]}, measured=measured)


def diagnosed(axis, friction, sag):
    rng = np.random.default_rng(3)
    plain = draw_case(axis[1], (), 0.0, 1, 2).records
    records = {role: logged(plain[role], role, friction, sag, rng) for role in ("fit", "select", "verify")}
    names = ("coulomb", "viscous", "armature", "torque_gain", "encoder_scale", "spring")
    return diagnose_joints(axis[0], records, axis[2] / "bank", names=names, seed=1), records


@pytest.mark.parametrize("damping", [AXIS["damping"], 0.125 * AXIS["damping"]])
def test_the_memory_of_a_loop_is_that_of_its_equation(axis, damping):
    """The sample from which a displaced start stays below 1/e, by the exact steps of a torque that is held for a millisecond.

    The weight does not matter, since the controller carries it.
    """
    record = draw_case(axis[1], (), 0.0, 1, 2).records["select"]
    controller = replace(axis[0].controller, damping=np.array([damping]))
    view = JointResiduals.of(Mechanism(replace(axis[0], controller=controller)), record)
    free = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / AXIS["inertia"]], [0.0, 0.0, 0.0]])
    moved = expm(free * 1e-3)
    step = moved[:2, :2] - np.outer(moved[:2, 2], [AXIS["stiffness"], damping])
    left = np.array([abs(np.linalg.matrix_power(step, round(1e3 * time))[0, 0]) for time in record.time])
    assert abs(view.memory(0) - np.flatnonzero(left >= np.exp(-1.0))[-1] - 1) <= 1


def test_what_follows_a_rest_is_as_long_as_the_memory_of_the_loop(axis):
    record = draw_case(axis[1], (), 0.0, 1, 2).records["select"]
    view = JointResiduals.of(Mechanism(axis[0]), record)
    rests, echoes = view.rests([Applied("coulomb", "axis", {"torque": 2.0})], ["axis"])
    edges = np.flatnonzero(rests[:-1] & ~rests[1:]) + 1
    assert rests.any()
    assert not (rests & echoes).any()
    assert echoes.sum() <= view.memory(0) * len(edges)
    assert not view.rests([], [])[0].any()


def test_friction_is_named_from_motion_where_a_record_mostly_creeps(axis):
    diagnosis, records = diagnosed(axis, 1.2, 0.0)
    view = JointResiduals.of(Mechanism(axis[0]), records["select"])
    best = diagnosis.finding.best
    assert view.rests(best.fit.effects, ["axis"])[0].mean() > 0.5
    assert diagnosis.finding.verdict == "named"
    assert best.names == ("coulomb:axis",)
    # The report says that something remains at rest.
    assert diagnosis.finding.something_remains
    assert best.fit.effects[0].parameters["torque"] == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_torque_that_acts_at_rest_alone_is_not_called_friction(axis, friction):
    """Without friction, and beside a little: in motion it is closed, and most of the gap is at rest."""
    diagnosis, _ = diagnosed(axis, friction, 2.5)
    finding = diagnosis.finding
    assert finding.verdict != "named"
    assert finding.something_remains
