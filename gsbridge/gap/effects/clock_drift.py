"""A clock of the measurements that runs too fast or too slow."""

from collections.abc import Mapping

import numpy as np

from gsbridge.gap.effects.base import Effect, Parameter
from gsbridge.gap.setup import Setup
from gsbridge.geometry import Array


class ClockDrift(Effect):
    """Positions and speeds whose time stamps run away from those of the commands; efforts' do not, as of another device."""

    name = "clock_drift"
    title = "a clock drift of the measured motion"
    hook = "clock"
    scope = "mechanism"
    parameters = (Parameter("drift", "1", -0.05, 0.05, 0.001, True, "seconds per second by which motion is stamped too late"),)
    sizes = (1.0, 6.0, 40.0)
    signature = "position error follows the speed and grows with time; effort is right"
    confused_with = ("clock_offset", "command_delay", "warming")
    tell_apart = "log for longer: an offset stays, a drift grows"
    cost = "post"

    def apply(self, setup: Setup, joint: int, values: Mapping[str, float]) -> None:
        """Stretch the logged motion."""

        def late(time: Array, channels: dict[str, Array]) -> dict[str, Array]:
            out = dict(channels)
            for kind in ("position", "velocity"):
                columns = [np.interp(time * (1.0 - values["drift"]), time, column) for column in channels[kind].T]
                out[kind] = np.stack(columns, axis=1)
            return out

        setup.outputs.append(late)
