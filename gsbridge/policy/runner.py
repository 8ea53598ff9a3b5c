"""The control loop of a policy on an arm: look, decide, command, 20 times a second, and stop when something is wrong.

Observations and commands are made by the code of the training (`gsbridge.environment.proprioception`, `gsbridge.sim.actions`);
only the source of pose and picture differs.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gsbridge.environment.proprioception import PROPRIO, Reached, begin, next_command, proprioception
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.policy.driver import Clock, RobotDriver, WallClock, hold
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.rectify import Rectifier
from gsbridge.policy.safety import End, Guard, Limits
from gsbridge.registration.result import Registration
from gsbridge.robot.reach import tool_down

logger = logging.getLogger("gsbridge")

Policy = Callable[[Mapping[str, Array], Mapping[str, object]], Array]
"""Function that returns an action for an observation and, in place of the trials' `info`, an empty mapping."""


@dataclass(frozen=True)
class Setup:
    """All that stays the same from episode to episode of an arm.

    Args:
        interface: Inputs and outputs of the policy.
        driver: The arm.
        registration: Registered poses of table and camera.
        clock: Clock of the control loop.
        limits: Limits beyond which an episode ends.
        rectify: Makes the policy's picture from the camera's.
        base_from_table: Pose of the table, from the registration. [4, 4].

    Raises:
        InputError: Registration, camera and policy do not belong together.
    """

    interface: PolicyInterface
    driver: RobotDriver
    registration: Registration
    clock: Clock = field(default_factory=WallClock)
    limits: Limits = field(default_factory=Limits)
    rectify: Rectifier = field(init=False)

    def __post_init__(self) -> None:
        camera = self.driver.camera or self.registration.camera
        if camera is None:
            raise InputError(
                "driver: camera",
                "neither the driver nor the registration knows the camera's intrinsics",
                "Give them as the driver's `camera`",
            )
        self.interface.check_table(self.registration)
        changed = self.interface.check_mount(self.registration)
        if changed is not None:
            logger.info("camera mount: %.1f mm, %.2f degrees from the training's", 1000 * changed[0], np.degrees(changed[1]))
        object.__setattr__(self, "rectify", Rectifier(camera, self.interface.camera))

    @property
    def base_from_table(self) -> Array:
        """Registered pose of the table in the base frame. [4, 4]."""
        return self.registration.base_from_table


def run_policy(
    policy: Policy,
    setup: Setup,
    *,
    steps: int | None = None,
    dry_run: bool = False,
    until: Callable[[], bool] | None = None,
    log: EpisodeLog | None = None,
) -> EpisodeLog:
    """Run one episode. The driver is always stopped at its end, also after an error or Ctrl-C, which are raised again.

    Args:
        policy: The policy that acts.
        setup: The arm.
        steps: Largest number of steps; None for as many as in the training.
        dry_run: Whether to give no commands and not to drive to the rest posture; the arm stays where it is.
        until: Called after each step; if it returns true, the episode is done. With a real arm, a person judges afterwards.
        log: Log to fill during the episode; None for a new one.

    Returns:
        The log; `log` itself if it is given.

    Raises:
        InputError: The tool is not in the pose in which episodes begin, or the picture does not fit the camera's intrinsics.
    """
    log = EpisodeLog() if log is None else log
    log.dry_run = dry_run
    driver = setup.driver
    loop = _Loop(policy, setup, log)
    try:
        # Before the arm moves, since the first call of a network takes longer than a step.
        loop.warm_up()
        if not dry_run:
            driver.rest()
        loop.start()
        logger.info("the episode begins%s", ", without commands" if dry_run else "")
        log.end = loop.run(setup.interface.settings.time_out if steps is None else steps, until)
    except BaseException as error:
        log.end = End.INTERRUPTED if isinstance(error, KeyboardInterrupt) else End.ERROR
        log.error = "" if isinstance(error, KeyboardInterrupt) else f"{type(error).__name__}: {error}"
        raise
    finally:
        log.clipped, log.saturated = loop.target.counted.clipped, loop.target.saturated
        hold(driver)
    return log


class _Loop:
    """State of one episode."""

    def __init__(self, policy: Policy, setup: Setup, log: EpisodeLog) -> None:
        self.policy, self.setup, self.log = policy, setup, log
        self.target = setup.interface.target()
        self.guard = Guard(setup.limits, setup.interface.workspace, self.target.scale, setup.interface.stroke)
        self._table_from_base = np.linalg.inv(setup.base_from_table)
        self._before: Reached | None = None

    def warm_up(self) -> None:
        """Let the policy act once on an empty observation."""
        camera = self.setup.interface.camera
        blank: dict[str, Array] = {
            "image": np.zeros((camera.height, camera.width, 3), np.uint8),
            "proprio": np.zeros(PROPRIO, np.float32),
        }
        self.policy(blank, {})

    def start(self) -> None:
        """Begin an episode: the arm's present pose is the first command."""
        end, pose = self._measure()
        if pose is None:
            raise InputError(
                "driver: measure",
                f"it gave no finite pose, or an opening that is not within 0 to {self.setup.interface.stroke:g} m",
                "Return base_from_tool, 4x4, and the distance of the pads in metres",
            )
        if not self.log.dry_run:
            self.setup.interface.check_start(pose)
        if end is not None:
            x, y, z = self.reached.position
            raise InputError(
                "start of the episode",
                f"the tool stands at ({x:.2f}, {y:.2f}, {z:.2f}) m of the table: {end.value}",
                "It must point down, inside the workspace; check the rest posture, the driver's frames and the registration",
            )
        begin(self.target, self.reached)

    def run(self, steps: int, until: Callable[[], bool] | None) -> End:
        """Take steps until something ends the episode."""
        clock, period = self.setup.clock, 1.0 / self.setup.interface.control_hz
        first = moment = clock.now()
        for _ in range(steps):
            started, reached = clock.now() - first, self.reached
            end, action, command = self._decide()
            if end is not None:
                return end
            moment += period
            # Nothing is commanded by a measurement that is as old as that.
            stalled = clock.now() - moment > self.setup.limits.stall
            answer = None if self.log.dry_run or stalled else self._send(command)
            late = clock.now() - moment
            self.log.add(started, reached, action, command, max(0.0, late), answer is False)
            if stalled or late > self.setup.limits.stall:
                return End.STALLED
            if late > 0:
                # The next period begins now, since catching up would send commands in a burst.
                moment = clock.now()
            else:
                clock.wait_until(moment)
            end = self.guard.accepted(answer) or self._measure()[0]
            if end is None and not self.log.dry_run:
                end = self.guard.follows(*command[:2])
            if end is not None:
                return end
            if until is not None and until():
                return End.DONE
        return End.TIME_OUT

    def _measure(self) -> tuple[End | None, Array | None]:
        """Read the arm; return why the episode must end, or None, and `table_from_tool`, None if the reading is no pose."""
        reading = self.setup.driver.measure()
        end, pose = self.guard.reading(reading, self._table_from_base)
        if pose is not None:
            self.reached = self._before = Reached.of_pose(pose, reading.aperture).after(self._before)
        return end, pose

    def _decide(self) -> tuple[End | None, Array, tuple[Array, float, float]]:
        """Take a picture; return why the episode must end, or None, the action, and the command in the table frame."""
        raw = self.setup.driver.image()
        picture = self.setup.rectify(raw)
        if self.log.keep_pictures:
            self.log.pictures.append(np.array(picture))
        action = self.policy({"image": picture, "proprio": proprioception(self.target, self.reached)}, {})
        end = self.guard.picture(raw) or self.guard.action(action)
        if end is not None:
            return end, action, (np.zeros(3), 0.0, 0.0)
        command = next_command(self.target, self.reached, action)
        return self.guard.command(*command[:2], self.reached), action, command

    def _send(self, command: tuple[Array, float, float]) -> bool | None:
        """Give a command to the arm; return what it answers.

        Raises:
            InputError: The answer is neither true, false nor none: a status of 0 may mean either.
        """
        position, yaw, aperture = command
        answer: object = self.setup.driver.command(self.setup.base_from_table @ tool_down(position, yaw), aperture)
        if answer is None or isinstance(answer, bool | np.bool_):
            return None if answer is None else bool(answer)
        said = f"it answered {answer!r}"[:100]
        raise InputError("driver: command", said, "Return False where the arm cannot go there, else True or None")
