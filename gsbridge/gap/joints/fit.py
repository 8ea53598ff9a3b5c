"""Fitting the parameters of effects to a record: bounded Levenberg-Marquardt that spends few simulations.

The first Jacobian comes from the bank's signatures where they allow it, and is then kept up by Broyden's rank-one updates.
Finite differences are taken only where neither helps, and in `polish`, since intervals come from them.

Source: Broyden, Mathematics of Computation 19, 1965; Levenberg, Quarterly of Applied Mathematics 2, 1944.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate, EffectFit
from gsbridge.gap.joints.coordinates import Coordinates
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.screen import Screen, SignatureMatch
from gsbridge.geometry import Array

_ROUNDS = 12
_SMALL = 0.05
"""Reduction of the squared residual, in units of the noise, that a further step must promise to be worth a simulation."""

_SHARE = 1e-4
"""Share of the squared residual that a further step must promise to remove; the larger of this and `_SMALL` counts."""

_STEP = 5e-3
"""Step of finite differences, in shares of a parameter's scale."""

_UNSURE = 0.2
"""Standard deviation of the time step's error that remains after correction, in multiples of the change by a finer step."""

_REACH = 3.0
"""Longest step of a fit, in scales of the coordinates."""

_MOST = 10
"""Simulations that a fit from signatures may take, plus one and a half for each parameter."""

_SHORTENED = 3
"""How often a step that is no gain once bounds have cut it is tried again with more damping."""

_NOISY = 1.5
"""Mean squared residual, in units of the noise, up to which a fit counts as leaving only noise."""

_HIDDEN = 1e-2
"""Singular value of the scaled Jacobian, as a share of the largest, up to which a direction of the parameters does not show."""


_APART = 0.25
"""Relative difference of two starts in some parameter above which a fit from the second is worth while."""

_OCTAVES = (0.5, 0.25, 0.125, 0.0625)
"""Steps, in doublings, of the search for the best size of an effect with a threshold, before it is fitted."""

_NEARBY = (0.96, 0.98, 1.02, 1.04)
"""Multiples of the fitted size of an effect with a threshold that are tried after a fit, since derivatives may mislead it."""

_NOTHING = 1e-150
"""Squared derivative, in units of the noise, up to which it counts as zero."""


class ReplayedRecords(Protocol):
    """The interface to one or more records that a fit needs; all residual-like arrays of an object have the same shape."""

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that replays the records."""

    @property
    def replays(self) -> int:
        """Number of simulations that one residual takes."""

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Compute measured less simulated, in units of the noise."""

    def stepping(self) -> Array:
        """Compute the change of the nominal replay by another time step, in units of the noise."""

    def stepping_beyond(self, effects: Sequence[Applied]) -> Array:
        """Compute what a vanishing time step changes in a replay with effects, beyond its change of the nominal one."""


class _Problem:
    """Residuals as a function of the fit coordinates of several candidates."""

    def __init__(self, view: ReplayedRecords, who: Sequence[Candidate], weighted: bool = True) -> None:
        self.view, self.who = view, tuple(who)
        self.coordinates = Coordinates(who, weighted)
        self.cuts = np.cumsum([len(candidate.effect.parameters) for candidate in who])[:-1]

    def at(self, values: Sequence[Mapping[str, float]]) -> Array:
        """Convert the candidates' parameters to coordinates. [P]."""
        parts = [candidate.vector(one) for candidate, one in zip(self.who, values, strict=True)]
        return self.coordinates.of(np.concatenate([np.zeros(0), *parts]))

    def effects(self, vector: Array) -> tuple[Applied, ...]:
        if not self.who:
            return ()
        parts = np.split(self.coordinates.parameters(vector), self.cuts)
        return tuple(c.from_vector(part) for c, part in zip(self.who, parts, strict=True))

    @property
    def runs(self) -> int:
        return self.view.mechanism.runs

    def derivatives_afforded(self, limit: float) -> bool:
        """Tell whether simulations for derivatives by all parameters are left, up to `limit` in total."""
        return self.runs + len(self.coordinates) * self.view.replays < limit

    def untouched(self, vector: Array, residual: Array) -> EffectFit:
        """Return a fit that was given up at its start."""
        unsure = np.full(len(vector), np.inf)
        chi2 = float(residual @ residual)
        return EffectFit(self.who, self.effects(vector), chi2, False, unsure, 0.0, len(vector), self.view.replays)

    def residual(self, vector: Array) -> Array:
        return self.view.residual(self.effects(vector)).ravel()

    def difference(self, vector: Array, residual: Array, k: int) -> Array:
        """Compute the derivative by one coordinate, with a step towards the farther bound. [residuals]."""
        low, high = self.coordinates.bounds(vector)
        h = _STEP * self.coordinates.scale(vector)[k] * (1.0 if high[k] - vector[k] > vector[k] - low[k] else -1.0)
        moved = vector.copy()
        moved[k] += h
        return (self.residual(moved) - residual) / h

    def differences(self, vector: Array, residual: Array) -> Array:
        """Compute derivatives by all coordinates. [residuals, P]."""
        return np.stack([self.difference(vector, residual, k) for k in range(len(vector))], axis=1)

    def step(self, vector: Array, residual: Array, jacobian: Array, damping: float) -> tuple[Array, float]:
        """Compute the coordinates after a damped step within the bounds, and the promised reduction of the squared residual."""
        scale, (low, high) = self.coordinates.scale(vector), self.coordinates.bounds(vector)
        gradient, curvature = jacobian.T @ residual, jacobian.T @ jacobian
        free = ~(((vector <= low) & (gradient > 0)) | ((vector >= high) & (gradient < 0)))
        # Parameters that do not show stay where they are.
        shown = np.sqrt(np.diag(curvature)) * scale
        free &= shown > 1e-6 * shown.max()
        move = np.zeros_like(vector)
        for _ in range(len(vector)):
            if not free.any():
                break
            block = curvature[np.ix_(free, free)]
            metric = np.diag(np.maximum(np.diag(block), 1e-12 / scale[free] ** 2))
            move[:] = 0.0
            move[free] = -np.linalg.lstsq(block + damping * metric, gradient[free], rcond=1e-12)[0]
            new = vector + np.clip(move, -_REACH * scale, _REACH * scale)
            out = free & ((new < low) | (new > high))
            if not out.any():
                break
            # Coordinates that hit a bound stay there while the others move on.
            free &= ~(out & ((vector <= low) | (vector >= high)))
            break
        aimed, tried = vector + np.clip(move, -_REACH * scale, _REACH * scale), []
        for kept in (True, False):
            new = self.coordinates.within(aimed, kept)
            moved = new - vector
            tried.append((new, float(-(2 * gradient @ moved + moved @ curvature @ moved))))
        return max(tried, key=lambda one: one[1])


def fit(
    view: ReplayedRecords,
    who: Sequence[Candidate],
    start: Sequence[dict[str, float]],
    bar: float = np.inf,
    screen: Screen | None = None,
    limit: float = np.inf,
    known: Array | None = None,
) -> EffectFit:
    """Fit all parameters of some effects together.

    Args:
        view: The record to fit.
        who: Candidates.
        start: Start parameters of each candidate.
        bar: Squared residual that a rival has reached; a fit that will not come near it is given up, unconverged.
        screen: Signatures on that record, for the first derivatives.
        limit: Total count of the mechanism's simulations at which a fit is given up, unconverged.
        known: Derivatives by the parameters of the first candidates, near the start. [residuals, parameters].
    """
    problem = _Problem(view, who)
    x = problem.at(start)
    if screen is not None:
        # A fit that converges slowly must not use up the simulations of others.
        limit = min(limit, problem.runs + _MOST + 3 * len(x) // 2)
    r = problem.residual(x)
    if screen is None and known is None and not problem.derivatives_afforded(limit):
        return problem.untouched(x, r)
    if known is None:
        jacobian = _first(problem, x, r, start, screen)
    else:
        count = known.shape[1]
        more = [problem.difference(x, r, k)[:, None] for k in range(count, len(x))]
        jacobian = np.concatenate([known @ problem.coordinates.slopes(x)[:count, :count], *more], axis=1)
    return _descend(problem, x, r, jacobian, bar, fresh=screen is None and known is None, limit=limit)


def derivatives(view: ReplayedRecords, fitted: EffectFit) -> Array:
    """Compute derivatives of residuals by the fitted parameters, by finite differences. [residuals, parameters]."""
    problem = _Problem(view, fitted.who, weighted=False)
    x = problem.at(fitted.values)
    return problem.differences(x, problem.residual(x)) if len(x) else np.empty((view.residual().size, 0))


def ordered(view: ReplayedRecords, match: SignatureMatch, affords: Callable[[int], bool]) -> tuple[dict[str, float], ...]:
    """Order the starts of a fit: simulate the first two, if signatures cannot decide between them, and put the better first.

    Args:
        view: The record to fit.
        match: The candidate and its starts.
        affords: Whether a number of simulations is left.
    """
    first, *others = match.starts
    # If signatures of different shape parameters blend, a fit converges from any of the starts.
    if match.candidate.effect.blends or match.candidate.effect.threshold or not others or not affords(4):
        return match.starts
    left = [float((view.residual((match.candidate.applied(values),)) ** 2).sum()) for values in (first, others[0])]
    return match.starts if left[0] <= left[1] else (others[0], first, *others[1:])


def nearer(view: ReplayedRecords, who: Candidate, start: dict[str, float], affords: Callable[[int], bool]) -> dict[str, float]:
    """Search for a better start of an effect with a threshold, since its signature tells nothing of other sizes.

    Args:
        view: The record to fit.
        who: The candidate.
        start: Parameters of its best signature.
        affords: Whether a number of simulations is left.
    """
    if not who.effect.threshold or len(who.effect.parameters) > 1 or not affords(2 * len(_OCTAVES) + 3):
        return start

    def squares(values: dict[str, float]) -> float:
        return float((view.residual((who.applied(values),)) ** 2).sum())

    best, values = squares(start), start
    for step in _OCTAVES:
        for turned in (step, -step):
            # Go on as long as it helps: the true size may be three times that of the smallest visible signature.
            while affords(4):
                tried = who.effect.scaled(values, 2.0**turned)
                if (left := squares(tried)) >= best:
                    break
                best, values = left, tried
    return values


def polish(view: ReplayedRecords, rough: EffectFit, limit: float = np.inf) -> EffectFit:
    """Improve a fit: take derivatives anew where it ended, and make a few more steps.

    Args:
        view: The record to fit.
        rough: The fit to start from.
        limit: Total count of the mechanism's simulations at which a fit is given up, unconverged.
    """
    problem = _Problem(view, rough.who)
    x = problem.at(rough.values)
    r = problem.residual(x)
    jacobian = problem.differences(x, r)
    # Do not stop early for a small gain (`share`): an interval needs an estimate well within a standard deviation of the best.
    return _descend(problem, x, r, jacobian, np.inf, fresh=True, share=0.0, last=True, limit=limit)


def settled(view: ReplayedRecords, fitted: EffectFit, limit: float = np.inf) -> EffectFit:
    """Try slightly smaller and larger sizes of effects with a threshold, where derivatives mislead, and refit from the best.

    Args:
        view: The record to fit.
        fitted: The fit.
        limit: Total count of the mechanism's simulations at which this is given up.
    """
    best, chi2 = fitted.values, float((view.residual(fitted.effects) ** 2).sum())
    for k, candidate in enumerate(fitted.who):
        for factor in _NEARBY if candidate.effect.threshold else ():
            if view.mechanism.runs >= limit:
                return fitted
            values = [*fitted.values[:k], candidate.effect.scaled(fitted.values[k], factor), *fitted.values[k + 1 :]]
            effects = [who.applied(one) for who, one in zip(fitted.who, values, strict=True)]
            left = float((view.residual(effects) ** 2).sum())
            best, chi2 = (tuple(values), left) if left < chi2 else (best, chi2)
    if best == fitted.values:
        return fitted
    again = fit(view, fitted.who, best, limit=limit)
    return again if again.converged and again.chi2 <= chi2 else fitted


def _first(problem: _Problem, x: Array, r: Array, start: Sequence[dict[str, float]], screen: Screen | None) -> Array:
    """Compute derivatives at the start: from signatures, and by differences where these do not give them."""
    if screen is None:
        return problem.differences(x, r)
    columns = np.concatenate([-screen.columns(who, values) for who, values in zip(problem.who, start, strict=True)], axis=1)
    plain = _Problem(problem.view, problem.who, weighted=False)
    for k in np.flatnonzero(np.isnan(columns).any(axis=0)):
        columns[:, k] = plain.difference(plain.at(start), r, int(k))
    return columns @ problem.coordinates.slopes(x)


def _descend(
    problem: _Problem,
    x: Array,
    r: Array,
    jacobian: Array,
    bar: float,
    fresh: bool,
    share: float = _SHARE,
    last: bool = False,
    limit: float = np.inf,
) -> EffectFit:
    """Make steps until none promises more than `_SMALL` and more than `share` of the squared residual.

    The `last` fit also simulates the error of the time step at its end, which limits and dry friction magnify.
    """
    best, damping, settled, failures = float(r @ r), 1e-4, False, 0
    for _ in range(_ROUNDS):
        new, promise = problem.step(x, r, jacobian, damping)
        for _ in range(_SHORTENED):
            if promise >= -max(_SMALL, share * best):
                break
            # Bounds cut a step that was too long, so that it loses: this is no convergence; try a shorter step.
            damping = max(damping, 1e-3) * 20.0
            new, promise = problem.step(x, r, jacobian, damping)
        if promise < max(_SMALL, share * best):
            # Updated derivatives may miss a way down: take them anew, unless only noise is left or a rival is far ahead.
            if fresh or best < _NOISY * len(r) or best > 2.0 * bar or not problem.derivatives_afforded(limit):
                settled = True
                break
            jacobian = problem.differences(x, r)
            fresh = True
            continue
        if best - 1.5 * promise > bar or problem.runs >= limit:
            break
        r_new = problem.residual(new)
        chi2, moved = float(r_new @ r_new), new - x
        scaled = moved / problem.coordinates.scale(x) ** 2
        # Broyden's update: the new derivatives reproduce what the step has changed.
        jacobian = jacobian + np.outer(r_new - r - jacobian @ moved, scaled / (moved @ scaled))
        if chi2 < best:
            won = best - chi2
            x, r, best, damping, failures = new, r_new, chi2, damping * 0.2, 0
            fresh = False
            if won < 0.1 * _SMALL:
                settled = True
                break
        else:
            damping, failures = max(damping, 1e-3) * 20.0, failures + 1
            if failures >= 3:
                if fresh:
                    # At a kink (dry friction, limits), steps may promise a small gain that none achieves: that is convergence.
                    settled = promise < max(20 * _SMALL, 10 * _SHARE * best)
                    break
                if not problem.derivatives_afforded(limit):
                    break
                jacobian = problem.differences(x, r)
                damping, failures, fresh = 1e-3, 0, True
    # Intervals are those of the parameters, not of the coordinates in which the fit moved.
    jacobian = jacobian @ np.linalg.inv(problem.coordinates.slopes(x))
    curvature = jacobian.T @ jacobian
    # A parameter that does not show at all has an infinite deviation.
    hidden = np.diag(curvature) <= _NOTHING
    scale = np.where(hidden, 0.0, 1.0 / np.sqrt(np.maximum(np.diag(curvature), _NOTHING)))
    covariance = np.linalg.pinv(curvature * np.outer(scale, scale), rcond=1e-10) * np.outer(scale, scale)
    # The remaining error of the time step moves the estimates as noise does.
    astray = _UNSURE * covariance @ (jacobian.T @ problem.view.stepping().ravel())
    beyond = covariance @ (jacobian.T @ problem.view.stepping_beyond(problem.effects(x)).ravel()) if last else 0.0
    deviations = np.where(hidden, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0) + astray**2 + beyond**2))
    spread = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    correlation = np.abs(covariance / np.maximum(spread, 1e-300) - np.eye(len(x))).max() if len(x) > 1 else 0.0
    shown = np.linalg.svd(
        jacobian * Coordinates(problem.who, weighted=False).scale(problem.coordinates.parameters(x)), compute_uv=False
    )
    rank = max(1, int((shown > _HIDDEN * shown[0]).sum()))
    known = deviations, float(correlation), rank
    return EffectFit(problem.who, problem.effects(x), best, settled, *known, records=problem.view.replays)


def differ(some: dict[str, float], others: dict[str, float]) -> bool:
    """Tell whether two starts differ enough to be worth a fit each."""
    return any(abs(some[name] - others[name]) > _APART * max(abs(some[name]), abs(others[name])) for name in some)
