"""Dead time between command and controller."""

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.base import DRIVEN, Effect, Parameter
from gsbridge.gap.joints.mechanism.setup import JointSetup
from gsbridge.geometry import Array


def delayed(values: Array, seconds: float, step: float) -> Array:
    """Commands some time later; before the first one counts the first one. [K, N]."""
    grid = np.arange(len(values)) * step
    return np.stack([np.interp(grid - seconds, grid, column) for column in values.T], axis=1)


class CommandDelay(Effect):
    """Dead time between command and controller, of all joints."""

    name = "command_delay"
    title = "latency of the commands"
    hook = "command"
    scope = "mechanism"
    parameters = (Parameter("time", "s", 0.0, 0.4, 0.005, True, "from a command to the controller"),)
    modes = DRIVEN
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # a delay that shows at microseconds may be a quarter of a second
    signature = "position error follows the speed; sharp at steps"
    confused_with = ("lag", "clock_offset")
    tell_apart = "a square wave; compare with the command's echo"

    def apply(self, setup: JointSetup, joint: int, values: Mapping[str, float]) -> None:
        """Shift the commands."""
        setup.commands.append(lambda commands, step: delayed(commands, values["time"], step))
