"""What could stand in the place of one effect of a set: a set is compared with others before all of it is named."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from gsbridge.gap.diagnosis.results import Candidate, Hypothesis
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen

_ALIKE = 0.95
"""Share of what an effect explains that a candidate's signatures must explain to be tried in its place."""

_SHOWN = 9.0
"""Squared residual, in units of the noise, that an effect must explain of a record to show there at all."""


def stand_ins(
    view: JointResiduals, screen: Screen, best: Hypothesis, known: Sequence[Hypothesis], affords: Callable[[], bool]
) -> Iterator[tuple[tuple[Candidate, ...], list[dict[str, float]]]]:
    """Sets in which the candidate that looks most like one of the effects of `best` stands in its place.

    A set is grown from signatures, which tell near twins apart by little: a lag and a delay, each beside two other effects.
    Where only one of the two was tried, it would be named without having been compared with the other. Each set that is
    asked for costs one simulation.

    Args:
        view: Residuals on the record `fit`.
        screen: Signatures on that record.
        best: The best explanation, of several effects.
        known: Explanations that were fitted; none of them is proposed again.
        affords: Whether there are simulations left for another set; asked before each.

    Yields:
        The effects of a set, and parameters of each to start from.
    """
    who, fitted = best.fit.who, {frozenset(trial.fit.who) for trial in known}
    for k, own in enumerate(who):
        if not affords():
            return
        kept = [j for j in range(len(who)) if j != k]
        part = view.residual([best.fit.effects[j] for j in kept]) - best.first
        enough = _ALIKE * float((part**2).sum())
        if best.fit.records > 1 and enough < _SHOWN:
            continue
        others = (m for m in screen.matches(part) if m.candidate not in who and not _nested(own, m.candidate))
        alike = [match for match in others if match.bound >= enough]
        if not alike:
            continue
        other = max(alike, key=lambda match: match.bound)
        every = (*who[:k], other.candidate, *who[k + 1 :])
        if frozenset(every) not in fitted:
            yield every, [*best.fit.values[:k], other.starts[0], *best.fit.values[k + 1 :]]


def _nested(one: Candidate, other: Candidate) -> bool:
    """Whether one of two candidates is a special case of the other, which is compared elsewhere."""
    return one.joint == other.joint and (one.name in other.effect.contains or other.name in one.effect.contains)
