"""A controller with an integral that the model does not have is told, and no effect is blamed for it."""

import pytest
from axis_logs import axis_in, records_of, simulated
from scipy.integrate import cumulative_trapezoid

from gsbridge.effects.registry import Applied
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints
from gsbridge.gap.joints.integral_action import integral_action
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_in(tmp_path_factory.mktemp("axis"))


def test_a_controller_with_an_integral_is_told_and_nothing_is_blamed_for_it(axis):
    """Its gain comes out of the logged efforts; another stiffness, a late command and friction are no integral."""
    system, gain = axis[0], 30.0
    late = Applied("command_delay", "", {"time": 0.02})
    friction = Applied("coulomb", "axis", {"torque": 0.4})
    for effects, integral in (((), gain), ((friction,), gain), ((friction,), 0.0), ((late,), 0.0)):
        records = simulated(axis, records_of(axis), effects)
        for role, record in records.items():
            error = record.commands["command"] - record.measured["position"]
            held = cumulative_trapezoid(error, record.time, axis=0, initial=0.0)
            records[role] = record.with_measured({**record.measured, "effort": record.measured["effort"] + integral * held})
        views = [JointResiduals.of(Mechanism(system), records[role]) for role in ("fit", "select")]
        told = integral_action(views)
        assert (told is not None) == (integral > 0.0)
        if told is not None and not effects:
            assert told.gains["axis"] == pytest.approx(gain, rel=0.05)
            diagnosis = diagnose_joints(system, records, axis[2] / "bank", names=("coulomb", "viscous"), seed=1)
            findings = JointAccount().findings_of(diagnosis, records, seed=1)
            assert findings["verdict"] == "none_of_the_known"
            assert findings["status"] == "degraded"
            assert "N m/(rad s)" in findings["sentence"]
            assert findings["amended"] == []
