"""The MuJoCo model of a world: the robot's description, the table, the plate and the true object.

MuJoCo reads the URDF. This module adds what a URDF cannot express: rotor inertias (without them the servos are unstable),
gravity compensation, servos, stiff couplings of the fingers, and which bodies may collide. Neighbouring links of the arm must
not collide, because their hulls overlap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from gsbridge.geometry import Array, quat_from_rotation
from gsbridge.reality.world.bodies import TrueBody
from gsbridge.reality.world.hidden import Hidden
from gsbridge.robot.assembly import RobotFiles

STEP = 0.001
"""Time step, s."""

OBJECT, TABLE, PLATE = "object", "table", "plate"

_ARM_BITS, _STATIC_BITS, _OBJECT_BITS = (1, 0), (2, 1), (4, 3)
"""`contype`, `conaffinity`: the object collides with everything; the robot collides with table, plate and object, but not with
itself."""

_SLIPPERY = (0.01, 0.0, 0.0)
"""Friction of the object. MuJoCo uses the larger friction of two bodies in contact, so the other body sets the value."""

_HAND_FRICTION = 0.3
"""Sliding friction of the robot's metal and plastic."""

_STIFFNESS = (9000.0, 10000.0, 5000.0, 5000.0, 1200.0, 1000.0, 400.0)
_DAMPING = (350.0, 380.0, 160.0, 160.0, 30.0, 25.0, 9.0)
_ROTORS = (1.0, 1.0, 0.6, 0.6, 0.2, 0.15, 0.1)
"""Servo gains, N m/rad and N m s/rad, and rotor inertias reflected to the joint, kg m2. They are stiffer and heavier than a
simulation of this robot has to assume; the natural frequency is about 7 Hz at the arm's foot and 12 Hz at the wrist."""

_VISCOUS = (1.5, 1.5, 0.8, 0.8, 0.4, 0.4, 0.3)
"""Viscous friction of the arm's joints, N m s/rad."""

GRIP_STIFFNESS, _GRIP_DAMPING, _FINGER_ROTOR, _FINGER_FRICTION = 80.0, 1.6, 0.004, 0.02
"""Servo of the gripper's driver, N m/rad and N m s/rad; rotor, kg m2, and viscous friction, N m s/rad, of each finger joint."""

_RIGID = ((0.002, 1.0), (0.98, 0.999, 0.001, 0.5, 2.0))
"""`solref`, `solimp` of the finger coupling."""


@dataclass(frozen=True)
class Stand:
    """Poses of robot and plate in the world.

    Args:
        base_from_table: True pose of the table. [4, 4].
        plate: x, y of the plate's centre, table frame, m; None without a plate.
    """

    base_from_table: Array
    plate: tuple[float, float] | None = None


def build_model(
    robot: RobotFiles, stand: Stand, body: TrueBody | None, plate_pieces: list[Array], hidden: Hidden
) -> mujoco.MjModel:
    """Compile the model of a world, table frame.

    Args:
        robot: The robot, with the true pose of its camera.
        stand: Poses of table and plate.
        body: The true object; None for a bare table.
        plate_pieces: Corners of the plate's convex pieces, own frame, m; used when `stand.plate` is given. [N, 3] each.
        hidden: Hidden parameters.

    Returns:
        The model. Actuators: a position servo and a speed servo per arm joint, all positions first, then the gripper's driver.
    """
    spec = mujoco.MjSpec.from_file(str(robot.urdf))
    spec.modelname = "mirror"
    option = spec.option
    option.timestep = STEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    # A diverged state must be noticed; by default MuJoCo resets it without a report.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    _robot(spec, robot, stand, hidden)
    solref = (hidden.contact_time, 1.0)
    spec.worldbody.add_geom(
        name=TABLE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1], solref=solref, **_touch(_STATIC_BITS),
        friction=(hidden.friction_table, hidden.friction_spin, 0.0),
    )  # fmt: skip
    if stand.plate is not None:
        plate = spec.worldbody.add_body(name=PLATE, pos=[*stand.plate, 0.0])
        glaze = (hidden.friction_plate, hidden.friction_spin, 0.0)
        for index, points in enumerate(plate_pieces):
            _piece(spec, plate, f"{PLATE}_{index}", points, glaze, _STATIC_BITS, solref)
    if body is not None:
        free = spec.worldbody.add_body(name=OBJECT, mass=body.mass, ipos=body.centre, explicitinertial=True)
        tensor = body.inertia
        free.fullinertia = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        free.add_freejoint(name=OBJECT)
        for index, points in enumerate(body.pieces):
            _piece(spec, free, f"{OBJECT}_{index}", points, _SLIPPERY, _OBJECT_BITS, solref)
    return spec.compile()


def _touch(bits: tuple[int, int]) -> dict[str, int]:
    """Return the collision bits of a geom, and `condim` 4: its contacts resist sliding and spinning."""
    return {"contype": bits[0], "conaffinity": bits[1], "condim": 4}


def _piece(
    spec: Any,
    body: Any,
    name: str,
    points: Array,
    friction: tuple[float, ...],
    bits: tuple[int, int],
    solref: tuple[float, float],
) -> None:
    """Add one convex piece to a body."""
    spec.add_mesh(name=name, uservert=np.asarray(points, dtype=np.float64).ravel())
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, friction=friction, solref=solref, mass=0.0, **_touch(bits)
    )


def _robot(spec: Any, robot: RobotFiles, stand: Stand, hidden: Hidden) -> None:
    """Add to the robot, as read from its URDF, what the URDF cannot express."""
    record, arm = robot.record, tuple(robot.record["arm_joints"])
    table_from_base = np.linalg.inv(stand.base_from_table)
    base = spec.body(record["base"])
    base.pos, base.quat = table_from_base[:3, 3], quat_from_rotation(table_from_base[:3, :3])
    for body in spec.bodies:
        if body.name == "world":
            continue
        body.gravcomp = 1.0 + hidden.gravity_error
        pad = body.name in record["gripper"]["pads"]
        for geom in list(body.geoms):
            if geom.contype == 0:  # drawn only
                spec.delete(geom)
                continue
            rubber = pad and geom.type == mujoco.mjtGeom.mjGEOM_BOX
            geom.friction = (hidden.friction_pad if rubber else _HAND_FRICTION, hidden.friction_spin, 0.0)
            geom.contype, geom.conaffinity, geom.condim = *_ARM_BITS, 4
            geom.solref = (hidden.contact_time, 1.0)
    for index, name in enumerate(arm):
        joint = spec.joint(name)
        # Only MuJoCo's model has these offsets: planning and measuring use the nominal link dimensions.
        link = joint.parent
        link.pos = np.array(link.pos) + hidden.link_offset[3 * index : 3 * index + 3]
        joint.armature = _ROTORS[index] * hidden.inertia[index]
        joint.damping = _linear(_VISCOUS[index])
        joint.frictionloss = hidden.joint_friction * record["limits"][name]["effort"]
    for name in record["gripper"]["joints"]:
        joint = spec.joint(name)
        joint.armature, joint.damping = _FINGER_ROTOR, _linear(_FINGER_FRICTION)
    for coupling in spec.equalities:
        coupling.solref, coupling.solimp = _RIGID
    gains = [_STIFFNESS[k] * hidden.stiffness[k] for k in range(len(arm))]
    brakes = [_DAMPING[k] * hidden.damping[k] for k in range(len(arm))]
    # Two servos per joint instead of one: the second follows the set point's speed, so that damping does not hold the arm back.
    for name, gain in zip(arm, gains, strict=True):
        _servo(spec, name, gain, [0.0, -gain, 0.0], hidden.latency)
    for name, gain in zip(arm, brakes, strict=True):
        _servo(spec, name, gain, [0.0, 0.0, -gain], hidden.latency)
    _servo(spec, record["gripper"]["driver"], GRIP_STIFFNESS, [0.0, -GRIP_STIFFNESS, -_GRIP_DAMPING], hidden.latency)


def _linear(coefficient: float) -> Array:
    """Return damping proportional to speed as coefficients of MuJoCo's damping polynomial. [3]."""
    return np.array([coefficient, 0.0, 0.0])


def _servo(spec: Any, joint: str, gain: float, bias: list[float], latency: float) -> None:
    """Add an actuator with the torque `gain * command + bias . (1, angle, speed)`; its command is delayed by `latency`, s."""
    servo = spec.add_actuator(
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=joint,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
    )
    gains, biases = servo.gainprm.copy(), servo.biasprm.copy()
    gains[0], biases[:3] = gain, bias
    servo.gainprm, servo.biasprm = gains, biases
    if latency >= 0.5 * STEP:
        servo.delay = round(latency / STEP) * STEP
        servo.nsample = round(latency / STEP) + 1
