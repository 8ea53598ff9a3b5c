"""Dead times that episodes of a training draw, against how far the tool stays behind a steady command."""

import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import content, cube, model

from gsbridge.sim.world import SimWorld

SPEED, PERIODS = 0.1, 16
"""Speed of the commanded tool point, m/s, and control periods of a motion."""


def world(latency=0.0, delay=0.0):
    return SimWorld(robot(), cube(), model(arm={**content()["arm"], "delay": delay}), latency=latency)


def path(sim, seed):
    """Places of the tool while its command moves along x at `SPEED` and the gripper closes. [PERIODS, 4]."""
    sim.reset(np.array([0.1, 0.3, 0.0]), seed)
    start = sim.state().tool_position[0]
    out = []
    for number in range(1, PERIODS + 1):
        target = start - [SPEED * number * sim.model.period, 0.0, 0.0]
        sim.command(target, 0.0, 0.14 - 0.005 * number)
        sim.step()
        state = sim.state()
        out.append([*state.tool_position[0], state.aperture[0]])
    return np.array(out)


def behind(sim, seed, punctual):
    """How much later than in a punctual world the tool comes along, s."""
    return float((path(sim, seed) - punctual)[-1, 0] / SPEED)


def test_every_episode_comes_later_by_a_time_of_its_own():
    with world() as sim:
        punctual = path(sim, 0)
        np.testing.assert_array_equal(path(sim, 1), punctual)
    with world(latency=0.2) as sim:
        times = [behind(sim, seed, punctual) for seed in range(12)]
        # The same seed draws the same time, whatever came before.
        assert [behind(sim, seed, punctual) for seed in (5, 2)] == [times[5], times[2]]
    assert min(times) > -0.002
    assert max(times) < 0.202
    assert max(times) - min(times) > 0.1


def test_it_adds_to_the_model_s_and_acts_on_the_gripper_too():
    with world() as sim:
        punctual = path(sim, 0)
    with world(latency=0.1) as sim:
        drawn = behind(sim, 3, punctual)
    with world(latency=0.1, delay=0.05) as sim:
        late = path(sim, 3)
    assert (late - punctual)[-1, 0] / SPEED == pytest.approx(drawn + 0.05, abs=0.003)
    with world(delay=round(drawn + 0.05, 3)) as sim:
        np.testing.assert_allclose(path(sim, 0), late, atol=3e-4)
