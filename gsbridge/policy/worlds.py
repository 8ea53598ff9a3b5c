"""Worlds driven like arms: the simulated one and the mirror behind `RobotDriver`.

They measure joint angles and know the table by its registration, as a real arm does; the mirror's encoders have their noise.
Privileged states serve one purpose only: the referee in place of a person.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from gymnasium.utils import seeding

from gsbridge.environment.build import StageFiles, build_renderer, build_world, camera_response
from gsbridge.environment.env import DrawnEye, Eye, OwnEye, draw_episode, judge
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.geometry import Array
from gsbridge.policy.driver import Reading, tool_pose
from gsbridge.policy.export import CONTROL_HZ
from gsbridge.policy.robot_trials import Verdict
from gsbridge.reality.world.camera import Quality, Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.registration.result import Registration
from gsbridge.robot.gripper import GripperDimensions
from gsbridge.robot.kinematics import Kinematics
from gsbridge.tasks.outcome import Progress
from gsbridge.tasks.world import World


class WorldDriver:
    """Any world with joints, behind `RobotDriver`; its clock steps it.

    Args:
        world: The world.
        eye: Camera of the world, with the policy's intrinsics.
        kinematics: Kinematics of the world's robot.
        dimensions: Dimensions of the robot's gripper.
        commanded_from: `base_from_table` by which the world turns commands into postures. [4, 4].
        settings: Task and size of the pictures.
        control_hz: Steps of the world per second.
    """

    def __init__(
        self,
        world: World,
        eye: Eye,
        kinematics: Kinematics,
        dimensions: GripperDimensions,
        commanded_from: Array,
        settings: EnvironmentSettings,
        control_hz: float = CONTROL_HZ,
    ) -> None:
        self.world, self.eye, self.kinematics, self.dimensions = world, eye, kinematics, dimensions
        self.camera = wrist_camera(eye.size)
        self.clock, self.referee = WorldClock(world, 1.0 / control_hz), Referee(world, settings)
        self._table_from_base = np.linalg.inv(commanded_from)
        self._start: tuple[Array, int] = np.array([0.0, 0.265, 0.0]), 0

    def prepare(self, pose: Array, seed: int) -> None:
        """Choose the next episode: x, y, yaw of the object, [3], and the seed of what is random."""
        self._start = np.array(pose, dtype=np.float64), int(seed)

    def rest(self) -> None:
        """Begin the episode: see `RobotDriver`."""
        self.world.reset(*self._start)
        self.eye.begin(self._start[1])
        self.referee.begin()

    def measure(self) -> Reading:
        """See `RobotDriver`."""
        joints = self.world.joints()[0]
        return Reading(tool_pose(self.kinematics, joints), float(self.dimensions.aperture(joints[-1])))

    def image(self) -> Array:
        """See `RobotDriver`."""
        return self.eye.look(self.world)

    def command(self, base_from_tool: Array, aperture: float) -> bool:
        """See `RobotDriver`: worlds take the pose in their table's frame."""
        pose = self._table_from_base @ base_from_tool
        before = int(getattr(self.world, "refused", 0))
        self.world.command(pose[:3, 3], float(np.arctan2(pose[1, 0], pose[0, 0])), aperture)
        return int(getattr(self.world, "refused", 0)) == before

    def stop(self) -> None:
        """See `RobotDriver`: a world stands still while nobody steps it."""

    def close(self) -> None:
        """Release the world."""
        close = getattr(self.world, "close", None)
        if close is not None:
            close()


class WorldClock:
    """A world's own time: waiting steps it, computing takes none.

    Args:
        world: The world.
        period: Time of one of its steps, s.
    """

    def __init__(self, world: World, period: float) -> None:
        self.world, self.period, self._count = world, period, 0

    def now(self) -> float:
        """See `Clock`."""
        return self._count * self.period

    def wait_until(self, moment: float) -> None:
        """See `Clock`."""
        # Half a step of room for rounding.
        while self.now() < moment - 0.5 * self.period:
            self.world.step()
            self._count += 1


class SimDriver(WorldDriver):
    """The simulated world as an arm.

    Args:
        files: What it is made of; its registration is the one that the runner takes.
        settings: Settings of the policy's environment: picture size and renderer.

    Raises:
        InputError: A file is missing, of the wrong kind or damaged.
    """

    def __init__(self, files: StageFiles, settings: EnvironmentSettings) -> None:
        world = build_world(files)
        eye = DrawnEye(build_renderer(files, settings), camera_response(files))
        super().__init__(world, eye, world.kinematics, world.dimensions, world.base_from_table, settings)


@dataclass(frozen=True)
class MirrorSetting:
    """Choice of a mirror: its scenes and its seed.

    Args:
        item, background: Names of its object and table.
        seed: Seed of textures, shapes and hidden parameters; `world_seed` overrides it for the hidden ones.
        world_seed: Seed of the hidden parameters; None for `seed`.
        pieces: Folder that keeps convex pieces from run to run; None for a temporary one.
        samples: Samples per pixel, at least.
        threads: Threads to render with.
    """

    item: str
    background: str
    seed: int = 0
    world_seed: int | None = None
    pieces: str | Path | None = None
    samples: int = 32
    threads: int = 1


class MirrorDriver(WorldDriver):
    """The mirror as an arm: true table and camera, measured joints.

    Args:
        mirror: Which mirror.
        registration: Where a person believes table and camera to be.
        settings: Settings of the policy's environment: picture size.

    Raises:
        InputError: Unknown object or background.
    """

    def __init__(self, mirror: MirrorSetting, registration: Registration, settings: EnvironmentSettings) -> None:
        hidden = Hidden.draw(mirror.seed if mirror.world_seed is None else mirror.world_seed)
        with TemporaryDirectory() as folder:
            world = build_mirror(
                Setting(mirror.item, mirror.background, seed=mirror.seed),
                true_robot(Path(folder) / "robot", hidden),
                true_base_from_table(hidden),
                hidden,
                pieces=Path(folder) / "pieces" if mirror.pieces is None else mirror.pieces,
                threads=mirror.threads,
                quality=Quality(samples=mirror.samples),
            )
        physics = world.physics
        # By the registered table in both directions: the pose that the runner asks for is the pose that the arm is sent to.
        physics.commanded_from = np.array(registration.base_from_table)
        super().__init__(
            world, OwnEye(settings.image_size), physics.kinematics, physics.dimensions, physics.commanded_from, settings
        )


class Referee:
    """Judges a world by the rules of its task, and ends the episode at a success.

    Args:
        world: The world.
        settings: Settings of the task.
    """

    def __init__(self, world: World, settings: EnvironmentSettings) -> None:
        self.world, self.rules = world, settings.rules()

    def begin(self) -> None:
        """Begin an episode and judge its start."""
        self._progress = Progress.start(1)
        self()

    def __call__(self) -> bool:
        """Judge the state after a step; whether the episode is over."""
        state = self.world.state()
        self._progress, self.outcome = judge(state, self._progress, self.rules)
        return bool(self.outcome.success_tolerant[0]) or not bool(state.finite()[0])

    @property
    def verdict(self) -> Verdict:
        """Judgement of the world's last state."""
        success = bool(self.outcome.success[0])
        failure = "" if success else str(self.outcome.failure[0])
        return Verdict(success, bool(self.outcome.success_tolerant[0]), failure)


def episode_seed(settings: EnvironmentSettings, index: int) -> int:
    """Seed of a trial's world, the same as in `gsbridge.environment.trials`."""
    rng, _ = seeding.np_random(1000 * settings.pose_seed + index)
    return draw_episode(rng, settings.region())[1]
