"""Starts of the replays of mechanisms without feedback, against a pendulum that SciPy swings."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.first_states import HIGHEST, state_at
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, spans_of

MASS, REACH, INERTIA, GRAVITY = 1.0, 0.3, 0.01, 9.81
URDF = f"""<robot name="axis"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -{REACH}"/><mass value="{MASS}"/>
<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


@cache
def swing(angle, speed):
    """A pendulum's angle and speed as functions of time, rad and rad/s."""

    def law(_, x):
        return x[1], -MASS * GRAVITY * REACH * np.sin(x[0]) / (INERTIA + MASS * REACH**2)

    return solve_ivp(law, (0.0, 30.0), (angle, speed), rtol=1e-10, atol=1e-10, dense_output=True).sol


def record_of(time, motion, noise, seed=0):
    position = motion(time)[:1].T + noise * np.random.default_rng(seed).standard_normal((len(time), 1))
    return Record("swing", time, ("hinge",), {}, {"position": position})


@pytest.fixture(scope="module")
def mechanism(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pendulum")
    (folder / "axis.urdf").write_text(URDF)
    content = {"urdf": "axis.urdf", "controller": {"mode": "free"}, "physics_rate": 2000}
    return Mechanism(parse_mechanism_model(content, folder))


def alarm(mechanism, record):
    view = JointResiduals.of(mechanism, record)
    return joint_null(view, np.random.default_rng(0)).p_value(view.residual())


@pytest.mark.parametrize("start", [(1.0, 0.0), (2.0, 0.0)])
@pytest.mark.parametrize(("rate", "noise"), [(10, 1e-3), (10, 2e-4), (15, 1e-3), (25, 2e-4), (100, 2e-4)])
def test_a_perfect_model_of_a_swing_raises_no_alarm_at_any_rate(mechanism, rate, noise, start):
    assert alarm(mechanism, record_of(np.arange(25 * rate) / rate, swing(*start), noise)) > 0.05


HOLES = [(3.2, 6.15), (3.2, 3.6), (3.7, 4.0), (3.45, 4.25), (3.995, 4.005)]


@pytest.mark.parametrize("hole", HOLES)
def test_a_perfect_model_raises_no_alarm_behind_a_hole(mechanism, hole):
    time = np.arange(1200) / 100
    record = record_of(time[(time < hole[0]) | (time > hole[1])], swing(1.0, 0.0), 2e-4)
    assert alarm(mechanism, record) > 0.05
    row = int(np.searchsorted(record.time, hole[1]))
    place, speed = state_at(record, row, HIGHEST)
    told = swing(1.0, 0.0)(record.time[row])
    assert place[0] == pytest.approx(told[0], abs=1e-3)
    assert speed[0] == pytest.approx(told[1], abs=0.06)


@pytest.mark.parametrize("kept", [1, 2, 4])
def test_a_few_samples_between_two_holes(mechanism, kept):
    """One or two tell no speed, so that no stretch begins there."""
    time = np.arange(1200) / 100
    inside = (time < 3.5) | ((time > 3.995) & (time < 3.995 + kept / 100)) | (time > 4.5)
    record = record_of(time[inside], swing(1.0, 0.0), 2e-4)
    starts = [record.time[first] for first, _ in spans_of(record, mechanism.system)]
    assert (4.0 in starts) == (kept == 4)
    assert alarm(mechanism, record) > 0.05


@pytest.mark.parametrize(("rate", "bound"), [(10, 0.15), (25, 0.1), (100, 0.1), (1000, 0.05)])
@pytest.mark.parametrize("logged", [False, True])
def test_states_are_those_of_the_swing(rate, bound, logged):
    time, motion = np.arange(4 * rate) / rate, swing(1.0, 0.0)
    record = record_of(time, motion, 1e-3)
    if logged:
        speed = motion(time)[1:].T + 1e-2 * np.random.default_rng(1).standard_normal((len(time), 1))
        record = record.with_measured({**record.measured, "velocity": speed})
    for row in (0, rate // 3, rate, 4 * rate - 1):
        place, speed = state_at(record, row, HIGHEST)
        assert place[0] == pytest.approx(motion(time[row])[0], abs=4e-3)
        assert speed[0] == pytest.approx(motion(time[row])[1], abs=bound)
