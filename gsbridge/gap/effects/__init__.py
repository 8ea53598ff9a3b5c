"""The catalogue of effects: every module of this package that defines one adds it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType

from gsbridge.effects.base import Effect
from gsbridge.effects.parameter import entries_of
from gsbridge.errors import InputError


@functools.cache
def catalogue() -> Mapping[str, Effect]:
    """All effects by name."""
    # Late: both packages import modules that look effects up here.
    from gsbridge.gap.contact import effects as body_effects
    from gsbridge.gap.joints import effects as joint_effects

    found: dict[str, Effect] = {}
    for package in (joint_effects, body_effects):
        found |= entries_of(package.__name__, package.__path__, Effect)
    return MappingProxyType(dict(sorted(found.items())))


def effect_of(name: str, source: str = "model") -> Effect:
    """An effect by name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in catalogue():
        raise InputError(source, f"the effect '{name}' is unknown", f"Use one of: {', '.join(catalogue())}")
    return catalogue()[name]
