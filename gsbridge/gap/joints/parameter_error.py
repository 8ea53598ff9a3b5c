"""What is left of a record that a fit has not seen, but for the error that noise has left in the fit's parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import EffectFit
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array


def beside_parameter_error(left: Array, here: Array, there: Array) -> Array:
    """The residual of a record with the parameters on which it and the record of the fit agree best.

    Parameters are as unsure as the noise of the record that they were fitted to makes them. On another record, which may move
    faster, that error shows as something that is no noise, although nothing is missing. To first order, parameters of both
    records together leave noise alone where nothing else is missing.

    Args:
        left: What the fit leaves of the record, in units of the noise. [T, C].
        here: Derivatives of the record's residuals by the parameters. [T C, P].
        there: The same of the record of the fit, whose residuals may be of another number. [residuals, P].

    Returns:
        Measured less simulated, in units of the noise. [T, C].
    """
    curvature = here.T @ here + there.T @ there
    # Parameters differ by orders of magnitude; one that does not show on either record stays where it is.
    sizes = np.sqrt(np.diag(curvature))
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    inverse = np.linalg.pinv(curvature * np.outer(scale, scale), rcond=1e-10) * np.outer(scale, scale)
    moved = left.ravel() - here @ (inverse @ (here.T @ left.ravel()))
    return moved.reshape(left.shape)


class BesideParameterError:
    """`beside_parameter_error` of fits on another record; what was asked before is not simulated again.

    Args:
        view: The record: one that no fit has seen, or the second one, which only fits to two records have seen.
        seen: The records that fits have seen: all have seen the first one, those to two records the first two.
        derivatives: Derivatives of a record's residuals by a fit's parameters.
    """

    def __init__(
        self,
        view: JointResiduals,
        seen: Sequence[JointResiduals],
        derivatives: Callable[[JointResiduals, EffectFit], Array],
    ) -> None:
        self._view, self._seen, self._derivatives = view, tuple(seen), derivatives
        self._known: dict[int, tuple[EffectFit, Array]] = {}

    def __call__(self, fitted: EffectFit) -> Array:
        """The residual, in units of the noise; as it is where the fit has seen the record. [T, C]."""
        seen = self._seen[: fitted.records]
        if any(self._view is view for view in seen):
            return self._view.residual(fitted.effects)
        if id(fitted) not in self._known:
            there = np.concatenate([self._derivatives(view, fitted) for view in seen])
            residual = beside_parameter_error(self._view.residual(fitted.effects), self._derivatives(self._view, fitted), there)
            self._known[id(fitted)] = fitted, residual
        return self._known[id(fitted)][1]

    def runs(self, fitted: EffectFit) -> int:
        """Most simulations that asking takes."""
        return len(fitted.deviations) * (fitted.records + 1)
