"""Bodies of assets in PyBullet: loading, poses, and a check that a body stays at rest in its filmed pose."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from gsbridge.errors import InputError
from gsbridge.geometry import Array, quat_from_rotation, rotation_angle, rotation_from_quat

COLLISION_MARGIN = 1e-3
"""Margin that Bullet's URDF reader adds all round convex and concave meshes, m; no call changes it for parts of a compound."""

TIME_STEP = 1e-3
"""Step of the simulation, s."""


def matrix_from_bullet(position: Array, quat_xyzw: Array) -> Array:
    """4x4 pose from Bullet's position [3] and quaternion (xyzw) [4]."""
    out = np.eye(4)
    out[:3, :3] = rotation_from_quat(np.roll(quat_xyzw, 1))
    out[:3, 3] = position
    return out


def load_body(
    client: BulletClient, urdf: str | Path, world_from_body: Array | None = None, *, static: bool = False, single: bool = False
) -> int:
    """Load an asset's URDF with the inertia it states.

    Args:
        client: Connected PyBullet client.
        urdf: `body.urdf` of an asset.
        world_from_body: Pose of the body frame; the world's origin when None. [4, 4].
        static: Fix the body at that pose.
        single: Load a single body instead of the base of a tree of links, which is faster. `getDynamicsInfo` then does not
            give the frame of inertia.

    Returns:
        Bullet's number of the body.

    Raises:
        InputError: The file cannot be loaded.
    """
    pose = np.eye(4) if world_from_body is None else np.asarray(world_from_body, dtype=np.float64)
    try:
        return client.loadURDF(
            str(urdf),
            basePosition=pose[:3, 3].tolist(),
            baseOrientation=np.roll(quat_from_rotation(pose[:3, :3]), -1).tolist(),
            useFixedBase=static,
            useMaximalCoordinates=single,
            # Without the flag Bullet would derive an inertia from the bounds of the hulls.
            flags=client.URDF_USE_INERTIA_FROM_FILE,
        )
    except pybullet.error as error:
        raise InputError(urdf, f"PyBullet cannot load the body ({error})", "Run the asset stage again") from error


def body_from_inertial(client: BulletClient, body: int) -> Array:
    """Frame in which Bullet reports the pose of a body's base: centre of mass and principal axes. Constant. [4, 4]."""
    dynamics = client.getDynamicsInfo(body, -1)
    return matrix_from_bullet(dynamics[3], dynamics[4])


def world_from_body(client: BulletClient, body: int) -> Array:
    """Pose of the body frame. [4, 4]."""
    return matrix_from_bullet(*client.getBasePositionAndOrientation(body)) @ np.linalg.inv(body_from_inertial(client, body))


@dataclass(frozen=True)
class Rest:
    """How a body rests on a flat table.

    Args:
        penetration_mm: Deepest penetration, either at the start before the engine pushes the body out, or at the end, mm.
        drift_mm: Largest distance of the body frame from its first place, over the whole time, mm.
        drift_deg: Largest rotation from its first attitude, degrees.
        speed_mm_s: Speed at the end, mm/s.
        seconds: Time simulated, s.
    """

    penetration_mm: float
    drift_mm: float
    drift_deg: float
    speed_mm_s: float
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Plain mapping for a JSON file."""
        return asdict(self)


def rest_check(urdf: str | Path, seconds: float = 2.0) -> Rest:
    """Put a body on a table in its filmed pose, let it go and measure how it rests.

    Args:
        urdf: `body.urdf` of an asset.
        seconds: Time to simulate, s.

    Raises:
        InputError: The file cannot be loaded.
    """
    client = BulletClient(pybullet.DIRECT)
    try:
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(TIME_STEP)
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[0.5, 0.5, 0.05])
        table = client.createMultiBody(0, shape, basePosition=[0, 0, -0.05])
        body = load_body(client, urdf)
        client.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0)
        client.performCollisionDetection()
        depths = [0.0, *(-contact[8] for contact in client.getContactPoints(body, table))]
        back = np.linalg.inv(body_from_inertial(client, body))
        drift = turn = 0.0
        for _ in range(round(seconds / TIME_STEP)):
            client.stepSimulation()
            pose = matrix_from_bullet(*client.getBasePositionAndOrientation(body)) @ back
            drift = max(drift, float(np.linalg.norm(pose[:3, 3])))
            turn = max(turn, float(rotation_angle(pose[:3, :3])))
        depths += [-contact[8] for contact in client.getContactPoints(body, table)]
        speed = float(np.linalg.norm(client.getBaseVelocity(body)[0]))
        return Rest(1e3 * max(depths), 1e3 * drift, float(np.degrees(turn)), 1e3 * speed, seconds)
    finally:
        client.disconnect()
