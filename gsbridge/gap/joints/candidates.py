"""Candidates of a mechanism: every effect on every joint where it can act and show."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.joints.sliding import SLIDING_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.closure import closed_at_most_times
from gsbridge.gap.diagnosis.results import Candidate, Hypothesis
from gsbridge.gap.formats.records import TOOL
from gsbridge.gap.joints.mechanism.replay import up_of
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_LOWEST = (0.02, 0.08, 0.2)
"""Heights at which a surface is tried, as shares of the range of commanded tool heights, counted from the lowest."""

_LEVEL = 0.01
"""Range of commanded tool heights, m, up to which no surface is tried."""

_KNOCKING = ("backlash",)
"""Names of effects in which parts knock against each other."""


@dataclass(frozen=True, order=True)
class JointCandidate(Candidate):
    """An effect of a joint, or of the whole mechanism, that may be missing.

    Args:
        slides: Whether the joint slides, so that the effect's figures are in metres and newtons.
        heights: Heights at which a surface may be in the way of the tool, m above the base's origin.
    """

    registry = JOINT_EFFECTS
    slides: bool = field(default=False, compare=False)
    heights: tuple[float, ...] = field(default=(), compare=False)

    @property
    def effect(self) -> JointEffect:
        """The effect's entry in the registry for turning or for sliding joints."""
        return (SLIDING_EFFECTS if self.slides else JOINT_EFFECTS).effect(self.name)

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return parameter sets whose multiples are tried first: those of the effect, a surface's at each of its heights."""
        own = super().directions()
        return tuple({**values, "height": height} for values in own for height in self.heights) if self.heights else own


def closed_beside_knocks(effects: Sequence[Applied], before: Array, after: Array, share: float) -> float:
    """Compute the share of a gap that effects close at most times, if they make parts knock; otherwise negative infinity.

    When exactly a gear's play closes, and how often it rebounds, depends on the hardness of its teeth and on the time step of
    the replay. A knock that is simulated too early leaves as large a residual as a knock that is missing.

    Args:
        effects: The effects.
        before: Whitened residual without the effects. [T, C].
        after: Whitened residual with the effects. [T, C].
        share: Mean square of noise alone.
    """
    knocks = any(applied.name in _KNOCKING for applied in effects)
    return closed_at_most_times(before, after, share) if knocks else -np.inf


def special_cases(
    trials: Sequence[Hypothesis], known: Sequence[Hypothesis], who: Sequence[Candidate], near: float
) -> list[tuple[tuple[Candidate, ...], list[dict[str, float]]]]:
    """List special cases of explanations, in which a simpler effect replaces one effect, with parameters to start from.

    An effect must be compared with its special cases; otherwise it may be named for parameters that explain nothing.

    Args:
        trials: The explanations.
        known: Explanations that were fitted already and are left out.
        who: All candidates.
        near: Multiple of the best squared residual on `fit` up to which an explanation's special cases are listed.
    """
    out, fitted = list[tuple[tuple[Candidate, ...], list[dict[str, float]]]](), {frozenset(t.fit.who) for t in known}
    best = min((trial.fit.chi2 for trial in trials), default=0.0)
    for trial in (trial for trial in trials if trial.fit.chi2 <= near * best):
        for k, (whole, values) in enumerate(zip(trial.fit.who, trial.fit.values, strict=True)):
            for other in (c for c in who if c.joint == whole.joint and c.name in whole.effect.contains):
                names = [parameter.name for parameter in other.effect.parameters]
                every = (*trial.fit.who[:k], other, *trial.fit.who[k + 1 :])
                if frozenset(every) in fitted or not set(names) <= set(values):
                    continue
                fitted.add(frozenset(every))
                starts = [*trial.fit.values[:k], {name: values[name] for name in names}, *trial.fit.values[k + 1 :]]
                out.append((every, starts))
    return out


def candidates(
    view: JointResiduals, names: Collection[str] | None = None, others: Sequence[JointResiduals] = ()
) -> tuple[JointCandidate, ...]:
    """List all candidates of a mechanism, or only those of the effects in `names`.

    An effect that a model may hold only once is no candidate where the model has it.

    Args:
        view: A record and the mechanism that replays it.
        names: Effects that may be the cause; None for the whole catalogue.
        others: Further records, whose commands may reach lower heights of the tool.
    """
    system, out = view.mechanism.system, list[JointCandidate]()
    for name, effect in JOINT_EFFECTS.items():
        if system.controller.mode not in effect.modes or (names is not None and name not in names):
            continue
        if name == "damping" and len(system.joints) < 2:
            # With a single joint, `damping` is the same as `gain_d`.
            continue
        held = {applied.joint for applied in system.effects if applied.name == name and effect.alone}
        if name == "table" and not held:
            heights = _heights((view, *others))
            out += [JointCandidate(name, heights=heights)] if heights else []
            continue
        joints = [joint for joint in (system.joints if effect.scope == "joint" else ("",)) if joint not in held]
        sliding = set(system.sliding)
        out += [JointCandidate(name, joint, joint in sliding) for joint in joints if not (effect.turns and joint in sliding)]
    return tuple(out)


def thresholds(who: Sequence[Candidate], view: JointResiduals, residual: Array) -> list[Candidate]:
    """Select one-parameter candidates that act only above a threshold, on the joint with the largest residual.

    Args:
        who: Candidates.
        view: A record.
        residual: Whitened residual of the record. [T, C].
    """
    column = int(np.argmax((residual**2).mean(axis=0)))
    kind, k = view.channels[column]
    if kind == TOOL:
        return []
    joint = view.record.joints[k]
    return [c for c in who if c.joint == joint and c.effect.threshold and len(c.effect.parameters) == 1]


def _heights(views: Sequence[JointResiduals]) -> tuple[float, ...]:
    """Choose heights at which a surface would stop the tool in the lowest part of the commanded motion, m above the base.

    There are none if the commanded motion is level, or if no frame tells how far the last link reaches.
    """
    mechanism, up = views[0].mechanism, up_of(views[0].mechanism.system.gravity)
    if not mechanism.system.tool and not mechanism.toe.any():
        return ()
    commands = np.concatenate([view.record.commands["command"] for view in views])[:, mechanism.chain.order]
    heights = mechanism.chain.follow(mechanism.tip, mechanism.toe, commands) @ up
    low, high = float(heights.min()), float(heights.max())
    return tuple(round(low + share * (high - low), 4) for share in _LOWEST) if high - low > _LEVEL else ()
