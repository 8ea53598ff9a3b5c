"""Fit of image effects' parameters to photos, by bounded least squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from gsbridge.gap.diagnosis.results import Candidate, EffectFit
from gsbridge.gap.image.residuals import ImageResiduals
from gsbridge.geometry import Array

_ROUNDS = 30
_STEP = 0.04
"""Step of finite differences, in units of an amplitude's typical size or of a fiftieth of a shape parameter's range."""

_HIDDEN = 1e-2
"""Share of the Jacobian's largest singular value below which a singular direction counts as unobservable."""


class _LostError(Exception):
    """The search is stuck: the images depend on no parameter there, so no step can be computed."""


def fit(
    view: ImageResiduals, who: Sequence[Candidate], starts: Sequence[Mapping[str, float]], rounds: int = _ROUNDS
) -> EffectFit:
    """Fit all parameters of some effects together.

    Args:
        view: Residuals on the photos to fit.
        who: Effects to fit.
        starts: Start parameters of each effect.
        rounds: Largest number of steps.
    """
    parameters = [p for candidate in who for p in candidate.effect.parameters]
    cuts = np.cumsum([len(candidate.effect.parameters) for candidate in who])[:-1]
    low, high = (np.array([getattr(p, side) for p in parameters]) for side in ("low", "high"))
    scale = np.array([p.typical if p.amplitude else 0.02 * (p.high - p.low) for p in parameters])
    begin = np.concatenate([c.vector(values) for c, values in zip(who, starts, strict=True)])
    inside = 1e-3 * (high - low)
    begin = np.clip(begin, low + np.minimum(inside, 0.1 * scale), high - np.minimum(inside, 0.1 * scale))

    def effects(x: Array):  # type: ignore[no-untyped-def]
        return tuple(c.from_vector(part) for c, part in zip(who, np.split(np.clip(x * scale, low, high), cuts), strict=True))

    def residual(x: Array) -> Array:
        if not np.isfinite(x).all():
            raise _LostError
        return view.residual(effects(x)).ravel().astype(np.float64)

    def slopes(x: Array) -> Array:
        here, columns = residual(x), []
        for k in range(len(x)):
            step = _STEP if x[k] * scale[k] + _STEP * scale[k] <= high[k] else -_STEP
            moved = x.copy()
            moved[k] += step
            columns.append((residual(moved) - here) / step)
        if not any(column.any() for column in columns):
            raise _LostError
        return np.stack(columns, axis=1)

    try:
        found = least_squares(
            residual, begin / scale, slopes, bounds=(low / scale, high / scale), x_scale="jac", ftol=1e-6, xtol=1e-4, gtol=None,
            max_nfev=rounds,
        )  # fmt: skip
    except _LostError:
        unknown = np.full(len(scale), np.inf)
        return EffectFit(
            tuple(who), effects(begin / scale), float((residual(begin / scale) ** 2).sum()), False, unknown, 0.0, 1
        )
    slope = np.asarray(found.jac)
    curvature = slope.T @ slope
    size = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    covariance = np.linalg.pinv(curvature * np.outer(size, size), rcond=1e-8) * np.outer(size, size)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
    root = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    spread = np.outer(root, root)
    correlation = float(np.abs(covariance / np.maximum(spread, 1e-300) - np.eye(len(scale))).max()) if len(scale) > 1 else 0.0
    shown = np.linalg.svd(slope, compute_uv=False)
    rank = max(1, int((shown > _HIDDEN * shown[0]).sum()))
    chi2 = 2.0 * float(found.cost)
    return EffectFit(tuple(who), effects(found.x), chi2, found.status > 0, deviations, correlation, rank)
