"""What the third record says of an explanation. It had no part in fitting or choosing, but for limits that `fit` never reaches,
of which it must show something, too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import EffectFit, Verification
from gsbridge.gap.joints.candidates import closed_beside_knocks
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.fit import ReplayedRecords, derivatives
from gsbridge.gap.joints.parameter_error import beside_parameter_error
from gsbridge.gap.joints.residuals import JointResiduals


def verify(
    view: JointResiduals,
    effects: Sequence[Applied],
    rng: np.random.Generator,
    fitted: tuple[ReplayedRecords, EffectFit] | None = None,
    alarm: float = 0.0,
) -> Verification:
    """Replay a record with and without effects; sizes are root mean squares in units of the noise (1 is noise alone).

    Args:
        view: Residuals of a record that was not fitted.
        effects: What was found.
        rng: Random numbers for effect-free replicates.
        fitted: The records of the fit, and the fit: what the error of its parameters leaves is then no alarm.
        alarm: p-value below which a discrepancy counts.
    """
    sizes, plain, residual = [], view.residual(), np.zeros(0)
    for added in ((), tuple(effects)):
        residual = view.residual(added)
        sizes.append((float(np.sqrt((residual**2).sum() / view.freedom)), np.sqrt((residual**2).sum(axis=0) / view.count)))
    (before, rows_before), (after, rows_after) = sizes
    gap, left = np.sqrt(max(before**2 - 1.0, 1e-12)), np.sqrt(max(after**2 - 1.0, 0.0))
    names = [view.record.label(kind, k) for kind, k in view.channels]
    channels = {name: (float(a), float(b)) for name, a, b in zip(names, rows_before, rows_after, strict=True)}
    null = joint_null(view, rng)
    p_remaining = null.p_value(residual)
    if fitted is not None and p_remaining < alarm:
        here, there = (derivatives(one, fitted[1]) for one in (view, fitted[0]))
        p_remaining = max(p_remaining, null.p_value(beside_parameter_error(residual, here, there)))
    mostly = closed_beside_knocks(effects, plain, residual, null.share)
    return Verification(before, after, float(1.0 - left / gap), channels, after <= before, p_remaining, mostly)
