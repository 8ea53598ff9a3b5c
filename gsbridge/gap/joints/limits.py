"""Limits that one record reaches and another does not: of a motor's torque, or of how fast a command may change.

A motor below its limit shows nothing of it. If `fit` holds slow motions and `select` faster ones, a limit shows in the residual
of `select` alone. It is then fitted to both records, and must show on the third record, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Rules
from gsbridge.gap.diagnosis.verdict import transfer
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_JOINTS = 2
"""Number of joints whose limits are tried: those with the largest residuals."""

_LEVELS, _HALVINGS = 4, 3
"""Number of limits that are tried between the largest values of two records, and how often their distance is then halved."""

_SHARES = (0.95, 0.88, 0.8, 0.7, 0.6, 0.5, 0.25, 0.12, 0.06, 0.03)
"""Limits that are tried beside an explanation, as shares of the largest value on the records. They reach far down, since a
command that jumps has a speed far above any limit."""

_LOWEST = 0.05
"""Least value, as a share of that on the second record, that a joint is taken to reach on the first, even if it rests there."""

_FITTED = 2
"""Number of limits that are fitted: those that leave the smallest residual."""

_NEARLY = 2.0
"""Multiple of the best limit's squared residual up to which a second limit is fitted, too."""

_BEYOND = 1.02
"""Ratio of the largest values of two records above which a limit may lie between them."""

_MORE = 3.0
"""Ratio of the excess over the noise on the second record to that on the first, above which the second shows clearly more."""


def shows_more(first: JointResiduals, second: JointResiduals, effects: Sequence[Applied], floors: tuple[float, float]) -> bool:
    """Tell whether effects leave clearly more on the second record than on the first, relative to the noise of each.

    Args:
        first: Residuals on one record.
        second: Residuals on another.
        effects: The effects.
        floors: Squared residual of noise alone on each record.
    """
    one, other = (_squares(view, effects) / floor - 1.0 for view, floor in zip((first, second), floors, strict=True))
    return other > _MORE * max(one, 0.0)


def limits_beside(
    first: JointResiduals,
    second: JointResiduals,
    who: Sequence[Candidate],
    effects: Sequence[Applied],
    gain: float,
    affords: Callable[[int], bool],
) -> Iterator[tuple[Candidate, dict[str, float]]]:
    """Find limits that the second record reaches and the first does not, with parameters to start from, the best first.

    Args:
        first: Residuals on one record.
        second: Residuals on another.
        who: Candidates.
        effects: Effects that are known already.
        gain: Least reduction of the squared residual on the second record.
        affords: Whether a number of simulations is left.

    Yields:
        A limit and its parameters.
    """
    plain, found = _squares(second, effects), list[tuple[float, _Search]]()
    for candidate, low, high in _passed(first, second, who, effects, affords):
        if affords(_LEVELS):
            search = _Search(second, effects, candidate, low, high)
            found.append((search.try_levels(), search))
    found.sort(key=lambda item: item[0])
    fit = 6 * (1 + sum(len(effect.parameters) for effect in effects))
    least = np.inf
    for left, search in found[:_FITTED]:
        if left < _NEARLY * least and affords(2 * _HALVINGS + fit) and plain - search.halve() >= gain:
            least = min(least, left)
            yield search.candidate, search.values


def _passed(
    first: JointResiduals,
    second: JointResiduals,
    who: Sequence[Candidate],
    effects: Sequence[Applied],
    affords: Callable[[int], bool],
) -> list[tuple[Candidate, float, float]]:
    """List limits of the joints with the largest residuals on the second record, with the largest values of both records."""
    known = {(effect.name, effect.joint) for effect in effects}
    among = [c for c in who if c.effect.cuts and (c.name, c.joint) not in known]
    if not among or not affords(2):
        return []
    peaks = [peaks_of(view, effects) for view in (first, second)]
    out = list[tuple[Candidate, float, float]]()
    for candidate in among:
        k = second.record.joints.index(candidate.joint)
        low, high = (float(peak[candidate.effect.cuts][k]) for peak in peaks)
        if high > _BEYOND * low:
            out.append((candidate, max(low, _LOWEST * high), high))
    # If no channel belongs to a joint, try the joints whose values exceed those of the first record by the largest ratio.
    beyond = sorted(out, key=lambda item: -item[2] / item[1])
    joints = [*_erring(second, effects), *(candidate.joint for candidate, _, _ in beyond)]
    tried = list(dict.fromkeys(joints))[:_JOINTS]
    return sorted((item for item in out if item[0].joint in tried), key=lambda item: tried.index(item[0].joint))


class _Search:
    """Search, between two values, for the limit that leaves the smallest residual on a record.

    Args:
        view: Residuals on the record.
        effects: Effects beside the limit.
        candidate: The limit.
        low: Value that another record reaches without showing the limit.
        high: Largest value on this record.
    """

    def __init__(self, view: JointResiduals, effects: Sequence[Applied], candidate: Candidate, low: float, high: float) -> None:
        self.candidate = candidate
        self._view, self._effects, self._low, self._ratio = view, effects, low, high / low
        self._seen: dict[float, float] = {}
        self._step = 1.0 / _LEVELS

    @property
    def values(self) -> dict[str, float]:
        """The parameters of the best limit so far."""
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
                self._try(min(max(place, 0.0), 1.0))
        return self._seen[self._best()]

    def _best(self) -> float:
        return min(self._seen, key=lambda place: self._seen[place])

    def _try(self, place: float) -> None:
        self._seen[place] = _squares(self._view, (*self._effects, self.candidate.applied(self._values(place))))

    def _values(self, place: float) -> dict[str, float]:
        (parameter,) = self.candidate.effect.parameters
        return {parameter.name: min(1.0 / (self._low * self._ratio**place), parameter.high)}


def shown_by(third: JointResiduals, whole: EffectFit, without: Sequence[Applied], rules: Rules) -> bool:
    """Tell whether the third record shows, by more than chance, an effect that was fitted to both others.

    Args:
        third: Residuals on the record `verify`.
        whole: The fit with the effect.
        without: Effects of an explanation without it.
        rules: Thresholds.
    """
    return transfer(third.residual(without), third.residual(whole.effects)) > rules.deviations


def levels(views: Sequence[JointResiduals], effects: Sequence[Applied], who: Candidate) -> list[dict[str, float]]:
    """List parameters at which a limit is tried: shares of the largest value on the records; none if nothing moves.

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
    """Find the largest values on a record of the quantities that a limit may cut off. [N] each.

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


def nothing_fitted(residual: Array, records: int = 1) -> EffectFit:
    """Return the fit of no effects, which leaves a residual unchanged.

    Args:
        residual: Residual, in units of the noise. [T, C].
        records: Number of records to which the fits were made with which this one is compared.
    """
    return EffectFit((), (), float((residual**2).sum()), True, np.zeros(0), 0.0, 0, records)


def _erring(view: JointResiduals, effects: Sequence[Applied]) -> list[str]:
    """Order joints by the squared residual that effects leave on their channels, largest first."""
    left = (view.residual(effects) ** 2).sum(axis=0)
    joints, sums = view.record.joints, dict[str, float]()
    for (kind, k), value in zip(view.channels, left, strict=True):
        if kind in ("position", "velocity", "effort"):
            sums[joints[k]] = sums.get(joints[k], 0.0) + float(value)
    return sorted(sums, key=lambda joint: -sums[joint])


def _squares(view: JointResiduals, effects: Sequence[Applied]) -> float:
    return float((view.residual(effects) ** 2).sum())
