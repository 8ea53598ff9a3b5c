"""Candidates of a mechanism: every effect on every joint where it can act and show."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.joints.sliding import SLIDING_EFFECTS
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel


@dataclass(frozen=True, order=True)
class JointCandidate(Candidate):
    """An effect of a joint, or of the whole mechanism, that may be missing.

    Args:
        slides: Whether the joint slides, so that the effect's figures are in metres and newtons.
    """

    registry = JOINT_EFFECTS
    slides: bool = field(default=False, compare=False)

    @property
    def effect(self) -> JointEffect:
        """Its entry in the registry of what the joint does."""
        return (SLIDING_EFFECTS if self.slides else JOINT_EFFECTS).effect(self.name)


def candidates(system: MechanismModel, names: Collection[str] | None = None) -> tuple[JointCandidate, ...]:
    """All candidates of a mechanism; of these effects only, if `names` is given."""
    out: list[JointCandidate] = []
    for name, effect in JOINT_EFFECTS.items():
        if system.controller.mode not in effect.modes or (names is not None and name not in names):
            continue
        joints = system.joints if effect.scope == "joint" else ("",)
        sliding = set(system.sliding)
        out += [JointCandidate(name, joint, joint in sliding) for joint in joints if not (effect.turns and joint in sliding)]
    return tuple(out)
