"""The bodies of one simulated world in PyBullet, with every coefficient set from the model. Every world has its own client."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from gsbridge.asset.bullet import load_body, matrix_from_bullet
from gsbridge.asset.bundle import Asset
from gsbridge.errors import InputError
from gsbridge.geometry import Array, quat_from_rotation
from gsbridge.meshes import read_mesh
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.fused import Load, fused_description
from gsbridge.sim.item_setup import ItemSetup
from gsbridge.sim.model import Model, Surface

TABLE_SIZE = (0.90, 1.20, 0.05)
"""Size of the table's slab, x, y, thickness, m; its top is z = 0."""

SOLVER_ITERATIONS = 30
"""Largest number of solver iterations. Free motion converges in a few; a gripped object never does, since Bullet does not
start a step from the last one's solution. The time of a step grows in proportion. The residual that is left lets a gripped
object creep; the friction anchors of `Engine._set_contacts` bring it back. Without them an object slips in the hand while it is
lifted, and with 20 iterations a cube whose faces are not quite parallel slips in spite of them."""

_FIXED, _MOVING = (2, ~2), (1, -1)
"""Bullet's own collision groups and their masks: bodies that do not move collide only with bodies that do."""

_RIGID = 1e18
"""Stiffness of a rigid body, N/m: Bullet's own for bodies without a stated stiffness."""

_GEAR_FORCE = 1e4
"""Torque the fingers' coupling may carry, N m: practically rigid."""


@dataclass(frozen=True)
class Item:
    """The object a world handles.

    Args:
        urdf: One link, body frame.
        points: Vertices of its convex hulls, body frame, m. [P, 3].
        width: How far two fingers must open to take it, m: over its narrowest side, or over the wall of a vessel.
    """

    urdf: Path
    points: Array
    width: float

    @classmethod
    def of(cls, asset: Asset, source: str | Path = "object") -> Item:
        """The object of an asset.

        Raises:
            InputError: The asset is a background.
        """
        if asset.properties is None:
            raise InputError(source, "this asset is a background, no object", "Name an object's asset")
        width = asset.width if asset.rim is None else asset.rim.thickness
        return cls(asset.urdf, np.concatenate([read_mesh(path).vertices for path in asset.hulls]), width)


class Engine:
    """Bodies and constraints, loaded once. An episode begins with `rewind`, `place` and, last of all, `forget`.

    Args:
        robot: The robot's files.
        item: The object.
        model: The simulation model.
        table_from_base: Pose of the robot's base in the table frame. [4, 4].
        centre: Middle of the table's slab, m. [2].
        plate: URDF of a static background, or None.
        table_from_plate: Pose of the plate. [4, 4].
        q: Arm and gripper driver at the start. [8].
        setup: The object with the model's effects.
        loads: Changes of the mass properties of the link that each arm joint moves, by joint.

    Raises:
        InputError: A file cannot be loaded.

    Attributes:
        measured: Angles and speeds of the arm and the gripper's driver, as of the last `measure`. [2, 8].
    """

    advance: Callable[[], None]
    """Play one step of physics."""

    def __init__(
        self,
        robot: RobotFiles,
        item: Item,
        model: Model,
        table_from_base: Array,
        centre: tuple[float, float],
        plate: Path | None,
        table_from_plate: Array,
        q: Array,
        setup: ItemSetup,
        loads: Mapping[str, Sequence[Load]],
    ) -> None:
        self.client = client = BulletClient(pybullet.DIRECT)
        client.setGravity(0.0, 0.0, -setup.figures["gravity"])
        client.setPhysicsEngineParameter(
            fixedTimeStep=model.time_step,
            numSubSteps=0,
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
            restitutionVelocityThreshold=0.05,
            # Square of the change per iteration below which a row counts as converged: 1 mm/s, 1 mrad/s.
            solverResidualThreshold=1e-6,
        )
        length, width, thickness = TABLE_SIZE
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[length / 2, width / 2, thickness / 2])
        top = setup.table_pose()
        self.table = client.createMultiBody(
            0.0,
            shape,
            basePosition=(top @ [*centre, -thickness / 2, 1.0])[:3].tolist(),
            baseOrientation=np.roll(quat_from_rotation(top[:3, :3]), -1).tolist(),
            useMaximalCoordinates=True,
        )
        self.plate = None if plate is None else load_body(client, plate, table_from_plate, static=True)
        self._load_robot(robot, table_from_base, q, loads)
        # As a single body the object needs no multibody algebra, and its contacts with the table cost a fraction.
        self.item = self._load_item(item, setup)
        # The object was loaded at the origin, so this is the pose of its inertial frame, in which Bullet reports poses.
        self.body_from_inertial = matrix_from_bullet(*client.getBasePositionAndOrientation(self.item))
        self.inertial_from_body = np.linalg.inv(self.body_from_inertial)
        self._touching = [(self.table, -1, True)]
        self._touching += [] if self.plate is None else [(self.plate, -1, True)]
        self._touching += [(self.robot, -1, True), *((self.robot, link, False) for link in self.links.values())]
        self._touching += [(self.item, -1, False)]
        self._set_contacts(model, setup)
        self._bind()
        if setup.pushes:
            plain: Callable[[], None] = self.advance
            self.advance = partial(self._push_and_advance, setup, model.time_step, plain)

    def close(self) -> None:
        """Release the engine; the world cannot be used afterwards."""
        self.client.disconnect()

    def _load_item(self, item: Item, setup: ItemSetup) -> int:
        """Load the object as a single body, with its centre of mass where the setup has it."""
        description = setup.description(item.urdf)
        if description is None:
            return load_body(self.client, item.urdf, single=True)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "body.urdf"
            path.write_text(description, encoding="utf-8")
            return load_body(self.client, path, single=True)

    def _push_and_advance(self, setup: ItemSetup, step: float, advance: Callable[[], None]) -> None:
        """Play one physics step with a steady force and losses in the air, for which Bullet has no parameters."""
        velocity, spin = (np.array(row) for row in self._item_velocity(self.item))
        pushed = setup.pushed(velocity, spin, self.item_mass, step)
        self.client.resetBaseVelocity(self.item, *(row.tolist() for row in pushed))
        advance()

    def _load_robot(self, robot: RobotFiles, table_from_base: Array, q: Array, loads: Mapping[str, Sequence[Load]]) -> None:
        """Load the robot, switch off all motors and losses of the engine, and couple the fingers."""
        client, record = self.client, robot.record
        try:
            with TemporaryDirectory() as folder:
                description = Path(folder) / "fused.urdf"
                description.write_text(fused_description(robot.urdf, loads), encoding="utf-8")
                self.robot = client.loadURDF(
                    str(description),
                    basePosition=table_from_base[:3, 3].tolist(),
                    baseOrientation=np.roll(quat_from_rotation(table_from_base[:3, :3]), -1).tolist(),
                    useFixedBase=True,
                    flags=client.URDF_USE_INERTIA_FROM_FILE,
                )
        except pybullet.error as error:
            raise InputError(robot.urdf, f"PyBullet cannot load the robot ({error})", "Build the robot again") from error
        information = [client.getJointInfo(self.robot, number) for number in range(client.getNumJoints(self.robot))]
        joints = {item[1].decode(): item[0] for item in information}
        self.links = {item[12].decode(): item[0] for item in information}
        coupled, driver = record["gripper"]["joints"], record["gripper"]["driver"]
        for number in joints.values():
            # A velocity motor is on by default and would act as friction.
            client.setJointMotorControl2(self.robot, number, client.VELOCITY_CONTROL, force=0.0)
            client.changeDynamics(self.robot, number, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
        client.changeDynamics(self.robot, -1, linearDamping=0.0, angularDamping=0.0)
        for name, multiplier in coupled.items():
            if name != driver:
                gear = client.createConstraint(
                    self.robot, joints[driver], self.robot, joints[name], client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
                )
                client.changeConstraint(gear, gearRatio=-multiplier, maxForce=_GEAR_FORCE, erp=1.0)
        values = {**dict(zip(record["arm_joints"], q[:-1], strict=True)), **{name: m * q[-1] for name, m in coupled.items()}}
        self._home = {joints[name]: float(value) for name, value in values.items()}
        knuckles = [name for name, multiplier in coupled.items() if multiplier > 0]
        self.measured_joints = [joints[name] for name in (*record["arm_joints"], driver)]
        self.driven_joints = [joints[name] for name in (*record["arm_joints"], *knuckles)]
        self.knuckles = len(knuckles)
        self.pads = tuple(self.links[name] for name in record["gripper"]["pads"])

    def _set_contacts(self, model: Model, setup: ItemSetup) -> None:
        """Set all coefficients. Bullet multiplies friction and restitution of two bodies, so the object's are 1."""
        client = self.client
        table, f = setup.table(model), setup.figures
        # Between two single bodies Bullet applies spinning friction only if rolling friction is positive.
        self._set_surface(self.table, -1, replace(table, rolling_friction=max(table.rolling_friction, 1e-9)))
        if self.plate is not None:
            self._set_surface(self.plate, -1, model.contact.plate)
        for link in (-1, *self.links.values()):
            self._set_surface(self.robot, link, model.contact.gripper)
        for pad in self.pads:
            # The anchor pulls a sticking contact back to where it began, within Coulomb's cone; without it, the solver's
            # residuals add up to slip. Only the pads have it: an object that slides on the table must not be held.
            client.changeDynamics(self.robot, pad, frictionAnchor=True)
        if setup.soft:
            self._soften_table(model, setup)
        self._set_surface(self.item, -1, Surface(1.0, 0.0, 0.0, 1.0))
        mass, _, inertia, *_ = client.getDynamicsInfo(self.item, -1)
        self.item_mass = mass * f["mass"]
        client.changeDynamics(
            self.item,
            -1,
            mass=self.item_mass,
            localInertiaDiagonal=[f["mass"] * f["inertia"] * value for value in inertia],
            # Bullet's damping is the share of the speed that is lost in a second.
            linearDamping=-np.expm1(-model.object.linear_damping),
            angularDamping=-np.expm1(-model.object.angular_damping),
            contactStiffness=model.contact.stiffness,
            contactDamping=0.0 if setup.soft else model.contact.damping,
            # By default Bullet brakes a body before it touches, by an amount that depends on where the last step ended, which
            # would make restitution a matter of chance.
            contactProcessingThreshold=0.0,
            activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
        )

    def _soften_table(self, model: Model, setup: ItemSetup) -> None:
        """Give the table a compliance and a damping of its own.

        Bullet adds up the compliances and the dampings of two bodies in contact. The object's damper, stiff beside the
        table's, would keep the table from giving way. So the object's damping moves to all other bodies that it touches, and
        the table gets the damping of both contacts in series.
        """
        own, soft = 1.0 / model.contact.stiffness, setup.figures["compliance"]
        damping = (model.contact.damping * own**2 + setup.figures["contact_damping"] * soft**2) / (own + soft) ** 2
        # Bullet takes the spring's force at the end of a step, which damps by stiffness times step; this is subtracted.
        damping = max(damping - model.time_step / (own + soft), 0.0)
        others = [] if self.plate is None else [(self.plate, -1)]
        for body, link in [*others, *((self.robot, link) for link in (-1, *self.links.values()))]:
            self.client.changeDynamics(body, link, contactStiffness=_RIGID, contactDamping=model.contact.damping)
        self.client.changeDynamics(self.table, -1, contactStiffness=1.0 / soft, contactDamping=damping)

    def _set_surface(self, body: int, link: int, surface: Surface) -> None:
        """Set the coefficients of one link. Bullet multiplies rolling and spinning friction by the other body's friction."""
        self.client.changeDynamics(
            body,
            link,
            lateralFriction=surface.friction,
            rollingFriction=surface.rolling_friction,
            spinningFriction=surface.spinning_friction,
            restitution=surface.restitution,
        )

    def _bind(self) -> None:
        """Look up the calls of the control loop once: the client's own look-up costs as much as the call."""
        client = self.client
        # The module's own functions take the client's number by position, which is faster than by name.
        self._number = client._client
        self._joint_states = partial(pybullet.getJointStates, self.robot, self.measured_joints, self._number)
        self.measured = np.zeros((2, len(self.measured_joints)))
        self._write = partial(Struct(f"{self.measured.size}d").pack_into, self.measured.data.cast("B"), 0)
        self._set_torques = pybullet.setJointMotorControlArray
        self.advance = partial(pybullet.stepSimulation, self._number)
        self._contacts = client.getContactPoints
        self._item_pose, self._item_velocity = client.getBasePositionAndOrientation, client.getBaseVelocity
        self._torque_mode = client.TORQUE_CONTROL

    def rewind(self) -> None:
        """Put the robot in its rest posture, at rest."""
        for joint, angle in self._home.items():
            self.client.resetJointState(self.robot, joint, angle)

    def forget(self) -> None:
        """Clear the contacts of all bodies, once all of them are at their start poses.

        Bullet keeps pairs, their contacts and enlarged bounding boxes from step to step; `restoreState` clears none of this.
        An object that starts close to where it was, or in the hand, would fall differently than in a new world.
        """
        # Setting a collision filter, even to its present value, makes Bullet register the body anew.
        for body, link, fixed in self._touching:
            self.client.setCollisionFilterGroupMask(body, link, *(_FIXED if fixed else _MOVING))

    def place(self, table_from_item: Array) -> None:
        """Put the object, at rest, at a pose of its body frame; its old contacts stay until `forget`. [4, 4]."""
        pose = table_from_item @ self.body_from_inertial
        quat = np.roll(quat_from_rotation(pose[:3, :3]), -1)
        self.client.resetBasePositionAndOrientation(self.item, pose[:3, 3].tolist(), quat.tolist())
        self.client.resetBaseVelocity(self.item, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])

    def overlap(self) -> float:
        """Deepest penetration of the object into table or plate, m, 0 without any."""
        depth = 0.0
        for body in (self.table, self.plate):
            if body is not None:
                points = self.client.getClosestPoints(self.item, body, 0.0)
                depth = max(depth, *(-point[8] for point in points), 0.0) if points else depth
        return depth

    def measure(self) -> None:
        """Bring `measured` up to date."""
        # Unpacked one by one and written by `struct`: this runs in every physics step; a loop is slower, and numpy slowest.
        (
            (a, va, _, _),
            (b, vb, _, _),
            (c, vc, _, _),
            (d, vd, _, _),
            (e, ve, _, _),
            (f, vf, _, _),
            (g, vg, _, _),
            (h, vh, _, _),
        ) = self._joint_states()
        self._write(a, b, c, d, e, f, g, h, va, vb, vc, vd, ve, vf, vg, vh)

    def drive(self, torques: Array) -> None:
        """Apply the torques of the arm, and that of the gripper's driver, shared evenly between the knuckles, N m. [8]."""
        forces = torques.tolist()
        forces += [forces.pop() / self.knuckles] * self.knuckles
        mode, number = self._torque_mode, self._number
        self._set_torques(self.robot, self.driven_joints, mode, forces=forces, physicsClientId=number)

    def contact_forces(self) -> tuple[float, float, float, float]:
        """Normal forces, N: left pad and right pad on the object, robot on table and plate, object on table and plate."""
        left = right = resting = touching = 0.0
        item, robot, pads = self.item, self.robot, self.pads
        for _, a, b, link_a, link_b, _, _, _, _, force, *_ in self._contacts():
            if item in (a, b):
                body, link = (b, link_b) if a == item else (a, link_a)
                if body != robot:
                    resting += force
                elif link == pads[0]:
                    left += force
                elif link == pads[1]:
                    right += force
            elif robot in (a, b):
                touching += force
        return left, right, touching, resting

    def item_motion(self) -> Array:
        """Position (3) and quaternion xyzw (4) of the object's inertial frame, velocity (3) of its centre, spin (3). [13]."""
        position, quat = self._item_pose(self.item)
        velocity, spin = self._item_velocity(self.item)
        return np.array((*position, *quat, *velocity, *spin))
