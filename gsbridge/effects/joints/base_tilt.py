"""A base that is not level."""

from collections.abc import Mapping

from scipy.spatial.transform import Rotation

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class BaseTilt(JointEffect):
    """A base that is tilted about its two horizontal axes."""

    name = "base_tilt"
    title = "a tilted base"
    hook = "body"
    scope = "mechanism"
    parameters = (
        Parameter("about_x", "rad", -0.3, 0.3, 0.02, True, "turn of the base about its x axis"),
        Parameter("about_y", "rad", -0.3, 0.3, 0.02, True, "turn of the base about its y axis"),
    )
    signature = "a constant that depends on the pose, also in joints that carry no weight"
    confused_with = ("encoder_offset", "effort_offset", "payload")
    tell_apart = "turn the first joint by 180 degrees"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return a typical tilt about each axis, with both signs."""
        return tuple({"about_x": a, "about_y": b} for a, b in ((0.02, 0), (-0.02, 0), (0, 0.02), (0, -0.02)))

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Turn gravity by the opposite angle, which is the same as turning the base."""
        turn = Rotation.from_rotvec([values["about_x"], values["about_y"], 0.0])
        setup.gravity = turn.inv().apply(setup.gravity)
