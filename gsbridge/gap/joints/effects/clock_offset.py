"""Measurements that are stamped too late or too early."""

from collections.abc import Callable, Mapping

import numpy as np

from gsbridge.effects.base import Effect, Parameter
from gsbridge.gap.formats.records import TOOL
from gsbridge.gap.joints.mechanism.setup import JointSetup
from gsbridge.geometry import Array

MOTION = ("position", "velocity", TOOL)


def restamp(setup: JointSetup, taken: Callable[[Array], Array]) -> None:
    """Log positions and speeds as they were at other times than their stamps say.

    Args:
        setup: The mechanism's.
        taken: Stamps to the times of the samples, s. [T] -> [T].
    """

    def late(time: Array, channels: dict[str, Array]) -> dict[str, Array]:
        out = dict(channels)
        for kind in (kind for kind in MOTION if kind in channels):
            out[kind] = np.stack([np.interp(taken(time), time, column) for column in channels[kind].T], axis=1)
        return out

    setup.outputs.append(late)


class ClockOffset(Effect):
    """Positions and speeds that are stamped too late; efforts are not, since another device logs them."""

    name = "clock_offset"
    title = "a clock offset of the measured motion"
    hook = "clock"
    scope = "mechanism"
    parameters = (Parameter("time", "s", -0.1, 0.1, 0.005, True, "by which motion is stamped too late"),)
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # a delay that shows at microseconds may be a quarter of a second
    signature = "position error follows the speed; effort is right"
    confused_with = ("command_delay", "lag")
    tell_apart = "compare with the command's echo; efforts tell"
    cost = "post"

    def apply(self, setup: JointSetup, joint: int, values: Mapping[str, float]) -> None:
        """Shift the logged motion."""
        restamp(setup, lambda time: time - values["time"])
