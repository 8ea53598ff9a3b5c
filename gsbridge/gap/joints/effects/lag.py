"""A filter of first order between command and controller."""

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from gsbridge.effects.base import DRIVEN, Effect, Parameter
from gsbridge.gap.joints.mechanism.setup import JointSetup
from gsbridge.geometry import Array


def smoothed(values: Array, seconds: float, step: float) -> Array:
    """Commands behind a filter of first order that has settled at the first one: exact for lines between them. [K, N]."""
    if seconds <= 0:
        return values
    keep = np.exp(-step / seconds)
    # Commands that were held for a step instead would come out half a step too early, which is a lag of its own.
    old = seconds / step * (1 - keep)
    return lfilter([1 - old, old - keep], [1, -keep], values, axis=0, zi=old * values[:1])[0]


class Lag(Effect):
    """A filter of first order between command and controller, of all joints."""

    name = "lag"
    title = "a filter on the commands"
    hook = "command"
    scope = "mechanism"
    parameters = (Parameter("time", "s", 0.0, 0.4, 0.005, True, "time constant"),)
    modes = DRIVEN
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # a delay that shows at microseconds may be a quarter of a second
    signature = "smoothed response, rounded corners"
    confused_with = ("command_delay", "gain_d")
    tell_apart = "a square wave or a chirp of 2 to 10 Hz"

    def apply(self, setup: JointSetup, joint: int, values: Mapping[str, float]) -> None:
        """Filter the commands."""
        setup.commands.append(lambda commands, step: smoothed(commands, values["time"], step))
