"""PyBullet against a MuJoCo twin: same description, gains, armature and commands, other engine, other code for the torques."""

import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import world

from gsbridge.sim.twin import compare_with_twin, set_points


@pytest.mark.parametrize("armature", [True, False])
def test_same_commands_same_free_motion(armature):
    changes = {} if armature else {"arm__armature": [0.0] * 7, "arm__stiffness": [2000.0] * 4 + [60.0, 60.0, 3.0],
                                   "arm__damping": [130.0] * 4 + [3.0, 3.0, 0.1]}  # fmt: skip
    with world(**changes) as sim:
        found = compare_with_twin(robot(), sim)
    assert found.travel.min() > 0.08
    assert found.speed > 0.02
    assert found.tool < 0.001  # m; the floor is 3 mm
    assert found.joints < 2e-3


def test_the_twin_sees_a_softer_arm():
    """Agreement is no matter of course: gains that only one engine has tear them apart."""
    with world() as sim:
        stiff = sim.model
        sim.controller._arm["law"][0, 0] *= 0.02
        found = compare_with_twin(robot(), sim)
        assert sim.model is stiff
    assert found.tool > 0.003


def test_set_points_of_a_steady_motion_trail_by_half_a_period():
    goals = np.arange(6.0)[:, None] * [1.0, -2.0]
    found = set_points(goals, 50)
    assert found.shape == (251, 2)
    np.testing.assert_allclose(found[100:], (np.arange(100, 251) / 50 - 0.5)[:, None] * [1.0, -2.0], atol=1e-12)
    np.testing.assert_allclose(found[0], 0.0)
