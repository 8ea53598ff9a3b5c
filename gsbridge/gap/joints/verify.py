"""What the third record says of an explanation. It had no part in fitting or choosing, but for limits that `fit` never reaches,
of which it must show something, too."""

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
        view: Residuals of a record that was not fitted.
        effects: What was found.
        rng: Random numbers for effect-free replicates.
        beside: What is left beside the error of the parameters, which is then no alarm. [T, C].
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
    """The finding after a `third_opinion` by the last record, which counts only if errors that are known do not make it.

    On a record that moves faster, the error of a parameter may leave more of the right explanation than a wrong one leaves. And
    near twins may differ by no more than the step of time changes: a late command is simulated, a late clock is not.

    Args:
        finding: What two records tell.
        views: Residuals on all records, the one that no fit has seen last.
        rules: Thresholds.
        floor: Squared residual of noise alone on `select`.
        runs: Simulations that are left to ask; without enough of them, nothing is named.
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
    """An explanation with what it would leave of `fit` and `select` at a vanishing step of time; two simulations.

    Args:
        trial: The explanation.
        views: Residuals on these records, and perhaps others.
    """
    first, second = (_fine(view, trial.fit.effects) for view in views[:2])
    fitted = replace(trial.fit, chi2=float((first**2).sum()))
    return replace(trial, fit=fitted, residual=second, first=first, chi2=float((second**2).sum()))


def _fine(view: JointResiduals, effects: Sequence[Applied]) -> Array:
    return view.residual(effects) - view.stepping_beyond(effects)
