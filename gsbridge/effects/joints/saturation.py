"""A limit of the motor's torque."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import DRIVEN, JointEffect, MechanismSetup, Parameter


class Saturation(JointEffect):
    """A limit of the motor's torque."""

    name = "saturation"
    title = "a limit of the motor's torque"
    hook = "actuator"
    parameters = (Parameter("weakness", "1/(N m)", 0.0, 100.0, 0.1, True, "one over the largest torque"),)
    modes = DRIVEN
    threshold = True
    cuts = "effort"
    sizes = (1.0, 1.05, 1.12, 1.25, 1.5, 2.0)
    signature = "errors only while the torque is at its limit; effort is cut flat"
    confused_with = ("rate_limit", "payload")
    tell_apart = "a smaller amplitude makes it vanish"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Lower the joint's torque limit, if it is higher."""
        if values["weakness"] > 0:
            row = setup.law["torque_limit"]
            row[joint] = min(row[joint], 1.0 / values["weakness"])
