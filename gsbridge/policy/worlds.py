"""Worlds driven like arms: the simulated one and the mirror behind `RobotDriver`.

They measure joint angles and know the table only by its registration, as a real arm does; the mirror's encoders have noise and
offsets. Only the referee, which takes the place of a person, uses privileged states. The mirror is driven through `Sealed`, so
the code that drives it has no access to true poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from gymnasium.utils import seeding

from gsbridge.environment.build import StageFiles, build_renderer, build_world, camera_response
from gsbridge.environment.env import DrawnEye, Eye, draw_episode, judge
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.geometry import Array
from gsbridge.policy.driver import Reading, tool_pose
from gsbridge.policy.robot_trials import Verdict
from gsbridge.reality.mirror.backgrounds import PLATE_WELL_M
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import TRIAL, MirrorWorld, mirror_world
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.registration.result import Registration
from gsbridge.robot.gripper import GripperDimensions
from gsbridge.robot.kinematics import Kinematics
from gsbridge.tasks.outcome import Progress
from gsbridge.tasks.state import State
from gsbridge.tasks.world import CONTROL_HZ, World


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
        referee: Judges the episodes; None for one that looks at this world.

    Attributes:
        reading: The last measurement; None before the first of an episode.
    """

    def __init__(
        self,
        world: World | Sealed,
        eye: Eye | Window | Dark,
        kinematics: Kinematics,
        dimensions: GripperDimensions,
        commanded_from: Array,
        settings: EnvironmentSettings,
        control_hz: float = CONTROL_HZ,
        referee: Referee | None = None,
    ) -> None:
        self.world, self.eye, self.kinematics, self.dimensions = world, eye, kinematics, dimensions
        self.camera = wrist_camera(eye.size)
        self.clock = WorldClock(world, 1.0 / control_hz)
        # A sealed world always comes with a referee.
        self.referee = Referee(world, settings) if referee is None else referee  # type: ignore[arg-type]
        self.reading: Reading | None = None
        self._table_from_base = np.linalg.inv(commanded_from)
        self._start: tuple[Array, int] = np.array([0.0, 0.265, 0.0]), 0

    def prepare(self, pose: Array, seed: int) -> None:
        """Choose the next episode: start pose x, y, yaw of the object, m and rad, [3], and the seed of what is random."""
        self._start = np.array(pose, dtype=np.float64), int(seed)

    def rest(self) -> None:
        """Begin the episode: see `RobotDriver`."""
        self.world.reset(*self._start)
        self.eye.begin(self._start[1])
        self.reading = None
        self.referee.begin()

    def measure(self) -> Reading:
        """See `RobotDriver`."""
        joints = self.world.joints()[0]
        self.reading = Reading(tool_pose(self.kinematics, joints), float(self.dimensions.aperture(joints[-1])))
        return self.reading

    def image(self) -> Array:
        """See `RobotDriver`."""
        return self.eye.look(self.world)  # type: ignore[arg-type]  # each world has the eye that fits it

    def command(self, base_from_tool: Array, aperture: float) -> bool:
        """See `RobotDriver`; the world gets the pose [4, 4] in its table's frame."""
        pose = self._table_from_base @ base_from_tool
        before = int(getattr(self.world, "refused", 0))
        self.world.command(pose[:3, 3], float(np.arctan2(pose[1, 0], pose[0, 0])), aperture)
        return int(getattr(self.world, "refused", 0)) == before

    def stop(self) -> None:
        """Do nothing (see `RobotDriver`): a world stands still unless it is stepped."""

    def close(self) -> None:
        """Release the world."""
        close = getattr(self.world, "close", None)
        if close is not None:
            close()


class WorldClock:
    """A world's own time: waiting steps the world, and computing takes no time.

    Args:
        world: The world.
        period: Time of one of its steps, s.
    """

    def __init__(self, world: World | Sealed, period: float) -> None:
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
        files: Files that it is made of; their registration is the one that the runner uses.
        settings: Settings of the policy's environment: picture size and renderer.

    Raises:
        InputError: A file is missing, of the wrong kind or damaged.
    """

    def __init__(self, files: StageFiles, settings: EnvironmentSettings) -> None:
        world = build_world(files)
        eye = DrawnEye(build_renderer(files, settings), camera_response(files))
        super().__init__(world, eye, world.kinematics, world.dimensions, world.base_from_table, settings)


class Sealed:
    """The part of a world that an arm and its camera offer: measured joints, commands, time steps and pictures.

    It gives no access to the true poses of tool, object and camera, to contacts, or to hidden parameters.

    Args:
        world: The world.
    """

    def __init__(self, world: MirrorWorld | MirrorPhysics) -> None:
        self.reset, self.command, self.step, self.joints = world.reset, world.command, world.step, world.joints
        if isinstance(world, MirrorWorld):
            self.image = world.image
        self._count = lambda: world.refused

    @property
    def refused(self) -> int:
        """Number of commands out of reach in this episode."""
        return self._count()


class Window:
    """Pictures of a world's own camera.

    Args:
        size: Edge of the picture, px.
    """

    def __init__(self, size: int) -> None:
        self.size = size

    def begin(self, seed: int) -> None:
        """Do nothing: the world already has its seed."""

    def look(self, world: Sealed) -> Array:
        """The picture. uint8 [size, size, 3]."""
        return world.image(self.size)


class Dark:
    """Black pictures, for controllers that use none: path tracing would be wasted time.

    Args:
        size: Edge of the picture, px.
    """

    def __init__(self, size: int) -> None:
        self.size, self._picture = size, np.zeros((size, size, 3), np.uint8)

    def begin(self, seed: int) -> None:
        """Do nothing: black pictures need no seed."""

    def look(self, world: Sealed) -> Array:
        """The picture. uint8 [size, size, 3]."""
        return self._picture


@dataclass(frozen=True)
class MirrorSetting:
    """Choice of a mirror: its scenes, seeds and picture quality.

    Args:
        item, background: Names of its object and table.
        seed: Seed of textures, shapes and hidden parameters; `world_seed` overrides it for the hidden ones.
        world_seed: Seed of the hidden parameters; None for `seed`.
        pieces: Folder that keeps convex pieces from run to run; None for a temporary one.
        samples: Smallest number of samples per pixel.
        threads: Threads to render with.
    """

    item: str
    background: str
    seed: int = 0
    world_seed: int | None = None
    pieces: str | Path | None = None
    samples: int = TRIAL.samples
    threads: int = 1

    def build(self) -> MirrorWorld:
        """Build the world, with the picture quality of trials.

        Raises:
            InputError: Unknown object or background.
        """
        hidden = Hidden.draw(self.seed if self.world_seed is None else self.world_seed)
        setting, quality = Setting(self.item, self.background, seed=self.seed), replace(TRIAL, samples=self.samples)
        with TemporaryDirectory() as folder:
            pieces = Path(folder) if self.pieces is None else self.pieces
            return mirror_world(setting, hidden, pieces=pieces, threads=self.threads, quality=quality)


class MirrorDriver(WorldDriver):
    """The mirror as an arm, which measures its joints and knows the table by its registration.

    Args:
        world: The mirror, or its physics alone for controllers that use no pictures.
        registration: Registered poses of table and camera.
        settings: Settings of the policy's environment: task, picture size.
    """

    def __init__(self, world: MirrorWorld | MirrorPhysics, registration: Registration, settings: EnvironmentSettings) -> None:
        physics = world.physics if isinstance(world, MirrorWorld) else world
        # Runner and world both convert by the registered table, so that the arm is sent to the pose that the runner asks for.
        physics.commanded_from = np.array(registration.base_from_table)
        size = settings.image_size
        super().__init__(
            Sealed(world),
            Window(size) if isinstance(world, MirrorWorld) else Dark(size),
            physics.kinematics,
            physics.dimensions,
            physics.commanded_from,
            settings,
            referee=Referee(world, _as_it_is(settings, physics.stand.plate)),
        )


def _as_it_is(settings: EnvironmentSettings, plate: tuple[float, float] | None) -> EnvironmentSettings:
    """Return settings with the plate's true pose, so that a wrong reconstruction misses the goal instead of moving it."""
    if settings.plate is None or plate is None:
        return settings
    return replace(settings, plate=replace(settings.plate, x=plate[0], y=plate[1], height=PLATE_WELL_M))


class Referee:
    """Judges a world by the rules of its task, and ends the episode at a success.

    Args:
        world: The world.
        settings: Settings of the task.

    Attributes:
        states: True states of the episode, the first before any step.
    """

    def __init__(self, world: World, settings: EnvironmentSettings) -> None:
        self.world, self.rules = world, settings.rules()
        self.states: list[State] = []

    def begin(self) -> None:
        """Begin an episode and judge its start."""
        self._progress, self.states = Progress.start(1), []
        self()

    def __call__(self) -> bool:
        """Judge the state after a step; return whether the episode is over."""
        state = self.world.state()
        self.states.append(state)
        self._progress, self.outcome = judge(state, self._progress, self.rules)
        return bool(self.outcome.success_tolerant[0]) or not bool(state.finite()[0])

    @property
    def verdict(self) -> Verdict:
        """Judgement of the world's last state."""
        success = bool(self.outcome.success[0])
        failure = "" if success else str(self.outcome.failure[0])
        return Verdict(success, bool(self.outcome.success_tolerant[0]), failure)


def episode_seed(settings: EnvironmentSettings, index: int) -> int:
    """Return the seed of a trial's world, the same as in `gsbridge.environment.trials`."""
    return world_seed(settings, 1000 * settings.pose_seed + index)


def world_seed(settings: EnvironmentSettings, seed: int) -> int:
    """Return the world's seed in an episode that `PickEnvironment.reset` would begin with `seed`."""
    rng, _ = seeding.np_random(seed)
    return draw_episode(rng, settings.region())[1]
