"""A gravity compensation that differs from the stated one."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class Gravcomp(JointEffect):
    """A controller that compensates a wrong share of the weight, the same error at every joint."""

    name = "gravcomp"
    title = "another share of the weight carried by the controller"
    hook = "actuator"
    scope = "mechanism"
    parameters = (Parameter("change", "", -1.5, 1.5, 0.05, True, "added to the stated share"),)
    modes = ("pd",)
    signature = "errors that follow the weight of the pose, gone when the controller is off"
    confused_with = ("payload", "link_mass")
    tell_apart = "change the controller's gain"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Change the compensated share of the weight at all joints."""
        setup.law["gravity_share"] += values["change"]
