"""Effects on the simulated arm: what they do to its set points and to its motion."""

import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import content, cube

from gsbridge.sim.arm_setup import ArmSetup, shape_commands
from gsbridge.sim.dynamics import packed
from gsbridge.sim.model import Model, parse_model
from gsbridge.sim.world import SimWorld


def with_effects(*effects: dict) -> Model:
    return parse_model({**content(), "effects": list(effects)})


def limited(slowness: float, joint: str = "joint_1") -> dict:
    return {"name": "rate_limit", "joint": joint, "parameters": {"slowness": slowness}}


def arm_joints() -> tuple[str, ...]:
    return tuple(robot().record["arm_joints"])


def swing(model: Model, steps: int = 14) -> np.ndarray:
    """Measured angles after each control period of a step of 48 mm sideways. [T, 7]."""
    rows = []
    with SimWorld(robot(), cube(), model) as sim:
        sim.command(np.array([0.048, 0.265, 0.25]), 0.0, 0.14)
        for _ in range(steps):
            sim.step()
            rows.append(sim.joints()[0][:7])
    return np.array(rows)


def test_a_speed_limit_that_is_never_reached_changes_nothing():
    """The arm's commands stay below 2 rad/s, so that the motion is the one without the limit."""
    plain, found = swing(with_effects()), swing(with_effects(*(limited(0.5, name) for name in arm_joints())))
    assert np.ptp(plain, axis=0).max() > 0.05
    assert np.abs(np.diff(plain, axis=0)).max() / 0.05 < 1.5
    np.testing.assert_allclose(found, plain, atol=1e-9)


@pytest.mark.parametrize("fastest", [0.5, 0.1])
def test_a_speed_limit_holds_position_and_speed_of_the_set_point(fastest):
    """Against the law: the position follows with at most the limit, and so does the speed that is fed forward."""
    step, joints = 0.001, arm_joints()
    model = with_effects(limited(1.0 / fastest, joints[0]))
    arm = packed(shaped=np.zeros((2, 8)), **{k: v for k, v in ArmSetup(model, joints, np.ones(7), np.zeros(3)).record().items()
                                             if k != "shaped"})  # fmt: skip
    time = step * np.arange(3000)
    wanted, speeds = 0.3 * np.sin(2.0 * time), 0.6 * np.cos(2.0 * time)
    found = []
    for position, speed in zip(wanted, speeds, strict=True):
        arm[0]["shaped"][:] = np.array([[position], [speed]])
        shape_commands(arm[0], step)
        found.append(arm[0]["shaped"].copy())
    found = np.array(found)
    follower = [wanted[0]]
    for position in wanted[1:]:
        follower.append(np.clip(position, follower[-1] - fastest * step, follower[-1] + fastest * step))
    np.testing.assert_allclose(found[:, 0, 0], follower, atol=1e-12)
    np.testing.assert_allclose(found[:, 1, 0], np.clip(speeds, -fastest, fastest), atol=1e-12)
    # The other joints have no limit.
    np.testing.assert_array_equal(found[:, 0, 1], wanted)
    np.testing.assert_array_equal(found[:, 1, 1], speeds)


def steady(*effects: dict, **changes) -> tuple[float, float]:
    """Place of the tool along x in the midst of a steady motion, m, and the latency that the arm's set-up states, s."""
    values = content()
    values["arm"] |= changes
    with SimWorld(robot(), cube(), parse_model({**values, "effects": list(effects)})) as sim:
        for number in range(-20, 25):
            sim.command(np.array([-0.15 + 0.012 * max(number, 0), 0.265, 0.25]), 0.0, 0.14)
            sim.step()
        return float(sim.state().tool_position[0, 0]), sim.controller.setup.latency


@pytest.mark.parametrize(
    ("effects", "changes", "expected"),
    [
        ([], {"delay": 0.06}, 0.06),
        ([{"name": "command_delay", "parameters": {"time": 0.1}}], {"delay": 0.03}, 0.13),
        ([{"name": "lag", "parameters": {"time": 0.08}}, {"name": "command_delay", "parameters": {"time": 0.05}}], {}, 0.13),
        ([{"name": "torque_lag", "joint": f"lbr_iiwa_joint_{k + 1}", "parameters": {"time": 0.002}} for k in range(7)]
         + [{"name": "torque_delay", "joint": "lbr_iiwa_joint_1", "parameters": {"time": 0.002}}], {}, 0.0),
    ],
)  # fmt: skip
def test_latency_is_by_how_much_the_arm_comes_late(effects, changes, expected):
    """In a steady motion of 12 mm per 50 ms, against the motion without any."""
    (found, latency), (nominal, none) = steady(*effects, **changes), steady()
    assert none == 0.0
    assert latency == pytest.approx(expected)
    assert (nominal - found) / 0.24 == pytest.approx(expected, abs=0.003)
