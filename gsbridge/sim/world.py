"""The simulated world, a `gsbridge.tasks.world.World`: robot, table, plate and one object, stepped by control periods."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles, check_rigid
from gsbridge.robot.chain import place_tool_down
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.limits import Workspace
from gsbridge.robot.nominal import base_from_table as nominal_table
from gsbridge.robot.reach import require_reach
from gsbridge.sim.controller import Controller
from gsbridge.sim.engine import Engine, Item
from gsbridge.sim.item_setup import ItemSetup
from gsbridge.sim.model import Model
from gsbridge.sim.observe import object_state, rigid_inverse, state_row
from gsbridge.tasks.state import ROW, State

CONTACT_SAMPLES = 5
"""Times per control period at which contact forces are read; the state holds their mean."""

_LATENCY = 5
"""Separates the random stream of the dead time from those of other draws that use the episode's seed."""

SETTLE_SECONDS = 0.2
"""Time that the object has to settle after it was set down, while the arm holds still, s."""


class SimWorld:
    """PyBullet world. Table frame; see `gsbridge.tasks.world.World` for the calls that all worlds share.

    Args:
        robot: The robot's files.
        item: The object.
        model: The simulation model.
        base_from_table: Pose of the table in the base frame, from the registration; None for the nominal one. [4, 4].
        workspace: Room in which the tool may be commanded, None for the default; the arm must reach all of it.
        plate: URDF of the static background with the plate, or None for the bare table.
        table_from_plate: Pose of the plate; None for the identity. [4, 4].
        latency: Longest dead time of commands beyond the model's, s; each episode draws its own, from 0 up to it.

    Raises:
        InputError: The object does not fit the gripper, the workspace is out of reach, or a file cannot be loaded.

    Attributes:
        refused: Commands that inverse kinematics could not reach and that were ignored, in this episode.
    """

    def __init__(
        self,
        robot: RobotFiles,
        item: Item,
        model: Model,
        *,
        base_from_table: Array | None = None,
        workspace: Workspace | None = None,
        plate: Path | None = None,
        table_from_plate: Array | None = None,
        latency: float = 0.0,
    ) -> None:
        self.model, self.item, self.workspace, self.latency = model, item, workspace or Workspace.around(), latency
        self.base_from_table = check_rigid(nominal_table() if base_from_table is None else base_from_table, "base_from_table")
        self.table_from_base = np.linalg.inv(self.base_from_table)
        self.dimensions = robot.dimensions
        self.dimensions.check_object(item.width, str(item.urdf))
        self.kinematics = Kinematics.read(robot.urdf, robot.record["rest_posture"])
        require_reach(self.kinematics, self.base_from_table, self.workspace, "base_from_table")
        setup = ItemSetup(model)
        down = self.base_from_table[:3, :3] @ [0.0, 0.0, -setup.figures["gravity"]]
        self.controller = Controller(robot, self.kinematics, model, down)
        self._links = self.kinematics.tree.links
        self._node = {name: k for k, name in enumerate(self._links)}
        self._home = np.append(self.kinematics.rest, self.dimensions.open_angle)
        centre = 0.5 * (np.array(self.workspace.lower) + self.workspace.upper)
        self.engine = Engine(
            robot, item, model, self.table_from_base, (float(centre[0]), float(centre[1])), plate,
            check_rigid(np.eye(4) if table_from_plate is None else table_from_plate, "table_from_plate"), self._home,
            setup, self.controller.setup.loads,
        )  # fmt: skip
        self._measured = self.engine.measured
        self.reset(np.array([*centre[:2], 0.0]), 0)

    def close(self) -> None:
        """Release the physics engine."""
        self.engine.close()

    def __enter__(self) -> SimWorld:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def reset(self, object_pose: Array, seed: int) -> None:
        """Begin an episode with the object at x, y, yaw [3]; see `World.reset`. `seed` seeds all that is random in it."""
        pose = np.asarray(object_pose, dtype=np.float64)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise InputError("object pose", "it is no finite x, y, yaw", "Give metres and radians")
        self.refused = 0
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        placed = np.eye(4)
        placed[:2, :2] = [[cosine, -sine], [sine, cosine]]
        placed[:2, 3] = pose[:2]
        self.engine.rewind()
        self.engine.place(placed)
        # On a plate or an uneven background, raise the object until it just touches.
        for _ in range(4):
            depth = self.engine.overlap()
            if depth <= 0.0:
                break
            placed[2, 3] += depth
            self.engine.place(placed)
        self.engine.forget()
        later = float(np.random.default_rng([seed, _LATENCY]).uniform(0.0, self.latency))
        self.controller.reset(self.kinematics.rest, self.dimensions.stroke, later)
        self.engine.measure()
        for _ in range(max(1, round(SETTLE_SECONDS / self.model.period))):
            self.step()

    def push(self, velocity: Array, spin: Array) -> None:
        """Give the object a velocity of its centre of mass and a spin, for experiments. [3] m/s, [3] rad/s."""
        self.engine.client.resetBaseVelocity(self.engine.item, np.asarray(velocity).tolist(), np.asarray(spin).tolist())
        self._look()

    def place(self, table_from_object: Array) -> None:
        """Put the object somewhere, at rest, for experiments. [4, 4]."""
        self.engine.place(check_rigid(table_from_object, "object pose"))
        self._look()

    def command(self, position: Array, yaw: float, aperture: float) -> None:
        """Set the target that `step` moves to and holds; a target out of reach is ignored and counted.

        Args:
            position: Tool point, table frame, m. [3].
            yaw: Turn of the tool about the vertical, 0 with the camera's side along the table's x, rad.
            aperture: Distance of the pads, m.

        Raises:
            InputError: The target is not finite.
        """
        point = np.asarray(position, dtype=np.float64).tolist()
        if np.shape(point) != (3,) or not all(map(isfinite, (*point, yaw, aperture))):
            raise InputError("command", "the target is not finite", "Check the policy's output for NaN")
        target = np.empty((4, 4))
        place_tool_down(self.base_from_table, point[0], point[1], point[2], float(yaw), target)
        found = self.kinematics.inverse(target, self.controller.goal[:-1])
        if found.converged:
            self.controller.aim(found.q, aperture)
        else:
            self.refused += 1

    def step(self) -> None:
        """Advance one control period: torques and physics at 1 kHz, contact forces read a few times."""
        engine, controller, measured = self.engine, self.controller, self._measured
        substeps = self.model.substeps
        every = max(1, substeps // CONTACT_SAMPLES)
        controller.begin_period(float(self.dimensions.aperture(measured[0, -1])))
        forces = [0.0] * 4
        samples = 0
        # Looked up once: a step takes only some 20 microseconds, so that the loop's own overhead counts.
        measure, law, drive, advance = engine.measure, controller.substep, engine.drive, engine.advance
        torques = controller.torques[0]
        for number in range(substeps):
            law(number, measured)
            drive(torques)
            advance()
            measure()
            if (number + 1) % every == 0:
                forces = [sum(pair) for pair in zip(forces, engine.contact_forces(), strict=True)]
                samples += 1
        self._forces = np.array([force / samples for force in forces])
        self._look()

    def _look(self) -> None:
        """Update poses, and the object's velocity, at the end of a control period."""
        self._poses = self.controller.place_links(self._measured, self.table_from_base)
        motion = self.engine.item_motion()
        self._object, self._velocity, self._spin = np.empty((4, 4)), np.empty(3), motion[10:]
        self._clearance = object_state(motion, self.engine.inertial_from_body, self.item.points, self._object, self._velocity)

    def state(self) -> State:
        """The world as the tasks see it; see the protocol."""
        row, tool = np.empty(ROW), self._poses[self._node[self.kinematics.tip]]
        opening = float(self.dimensions.aperture(self._measured[0, -1]))
        state_row(tool, opening, self._forces, self._object, self._velocity, self._spin, self._clearance, row)
        return State.of_row(row)

    def joints(self) -> tuple[Array, Array, Array]:
        """Angles, speeds and motor torques; see the protocol."""
        angles, speeds = self.controller.sense(self._measured)
        return angles.copy(), speeds.copy(), self.controller.torques[1].copy()

    def measured_tool(self) -> Array | None:
        """Return `table_from_tool` by the angles that the encoders report, [4, 4]; None where these are the true ones."""
        if not self.controller.misread:
            return None
        poses = self.controller.place_links(self.controller.sense(self._measured), self.table_from_base)
        return np.array(poses[self._node[self.kinematics.tip]])

    def body_poses(self) -> dict[str, Array]:
        """Poses of the object and of the robot's links; see the protocol."""
        return {"object": self._object.copy(), **dict(zip(self._links, self._poses.copy(), strict=True))}

    def camera_pose(self) -> Array:
        """Pose of the wrist camera; see the protocol."""
        out = np.empty((4, 4))
        rigid_inverse(self._poses[self._node["camera"]], out)
        return out
