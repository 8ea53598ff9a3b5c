"""A controller stiffness that differs from the stated one."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class GainP(JointEffect):
    """A controller stiffness that differs from the stated one."""

    name = "gain_p"
    title = "another stiffness of the controller"
    hook = "actuator"
    parameters = (Parameter("change", "", -0.8, 3.0, 0.1, True, "share by which the stiffness is larger"),)
    modes = ("pd",)
    signature = "static errors change; effort no longer follows the logged error"
    confused_with = ("torque_gain", "gravcomp", "encoder_scale")
    tell_apart = "log position error and effort"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Scale the stiffness of the joint's controller."""
        setup.law["stiffness"][joint] *= 1.0 + values["change"]
