"""The account of a gap: all effects that explain a part of it, in order, and how much each explains where nobody fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Finding, Hypothesis
from gsbridge.gap.joints.candidates import Candidate
from gsbridge.gap.joints.fit import EffectFit
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.residual_map import map_residuals
from gsbridge.gap.joints.residuals import JointResiduals

NAMED, ONE_OF, LIKELY = "named", "one of", "likely, not proven"

_AS_GOOD = 0.9
"""Share of what an entry explains that another effect must explain in its place to be one of those that could stand there."""

_ALTERNATIVES = 6
"""Of an entry, at most."""


@dataclass(frozen=True)
class Entry:
    """One line of an account.

    Args:
        candidate: The effect and its joint.
        effect: The same with its parameters.
        deviations: Standard deviations of these, in the catalogue's order. [P].
        share: Of the gap on `verify` that it closes after those before it; negative if it makes it worse.
        verdict: `NAMED`, `ONE_OF` or `LIKELY`.
        instead: What else could stand in its place.
    """

    candidate: Candidate
    effect: Applied
    deviations: tuple[float, ...]
    share: float
    verdict: str
    instead: tuple[str, ...]


@dataclass(frozen=True)
class Account:
    """All that explains a gap.

    Args:
        entries: In the order in which they explain the gap on `select`.
        explained: Share of the gap on `verify` that they close together.
        channel, phase: Where most remains; empty where nothing stands out.
        left: Residual there, in units of the noise.
    """

    entries: tuple[Entry, ...]
    explained: float
    channel: str = ""
    phase: str = ""
    left: float = 0.0

    @property
    def effects(self) -> tuple[Applied, ...]:
        """Of all entries."""
        return tuple(entry.effect for entry in self.entries)


def account_of(search: JointIdentification, finding: Finding, third: JointResiduals) -> Account | None:
    """Take account of a gap; None where nothing was fitted, or nothing is missing.

    Args:
        search: The diagnosis, whose records `fit` and `select` it has.
        finding: What it found.
        third: JointResiduals of the record `verify`.
    """
    if finding.best is None or finding.verdict in ("no_discrepancy", "not_enough_excitation"):
        return None
    whole = search.widen(finding)
    if whole is None:
        return None
    order = _order(search, whole)
    sizes = [_size(third, [whole.fit.effects[k] for k in order[:number]]) for number in range(len(order) + 1)]
    gap = max(sizes[0], 1e-9)
    places = np.cumsum([0, *(len(candidate.effect.parameters) for candidate in whole.fit.who)])
    entries = []
    for number, k in enumerate(order):
        candidate = whole.fit.who[k]
        verdict, instead = _standing(search, finding, whole.fit, k)
        deviations = tuple(float(value) for value in whole.fit.deviations[places[k] : places[k + 1]])
        share = float((sizes[number] - sizes[number + 1]) / gap)
        entries.append(Entry(candidate, whole.fit.effects[k], deviations, share, verdict, instead))
    account = Account(tuple(entries), float((sizes[0] - sizes[-1]) / gap))
    found = map_residuals(third, third.residual(account.effects), third.simulate(account.effects))
    values = np.where(found.marked, found.values, -np.inf)
    if not np.isfinite(values).any():
        return account
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    columns = [name for names in found.groups.values() for name in names]
    return replace(account, channel=found.channels[row], phase=columns[column], left=float(values[row, column]))


def _size(view: JointResiduals, effects: Sequence[Applied]) -> float:
    """Root mean square residual beyond the noise, in units of it."""
    return float(np.sqrt(max((view.residual(tuple(effects)) ** 2).sum() / view.freedom - 1.0, 0.0)))


def _order(search: JointIdentification, whole: Hypothesis) -> list[int]:
    """Places of the effects in the order in which they explain `select`, each beside those before it."""
    effects, out = whole.fit.effects, list[int]()
    while len(out) < len(effects) - 1:
        left = [k for k in range(len(effects)) if k not in out]
        sizes = [_size(search.second, [effects[j] for j in (*out, k)]) for k in left]
        out.append(left[int(np.argmin(sizes))])
    return [*out, *(k for k in range(len(effects)) if k not in out)]


def _standing(search: JointIdentification, finding: Finding, fitted: EffectFit, k: int) -> tuple[str, tuple[str, ...]]:
    """How sure an entry is, and what else could stand in its place."""
    candidate = fitted.who[k]
    proven = finding.best is not None and candidate in finding.best.fit.who
    if proven and finding.verdict == "named":
        return NAMED, ()
    if proven and finding.verdict == "ambiguous" and finding.best is not None:
        others = [name for name in finding.ambiguous if name != " + ".join(finding.best.names)]
        return ONE_OF, tuple(others[:_ALTERNATIVES])
    without = search.first.residual(tuple(e for j, e in enumerate(fitted.effects) if j != k))
    explained = float((without**2).sum()) - fitted.chi2
    alike = [m for m in search.screen.matches(without) if m.candidate not in fitted.who and m.bound >= _AS_GOOD * explained]
    alike.sort(key=lambda match: -match.bound)
    return (ONE_OF, tuple(str(m.candidate) for m in alike[:_ALTERNATIVES])) if alike else (LIKELY, ())
