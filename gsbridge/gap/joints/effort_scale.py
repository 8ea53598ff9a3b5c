"""Test whether the gap comes from the scale of the logged efforts: a wrong torque constant or a wrong unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.results import Finding
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_HALF = 0.5
"""Share of the gap's squares that may be left, with other scales, for them to be reported."""

_SLIGHT = 0.01
"""Largest deviation of a scale from 1 that is not reported."""


@dataclass(frozen=True)
class EffortScale:
    """The gap of the model without effects, with a fitted scale of the efforts for each joint.

    Args:
        scales: Ratio of logged to simulated effort, by joint.
        before: Squared residual of all records as they are logged.
        after: Squared residual with these scales.
        freedom: Degrees of freedom of the residuals.
    """

    scales: dict[str, float]
    before: float
    after: float
    freedom: int

    def rivals(self, finding: Finding) -> bool:
        """Tell whether the scales close most of the gap and explain as much as the best effects."""
        best = finding.best
        better = self.after - self.freedom < _HALF * (self.before - self.freedom)
        return better and best is not None and self.after <= best.chi2 + float((best.first**2).sum())

    @property
    def sentence(self) -> str:
        """A sentence for the reader."""
        sizes = [(squares / self.freedom) ** 0.5 for squares in (self.before, self.after)]
        listed = ", ".join(f"{joint} {scale:.3g}" for joint, scale in self.scales.items() if abs(scale - 1.0) > _SLIGHT)
        turned = [joint for joint, scale in self.scales.items() if scale < 0.0]
        check = f"turn the sign of the efforts of {', '.join(turned)}, and " if turned else ""
        return (
            f"Efforts are logged in another scale than the model has: logged by simulated are {listed}. With these scales "
            f"{plain(sizes[1])} instead of {plain(sizes[0])} times the noise remain without any effect, which none explains "
            f"better: {check}check the unit of the efforts, and 'torque_per_ampere' where they come from currents."
        )


def effort_scale(views: Sequence[JointResiduals]) -> EffortScale | None:
    """Fit a scale of the efforts to each joint, for the model without effects; None if no efforts are logged.

    Args:
        views: Residuals on records of one mechanism.
    """
    columns = [number for number, (kind, _) in enumerate(views[0].channels) if kind == "effort"]
    if not columns:
        return None
    logged, simulated = [view.stack(view.record.measured) for view in views], [view.replay() for view in views]

    def sums(rows: Sequence[Array], others: Sequence[Array]) -> Array:
        products = [np.nan_to_num(a[:, columns] * b[:, columns]).sum(axis=0) for a, b in zip(rows, others, strict=True)]
        return np.asarray(np.sum(products, axis=0))

    scales = np.ones(len(views[0].channels))
    scales[columns] = sums(logged, simulated) / np.maximum(sums(simulated, simulated), 1e-300)
    before = sum(float((view.residual() ** 2).sum()) for view in views)
    moved = [view.whiten(a - scales * b) for view, a, b in zip(views, logged, simulated, strict=True)]
    joints = views[0].record.joints
    named = {joints[views[0].channels[number][1]]: float(scales[number]) for number in columns}
    return EffortScale(named, before, sum(float((row**2).sum()) for row in moved), sum(view.freedom for view in views))
