"""Fitting the parameters of effects to a record: bounded Levenberg-Marquardt, counted in simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.candidates import Candidate
from gsbridge.gap.system import Applied
from gsbridge.gap.view import View
from gsbridge.geometry import Array

_ROUNDS = 12
_HOPE = 5.0
"""Times the last round's gain that a fit may still be expected to gain."""

_STEP = 2e-3
"""Of finite differences, in shares of a parameter's scale."""


@dataclass(frozen=True)
class Fit:
    """Effects with fitted parameters.

    Args:
        who: The candidates.
        effects: With parameters.
        chi2: Squared residual on the fitted record, in units of the noise.
        converged: Whether the last rounds changed nothing, away from bounds that make no sense.
        deviations: Standard deviation of each parameter from the curvature, without allowance for coloured residuals. [P].
        correlation: Largest correlation of two parameters.
    """

    who: tuple[Candidate, ...]
    effects: tuple[Applied, ...]
    chi2: float
    converged: bool
    deviations: Array
    correlation: float


def fit(view: View, who: Sequence[Candidate], start: Sequence[dict[str, float]], bar: float = np.inf) -> Fit:
    """Fit all parameters of some effects together.

    Args:
        view: The record to fit.
        who: Candidates.
        start: Parameters of each to start from.
        bar: Squared residual that a rival has reached: a fit that is not on its way there is given up, unconverged.
    """
    parts = [candidate.vector(values) for candidate, values in zip(who, start, strict=True)]
    cuts = np.cumsum([len(part) for part in parts])[:-1]
    parameters = [p for candidate in who for p in candidate.effect.parameters]
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    x = np.concatenate(parts)
    typical = np.array([p.typical if p.amplitude else max(abs(p.typical), 0.1 * (p.high - p.low)) for p in parameters])
    scale = np.maximum(np.abs(x), 0.02 * typical)

    def effects(vector: Array) -> tuple[Applied, ...]:
        return tuple(c.from_vector(part) for c, part in zip(who, np.split(vector, cuts), strict=True))

    def residual(vector: Array) -> Array:
        return view.residual(effects(vector)).ravel()

    r = residual(x)
    best, damping, settled = float(r @ r), 1e-3, False
    jacobian = np.zeros((len(r), len(x)))
    for number in range(_ROUNDS):
        for k in range(len(x)):
            # Away from the nearer bound.
            h = _STEP * scale[k] * (1.0 if high[k] - x[k] > x[k] - low[k] else -1.0)
            moved = x.copy()
            moved[k] += h
            jacobian[:, k] = (residual(moved) - r) / h
        gradient, curvature = jacobian.T @ r, jacobian.T @ jacobian
        gained = 0.0
        for _ in range(5):
            metric = np.diag(np.maximum(np.diag(curvature), 1e-12 / scale**2))
            step = -np.linalg.solve(curvature + damping * metric, gradient)
            new = np.clip(x + np.clip(step, -3 * scale, 3 * scale), low, high)
            if np.array_equal(new, x):
                break
            r_new = residual(new)
            chi2 = float(r_new @ r_new)
            if chi2 < best:
                gained, x, r, best = best - chi2, new, r_new, chi2
                scale = np.maximum(np.abs(x), 0.02 * typical)
                damping = max(damping * 0.2, 1e-9)
                break
            damping *= 8.0
        if gained < max(0.02, 1e-5 * best):
            settled = True
            break
        if number >= 1 and best - _HOPE * gained > bar:
            break
    curvature = jacobian.T @ jacobian
    covariance = np.linalg.pinv(curvature)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    spread = np.outer(deviations, deviations)
    correlation = np.abs(covariance / np.maximum(spread, 1e-300) - np.eye(len(x))).max() if len(x) > 1 else 0.0
    return Fit(tuple(who), effects(x), best, settled, deviations, float(correlation))


def fit_from(view: View, who: Sequence[Candidate], starts: Sequence[Sequence[dict[str, float]]], bar: float = np.inf) -> Fit:
    """The best of fits from several starts; it counts as converged only if the best one is."""
    found = [fit(view, who, start, bar) for start in starts]
    return min(found, key=lambda item: item.chi2)
