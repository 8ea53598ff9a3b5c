"""The mirror as one world: physics and camera together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.reality.mirror.backgrounds import PLATE_CENTRE_M
from gsbridge.reality.world.camera import MirrorCamera, Quality, Setting, expose, lamp_line, wrist_camera
from gsbridge.reality.world.electronics import Electronics
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics, build_physics
from gsbridge.reality.world.shutter import moments
from gsbridge.reality.world.surroundings import passer_pose, window_line
from gsbridge.robot.assembly import RobotFiles
from gsbridge.tasks.world import CONTROL_HZ

TRIAL = Quality(samples=32, depth=2)
"""Picture quality for trials, which take thousands of pictures: direct light of lamp and sky, with shadows."""


class MirrorWorld:
    """Stand-in for reality; implements `gsbridge.tasks.world.SeeingWorld`.

    Args:
        physics: Physics of the world.
        camera: Wrist camera of the world.
        quality: Samples and depth of the pictures; None for `TRIAL`.
    """

    def __init__(self, physics: MirrorPhysics, camera: MirrorCamera, quality: Quality | None = None) -> None:
        self.physics, self.camera, self.quality = physics, camera, quality or TRIAL
        # These methods are those of the physics; this class adds only the pictures.
        self.command, self.state, self.joints = physics.command, physics.state, physics.joints
        self.body_poses, self.camera_pose = physics.body_poses, physics.camera_pose
        self._electronics = Electronics(camera.hidden, 1.0 / CONTROL_HZ)
        # The current picture, by its size and the number of the control period.
        self._shown: dict[tuple[int, int], Array] = {}
        self._begin(0, 0)

    @property
    def refused(self) -> int:
        """Number of commands out of reach in this episode."""
        return self.physics.refused

    def reset(self, object_pose: Array, seed: int) -> None:
        """Begin an episode with the object at x, y (m), yaw (rad) [3]; see `World.reset`."""
        self.physics.reset(object_pose, seed)
        self._begin(seed, 0)

    def place(self, q: Array, aperture: float, object_pose: Array | None = None, number: int = 0) -> None:
        """Put robot and object at given poses at once: see `MirrorPhysics.place`.

        Args:
            q, aperture, object_pose: Arm joints, rad [7]; distance between the pads, m; the object's pose as in
                `MirrorPhysics.place` [3] or [4, 4].
            number: Number of the picture; pictures with different numbers have different noise.
        """
        self.physics.place(q, aperture, object_pose)
        self._begin(0, number)

    def step(self) -> None:
        """Advance one control period."""
        self.physics.step()
        self._steps += 1

    def image(self, size: int) -> Array:
        """Return the wrist camera's current picture; a second call in one period returns the same. uint8 [size, size, 3]."""
        asked = size, self._steps
        if asked not in self._shown:
            self._shown = {asked: self._shoot(wrist_camera(size))}
        return self._shown[asked].copy()

    def _begin(self, seed: int, steps: int) -> None:
        self._seed, self._steps = seed, steps
        self._shown = {}
        self._electronics.begin(seed)

    def _shoot(self, camera: Camera) -> Array:
        """Take a picture of the current state. [H, W, 3] uint8."""
        hidden, lens = self.camera.hidden, self.camera.lens(camera)
        seed = int(np.random.SeedSequence([self._seed, self._steps]).generate_state(1)[0])
        pinhole = camera if lens is None else lens.wide
        if hidden.exposure_time + hidden.readout > 0.0:
            light = self._exposed(pinhole, seed)
        else:
            self._move(self.body_poses(), 0.0)
            light = self.camera.light(pinhole, self.camera_pose(), self.quality, seed)
        light = light if lens is None else lens(light)
        gains = self._electronics.gains(light)
        return self._electronics.delivered(expose(light, hidden, np.random.default_rng([seed, 2]), gains))

    def _exposed(self, camera: Camera, seed: int) -> Array:
        """Render the light of a picture whose rows are exposed one after the other while arm and object move. [H, W, 3]."""
        hidden = self.camera.hidden
        parts = moments(hidden.exposure_time, hidden.readout, camera.height)
        light = np.zeros((camera.height, camera.width, 3))
        # Use as many rays in total as a picture of a single moment.
        rays = sum(part.bottom - part.top for part in parts) / camera.height
        quality = replace(self.quality, samples=max(1, round(self.quality.samples / rays)))
        for number, part in enumerate(parts):
            poses, pose = self.physics.moment(part.before)
            self._move(poses, part.before)
            rows = part.top, part.bottom
            seen = self.camera.light(camera, pose, quality, (seed + number) % 2**32, rows)
            light[part.top : part.bottom] += part.weights[:, None, None] * seen
        return light

    def _move(self, poses: Mapping[str, Array], before: float) -> None:
        """Set the poses of the bodies, and that of the passer as it was `before` s ago."""
        hidden = self.camera.hidden
        if hidden.passer > 0.0:
            seconds = self._steps / CONTROL_HZ - before
            # If the lamp is out, the passer crosses the light of the window instead.
            line = lamp_line(hidden) if hidden.lamp_dim < 1.0 else window_line(hidden)
            poses = {**poses, "passer": passer_pose(hidden, *line, self._seed, seconds)}
        self.camera.move(poses)


def mirror_physics(setting: Setting, hidden: Hidden, *, pieces: str | Path) -> MirrorPhysics:
    """Build the mirror's physics alone, for trials that need no pictures.

    Args:
        setting: Object and background in the room.
        hidden: Hidden parameters.
        pieces: Folder in which convex pieces are cached between runs.

    Raises:
        InputError: Unknown object.
    """
    with TemporaryDirectory() as folder:
        return _physics(setting, true_robot(Path(folder) / "robot", hidden), hidden, pieces)


def mirror_world(
    setting: Setting,
    hidden: Hidden,
    *,
    pieces: str | Path,
    threads: int = 1,
    quality: Quality | None = None,
) -> MirrorWorld:
    """Build the mirror in which policies are judged, with wrist camera and table at their true poses.

    Args:
        setting: Object, background and board in the room.
        hidden: Hidden parameters: `Hidden.draw(seed)`, or see `gsbridge.reality.world.world_variants`.
        pieces: Folder in which convex pieces are cached between runs.
        threads: Threads to render with.
        quality: Samples and depth of the pictures; None for `TRIAL`.

    Raises:
        InputError: Unknown object or background.
    """
    with TemporaryDirectory() as folder:
        robot = true_robot(Path(folder) / "robot", hidden)
        physics = _physics(setting, robot, hidden, pieces)
        return MirrorWorld(physics, MirrorCamera(setting, robot, hidden, threads), quality)


def _physics(setting: Setting, robot: RobotFiles, hidden: Hidden, pieces: str | Path) -> MirrorPhysics:
    stand = _stand(true_base_from_table(hidden), setting)
    return build_physics(robot, stand, setting.object, hidden, pieces=pieces, seed=setting.seed)


def _stand(base_from_table: Array, setting: Setting) -> Stand:
    return Stand(np.asarray(base_from_table, dtype=np.float64), PLATE_CENTRE_M if setting.background == "plate" else None)


def build_mirror(
    setting: Setting,
    robot: RobotFiles,
    base_from_table: Array,
    hidden: Hidden,
    *,
    pieces: str | Path,
    threads: int = 1,
    quality: Quality | None = None,
) -> MirrorWorld:
    """Build a world of the mirror with a given robot and table pose.

    Args:
        setting: Object, background, board, seed of textures.
        robot: The robot with its true camera pose.
        base_from_table: True pose of the table. [4, 4].
        hidden: Hidden parameters: `Hidden.draw(seed)`, or `Hidden.draw(seed).changed(...)` for a further world.
        pieces: Folder in which convex pieces are cached between runs.
        threads: Threads to render with.
        quality: Samples and depth of the pictures; None for `TRIAL`.

    Raises:
        InputError: Unknown object or background.
    """
    physics = build_physics(robot, _stand(base_from_table, setting), setting.object, hidden, pieces=pieces, seed=setting.seed)
    return MirrorWorld(physics, MirrorCamera(setting, robot, hidden, threads), quality)
