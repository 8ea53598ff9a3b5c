"""Verification of an explanation on the third record.

This record has no part in fitting or choosing, except that a limit which `fit` never reaches must show on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Finding, Hypothesis, Rules, Verification
from gsbridge.gap.diagnosis.verdict import third_opinion
from gsbridge.gap.joints.candidates import closed_beside_knocks
from gsbridge.gap.joints.detect import joint_null
from gsbridge.gap.joints.fit import derivatives
from gsbridge.gap.joints.parameter_error import BesideParameterError
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array


def verify(
    view: JointResiduals,
    effects: Sequence[Applied],
    rng: np.random.Generator,
    beside: Callable[[], Array] | None = None,
    alarm: float = 0.0,
) -> Verification:
    """Replay a record with and without effects; sizes are root mean squares in units of the noise (1 is noise alone).

    Args:
        view: Residuals on a record that was not fitted.
        effects: Effects that were found.
        rng: Random numbers for replicates without effects.
        beside: Function that computes the residual less what errors of the parameters explain, [T, C]; called only if the
            residual as it is would raise an alarm. None to allow for no such errors.
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
    if beside is not None and p_remaining < alarm:
        p_remaining = max(p_remaining, null.p_value(beside()))
    mostly = closed_beside_knocks(effects, plain, residual, null.share)
    chance = float(np.sqrt(2.0 / view.freedom))
    return Verification(before, after, float(1.0 - left / gap), channels, after <= before, p_remaining, mostly, chance)


def named_by_third(finding: Finding, views: Sequence[JointResiduals], rules: Rules, floor: float, runs: int) -> Finding:
    """Let the last record decide an ambiguous finding by `third_opinion`, unless known errors could make the difference.

    The opinion must hold after two corrections. On a faster record, an error of the parameters may leave more of the right
    explanation than a wrong one leaves. Similar effects may also differ by no more than the error of the time step: a late
    command is simulated, a late clock is not.

    Args:
        finding: Finding from the first two records.
        views: Residuals on all records, last the one that no fit has seen.
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
        runs: Simulations that are left; if too few, the finding is returned unchanged.
    """
    third = views[-1]
    named = third_opinion(finding, lambda trial: third.residual(trial.fit.effects), rules, floor)
    if named is finding:
        return finding
    beside = BesideParameterError(third, views[:-1], derivatives)
    compared = [trial.fit for trial, _ in finding.rivals if " + ".join(trial.names) in finding.ambiguous]
    if sum(beside.runs(fitted) + len(views) for fitted in compared) > runs:
        return finding
    named = third_opinion(finding, lambda trial: beside(trial.fit), rules, floor)
    if named is finding:
        return finding
    rivals = [(stepped(t, views), p) if " + ".join(t.names) in finding.ambiguous else (t, p) for t, p in finding.rivals]
    fine = replace(finding, best=rivals[0][0], rivals=tuple(rivals))
    again = third_opinion(fine, lambda trial: _fine(third, trial.fit.effects), rules, floor)
    return finding if again is fine else named


def stepped(trial: Hypothesis, views: Sequence[JointResiduals]) -> Hypothesis:
    """Recompute what an explanation leaves on `fit` and `select` at a vanishing time step; this takes two simulations.

    Args:
        trial: The explanation.
        views: Residuals on `fit` and `select`; others may follow.
    """
    first, second = (_fine(view, trial.fit.effects) for view in views[:2])
    fitted = replace(trial.fit, chi2=float((first**2).sum()))
    return replace(trial, fit=fitted, residual=second, first=first, chi2=float((second**2).sum()))


def _fine(view: JointResiduals, effects: Sequence[Applied]) -> Array:
    return view.residual(effects) - view.stepping_beyond(effects)
