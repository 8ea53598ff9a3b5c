"""The mirror's physics: takes commands for the tool and returns the state of robot and object."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gsbridge.errors import InputError
from gsbridge.geometry import Array, quat_from_rotation, rotation_from_quat
from gsbridge.reality.mirror.backgrounds import make_plate
from gsbridge.reality.world.bodies import TrueBody, true_body
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.model import GRIP_STIFFNESS, OBJECT, PLATE, STEP, TABLE, Stand, build_model
from gsbridge.reality.world.pieces import plate_pieces
from gsbridge.robot.assembly import RobotFiles, check_rigid
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.reach import tool_down
from gsbridge.tasks.state import State, clearance
from gsbridge.tasks.world import CONTROL_HZ

logger = logging.getLogger("gsbridge")

_GRIP_SPEED = 0.15
"""Speed at which the pads are driven towards each other, m/s."""

_PLATE_DETAIL = 2.0
"""Vertex spacing of the mesh from which the plate's pieces are cut, as a multiple of the spacing in films."""

_SETTLE = 0.05
"""Time for the object to settle at the beginning of an episode, s."""

_DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
"""Warnings of a diverged state, which MuJoCo by default resets to the initial state before it goes on."""


class MirrorPhysics:
    """One robot, one table, one object; implements `gsbridge.tasks.world.World`. Table frame, SI units, quaternions wxyz.

    Args:
        robot: The robot's files.
        stand: Poses of table and plate.
        body: The true object; None for a bare table (`state` then raises an error).
        hidden: Hidden parameters.
        plate: Corners of the plate's convex pieces, own frame, m. [N, 3] each.

    Attributes:
        commanded_from: `base_from_table` with which commands become postures: the true one, until the caller sets the one that
            the registration found. [4, 4].
        refused: Number of commands that no posture of the arm reaches; the arm then goes to the nearest posture found.
    """

    def __init__(
        self,
        robot: RobotFiles,
        stand: Stand,
        body: TrueBody | None,
        hidden: Hidden,
        plate: list[Array] | None = None,
    ) -> None:
        # Without a handler, MuJoCo writes its warnings into a file in the current folder.
        mujoco.set_mju_user_warning(logger.warning)
        self.robot, self.stand, self.body, self.hidden = robot, stand, body, hidden
        self.commanded_from = stand.base_from_table
        self.dimensions = robot.dimensions
        self.kinematics = Kinematics.read(robot.urdf)
        self.model = model = build_model(robot, stand, body, plate or [], hidden)
        self.data = mujoco.MjData(model)
        self.limits = self.kinematics.arm_limits
        grip = robot.record["gripper"]
        arm = tuple(robot.record["arm_joints"])
        joints = [model.joint(name) for name in (*arm, grip["driver"])]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        self._fingers = {model.joint(name).qposadr[0]: factor for name, factor in grip["joints"].items()}
        knuckles = [name for name, factor in grip["joints"].items() if factor > 0]
        self._knuckles = np.array([model.joint(name).qposadr[0] for name in knuckles])
        self._links = {model.body(k).name: k for k in range(1, model.nbody)}
        self._rows = _sides(model, grip["pads"])
        self._pull = np.zeros(4)
        self.refused = 0
        self._period = round(1.0 / (CONTROL_HZ * STEP))
        # Joint positions at every physics step of this period, for pictures with an exposure time; kept only for those.
        self._trail: list[Array] = []
        self._remembers = hidden.exposure_time + hidden.readout > 0.0
        self._shade = mujoco.MjData(model)
        self._offset = np.append(hidden.encoder_offset, 0.0)
        self._rng, self._losses, self._delays = (np.random.default_rng(stream) for stream in range(3))
        self.place(self.kinematics.rest, self.dimensions.stroke)

    def reset(self, object_pose: Array, seed: int) -> None:
        """Begin an episode: see `World.reset`. The object is put at x, y (m), yaw (rad) [3] and settles before the first step.

        Raises:
            InputError: The pose is not three finite numbers, or the physics diverged.
        """
        pose = np.asarray(object_pose, dtype=np.float64)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise InputError("object pose", f"{object_pose} is no x, y, yaw", "Give three finite numbers")
        self._rng, self._losses, self._delays = (np.random.default_rng([seed, stream]) for stream in (1, 3, 4))
        self.refused = 0
        self.place(self.kinematics.rest, self.dimensions.stroke, pose)
        for _ in range(round(_SETTLE / STEP)):
            mujoco.mj_step(self.model, self.data)
        self.check_sound()
        mujoco.mj_forward(self.model, self.data)
        self._pull[:] = 0.0
        self._feel()

    def place(self, q: Array, aperture: float, object_pose: Array | None = None) -> None:
        """Put robot and object at given poses at once, at rest and with the servos holding; used for photos of chosen postures.

        Args:
            q: Arm joints as the encoders measure them, rad. [7].
            aperture: Distance between the pads, m.
            object_pose: x, y (m) and yaw (rad) on the table, or a full `table_from_object`, for example of an object in the
                hand; None puts the object out of sight. [3] or [4, 4].

        Raises:
            InputError: The pose is neither.
        """
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self._trail = []
        angle = float(self.dimensions.angle(aperture))
        # The caller gives encoder readings, so the encoders' offset is taken off.
        data.qpos[self._q[:-1]] = self.limits.clip(q) - self._offset[:-1]
        for address, factor in self._fingers.items():
            data.qpos[address] = factor * angle
        if self.body is not None:
            start = model.joint(OBJECT).qposadr[0]
            data.qpos[start : start + 7] = _free_joint((0.0, -3.0, 0.0) if object_pose is None else object_pose)
        self._point = np.append(self.limits.clip(q), aperture)
        self._goal = self._point.copy()
        self._control(self._point, np.zeros(len(self._point)))
        if self.hidden.latency >= 0.5 * STEP:
            for index, value in enumerate(data.ctrl):
                history = np.full((int(model.actuator_history[index, 0]), 1), value)
                mujoco.mj_initCtrlHistory(model, data, index, None, history)
        mujoco.mj_forward(model, data)

    def command(self, position: Array, yaw: float, aperture: float) -> None:
        """Set the target that `step` moves to and holds; a target out of reach is approached as far as possible, and counted.

        A command may be lost at random (`Hidden.lost_commands`); the caller is not told.

        Args:
            position: Tool point, table frame, m. [3].
            yaw: Turn of the tool about the vertical, 0 with the camera's side along the table's x, rad.
            aperture: Distance between the pads, m; cut to the gripper's stroke.

        Raises:
            InputError: The target is not finite.
        """
        position = np.asarray(position, dtype=np.float64)
        if position.shape != (3,) or not (np.isfinite(position).all() and np.isfinite(yaw) and np.isfinite(aperture)):
            raise InputError(
                "command", f"{position}, {yaw}, {aperture} is no finite target", "Check the policy's output for NaN"
            )
        if self.hidden.lost_commands > 0.0 and self._losses.uniform() < self.hidden.lost_commands:
            return
        found = self.kinematics.inverse(self.commanded_from @ tool_down(position, yaw), self._goal[:-1])
        self.refused += not found.converged
        self._goal = np.append(found.q, np.clip(aperture, 0.0, self.dimensions.stroke))

    def step(self) -> None:
        """Advance one control period: the set point moves evenly, no faster than joints and gripper allow.

        If the command is late (`Hidden.latency_jitter`), the set point waits that long and does not catch up afterwards. The
        gripper's set point may run ahead of the fingers only in the commanded direction, and only as far as the grip force
        needs. Otherwise pads that press on an object would let go late, after the set point has come back out of the object.

        Raises:
            InputError: The physics diverged.
        """
        seconds = self._period * STEP
        reach = _GRIP_SPEED * seconds
        angle = self.data.qpos[self._q[-1]]
        rate, opening = float(self.dimensions.aperture_rate(angle)), float(self.dimensions.aperture(angle))
        pressing = self.hidden.grip_force * rate**2 / GRIP_STIFFNESS + reach + _GRIP_SPEED * self.hidden.latency
        low = opening - pressing if self._goal[-1] < opening else opening
        high = opening + pressing if self._goal[-1] > opening else opening
        start = np.append(self._point[:-1], np.clip(self._point[-1], low, high))
        opening = start[-1] + np.clip(self._goal[-1] - start[-1], -reach, reach)
        self._point = np.append(self.limits.follow(start[:-1], self._goal[:-1], seconds), opening)
        speed = (self._point - start) / seconds
        late = self._lateness()
        self._point = self._point - speed * late * STEP
        self._pull[:] = 0.0
        self._trail = []
        for number in range(self._period):
            if self._remembers:
                self._trail.append(self.data.qpos.copy())
            gone = number + 1 - late
            self._control(start + speed * max(gone, 0) * STEP, speed * (gone > 0))
            mujoco.mj_step(self.model, self.data)
            self._feel()
        self.check_sound()
        self._pull /= self._period
        # Update the poses to the positions just reached; `mj_step` leaves the poses from the beginning of the step.
        mujoco.mj_kinematics(self.model, self.data)

    def check_sound(self) -> None:
        """Refuse to go on from a diverged state.

        Raises:
            InputError: The physics diverged since the last call of `place` or `reset`.
        """
        if any(self.data.warning[kind].number for kind in _DIVERGED):
            raise InputError(
                "the mirror", "its physics diverged", "Bring the world's hidden parameters nearer to those of an ordinary lab"
            )

    def _lateness(self) -> int:
        """Draw the number of physics steps by which this period's command is late."""
        if self.hidden.latency_jitter == 0.0:
            return 0
        return round(self._delays.uniform(0.0, self.hidden.latency_jitter) / STEP)

    def _control(self, point: Array, speed: Array) -> None:
        """Send a set point and its speed to the servos: arm joints, rad, as the encoders measure them, and aperture, m. [8]."""
        data, arm = self.data, len(point) - 1
        data.ctrl[:arm] = point[:-1] - self._offset[:-1]
        data.ctrl[arm : 2 * arm] = speed[:-1]
        data.ctrl[-1] = self.dimensions.angle(point[-1])
        # The torque at which the pads press with the set force grows with the lever arm of the finger.
        most = self.hidden.grip_force * float(self.dimensions.aperture_rate(data.qpos[self._q[-1]]))
        self.model.actuator_forcelimited[-1] = 1
        self.model.actuator_forcerange[-1] = -most, most

    def _feel(self) -> None:
        """Add this step's normal forces, N, to `_pull`, in the order of `_PAIRS`.

        The pairs are: object on left pad, object on right pad, robot on table or plate, object on table or plate.
        """
        contact = self.data.contact
        if not self.data.ncon:
            return
        active = contact.efc_address >= 0
        kinds = self._rows[contact.geom[active]]
        pairs = kinds[:, 0] | kinds[:, 1]
        # With elliptic cones the first entry of a contact is its normal force.
        force = self.data.efc_force[contact.efc_address[active]]
        for row, pair in enumerate(_PAIRS):
            self._pull[row] += force[(pairs & pair) == pair].sum()

    def _pose(self, body: int, data: mujoco.MjData | None = None) -> Array:
        """Return `table_from_body` of a body, in the current or another state of the simulation. [4, 4]."""
        out, data = np.eye(4), self.data if data is None else data
        out[:3, :3] = data.xmat[body].reshape(3, 3)
        out[:3, 3] = data.xpos[body]
        return out

    def state(self) -> State:
        """Return the true state: see `World.state`.

        Raises:
            InputError: The world has no object.
        """
        if self.body is None:
            raise InputError("mirror", "this world has no object, so no task can judge it", "Name an object")
        data, tool, body = self.data, self._links["tool"], self._links[OBJECT]
        start = self.model.joint(OBJECT).dofadr[0]
        quat = data.xquat[body]
        return State(
            tool_position=data.xpos[tool][None].copy(),
            tool_quat=data.xquat[tool][None].copy(),
            aperture=np.mean(self.dimensions.aperture(data.qpos[self._knuckles]), keepdims=True),
            pad_forces=self._pull[None, :2].copy(),
            object_position=data.xpos[body][None].copy(),
            object_quat=quat[None].copy(),
            object_velocity=data.qvel[None, start : start + 3].copy(),
            # MuJoCo gives the angular velocity of a free body in the body's axes.
            object_spin=(rotation_from_quat(quat) @ data.qvel[start + 3 : start + 6])[None],
            object_clearance=clearance(self.body.hull, data.xpos[body][None], quat[None]),
            robot_contact=self._pull[2:3].copy(),
            object_contact=self._pull[3:4].copy(),
        )

    def joints(self) -> tuple[Array, Array, Array]:
        """Return the robot's measurements, noise included: see `World.joints`."""
        noise = self._rng.standard_normal((3, len(self._q)))
        # Speed is measured as the difference of two angles, so its noise is the angle noise divided by the control period.
        speed_noise = self.hidden.encoder_noise * CONTROL_HZ
        return (
            self.data.qpos[self._q] + self._offset + self.hidden.encoder_noise * noise[0],
            self.data.qvel[self._v] + speed_noise * noise[1],
            self.data.qfrc_actuator[self._v] + self.hidden.torque_noise * noise[2],
        )

    def body_poses(self) -> Mapping[str, Array]:
        """Return `table_from_body` of the object, every link of the robot, and the plate where there is one. Each [4, 4]."""
        return {name: self._pose(body) for name, body in self._links.items()}

    def camera_pose(self) -> Array:
        """Return the true `cam_from_table` of the wrist camera. [4, 4]."""
        return np.linalg.inv(self._pose(self._links["camera"]))

    def moment(self, before: float) -> tuple[Mapping[str, Array], Array]:
        """Return `body_poses` and `camera_pose` at an earlier moment of the last control period, for pictures that take time.

        Args:
            before: Time before now, s. Before the first step of an episode, the current poses are returned.
        """
        if not self._trail:
            return self.body_poses(), self.camera_pose()
        back = int(np.clip(round(before / STEP), 0, len(self._trail)))
        self._shade.qpos[:] = self.data.qpos if back == 0 else self._trail[-back]
        mujoco.mj_kinematics(self.model, self._shade)
        poses = {name: self._pose(body, self._shade) for name, body in self._links.items()}
        return poses, np.linalg.inv(poses["camera"])


def _free_joint(pose: ArrayLike) -> Array:
    """Return position and quaternion of a body given by x, y, yaw on the table, or by a full pose. [3] or [4, 4] -> [7]."""
    pose = np.asarray(pose, dtype=np.float64)
    if pose.shape == (4, 4):
        pose = check_rigid(pose, "object pose")
        return np.concatenate([pose[:3, 3], quat_from_rotation(pose[:3, :3])])
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InputError("object pose", f"{pose} is no x, y, yaw", "Give three finite numbers, or a 4x4 matrix")
    x, y, yaw = pose
    return np.array([x, y, 0.0, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


_LEFT, _RIGHT, _ROBOT, _STATIC, _BODY = 1, 2, 4, 8, 16
_PAIRS = (_LEFT | _BODY, _RIGHT | _BODY, _ROBOT | _STATIC, _BODY | _STATIC)


def _sides(model: mujoco.MjModel, pads: list[str]) -> Array:
    """Return for each geom the kind of body it belongs to (`_LEFT`, `_RIGHT`, ...), as bits. [number of geoms]."""
    out = np.full(model.ngeom, _ROBOT)
    for index in range(model.ngeom):
        geom, body = model.geom(index), model.body(model.geom_bodyid[index]).name
        if geom.name == TABLE or body == PLATE:
            out[index] = _STATIC
        elif body == OBJECT:
            out[index] = _BODY
        elif body in pads:
            out[index] = _ROBOT | (_LEFT, _RIGHT)[pads.index(body)]
    return out


def build_physics(
    robot: RobotFiles,
    stand: Stand,
    name: str | None,
    hidden: Hidden,
    *,
    pieces: str | Path,
    seed: int,
) -> MirrorPhysics:
    """Build the mirror's physics with one of its objects.

    Args:
        robot: The robot's files.
        stand: Poses of table and plate.
        name: One of the mirror's objects, or None.
        hidden: Hidden parameters.
        pieces: Folder in which convex pieces are cached between runs.
        seed: Seed of the world's textures and shapes, as in its films.

    Raises:
        InputError: Unknown object.
    """
    body = None if name is None else true_body(name, seed, hidden.mass, pieces, hidden.object_com)
    plate = None if stand.plate is None else plate_pieces(make_plate(seed, _PLATE_DETAIL)[0])
    return MirrorPhysics(robot, stand, body, hidden, plate)
