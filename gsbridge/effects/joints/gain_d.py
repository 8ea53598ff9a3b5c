"""A controller damping that differs from the stated one."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class GainD(JointEffect):
    """A controller damping that differs from the stated one."""

    name = "gain_d"
    title = "another damping of the controller"
    hook = "actuator"
    parameters = (Parameter("change", "", -0.8, 3.0, 0.1, True, "share by which the damping is larger"),)
    modes = ("pd",)
    signature = "errors that grow with the speed; effort follows speed"
    confused_with = ("viscous", "lag", "command_delay")
    tell_apart = "log command and effort; move at several constant speeds"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Scale the damping of the joint's controller."""
        setup.law["damping"][joint] *= 1.0 + values["change"]
