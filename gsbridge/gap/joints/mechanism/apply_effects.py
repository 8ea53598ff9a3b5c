"""A mechanism with effects put into it, ready to be simulated."""

from __future__ import annotations

from collections.abc import Sequence

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied, effect_of
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.mechanism.setup import JointSetup


def apply_effects(mechanism: Mechanism, effects: Sequence[Applied]) -> JointSetup:
    """A mechanism with its own and further effects.

    Raises:
        InputError: An effect or its joint is unknown.
    """
    setup = mechanism.setup()
    for applied in (*mechanism.system.effects, *effects):
        effect = effect_of(applied, JOINT_EFFECTS, joints=setup.joints)
        effect.apply(setup, setup.joints.index(applied.joint) if applied.joint else -1, applied.parameters)
    return setup
