"""Wrong clocks of mechanisms without feedback, whose replays start anew from states that these clocks stamped."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_gap_first_states import GRAVITY, INERTIA, MASS, REACH, URDF, swing

from gsbridge.effects.registry import Applied
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

NOISE = {"position": 2e-4, "velocity": 2e-3}
VISCOUS = 0.5


def mechanism_of(folder, mode, **changes):
    (folder / "axis.urdf").write_text(URDF)
    controller = {"mode": mode, "between": "line", "rate": 10000}
    content = {"urdf": "axis.urdf", "controller": controller, "physics_rate": 10000} | changes
    return Mechanism(parse_mechanism_model(content, folder))


def logged(motion, time, taken, kinds, commands):
    """The motion at the times `taken`, with noise, under other stamps."""
    rng, columns = np.random.default_rng(0), dict(zip(("position", "velocity"), motion(taken), strict=True))
    measured = {kind: (columns[kind] + NOISE[kind] * rng.standard_normal(len(time)))[:, None] for kind in kinds}
    return Record("log", time, ("hinge",), commands, measured, torque_commands=bool(commands))


def left(mechanism, record, *effects):
    view = JointResiduals.of(mechanism, record)
    return float(np.sqrt((view.residual(effects) ** 2).sum() / view.freedom))


@pytest.mark.parametrize("kinds", [("position",), ("position", "velocity")])
@pytest.mark.parametrize("drift", [-0.005, 0.001, 0.005, 0.01])
def test_the_drift_of_a_clock_explains_a_free_swing_however_long(tmp_path, drift, kinds):
    mechanism, time = mechanism_of(tmp_path, "free"), np.arange(2000) / 100
    record = logged(swing(1.0, 0.0), time, time * (1.0 - drift), kinds, {})
    assert left(mechanism, record) > 4.0
    assert left(mechanism, record, Applied("clock_drift", "", {"drift": drift})) == pytest.approx(1.0, abs=0.15)


def torque(time):
    return 1.5 * np.sin(2 * np.pi * 0.7 * time) + 1.0 * np.sin(2 * np.pi * 1.9 * time)


@pytest.fixture(scope="module")
def driven():
    def law(t, x):
        push = torque(t) - VISCOUS * x[1] - MASS * GRAVITY * REACH * np.sin(x[0])
        return x[1], push / (INERTIA + MASS * REACH**2)

    return solve_ivp(law, (0.0, 8.0), (0.0, 0.0), rtol=1e-9, atol=1e-9, dense_output=True).sol


@pytest.mark.parametrize(
    ("effects", "taken"),
    [
        ({"clock_offset": {"time": 0.02}}, lambda time: time - 0.02),
        ({"clock_offset": {"time": -0.05}}, lambda time: time + 0.05),
        ({"clock_drift": {"drift": 0.01}}, lambda time: time * 0.99),
        ({"clock_offset": {"time": 0.02}, "clock_drift": {"drift": 0.01}}, lambda time: 0.99 * time - 0.02),
    ],
)
def test_clocks_of_the_motion_explain_a_driven_swing(tmp_path, driven, effects, taken):
    mechanism, begin = mechanism_of(tmp_path, "torque", viscous=VISCOUS), 0.5
    time = np.arange(4000) / 1000
    record = logged(driven, time, taken(time) + begin, ("position",), {"command": torque(time + begin)[:, None]})
    assert left(mechanism, record) > 10.0
    applied = [Applied(name, "", values) for name, values in effects.items()]
    assert left(mechanism, record, *applied) == pytest.approx(1.0, abs=0.15)
