"""The description for engines against the whole one, by PyBullet's own dynamics."""

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient
from robot_fixture import robot

from gsbridge.errors import InputError
from gsbridge.robot.fused import fused_description

MOVING = 11


@pytest.fixture
def two(tmp_path):
    """A client with the whole robot and the fused one, and Bullet's numbers of both."""
    client = BulletClient(pybullet.DIRECT)
    (tmp_path / "fused.urdf").write_text(fused_description(robot().urdf))
    paths = robot().urdf, tmp_path / "fused.urdf"
    flags = client.URDF_USE_INERTIA_FROM_FILE
    yield client, [client.loadURDF(str(path), useFixedBase=True, flags=flags) for path in paths]
    client.disconnect()


def joints(client, body):
    """Names of the moving joints and of their links."""
    information = [client.getJointInfo(body, number) for number in range(client.getNumJoints(body))]
    return [(item[1], item[12], item[8], item[9]) for item in information if item[3] >= 0]


def test_only_moving_links_are_left(two):
    client, (whole, fused) = two
    assert client.getNumJoints(whole) > client.getNumJoints(fused) == MOVING
    assert joints(client, whole) == joints(client, fused)


def test_it_moves_as_before(two):
    client, bodies = two
    rng = np.random.default_rng(0)
    client.setGravity(0.3, -0.2, -9.81)
    for _ in range(5):
        q, speed, acceleration = rng.uniform(-0.6, 0.6, (3, MOVING)).tolist()
        inertia = [np.array(client.calculateMassMatrix(body, q)) for body in bodies]
        torques = [np.array(client.calculateInverseDynamics(body, q, speed, acceleration)) for body in bodies]
        np.testing.assert_allclose(inertia[1], inertia[0], atol=1e-10)
        np.testing.assert_allclose(torques[1], torques[0], atol=1e-10)


def test_it_touches_as_before(two):
    """A ball finds the same distances to hand and arm wherever it is."""
    client, bodies = two
    shape = client.createCollisionShape(client.GEOM_SPHERE, radius=0.01)
    ball = client.createMultiBody(0.1, shape)
    rng = np.random.default_rng(1)
    for _ in range(20):
        client.resetBasePositionAndOrientation(
            ball, (rng.uniform(-0.2, 0.2, 3) + np.array([0, 0, 1.35])).tolist(), [0, 0, 0, 1]
        )
        near = [min(point[8] for point in client.getClosestPoints(ball, body, 2.0)) for body in bodies]
        assert near[1] == pytest.approx(near[0], abs=1e-6)


def test_a_damaged_description_is_named(tmp_path):
    path = tmp_path / "robot.urdf"
    with pytest.raises(InputError, match="it does not exist"):
        fused_description(path)
    path.write_text("<robot><link name='a'/></robot>")
    with pytest.raises(InputError, match="link 'a' has no mass properties"):
        fused_description(path)
    path.write_text("<robot")
    with pytest.raises(InputError, match="no valid XML"):
        fused_description(path)
