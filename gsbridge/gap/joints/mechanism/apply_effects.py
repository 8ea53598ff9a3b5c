"""A mechanism with effects put into it, ready to be simulated."""

from __future__ import annotations

from collections.abc import Sequence

from gsbridge.errors import InputError
from gsbridge.gap.effects import effect_of
from gsbridge.gap.joints.mechanism.mechanism_model import Applied
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.mechanism.setup import JointSetup


def apply_effects(mechanism: Mechanism, effects: Sequence[Applied]) -> JointSetup:
    """A mechanism with its own and further effects.

    Raises:
        InputError: An effect or its joint is unknown.
    """
    setup = mechanism.setup()
    for applied in (*mechanism.system.effects, *effects):
        effect = effect_of(applied.name)
        wanted = {parameter.name for parameter in effect.parameters}
        if set(applied.parameters) != wanted or bool(applied.joint) != (effect.scope == "joint"):
            joint = "and a joint" if effect.scope == "joint" else "and no joint"
            raise InputError(
                f"effect {applied.name}",
                "its parameters are incomplete or unknown",
                f"Give {', '.join(sorted(wanted))} {joint}",
            )
        if applied.joint and applied.joint not in setup.joints:
            raise InputError(f"effect {applied.name}", f"there is no joint '{applied.joint}'", f"Use {', '.join(setup.joints)}")
        effect.apply(setup, setup.joints.index(applied.joint) if applied.joint else -1, applied.parameters)
    return setup
