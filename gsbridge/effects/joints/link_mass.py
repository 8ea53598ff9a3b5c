"""A link that is heavier or lighter than described."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class LinkMass(JointEffect):
    """A link that is heavier or lighter than described; its inertia scales with it."""

    name = "link_mass"
    title = "a wrong mass of the link"
    hook = "body"
    parameters = (Parameter("change", "", -0.8, 3.0, 0.05, True, "share by which the link is heavier"),)
    signature = "like weight and inertia, in the link's joint and those before it"
    confused_with = ("payload", "armature", "gravcomp", "torque_gain")
    tell_apart = "compare static with fast motion"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Scale mass and inertia of the link."""
        setup.scale_link(joint, 1.0 + values["change"])
