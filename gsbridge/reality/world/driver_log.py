"""Log of the driver of the mirror's arm: one row per cycle of its control loop, with the noise of its sensors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gsbridge.geometry import Array
from gsbridge.reality.mirror.backgrounds import PLATE_CENTRE_M, make_plate
from gsbridge.reality.world.bodies import true_body
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.model import STEP, Stand
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.reality.world.pieces import plate_pieces
from gsbridge.tasks.world import CONTROL_HZ

_PLATE_DETAIL = 2.0
"""Vertex spacing of the mesh from which the plate's pieces are cut, as a multiple of the spacing in films."""


WAIT = 0.5
"""Time for which the arm is logged at rest before an episode, s."""


@dataclass(frozen=True)
class DriverLog:
    """The log of one episode, with T rows and N arm joints.

    Args:
        time: Times of the rows, s; the episode begins at `WAIT`. [T].
        command: Set points sent to the joint controllers, rad. [T, N].
        command_velocity: Speeds sent with the commands, rad/s. [T, N].
        position: Measured angles, rad. [T, N].
        velocity: Measured speeds, rad/s. [T, N].
        effort: Measured motor torques, including gravity compensation, N m. [T, N].
    """

    time: Array
    command: Array
    command_velocity: Array
    position: Array
    velocity: Array
    effort: Array


class LoggedPhysics(MirrorPhysics):
    """The mirror's physics with a log. The motion is the same as without it: the log's noise has its own random stream."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self._logged: list[Array] = []
        self._sent: Array | None = None
        super().__init__(*args, **options)

    def reset(self, object_pose: ArrayLike, seed: int) -> None:
        """Begin an episode with the object at x, y (m), yaw (rad) [3].

        The log starts `WAIT` s earlier, while the arm waits, so that delayed commands have a history at the episode's start.
        """
        self.place(self.kinematics.rest, self.dimensions.stroke)
        still = self._point.copy()
        self._logged = []
        for _ in range(round(WAIT / STEP)):
            self._control(still, np.zeros_like(still))
            mujoco.mj_step(self.model, self.data)
            self._feel()
        self.check_sound()
        waited, self._logged, self._sent = self._logged, [], None
        super().reset(np.asarray(object_pose), seed)
        self._grain = np.random.default_rng([seed, 2])
        self._logged, self._sent = waited, None

    def log(self) -> DriverLog:
        """Return the log of the episode so far. Call this once per episode: another call draws other noise."""
        arm = len(self._q) - 1
        command, speed, position, velocity, effort = np.array(self._logged).reshape(-1, 5, arm).transpose(1, 0, 2)
        noise = self._grain.standard_normal((3, *position.shape))
        return DriverLog(
            STEP * np.arange(len(command)),
            command,
            speed,
            position + self._offset[:-1] + self.hidden.encoder_noise * noise[0],
            # The speed that the driver reports has the same noise as the one from `joints`.
            velocity + self.hidden.encoder_noise * CONTROL_HZ * noise[1],
            effort + self.hidden.torque_noise * noise[2],
        )

    def _control(self, point: Array, speed: Array) -> None:
        """Send a set point, and keep it for the log together with the state at that time."""
        super()._control(point, speed)
        arm = len(point) - 1
        state = self.data.qpos[self._q[:arm]], self.data.qvel[self._v[:arm]]
        self._sent = np.stack([point[:arm], speed[:arm], *state])

    def _feel(self) -> None:
        """Complete the log's row with the torques, which after a step are still those at its beginning."""
        super()._feel()
        if self._sent is not None:
            joints = self._v[:-1]
            torque = self.data.qfrc_actuator[joints] + self.data.qfrc_gravcomp[joints]
            self._logged.append(np.concatenate([self._sent, torque[None]]))
            self._sent = None


def logged_physics(setting: Setting, hidden: Hidden, *, pieces: str | Path) -> LoggedPhysics:
    """Build the mirror's physics with a log of the driver, and without a camera.

    Args:
        setting: Object and background in the room.
        hidden: Hidden parameters.
        pieces: Folder in which convex pieces are cached between runs.

    Raises:
        InputError: Unknown object.
    """
    with TemporaryDirectory() as folder:
        robot = true_robot(Path(folder) / "robot", hidden)
        plated = setting.background == "plate"
        stand = Stand(np.asarray(true_base_from_table(hidden)), PLATE_CENTRE_M if plated else None)
        body = (
            None if setting.object is None else true_body(setting.object, setting.seed, hidden.mass, pieces, hidden.object_com)
        )
        plate = plate_pieces(make_plate(setting.seed, _PLATE_DETAIL)[0]) if plated else None
        return LoggedPhysics(robot, stand, body, hidden, plate)
