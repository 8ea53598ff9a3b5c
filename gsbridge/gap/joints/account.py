"""The account of a gap: all effects that explain a part of it, and the share that each explains on the unfitted record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Protocol

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import LIKELY, NAMED, ONE_OF, TRANSFERS, AccountEntry, Finding, GapAccount, Hypothesis
from gsbridge.gap.diagnosis.wording import place
from gsbridge.gap.joints.pooled import PooledResiduals
from gsbridge.gap.joints.residual_map import map_residuals
from gsbridge.gap.joints.residuals import JointResiduals

_RIVALS = 6
"""Most alternatives that are listed for one entry."""


class Search(Protocol):
    """The part of the search that an account needs: the object that grew the explanation."""

    @property
    def both(self) -> PooledResiduals:
        """Residuals on the records `fit` and `select`."""

    def instead(self, whole: Hypothesis, k: int, third: JointResiduals | None = None) -> tuple[str, ...]:
        """Return names of effects that explain as much in the place of one effect of an explanation.

        Args:
            whole: The explanation.
            k: Number of the effect that is replaced.
            third: Residuals on the record `verify`, to compare on all records; None to compare on two.
        """


def account_of(search: Search, finding: Finding, whole: Hypothesis, third: JointResiduals) -> GapAccount:
    """Take account of a gap.

    Args:
        search: The search that grew the explanation on the records `fit` and `select`.
        finding: The finding that the account extends.
        whole: The explanation with all effects that help.
        third: Residuals on the record `verify`.
    """
    # Order by all records, so that the order hardly depends on which of them is called `fit`.
    order = _order(PooledResiduals((*search.both.views, third)), whole.fit.effects)
    sizes = [_size(third, [whole.fit.effects[k] for k in order[:number]]) for number in range(len(order) + 1)]
    gap = max(sizes[0], 1e-9)
    places = np.cumsum([0, *(len(candidate.effect.parameters) for candidate in whole.fit.who)])
    entries = []
    for number, k in enumerate(order):
        candidate = whole.fit.who[k]
        share = float((sizes[number] - sizes[number + 1]) / gap)
        # If an effect explains most of the gap, its rivals are fitted and compared with it on all records.
        verdict, instead = _standing(search, finding, whole, k, third if share >= TRANSFERS else None)
        deviations = whole.fit.deviations[places[k] : places[k + 1]]
        entries.append(AccountEntry(candidate, whole.fit.effects[k], deviations, share, verdict, instead))
    explained = float((sizes[0] - sizes[-1]) / gap)
    account = GapAccount(tuple(entries), explained, 1.0 - (1.0 - explained) ** 2)
    found = map_residuals(third, third.residual(account.effects), third.simulate(account.effects))
    values = np.where(found.marked, found.values, -np.inf)
    if not np.isfinite(values).any():
        return account
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    phase = place(*[(group, name) for group, names in found.groups.items() for name in names][column])
    return replace(account, channel=found.channels[row], phase=phase, left=float(values[row, column]))


def _size(view: JointResiduals, effects: Sequence[Applied]) -> float:
    """Compute the root mean square residual beyond the noise, in units of the noise."""
    return float(np.sqrt(max((view.residual(tuple(effects)) ** 2).sum() / view.freedom - 1.0, 0.0)))


def _order(seen: PooledResiduals, effects: tuple[Applied, ...]) -> list[int]:
    """Order effects by how much of the records they explain, without those that add nothing beside the others.

    Some effects explain only together: a stiffer servo and the friction that it overcomes. Forward selection (add what
    explains most beside those chosen) finds such a pair last. Backward elimination (drop what is missed least) finds it as
    soon as it matters, but may keep two effects where one would do. The order that leaves less along the way is returned.

    Returns:
        Places of the effects in `effects`.

    Source: Couvreur and Bresler, SIAM Journal on Matrix Analysis and Applications 21, 2000, for backward elimination.
    """

    @cache
    def left(who: frozenset[int]) -> float:
        return float((seen.residual([effects[k] for k in sorted(who)]) ** 2).sum())

    kept = frozenset(range(len(effects)))
    while kept and left(kept - {least := min(kept, key=lambda k: left(kept - {k}))}) <= left(kept):
        kept -= {least}
    adding, taking_away = list[int](), list[int]()
    while len(adding) < len(kept):
        adding.append(min(kept.difference(adding), key=lambda k: left(frozenset([*adding, k]))))
        standing = kept.difference(taking_away)
        taking_away.insert(0, min(standing, key=lambda k: left(standing - {k})))
    return min(adding, taking_away, key=lambda order: sum(left(frozenset(order[:count])) for count in range(len(order))))


def _standing(
    search: Search, finding: Finding, whole: Hypothesis, k: int, third: JointResiduals | None
) -> tuple[str, tuple[str, ...]]:
    """Return how sure an entry is (`NAMED`, `ONE_OF` or `LIKELY`), and what else could stand in its place."""
    proven = finding.best is not None and whole.fit.who[k] in finding.best.fit.who
    if proven and finding.verdict == "named":
        return NAMED, ()
    if proven and finding.verdict == "ambiguous" and finding.best is not None:
        others = [name for name in finding.ambiguous if name != " + ".join(finding.best.names)]
        return ONE_OF, tuple(others[:_RIVALS])
    alike = search.instead(whole, k, third)
    return (ONE_OF, alike) if alike else (LIKELY, ())
