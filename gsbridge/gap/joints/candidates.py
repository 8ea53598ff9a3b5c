"""Candidates of a mechanism: every effect on every joint where it can act and show."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel


@dataclass(frozen=True, order=True)
class JointCandidate(Candidate):
    """An effect of a joint, or of the whole mechanism, that may be missing."""

    registry = JOINT_EFFECTS


def candidates(system: MechanismModel, names: Collection[str] | None = None) -> tuple[JointCandidate, ...]:
    """All candidates of a mechanism; of these effects only, if `names` is given."""
    out: list[JointCandidate] = []
    for name, effect in JOINT_EFFECTS.items():
        if system.controller.mode not in effect.modes or (names is not None and name not in names):
            continue
        joints = system.joints if effect.scope == "joint" else ("",)
        out += [JointCandidate(name, joint) for joint in joints]
    return tuple(out)
