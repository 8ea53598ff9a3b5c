"""What is left of a record that a fit has not seen, but for the error that noise has left in the fit's parameters."""

from __future__ import annotations

import numpy as np

from gsbridge.gap.diagnosis.results import EffectFit
from gsbridge.gap.joints.fit import derivatives
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array


def beside_parameter_error(view: JointResiduals, seen: JointResiduals, fitted: EffectFit) -> Array:
    """The residual of a record with the parameters on which it and the record of the fit agree best.

    Parameters are as unsure as the noise of the record that they were fitted to makes them. On another record, which may move
    faster, that error shows as something that is no noise, although nothing is missing. To first order, parameters of both
    records together leave noise alone where nothing else is missing.

    Args:
        view: The record, which the fit has not seen.
        seen: The record of the fit.
        fitted: The fit.

    Returns:
        Measured less simulated, in units of the noise. [T, C].
    """
    left = view.residual(fitted.effects)
    here, there = derivatives(view, fitted), derivatives(seen, fitted)
    curvature = here.T @ here + there.T @ there
    # Parameters differ by orders of magnitude; one that does not show on either record stays where it is.
    sizes = np.sqrt(np.diag(curvature))
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    inverse = np.linalg.pinv(curvature * np.outer(scale, scale), rcond=1e-10) * np.outer(scale, scale)
    moved = left.ravel() - here @ (inverse @ (here.T @ left.ravel()))
    return moved.reshape(left.shape)
