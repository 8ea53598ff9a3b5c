"""Stand-ins: effects that could take the place of one effect of a set, which is compared with such sets before it is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate, Hypothesis
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen

_ALIKE = 0.95
"""Share of an effect's squared change that a candidate's signatures must explain to be tried in its place."""

_TWINS = 3
"""Most candidates that are tried in the place of one effect."""

_SHOWN = 9.0
"""Squared change, in units of the noise, that a candidate must explain on `fit` for an effect to count as visible there."""


@dataclass(frozen=True)
class StandIn:
    """A set of effects in which one effect is replaced by another.

    Args:
        who: Effects of the set.
        values: Start parameters of each effect.
        behind: By how much the other effect explains less of `fit` than the replaced one, both by their signatures. Squared
            residual, in units of the noise.
    """

    who: tuple[Candidate, ...]
    values: tuple[dict[str, float], ...]
    behind: float


def stand_ins(
    view: JointResiduals, screen: Screen, best: Hypothesis, known: Sequence[Hypothesis], margin: float
) -> list[StandIn]:
    """List sets in which a similar candidate replaces one of the effects of `best`, the most similar first.

    For each effect, these are the most similar candidate, and all others that signatures cannot tell from it.

    A set is grown from signatures, which hardly tell very similar effects apart: a lag and a delay, each beside two others. If
    only one of the two was tried, it would be named without having been compared with the other. Each effect of `best` takes
    one simulation.

    Args:
        view: Residuals on the record `fit`.
        screen: Signatures on that record.
        best: The best explanation, of several effects.
        known: Explanations that were fitted; their sets are not proposed again.
        margin: Squared residual, in units of the noise, by which signatures must differ to tell two candidates apart.
    """
    who, fitted, out = best.fit.who, {frozenset(trial.fit.who) for trial in known}, list[StandIn]()
    for k, own in enumerate(who):
        kept = [j for j in range(len(who)) if j != k]
        part = view.residual([best.fit.effects[j] for j in kept]) - best.first
        enough = _ALIKE * float((part**2).sum())
        if best.fit.records > 1 and enough < _SHOWN:
            continue
        matches = screen.matches(part)
        others = [m for m in matches if m.bound >= enough and m.candidate not in who and not _nested(own, m.candidate)]
        # Compare with what the effect's own signatures explain: at another size, even these do not explain all of it.
        mine = next((match.bound for match in matches if match.candidate == own), -np.inf)
        others.sort(key=lambda match: -match.bound)
        for number, other in enumerate(others[:_TWINS]):
            every = (*who[:k], other.candidate, *who[k + 1 :])
            alike = max(mine, others[0].bound) - other.bound < margin
            if frozenset(every) not in fitted and (number == 0 or alike):
                starts = (*best.fit.values[:k], other.starts[0], *best.fit.values[k + 1 :])
                out.append(StandIn(every, starts, mine - other.bound))
    return sorted(out, key=lambda one: one.behind)


def _nested(one: Candidate, other: Candidate) -> bool:
    """Tell whether one of two candidates is a special case of the other; special cases are compared elsewhere."""
    return one.joint == other.joint and (one.name in other.effect.contains or other.name in one.effect.contains)
