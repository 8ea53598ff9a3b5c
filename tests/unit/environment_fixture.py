"""A world without physics for the tests of the environment: a hand that follows commands, a cube that it can carry."""

import numpy as np

from gsbridge.environment.controllers import Grip
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.robot.limits import Workspace
from gsbridge.robot.reach import tool_down
from gsbridge.tasks.state import State

EDGE = 0.058
FORCE = 40.0
CLOSING = 0.0075  # m per step, as the nominal gripper
FINGERTIP = 0.0325
PLATE = Plate(0.02, 0.285, 0.004)
GRIP = Grip((0.0, 0.0, 0.043), (0.0, np.pi / 2), EDGE, EDGE)


class HandWorld:
    """Kinematic `World`: the tool reaches its command `lag` steps later, the fingers travel at their speed.

    The cube is gripped when the fingers stop at its sides with the tool beside its middle; it then hangs on the tool, and falls
    to the table, or the plate, when they open. A tool that goes down on it from the side pushes nothing: it is counted in
    `crashes`.
    """

    def __init__(self, lag: int = 1, plate: Plate | None = None) -> None:
        self.lag, self.plate = lag, plate
        self.workspace = Workspace.around()
        self.broken = False
        self.reset(np.array([0.0, 0.265, 0.0]), 0)

    def reset(self, object_pose, seed):
        self.rng = np.random.default_rng(seed)
        self.tool, self.yaw, self.aperture = np.array([0.0, 0.265, 0.25]), 0.0, 0.14
        self.commands = [(self.tool, self.yaw, self.aperture)] * (self.lag + 1)
        self.cube, self.cube_yaw = np.array([*object_pose[:2], 0.0]), float(object_pose[2])
        self.held = None
        self.crashes = 0
        self.broken = False

    def command(self, position, yaw, aperture):
        assert np.isfinite([*position, yaw, aperture]).all()
        self.commands[-1] = (np.array(position), float(yaw), float(aperture))

    def ground(self):
        on_plate = self.plate is not None and np.hypot(*(self.cube[:2] - [self.plate.x, self.plate.y])) < 0.1
        return self.plate.height if on_plate else 0.0

    def step(self):
        self.commands = [*self.commands[1:], self.commands[-1]]
        before = self.tool
        self.tool, self.yaw, wanted = self.commands[0]
        self.aperture += np.clip(wanted - self.aperture, -CLOSING, CLOSING)
        if self.held is not None and wanted > EDGE + 0.002:
            self.held = None
        if self.held is None:
            self.cube[2] = self.ground()
        beside = np.hypot(*(self.tool - self.cube)[:2]) < 0.02 and abs(self.tool[2] - FINGERTIP - self.cube[2]) < 0.04
        turned = abs((self.yaw - self.cube_yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        if self.held is None and beside and self.aperture <= EDGE and wanted < EDGE and turned < 0.2:
            self.held = self.cube - self.tool
        fingertips = self.tool[2] - FINGERTIP - self.cube[2]
        aside = np.hypot(*(self.tool - self.cube)[:2])
        if self.held is None and fingertips < EDGE and 0.03 < aside < 0.08 and np.hypot(*(self.tool - before)[:2]) > 0.002:
            self.crashes += 1
        if self.held is not None:
            self.aperture = EDGE
            self.cube = self.tool + self.held
            self.cube[2] = max(self.cube[2], self.ground())

    def state(self):
        pressed = 0.0 if self.held is None else max(0.0, self.cube[2] - (self.tool + self.held)[2])
        half, half_tool = 0.5 * self.cube_yaw, 0.5 * self.yaw
        return State(
            tool_position=(self.tool * (np.nan if self.broken else 1.0))[None],
            # Half a turn about an axis in the table's plane: the tool points down.
            tool_quat=np.array([[0.0, np.cos(half_tool), np.sin(half_tool), 0.0]]),
            aperture=np.array([self.aperture]),
            pad_forces=np.full((1, 2), 0.0 if self.held is None else FORCE),
            object_position=self.cube[None].copy(),
            object_quat=np.array([[np.cos(half), 0.0, 0.0, np.sin(half)]]),
            object_velocity=np.zeros((1, 3)),
            object_spin=np.zeros((1, 3)),
            object_clearance=self.cube[2:].copy(),
            robot_contact=np.array([max(0.0, FINGERTIP - self.tool[2]) * 1e4]),
            object_contact=np.array([1.1 * (self.held is None) + 5e4 * pressed]),
        )

    def joints(self):
        return np.zeros(8), np.zeros(8), np.zeros(8)

    def body_poses(self):
        cube = np.eye(4)
        cube[:3, 3] = self.cube
        return {"object": cube, "tool": tool_down(self.tool, self.yaw)}

    def camera_pose(self):
        return np.linalg.inv(tool_down(self.tool + np.array([0.08, 0.0, 0.2]), self.yaw))

    def image(self, size):
        """Something that changes with the world, and with its seed."""
        ramp = np.add.outer(np.arange(size), 2 * np.arange(size))[..., None] + 1000 * np.array([*self.tool[:2], self.cube[2]])
        return ((ramp + self.rng.integers(0, 4, 3)) % 256).astype(np.uint8)


def hand_environment(lag: int = 1, **settings) -> PickEnvironment:
    """An environment on it that sees with the world's own camera."""
    chosen = EnvironmentSettings(**{"image_size": 64, **settings})
    return PickEnvironment(HandWorld(lag, chosen.plate), chosen)
