"""The residual of a record that a fit has not seen, less what errors of the fitted parameters explain."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import EffectFit
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array


def beside_parameter_error(left: Array, here: Array, there: Array) -> Array:
    """Compute the residual of a record as if the parameters were fitted to it and to the record of the fit together.

    Noise leaves errors in fitted parameters. On another record, which may move faster, such errors show as more than noise,
    although no effect is missing. After a common fit, taken to first order, only noise is left if nothing else is missing.

    Args:
        left: Residual that the fit leaves on the record, in units of the noise. [T, C].
        here: Derivatives of this record's residuals by the parameters. [T C, P].
        there: Derivatives of the residuals of the fitted record, which may have another length. [residuals, P].

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
    """`beside_parameter_error` of fits on another record; results are kept, so that no fit is simulated twice.

    Args:
        view: Residuals on the record: one that no fit has seen, or the second one, which only fits to two records have seen.
        seen: Residuals on the fitted records, in order; a fit to n records has seen the first n.
        derivatives: Function that computes the derivatives of a record's residuals by a fit's parameters.
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
        """Compute the residual, in units of the noise; it is unchanged if the fit has seen the record. [T, C]."""
        seen = self._seen[: fitted.records]
        if any(self._view is view for view in seen):
            return self._view.residual(fitted.effects)
        if id(fitted) not in self._known:
            there = np.concatenate([self._derivatives(view, fitted) for view in seen])
            residual = beside_parameter_error(self._view.residual(fitted.effects), self._derivatives(self._view, fitted), there)
            self._known[id(fitted)] = fitted, residual
        return self._known[id(fitted)][1]

    def runs(self, fitted: EffectFit) -> int:
        """Count the most simulations that a call for this fit takes."""
        return len(fitted.deviations) * (fitted.records + 1)
