"""How far records disagree about the sizes of effects: what a law that is not quite the machine's adds to an interval.

One record tells a size as well as its noise lets it, if the law is right. Where it is not, another motion tells another size,
and neither residuals nor their curvature need show it. Three records are few to tell how far they disagree: an interval that
rests on that is wider than one of the same deviation that rests on noise.
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
"""Share of what chance lets records disagree that is allowed once more where one of them was fitted: its own error then widens
its own interval. With this, 88 to 95 % of the intervals hold whatever the scatter is."""


@dataclass(frozen=True)
class RecordSizes:
    """What each record alone says of the parameters of a fit.

    Args:
        values: Parameters. [records, P].
        deviations: Standard deviation of each by its record; infinite where the record tells nothing. [records, P].
    """

    values: Array
    deviations: Array

    @classmethod
    def of(cls, views: Sequence[JointResiduals], fitted: EffectFit) -> RecordSizes:
        """Fit each record apart.

        Args:
            views: Residuals on all records.
            fitted: A fit, from which each record's own begins.
        """
        values, deviations = list[Array](), list[Array]()
        for view in views:
            # Of what begins at a threshold, slopes alone would leave each record where the common fit has it.
            found = settled(view, polish(view, fitted))
            values.append(
                np.concatenate([who.vector(one) for who, one in zip(found.who, found.values, strict=True)] or [np.zeros(0)])
            )
            wide = max(1.0, float(np.sqrt(found.chi2 / view.freedom)))
            deviations.append(wide * found.deviations)
        return cls(np.stack(values), np.stack(deviations))

    @property
    def told(self) -> Array:
        """How many records tell each parameter. [P]."""
        return np.isfinite(self.deviations).sum(axis=0)

    def scatter(self, chance: float = 0.0) -> Array:
        """Standard deviation of each parameter from record to record, beyond what the deviations of each explain. [P].

        Args:
            chance: Share of what they explain that is allowed once more.

        Source: DerSimonian and Laird, Controlled Clinical Trials 7, 1986, of records with equal weights.
        """
        told, count = np.isfinite(self.deviations), self.told
        squares = np.where(told, np.square(np.where(told, self.deviations, 0.0)), 0.0)
        middle = np.where(told, self.values, 0.0).sum(axis=0) / np.maximum(count, 1)
        apart = np.where(told, (self.values - middle) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
        return np.sqrt(np.maximum(apart - (1.0 + chance) * squares.sum(axis=0) / np.maximum(count, 1), 0.0))

    def alone(self, count: int) -> Array:
        """Share of the variance between records that is left in a fit to the first few of them together. [P].

        Such a fit is their mean with the inverse of their variances as weights: one that all but one record decide nothing of
        averages nothing.

        Args:
            count: How many records were fitted.
        """
        weights = np.divide(1.0, np.square(self.deviations[:count]), where=self.deviations[:count] > 0.0,
                            out=np.zeros_like(self.deviations[:count]))  # fmt: skip
        total = weights.sum(axis=0)
        return np.where(total > 0.0, np.square(weights).sum(axis=0) / np.maximum(np.square(total), 1e-300), 1.0)


def widened(deviations: Array, sizes: RecordSizes, count: int) -> Array:
    """Standard deviations of a fit that know how far records disagree, and how little three records say of that. [P].

    They belong to normal laws with the same 90 % intervals as the Student laws that hold.

    Args:
        deviations: Of the fit, from what it was fitted to. [P].
        sizes: What each record says.
        count: How many of the first records were fitted together.

    Source: Hartung and Knapp, Statistics in Medicine 20, 2001; degrees of freedom of a sum of variances after Satterthwaite,
        Biometrics Bulletin 2, 1946.
    """
    between = np.square(sizes.scatter(_CHANCE if count == 1 else 0.0)) * sizes.alone(count)
    whole = np.square(deviations) + between
    share = np.divide(between, whole, where=np.isfinite(whole) & (whole > 0.0), out=np.zeros_like(whole))
    freedom = np.maximum(sizes.told - 1, 1) / np.maximum(np.square(share), 1e-12)
    return np.asarray(np.sqrt(whole) * student.isf(_TAIL, freedom) / norm.isf(_TAIL))
