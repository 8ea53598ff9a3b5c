"""The gymnasium environment: one arm, one object, one wrist camera.

**Action**, `Box(-1, 1, (5,))`: steps of the commanded tool pose, 20 per second; a diagonal may use every entry in full. Before
an action is added, the command is held to within one and a half actions of the arm, so that it leads by two and a half at most
(`gsbridge.sim.actions`).

| entry | meaning | for an action of 1 |
|---|---|---|
| 0, 1, 2 | tool point along x, y, z of the table | 24 mm |
| 3 | turn of the tool about the vertical | 0.15 rad |
| 4 | opening of the gripper, positive opens | 42 mm |

**Observation**, `Dict(image, proprio)`: the wrist camera's picture, uint8 [H, W, 3], and what an arm knows of itself, float32
[12] (`gsbridge.environment.proprioception` has the table).

**Reward** 1 in the step of success, else 0. **Terminated** on success, and when the world is no longer finite; **truncated** at
time-out. The object's pose and its contacts are in `info` only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces

from gsbridge.environment.lens import WristLens
from gsbridge.environment.litter import Litter
from gsbridge.environment.proprioception import PROPRIO, PROPRIO_BOUND, Reached, begin, next_command, proprioception
from gsbridge.environment.rendering import Renderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.limits import Workspace
from gsbridge.sim.actions import SIZE, ToolTarget
from gsbridge.sim.camera import respond
from gsbridge.sim.camera_values import respond_unrounded
from gsbridge.sim.model import CameraModel
from gsbridge.tasks import grasp, place
from gsbridge.tasks.outcome import Outcome, Progress
from gsbridge.tasks.poses import POSE_SETS, StartRegion, pose_set
from gsbridge.tasks.state import NAMES, State
from gsbridge.tasks.world import World

_LITTER = 3
"""Separates the random stream of the litter from that of the sensor's noise; both use the episode's seed."""

OPTIONS = ("pose", "pose_set", "index")


class Eye(Protocol):
    """Takes the wrist camera's picture of a world."""

    size: int

    def begin(self, seed: int) -> None:
        """Begin an episode; `seed` seeds what is random in its pictures."""

    def look(self, world: World) -> Array:
        """Picture of the wrist camera. uint8 [size, size, 3]."""


class DrawnEye:
    """Pictures drawn by a renderer and passed through the simulated camera's response and the model's image effects.

    With effects, the picture stays in float32 until all of them are applied, and is rounded to 8 bits once. Without any, the
    response is a look-up table over the bytes of the drawn picture.

    Args:
        renderer: See `Renderer`.
        response: Response and noise of the sensor, from the simulation model; None leaves the picture as it was drawn.
        lens: Applies the model's image effects; None for no effects.
        litter: Flat things that may lie on the table, drawn anew for each episode; None for an empty table.
    """

    def __init__(
        self,
        renderer: Renderer,
        response: CameraModel | None = None,
        lens: WristLens | None = None,
        litter: Litter | None = None,
    ) -> None:
        self.renderer, self.response, self.lens, self.litter = renderer, response, lens, litter
        self._seed = 0
        self.size = renderer.camera.width if lens is None else lens.nominal.width
        self._rng, self._scattered = np.random.default_rng(0), False

    def begin(self, seed: int) -> None:
        """See `Eye`."""
        self._rng, self._seed, self._scattered = np.random.default_rng(seed), seed, False

    def look(self, world: World) -> Array:
        """See `Eye`."""
        if self.litter is not None and not self._scattered:
            # A random stream of its own, so that litter does not change the sensor's noise.
            rng, self._scattered = np.random.default_rng([self._seed, _LITTER]), True
            self.renderer.lying = self.litter.scattered(rng, world.body_poses()["object"][:2, 3])
        pose = world.camera_pose() if self.lens is None else self.lens.pose(world.camera_pose())
        if self.lens is None or self.lens.plain:
            image = self.renderer.render(world.body_poses(), pose)
            return image if self.response is None else respond(image, self.response, self._rng)
        values = self.renderer.draw(world.body_poses(), pose)
        if self.response is not None:
            values = respond_unrounded(values, self.response, self._rng)
        return self.lens.photo(values, pose, self._rng)


class OwnEye:
    """Pictures of the world's own camera (`gsbridge.tasks.world.SeeingWorld`): the mirror, or a robot.

    Args:
        size: Edge of the picture, px.
    """

    def __init__(self, size: int) -> None:
        self.size = size

    def begin(self, seed: int) -> None:
        """Do nothing: the world has its seed already."""

    def look(self, world: World) -> Array:
        """See `Eye`."""
        return np.asarray(world.image(self.size))  # type: ignore[attr-defined]


class PickEnvironment(gymnasium.Env):
    """Grasping, or picking and placing; see the module for actions, observations and reward.

    Args:
        world: Any world.
        settings: Task, pictures, actions, start poses and end of an episode.
        renderer: Draws the pictures; None for a world with a camera of its own.
        stroke: Largest opening of the gripper, m.
        workspace: Room in which the tool may be commanded; None for the world's own, or the nominal one.
        response: Response of the simulated camera.
        lens: Applies the image effects of the simulation model to the pictures.
        litter: Flat things that may lie on the table in the pictures; None for an empty table.

    Raises:
        InputError: There is neither a renderer nor a camera, the renderer's pictures have another size than the settings', or
            the start region goes beyond the workspace.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  (gymnasium's own attribute)

    def __init__(
        self,
        world: World,
        settings: EnvironmentSettings,
        renderer: Renderer | None = None,
        *,
        stroke: float = 0.14,
        workspace: Workspace | None = None,
        response: CameraModel | None = None,
        lens: WristLens | None = None,
        litter: Litter | None = None,
    ) -> None:
        self.world, self.settings = world, settings
        self.workspace = workspace or getattr(world, "workspace", None) or Workspace.around()
        self.eye = _eye(world, renderer, response, lens, settings.image_size, litter)
        self.rules, self.region = settings.rules(), settings.region()
        if not self._reaches(self.region.corners()).all():
            x, y = (f"{self.workspace.lower[k]:g} to {self.workspace.upper[k]:g}" for k in range(2))
            middle = ", ".join(f"{value:g}" for value in self.region.centre)
            raise InputError(
                "start region",
                f"the square of {self.region.side:g} m about ({middle}) goes beyond the workspace, in which the tool may go: "
                f"x {x}, y {y} m",
                "Move it, make it smaller, or give another workspace",
            )
        self.target = ToolTarget.within(self.workspace, stroke, settings.action_scale())
        size = settings.image_size
        self.action_space = spaces.Box(-1.0, 1.0, (SIZE,), np.float32)
        self.observation_space = spaces.Dict(
            {
                "image": spaces.Box(0, 255, (size, size, 3), np.uint8),
                "proprio": spaces.Box(-PROPRIO_BOUND, PROPRIO_BOUND, (PROPRIO,), np.float32),
            }
        )
        self.render_mode = "rgb_array"
        self._sets: dict[str, Array] = {}
        self._image: Array | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seed of this and the following episodes.
            options: `pose` for a start pose x, y, yaw, m and rad; or `pose_set` (one of `POSE_SETS`) and `index` (0 to 31)
                for one of a set; without them the pose is drawn.

        Raises:
            InputError: An option is unknown, gives no valid pose, or gives one where the tool may not go.
        """
        super().reset(seed=seed)
        # Drawn in any case, so that naming one pose does not shift the random ones after it.
        drawn, episode_seed = draw_episode(self.np_random, self.region)
        self.start_pose = self._chosen(options or {}, drawn)
        self.world.reset(self.start_pose, episode_seed)
        self.eye.begin(episode_seed)
        state = self.world.state()
        self._reached = self._measure(state)
        begin(self.target, self._reached)
        self._progress, self._steps = Progress.start(1), 0
        self._progress, outcome = judge(state, self._progress, self.rules)
        return self._observe(), self._info(state, outcome)

    def step(self, action: Array) -> tuple[dict[str, Array], SupportsFloat, bool, bool, dict[str, Any]]:
        """Advance one control period.

        Args:
            action: See the module; entries outside -1..1 are cut and counted. [5].

        Raises:
            InputError: The action has another shape or is not finite.
        """
        self.world.command(*next_command(self.target, self._reached, action))
        self.world.step()
        self._steps += 1
        state = self.world.state()
        self._reached = self._measure(state).after(self._reached)
        self._progress, outcome = judge(state, self._progress, self.rules)
        finite = bool(state.finite()[0])
        terminated = bool(outcome.success_tolerant[0]) or not finite
        truncated = not terminated and self._steps >= self.settings.time_out
        return self._observe(), float(outcome.reward[0]), terminated, truncated, self._info(state, outcome)

    def render(self) -> Array | None:
        """The picture of the last observation. uint8 [H, W, 3]."""
        return self._image

    def close(self) -> None:
        """Release the world."""
        close = getattr(self.world, "close", None)
        if close is not None:
            close()

    def _reaches(self, xy: Array) -> Array:
        """Whether the tool may go over points of the table. [..., 2] -> bool [...]."""
        return self.workspace.contains(np.concatenate([xy, np.full((*xy.shape[:-1], 1), self.workspace.upper[2])], axis=-1))

    def _chosen(self, options: Mapping[str, Any], drawn: Array) -> Array:
        """Start pose by the options of `reset`. [3]."""
        unknown = [name for name in options if name not in OPTIONS]
        if unknown or ("index" in options) != ("pose_set" in options) or ("pose" in options and len(options) > 1):
            raise InputError(
                "reset options",
                f"{', '.join(sorted(options))} do not fit",
                "Give `pose`, or `pose_set` and `index`, or nothing",
            )
        if "pose" in options:
            pose = np.asarray(options["pose"], dtype=np.float64)
            if pose.shape != (3,) or not np.isfinite(pose).all():
                raise InputError(
                    "reset options: pose", f"{options['pose']!r} is no pose", "Give x, y, yaw in metres and radians"
                )
            if not self._reaches(pose[:2]):
                raise InputError(
                    "reset options: pose", f"{options['pose']!r} lies outside the workspace", "Start where the tool may go"
                )
            return pose
        if "pose_set" in options:
            name = options["pose_set"]
            if name not in POSE_SETS:
                raise InputError("reset options: pose_set", f"{name!r} is unknown", f"Use one of {', '.join(POSE_SETS)}")
            poses = self._sets.setdefault(name, pose_set(name, self.region, self.settings.pose_seed))
            index = options["index"]
            if isinstance(index, bool) or not isinstance(index, int | np.integer) or not 0 <= index < len(poses):
                raise InputError("reset options: index", f"{index!r} is out of range", f"Give 0 to {len(poses) - 1}")
            return poses[index].copy()
        return drawn

    def _measure(self, state: State) -> Reached:
        """What the arm measures of itself: the true tool pose of the state, unless the world's encoders report another one."""
        measured = getattr(self.world, "measured_tool", None)
        pose = None if measured is None else measured()
        return Reached.of_state(state) if pose is None else Reached.of_pose(pose, float(state.aperture[0]))

    def _observe(self) -> dict[str, Array]:
        """The observation of the state just reached."""
        self._image = self.eye.look(self.world)
        return {"image": self._image, "proprio": proprioception(self.target, self._reached)}

    def _info(self, state: State, outcome: Outcome) -> dict[str, Any]:
        """Privileged state and counts."""
        counted = self.target.counted
        return {
            "state": {name: getattr(state, name)[0] for name in NAMES},
            "target": {
                "position": self.target.position.copy(),
                "yaw": float(self.target.yaw),
                "aperture": float(self.target.aperture),
            },
            "start_pose": self.start_pose.copy(),
            "success": bool(outcome.success[0]),
            "success_tolerant": bool(outcome.success_tolerant[0]),
            "failure": str(outcome.failure[0]),
            "terms": {name: float(value[0]) for name, value in outcome.terms.items()},
            "steps": self._steps,
            "clipped": counted.clipped,
            "saturated": self.target.saturated,
            "refused": int(getattr(self.world, "refused", 0)),
        }


def draw_episode(rng: np.random.Generator, region: StartRegion) -> tuple[Array, int]:
    """Draw the start pose of an episode, [3], and the seed of what is random in it."""
    return region.sample(rng, 1)[0], int(rng.integers(2**31))


def judge(state: State, progress: Progress, rules: grasp.Grasp | place.Place) -> tuple[Progress, Outcome]:
    """Judge the state of N worlds by the rules of a task.

    Args:
        state: State of the worlds.
        progress: Memory of the steps before, from the last call or the episode's start.
        rules: Thresholds of the task.

    Returns:
        The progress to give to the next call, and the outcome.
    """
    if isinstance(rules, grasp.Grasp):
        return grasp.judge(state, progress, rules)
    return place.judge(state, progress, rules)


def state_of(info: Mapping[str, Any]) -> State:
    """The privileged state in the `info` of one environment (N = 1) or of a vector of them."""
    values = {name: np.asarray(info["state"][name], dtype=np.float64) for name in NAMES}
    if values["aperture"].ndim == 0:
        values = {name: value[None] for name, value in values.items()}
    return State(**values)


def _eye(
    world: World,
    renderer: Renderer | None,
    response: CameraModel | None,
    lens: WristLens | None,
    size: int,
    litter: Litter | None,
) -> Eye:
    """Make the eye of an environment: a renderer's, or the world's own camera."""
    if renderer is None:
        if not hasattr(world, "image"):
            raise InputError("environment", "the world has no camera of its own", "Give a renderer")
        return OwnEye(size)
    wanted = (size, size) if lens is None else (lens.camera.width, lens.camera.height)
    if (renderer.camera.width, renderer.camera.height) != wanted:
        raise InputError(
            "environment",
            f"the renderer draws {renderer.camera.width} x {renderer.camera.height} px, the settings ask for {size}",
            "Make its camera with `wrist_camera(settings.image_size)`",
        )
    return DrawnEye(renderer, response, lens, litter)
