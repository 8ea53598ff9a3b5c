"""Limits that one record passes and another does not: of a motor's torque, of how fast a command may change.

Below its limit a motor shows nothing of it. Where slow motions were recorded for the fit and faster ones to choose by, all
that a limit does is left of the second record alone. It is then fitted to both, and the third record must confirm it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Rules
from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.joints.fit import fit, polish
from gsbridge.gap.joints.pooled import PooledResiduals
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

_JOINTS = 2
"""Joints, those that err most, whose limits are tried."""

_LEVELS, _HALVINGS = 4, 3
"""Limits that are tried between the largest values of two records, and how often the distance to the next is then halved."""

_SHARES = (0.95, 0.88, 0.8, 0.7, 0.6, 0.5)
"""Limits at which one is looked at beside an explanation, in shares of the largest value."""

_FITTED = 2
"""Limits that are fitted, those that leave least."""

_BEYOND = 1.02
"""Ratio of the largest values of two records from which on one passes what the other does not."""

_MORE = 3.0
"""Ratio of what exceeds the noise on the second record to the same on the first, from which on the second shows more."""


@dataclass
class SetFits:
    """Fits of sets of effects to one record, or to two where the first shows nothing of one of them.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        screen: Signatures on `fit`.
        late: Effects of which `fit` shows nothing.
    """

    first: JointResiduals
    second: JointResiduals
    screen: Screen
    late: set[Candidate] = field(default_factory=set)

    def fit(
        self,
        who: Sequence[Candidate],
        starts: Sequence[dict[str, float]],
        bar: float = np.inf,
        limit: float = np.inf,
        near: bool = False,
    ) -> EffectFit:
        """Fit all parameters together, as `fit` does; the fit's squared residual is that of the first record.

        Args:
            who: Candidates.
            starts: Parameters of each to start from.
            bar: Squared residual on the first record that a rival has reached.
            limit: Simulations at which the fit is given up.
            near: Whether the starts are near the end, so that derivatives of their own are worth their simulations.
        """
        if not self.late & set(who):
            return fit(self.first, who, starts, bar, None if near else self.screen, limit)
        return self._as_on_first(fit(PooledResiduals((self.first, self.second)), who, starts, limit=limit))

    def polish(self, rough: EffectFit, limit: float = np.inf) -> EffectFit:
        """Improve a fit, as `polish` does."""
        if not self.late & set(rough.who):
            return polish(self.first, rough, limit)
        return self._as_on_first(polish(PooledResiduals((self.first, self.second)), rough, limit))

    def _as_on_first(self, fitted: EffectFit) -> EffectFit:
        return replace(fitted, chi2=_squares(self.first, fitted.effects))

    def shows_more(self, effects: Sequence[Applied], floors: tuple[float, float]) -> bool:
        """Whether effects leave clearly more of the second record than of the first, in shares of the noise of each."""
        first, second = (
            _squares(view, effects) / floor - 1.0 for view, floor in zip((self.first, self.second), floors, strict=True)
        )
        return second > _MORE * max(first, 0.0)

    def limits(
        self, who: Sequence[Candidate], best: EffectFit, gain: float, affords: Callable[[int], bool], limit: float
    ) -> list[EffectFit]:
        """Fits of an explanation with a limit more that the second record passes and the first does not.

        Args:
            who: Candidates.
            best: The explanation.
            gain: Least reduction of the squared residual on the second record.
            affords: Whether so many simulations are left.
            limit: Simulations at which a fit is given up.
        """
        plain, found = _squares(self.second, best.effects), list[tuple[float, _Search]]()
        for candidate, low, high in self._passed(who, best, affords):
            if affords(_LEVELS):
                search = _Search(self.second, best.effects, candidate, low, high)
                found.append((search.try_levels(), search))
        out, found = list[EffectFit](), sorted(found, key=lambda item: item[0])
        for _, search in found[:_FITTED]:
            if not affords(2 * _HALVINGS + 6 * (1 + sum(len(c.effect.parameters) for c in best.who))):
                break
            if plain - search.halve() < gain:
                continue
            self.late.add(search.candidate)
            fitted = self.fit((*best.who, search.candidate), (*best.values, search.values), limit=limit)
            if fitted.converged:
                out.append(fitted)
        return out

    def _passed(
        self, who: Sequence[Candidate], best: EffectFit, affords: Callable[[int], bool]
    ) -> list[tuple[Candidate, float, float]]:
        """Limits of the joints that err most on the second record, with the largest values of both records."""
        among = [c for c in who if c.effect.cuts and c not in best.who]
        if not among or not affords(2):
            return []
        peaks = [peaks_of(view, best.effects) for view in (self.first, self.second)]
        out = list[tuple[Candidate, float, float]]()
        for joint in _erring(self.second, best.effects)[:_JOINTS]:
            k = self.second.record.joints.index(joint)
            for candidate in (c for c in among if c.joint == joint):
                low, high = (float(peak[candidate.effect.cuts][k]) for peak in peaks)
                if high > _BEYOND * low > 0.0:
                    out.append((candidate, low, high))
        return out


class _Search:
    """Looks for the limit between two values that leaves least of a record.

    Args:
        view: Residuals on the record.
        effects: Effects beside the limit.
        candidate: The limit.
        low: A value that another record reaches without showing it.
        high: The largest value on this record.
    """

    def __init__(self, view: JointResiduals, effects: Sequence[Applied], candidate: Candidate, low: float, high: float) -> None:
        self.candidate = candidate
        self._view, self._effects, self._low, self._ratio = view, effects, low, high / low
        self._seen: dict[float, float] = {}
        self._step = 1.0 / _LEVELS

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the best limit so far."""
        return self._values(self._best())

    def try_levels(self) -> float:
        """Try a few limits, and return the least squared residual."""
        for k in range(_LEVELS):
            self._try(self._step * (k + 0.5))
        return self._seen[self._best()]

    def halve(self) -> float:
        """Try limits nearer and nearer to the best one, and return the least squared residual."""
        for _ in range(_HALVINGS):
            self._step *= 0.5
            best = self._best()
            for place in (best - self._step, best + self._step):
                self._try(place)
        return self._seen[self._best()]

    def _best(self) -> float:
        return min(self._seen, key=lambda place: self._seen[place])

    def _try(self, place: float) -> None:
        self._seen[place] = _squares(self._view, (*self._effects, self.candidate.applied(self._values(place))))

    def _values(self, place: float) -> dict[str, float]:
        (parameter,) = self.candidate.effect.parameters
        return {parameter.name: 1.0 / (self._low * self._ratio**place)}


def confirmed(third: JointResiduals, effects: Sequence[Applied], late: Sequence[Candidate], rules: Rules) -> bool:
    """Whether the third record shows each effect that was fitted to both others, by more than chance.

    Args:
        third: Residuals on the record `verify`.
        effects: All effects of an explanation.
        late: Candidates among them that were fitted to both others.
        rules: Thresholds.
    """
    whole = third.residual(effects)
    for candidate in late:
        others = [effect for effect in effects if (effect.name, effect.joint) != (candidate.name, candidate.joint)]
        if len(others) < len(effects) and transfer(third.residual(others), whole) <= rules.deviations:
            return False
    return True


def levels(views: Sequence[JointResiduals], effects: Sequence[Applied], who: Candidate) -> list[dict[str, float]]:
    """Parameters of a limit that some of the records pass.

    Args:
        views: Residuals on the records, each of which is simulated once.
        effects: Effects beside the limit.
        who: The limit.
    """
    (parameter,) = who.effect.parameters
    k = views[0].record.joints.index(who.joint)
    peak = max(float(peaks_of(view, effects)[who.effect.cuts][k]) for view in views)
    return [{parameter.name: min(1.0 / (share * peak), parameter.high)} for share in _SHARES] if peak > 0.0 else []


def peaks_of(view: JointResiduals, effects: Sequence[Applied]) -> dict[str, Array]:
    """Largest values on a record of what a limit may cut off. [N] each.

    Args:
        view: The record, which is simulated once.
        effects: Effects in the replay.

    Returns:
        `effort`, what the controller asks of the motors, N m or N, and `command_velocity`, rad/s or m/s.
    """
    record = view.record
    commands = record.commands.get("command", np.zeros((len(record.time), len(record.joints))))
    speeds = np.abs(np.diff(commands, axis=0)) / np.maximum(np.diff(record.time), 1e-9)[:, None]
    efforts = np.abs(view.simulate(effects)["effort"])
    return {"effort": np.nan_to_num(efforts).max(axis=0), "command_velocity": speeds.max(axis=0)}


def nothing_fitted(residual: Array) -> EffectFit:
    """The fit of no effects, which leaves a residual as it is."""
    return EffectFit((), (), float((residual**2).sum()), True, np.zeros(0), 0.0, 0)


def _erring(view: JointResiduals, effects: Sequence[Applied]) -> list[str]:
    """Joints by what effects leave of them, most first."""
    left = (view.residual(effects) ** 2).sum(axis=0)
    joints, sums = view.record.joints, dict[str, float]()
    for (kind, k), value in zip(view.channels, left, strict=True):
        if kind in ("position", "velocity", "effort"):
            sums[joints[k]] = sums.get(joints[k], 0.0) + float(value)
    return sorted(sums, key=lambda joint: -sums[joint])


def _squares(view: JointResiduals, effects: Sequence[Applied]) -> float:
    return float((view.residual(effects) ** 2).sum())
