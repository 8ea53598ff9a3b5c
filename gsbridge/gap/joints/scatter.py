"""How far records disagree about the sizes of effects: what a law that is not quite the machine's adds to an interval.

One record tells a size as well as its noise lets it, if the law is right. Where it is not, another motion tells another size,
and neither residuals nor their curvature need show it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import EffectFit
from gsbridge.gap.joints.fit import polish, settled
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array


def scatter_between(views: Sequence[JointResiduals], fitted: EffectFit) -> Array:
    """Standard deviation of each parameter from record to record, beyond what the deviations of each explain. [P].

    Args:
        views: Residuals on all records.
        fitted: A fit, from which each record's own begins.

    Source: DerSimonian and Laird, Controlled Clinical Trials 7, 1986, of records with equal weights.
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
    told = np.isfinite(np.stack(deviations))
    squares = np.where(told, np.square(np.where(told, np.stack(deviations), 0.0)), 0.0)
    count = told.sum(axis=0)
    middle = np.where(told, np.stack(values), 0.0).sum(axis=0) / np.maximum(count, 1)
    apart = np.where(told, (np.stack(values) - middle) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    return np.sqrt(np.maximum(apart - squares.sum(axis=0) / np.maximum(count, 1), 0.0))
