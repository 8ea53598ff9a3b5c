"""What could stand in the place of one effect of a set: a set is compared with others before all of it is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate, Hypothesis
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen

_ALIKE = 0.95
"""Share of what an effect explains that a candidate's signatures must explain to be tried in its place."""

_TWINS = 3
"""Candidates that are tried in the place of one effect, at most."""

_SHOWN = 9.0
"""Squared residual, in units of the noise, that an effect must explain of a record to show there at all."""


@dataclass(frozen=True)
class StandIn:
    """A set in which another effect stands in the place of one.

    Args:
        who: The effects.
        values: Parameters of each to start from.
        behind: By how much less of `fit` the other explains than the one does, both by their signatures. Squared residual, in
            units of the noise.
    """

    who: tuple[Candidate, ...]
    values: tuple[dict[str, float], ...]
    behind: float


def stand_ins(
    view: JointResiduals, screen: Screen, best: Hypothesis, known: Sequence[Hypothesis], margin: float
) -> list[StandIn]:
    """Sets in which a candidate that looks like one of the effects of `best` stands in its place, the most alike first.

    Of each effect, that is the candidate that looks most like it, and all whose signatures do not tell it from that effect.

    A set is grown from signatures, which tell near twins apart by little: a lag and a delay, each beside two other effects.
    Where only one of the two was tried, it would be named without having been compared with the other. Each effect takes one
    simulation.

    Args:
        view: Residuals on the record `fit`.
        screen: Signatures on that record.
        best: The best explanation, of several effects.
        known: Explanations that were fitted; none of them is proposed again.
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
        # A signature of another size does not explain all of its own effect either.
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
    """Whether one of two candidates is a special case of the other, which is compared elsewhere."""
    return one.joint == other.joint and (one.name in other.effect.contains or other.name in one.effect.contains)
