"""Residuals of several records joined into one vector, so that one fit serves them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_LARGE = 2.5
"""Multiple of the median residual above which a moment gets less weight, since something else may have happened there."""


@dataclass(frozen=True)
class PooledResiduals:
    """Records of one mechanism as one long row of residuals, in units of each channel's noise.

    Args:
        views: Residuals on each record.
        weights: Factors of the residuals, at most 1; None for 1 throughout. [sum of T C].
    """

    views: tuple[JointResiduals, ...]
    weights: Array | None = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that replays the records."""
        return self.views[0].mechanism

    @property
    def replays(self) -> int:
        """Number of simulations that one residual takes."""
        return len(self.views)

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Compute measured less simulated. [sum of T C]."""
        return self._joined([view.residual(effects) for view in self.views])

    def stepping(self) -> Array:
        """Compute the change of the nominal replays by a finer time step. [sum of T C]."""
        return self._joined([view.stepping() for view in self.views])

    def stepping_beyond(self, effects: Sequence[Applied]) -> Array:
        """Compute what a vanishing time step changes in replays with effects, beyond its change of the nominal ones.

        [sum of T C].
        """
        return self._joined([view.stepping_beyond(effects) for view in self.views])

    def robust(self, effects: Sequence[Applied]) -> PooledResiduals:
        """Give less weight to moments that these effects leave unexplained: an arm that leans on a table, a push.

        A moment whose residual exceeds `_LARGE` times the median is scaled down to the root of its size times that threshold,
        so that its square grows only linearly with its size.

        Source: Huber, Annals of Mathematical Statistics 35, 1964.
        """
        weights = []
        for view in self.views:
            residual = view.residual(effects)
            size = np.linalg.norm(residual, axis=1, keepdims=True)
            factor = np.sqrt(np.minimum(1.0, _LARGE * np.median(size) / np.maximum(size, 1e-300)))
            weights.append(np.broadcast_to(factor, residual.shape))
        return replace(self, weights=np.concatenate([part.ravel() for part in weights]))

    def _joined(self, parts: Sequence[Array]) -> Array:
        row = np.concatenate([part.ravel() for part in parts])
        return row if self.weights is None else self.weights * row

    def parts(self, row: Array) -> list[Array]:
        """Cut a row into records. [sum of T C] -> [T, C] each."""
        pieces = np.split(row, self.edges)
        return [piece.reshape(len(view.record.time), -1) for piece, view in zip(pieces, self.views, strict=True)]

    @property
    def edges(self) -> Array:
        """Indices at which one record ends and the next begins in a stacked residual. [records - 1]."""
        return np.cumsum([len(view.record.time) * len(view.channels) for view in self.views])[:-1]


_NOTHING = 1e-75
"""Length of a column of derivatives, in units of the noise, up to which it counts as zero."""

_MOMENTS = 25
"""Number of blocks of time per record whose residuals are taken to be independent of each other."""


def spread_of(both: PooledResiduals, effects: Sequence[Applied], jacobian: Array) -> Array:
    """Compute standard deviations of a fit's parameters by sandwich estimators, which allow for errors of the model. [P].

    Where a model errs, residuals keep their sign for long and change size with the motion, so that deviations from the
    curvature alone are far too small. The gradient is split into parts that are taken for independent, in two ways. Blocks of
    time show errors that come and go. They miss errors that return with the motion, since a fit leaves little gradient in each
    block then; frequencies, taken with random phases, show those. The largest estimate of each parameter counts.

    Args:
        both: The fitted records.
        effects: Fitted effects with their parameters.
        jacobian: Derivatives of the residuals by these parameters. [sum of T C, P].

    Source: White, Econometrica 50, 1982; in blocks of time after Newey and West, Econometrica 55, 1987; in frequencies after
        Grenander and Rosenblatt, Statistical Analysis of Stationary Time Series, 1957.
    """
    residual = both.residual(effects)
    sizes = np.linalg.norm(jacobian, axis=0)
    hidden = sizes <= _NOTHING
    scale = np.where(hidden, 0.0, 1.0 / np.maximum(sizes, _NOTHING))
    curvature = np.linalg.pinv((jacobian * scale).T @ (jacobian * scale), rcond=1e-10)
    moments, lines = list[Array](), list[Array]()
    for view, shapes, left in zip(
        both.views, np.split(jacobian * scale, both.edges), np.split(residual, both.edges), strict=True
    ):
        shapes, left = (values.reshape(len(view.record.time), len(view.channels), -1) for values in (shapes, left))
        pulls, length = (shapes * left).sum(axis=1), max(1, len(left) // _MOMENTS)
        moments += [pulls[k : k + length].sum(axis=0) for k in range(0, len(pulls), length)]
        # Channels are summed at each frequency, since they share one motion. The sum over all frequencies is the gradient.
        moved, left = np.fft.fft(shapes, axis=0), np.fft.fft(left, axis=0)
        lines += list((moved.conj() * left).sum(axis=1) / len(left))
    meats = [np.real(np.stack(parts).T @ np.stack(parts).conj()) for parts in (moments, lines)]
    variances = [np.diag(curvature @ meat @ curvature) for meat in meats]
    # A parameter that does not show at all has an infinite deviation.
    return np.where(hidden, np.inf, np.sqrt(np.maximum.reduce([*variances, np.diag(curvature), np.zeros(len(sizes))])) * scale)
