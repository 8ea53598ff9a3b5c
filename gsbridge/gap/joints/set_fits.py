"""Fits of sets of effects to one record, or to two where the first shows nothing of one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate, EffectFit
from gsbridge.gap.joints.fit import fit, polish
from gsbridge.gap.joints.limits import nothing_fitted
from gsbridge.gap.joints.pooled import PooledResiduals
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen


@dataclass
class SetFits:
    """Fits of sets of effects to `fit`, or to `select`, too, where `fit` shows nothing of one of the effects.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        screen: Signatures on `fit`.
        late: Effects that were found although `fit` shows nothing of them.
    """

    first: JointResiduals
    second: JointResiduals
    screen: Screen
    late: set[Candidate] = field(default_factory=set)

    def fit(
        self,
        who: Sequence[Candidate],
        starts: Sequence[dict[str, float]],
        bar: float = np.inf,
        limit: float = np.inf,
        near: bool = False,
        both: bool = False,
    ) -> EffectFit:
        """Fit all parameters together, as `fit` does; the fit's squared residual is that of the first record.

        Args:
            who: Candidates.
            starts: Parameters of each to start from.
            bar: Squared residual that a rival has reached: on the first record, or on both where `both` asks for them.
            limit: Simulations at which the fit is given up.
            near: Whether the starts are near the end, so that derivatives of their own are worth their simulations.
            both: Whether they are fitted to both records in any case, to be compared with a fit that is.
        """
        if not both and not self.late & set(who):
            return fit(self.first, who, starts, bar, None if near else self.screen, limit)
        if not who:
            return nothing_fitted(self.first.residual(), 2)
        return self._as_on_first(fit(self._both, who, starts, bar if both else np.inf, limit=limit))

    def polish(self, rough: EffectFit, limit: float = np.inf) -> EffectFit:
        """Improve a fit, as `polish` does."""
        if rough.records == 1:
            return polish(self.first, rough, limit)
        return self._as_on_first(polish(self._both, rough, limit))

    @property
    def _both(self) -> PooledResiduals:
        return PooledResiduals((self.first, self.second))

    def _as_on_first(self, fitted: EffectFit) -> EffectFit:
        return replace(fitted, chi2=float((self.first.residual(fitted.effects) ** 2).sum()))
