"""Account of a gap between throws: the effects that explain it, in order, and how sure each is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.null import closure
from gsbridge.gap.contact.replay import PHASES, ThrowReplay
from gsbridge.gap.contact.search import mean_error
from gsbridge.gap.diagnosis.results import LIKELY, NAMED, ONE_OF, AccountEntry, Candidate, GapAccount

_PLACES = dict(zip(PHASES, ("in flight", "at the first impact", "behind the first impact"), strict=True))
"""Names of the phases in words."""


@dataclass(frozen=True, order=True)
class BodyCandidate(Candidate):
    """An effect of a thrown body that may be missing."""

    registry = BODY_EFFECTS


def throw_account(
    effects: Sequence[Applied],
    sure: tuple[str, tuple[str, ...]],
    floor: float,
    select: ThrowReplay,
    verify: ThrowReplay,
    spans: Sequence[Mapping[str, tuple[float, float]]],
    figures: Sequence[Mapping[str, tuple[float, float]]],
) -> GapAccount:
    """Make the account of a gap: the best explanation, effect by effect, the one that closes most of it on `select` first.

    Args:
        effects: The best explanation.
        sure: The verdict about it, and names of the explanations that are not clearly worse.
        floor: Mean weighted distance that noise, chaos and the engine's choices explain, m.
        select: Throws on which the effects were chosen, weighted.
        verify: Throws that are held out from fitting and choosing, weighted.
        spans: 90 % intervals of the parameters, by effect.
        figures: Old and new value of the body's figures, by effect and parameter.
    """
    order, left = list[int](), list(range(len(effects)))
    while left:
        order.append(min(left, key=lambda k: mean_error(select, [effects[j] for j in (*order, k)])))
        left.remove(order[-1])
    errors = [mean_error(verify, [effects[k] for k in order[:count]]) for count in range(len(order) + 1)]
    closed = [closure(errors[0], error, floor) for error in errors]
    verdict = {"named": NAMED, "ambiguous": ONE_OF}.get(sure[0], ONE_OF if sure[1] else LIKELY)
    instead = sure[1] if verdict == ONE_OF else ()
    entries = [
        AccountEntry(BodyCandidate(effects[k].name), effects[k], np.empty(0), share, verdict, instead, spans[k], figures[k])
        for k, share in zip(order, np.diff(closed).tolist(), strict=True)
    ]
    rest = verify.phases(effects)
    worst = max(rest, key=lambda phase: rest[phase])
    return GapAccount(tuple(entries), closed[-1], closed[-1], "position", _PLACES[worst], rest[worst])
