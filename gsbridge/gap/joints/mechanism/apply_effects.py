"""Application of effects to a mechanism before it is simulated."""

from __future__ import annotations

from collections.abc import Sequence

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied, effect_of
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.mechanism.setup import JointSetup


def apply_effects(mechanism: Mechanism, effects: Sequence[Applied]) -> JointSetup:
    """Set up a mechanism with the effects of its own model and further ones.

    Raises:
        InputError: An effect or its joint is unknown.
    """
    setup = mechanism.setup()
    for applied in (*mechanism.system.effects, *effects):
        effect = effect_of(applied, JOINT_EFFECTS, joints=setup.joints)
        effect.apply(setup, setup.joints.index(applied.joint) if applied.joint else -1, applied.parameters)
    return setup
