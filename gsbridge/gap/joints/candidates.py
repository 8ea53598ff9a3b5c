"""Candidates: every effect of the catalogue on every joint where it can act and show."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.registry import Applied
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array


@dataclass(frozen=True, order=True)
class Candidate:
    """An effect and the joint it would act on, empty for the whole mechanism."""

    name: str
    joint: str = ""

    @property
    def effect(self) -> JointEffect:
        """Its entry in the catalogue."""
        return JOINT_EFFECTS.effect(self.name)

    def applied(self, values: Mapping[str, float]) -> Applied:
        """With parameters."""
        return Applied(self.name, self.joint, dict(values))

    def from_vector(self, vector: Array) -> Applied:
        """With parameters in the catalogue's order."""
        return self.applied({p.name: float(x) for p, x in zip(self.effect.parameters, vector, strict=True)})

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameters in the catalogue's order."""
        return np.array([values[p.name] for p in self.effect.parameters])

    def __str__(self) -> str:
        return f"{self.name}:{self.joint}" if self.joint else self.name


def candidates(system: MechanismModel, names: Collection[str] | None = None) -> tuple[Candidate, ...]:
    """All candidates of a mechanism; of these effects only, if `names` is given."""
    out = []
    for name, effect in JOINT_EFFECTS.items():
        if system.controller.mode not in effect.modes or (names is not None and name not in names):
            continue
        out += [Candidate(name, joint) for joint in system.joints] if effect.scope == "joint" else [Candidate(name)]
    return tuple(out)
