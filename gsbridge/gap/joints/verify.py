"""The gap on a record that neither fitting nor choosing has seen, before and after adding effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Rules
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.residuals import JointResiduals

PART = 0.5
"""Share of the gap that a name must close on the record that it has not seen."""

_SLIGHT = 1.1
"""Residual, in units of the noise, below which the third record hardly shows the gap and cannot refute a name."""


@dataclass(frozen=True)
class Verification:
    """Residuals on `verify`, root mean square in units of the noise (1 is noise alone).

    Args:
        before: Without the effects.
        after: With them.
        closure: Share of the gap above the noise that they close; negative if they make it worse.
        channels: Before and after of each channel.
        accepted: Whether the amended model is no worse.
        p_remaining: Of the hypothesis that they leave nothing but noise there.
    """

    before: float
    after: float
    closure: float
    channels: dict[str, tuple[float, float]]
    accepted: bool
    p_remaining: float = 1.0

    def transfers(self, rules: Rules) -> bool:
        """Whether the record does not refute the effects.

        They close a good part of a gap that stands out, and leave noise alone or a little more.

        Args:
            rules: Thresholds.
        """
        if self.before >= _SLIGHT and self.closure < PART:
            return False
        return self.p_remaining >= rules.alarm or self.closure >= rules.closure


def verify(view: JointResiduals, effects: Sequence[Applied], rng: np.random.Generator) -> Verification:
    """Replay a record with and without effects.

    Args:
        view: Of a record neither fitted nor used to choose.
        effects: What was found.
        rng: Of effect-free replicates.
    """
    sizes, residual = [], np.zeros(0)
    for added in ((), tuple(effects)):
        residual = view.residual(added)
        sizes.append((float(np.sqrt((residual**2).sum() / view.freedom)), np.sqrt((residual**2).mean(axis=0))))
    (before, rows_before), (after, rows_after) = sizes
    gap, left = np.sqrt(max(before**2 - 1.0, 1e-12)), np.sqrt(max(after**2 - 1.0, 0.0))
    names = [view.record.label(kind, k) for kind, k in view.channels]
    channels = {name: (float(a), float(b)) for name, a, b in zip(names, rows_before, rows_after, strict=True)}
    p_remaining = joint_null(view, rng).p_value(residual)
    return Verification(before, after, float(1.0 - left / gap), channels, after <= before, p_remaining)
