"""Disagreement of records about the parameters of effects, which widens their intervals where the law is not quite right.

If the law of an effect is right, the noise of a record alone limits how well it determines a parameter. If the law is not quite
the machine's, another motion gives another value, which neither residuals nor their curvature need show. The disagreement is
estimated from three records only, so that an interval that rests on it is wider (Student's law) than one that rests on noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from gsbridge.gap.diagnosis.results import EffectFit
from gsbridge.gap.joints.fit import polish, settled
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_TAIL = 0.05
"""Probability beyond each end of a 90 % interval."""

_CHANCE = 0.6
"""Additional share of the records' own variances that is taken off their scatter if a fit is to one record, whose own error
widens the interval already. With this, 88 to 95 % of the 90 % intervals hold the true value, whatever the scatter."""


@dataclass(frozen=True)
class RecordSizes:
    """Parameters of a fit as each record alone determines them.

    Args:
        values: Parameters. [records, P].
        deviations: Standard deviation of each parameter; infinite where a record tells nothing of it. [records, P].
    """

    values: Array
    deviations: Array

    @classmethod
    def of(cls, views: Sequence[JointResiduals], fitted: EffectFit) -> RecordSizes:
        """Fit each record alone.

        Args:
            views: Residuals on all records.
            fitted: Fit whose parameters each record's own fit starts from.
        """
        values, deviations = list[Array](), list[Array]()
        for view in views:
            # For effects with a threshold, derivatives alone would leave each record at the common fit; `settled` tries others.
            found = settled(view, polish(view, fitted))
            values.append(
                np.concatenate([who.vector(one) for who, one in zip(found.who, found.values, strict=True)] or [np.zeros(0)])
            )
            wide = max(1.0, float(np.sqrt(found.chi2 / view.freedom)))
            deviations.append(wide * found.deviations)
        return cls(np.stack(values), np.stack(deviations))

    @property
    def told(self) -> Array:
        """Number of records that determine each parameter. [P]."""
        return np.isfinite(self.deviations).sum(axis=0)

    def scatter(self, chance: float = 0.0) -> Array:
        """Compute the standard deviation of each parameter between records, beyond the records' own deviations. [P].

        Args:
            chance: Additional share of the records' own variances that is taken off.

        Source: DerSimonian and Laird, Controlled Clinical Trials 7, 1986, for records with equal weights.
        """
        told, count = np.isfinite(self.deviations), self.told
        squares = np.where(told, np.square(np.where(told, self.deviations, 0.0)), 0.0)
        middle = np.where(told, self.values, 0.0).sum(axis=0) / np.maximum(count, 1)
        apart = np.where(told, (self.values - middle) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
        return np.sqrt(np.maximum(apart - (1.0 + chance) * squares.sum(axis=0) / np.maximum(count, 1), 0.0))

    def alone(self, count: int) -> Array:
        """Compute the share of the variance between records that remains in a fit to the first of them together. [P].

        Such a fit is the mean of the records with inverse variances as weights. If one record alone determines a parameter,
        nothing is averaged, and the share is 1.

        Args:
            count: Number of records that were fitted together.
        """
        weights = np.divide(1.0, np.square(self.deviations[:count]), where=self.deviations[:count] > 0.0,
                            out=np.zeros_like(self.deviations[:count]))  # fmt: skip
        total = weights.sum(axis=0)
        return np.where(total > 0.0, np.square(weights).sum(axis=0) / np.maximum(np.square(total), 1e-300), 1.0)


def widened(deviations: Array, sizes: RecordSizes, count: int) -> Array:
    """Widen standard deviations of a fit by how far records disagree, and by how few records show that. [P].

    The true errors follow Student's law. The result is the deviation of the normal law with the same 90 % interval.

    Args:
        deviations: Standard deviations of the fit, from the fitted records alone. [P].
        sizes: Parameters as each record alone determines them.
        count: Number of records, from the first, that were fitted together.

    Source: Hartung and Knapp, Statistics in Medicine 20, 2001; degrees of freedom of a sum of variances after Satterthwaite,
        Biometrics Bulletin 2, 1946.
    """
    between = np.square(sizes.scatter(_CHANCE if count == 1 else 0.0)) * sizes.alone(count)
    whole = np.square(deviations) + between
    share = np.divide(between, whole, where=np.isfinite(whole) & (whole > 0.0), out=np.zeros_like(whole))
    freedom = np.maximum(sizes.told - 1, 1) / np.maximum(np.square(share), 1e-12)
    return np.asarray(np.sqrt(whole) * student.isf(_TAIL, freedom) / norm.isf(_TAIL))
