"""Moments in which something outside the model moved a mechanism: a hand, a cable, a push.

What pushes a link moves all joints that carry it at once, shortly, and far more than most effects do. No effect of the
catalogue does that, so that these moments tell nothing of what the model lacks, and hide what the rest of the record tells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.gap.diagnosis.closure import stretches
from gsbridge.gap.formats.records import TOOL
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen
from gsbridge.gap.joints.signatures import SignatureBank
from gsbridge.geometry import Array

_BLOCK = 0.02
"""Time over which squared residuals are averaged, s."""

_LOUD = 10.0
"""Multiple of the median squared residual, and of the noise's, from which on a moment is one of a touch."""

_BEFORE = 0.05
"""Time before such a moment in which a touch may have begun, s."""

_BEHIND = 4.0
"""Time constants of the controller after which what a touch displaced is back."""

_LONGEST = 0.4
"""Largest share of a record that touches may take."""

_MOSTLY, _HALF = 0.8, 0.5
"""Share of what exceeds the noise that falls into the touches: of one record at least, and of others of the same case."""

_SLIGHT = 0.1
"""Share of what exceeds the noise below which a stretch is no touch of its own."""

_ALONE = 0.9
"""Share of that on one joint from which on something may be wrong with this joint instead."""

_TOLD = 0.4
"""Share of the squared residual of `fit` that the signatures of one candidate must tell to be looked for in all of it."""


def leave_out_touches(views: Mapping[str, JointResiduals], bank: SignatureBank) -> dict[str, list[tuple[float, float]]]:
    """Let moments count no longer in which something touched the mechanism, unless an effect may explain them.

    Args:
        views: Residuals by role, which leave them out from then on.
        bank: Signatures on `fit`.

    Returns:
        Begin and end of what was left out, s from the record's first sample, by role; empty where nothing was.
    """
    found = touches(views)
    if "fit" not in found:
        return {}
    residual = views["fit"].residual()
    told = max((match.bound for match in Screen(views["fit"], bank).matches(residual)), default=0.0)
    if told > _TOLD * float((residual**2 - 1.0).sum()):
        return {}
    out = dict[str, list[tuple[float, float]]]()
    for role, spans in found.items():
        time = views[role].record.time - views[role].record.time[0]
        out[role] = [(float(time[first]), float(time[last - 1])) for first, last in spans]
        views[role].leave_out(spans)
    return out


def touches_told(left_out: Mapping[str, Sequence[tuple[float, float]]], alone: bool = False) -> str:
    """A sentence on what was left out.

    Args:
        left_out: Begin and end, s, by role.
        alone: Whether simulation and measurement agree at all other times, which makes it the whole finding.
    """
    where = "; ".join(
        f"'{role}' {' and '.join(f'from {begin:.2f} to {end:.2f} s' for begin, end in spans)}"
        for role, spans in left_out.items()
    )
    happened = f"omething that is not in the model moved several joints at once, as a push or a cable does ({where})"
    if alone:
        return f"S{happened}. Simulation and measurement agree at all other times."
    return f"s{happened}: these moments count neither in the fit nor in the verdict"


def touches(views: Mapping[str, JointResiduals]) -> dict[str, list[tuple[int, int]]]:
    """First sample of each touch, and the one behind its last, of the records in which something touched the mechanism.

    Args:
        views: Residuals by role.

    Returns:
        By role; empty where nothing looks like a touch, or where it might be one joint's fault.
    """
    found: dict[str, list[tuple[int, int]]] = {}
    shares, joints = dict[str, float](), np.zeros(len(next(iter(views.values())).record.joints))
    for role, view in views.items():
        if TOOL in view.record.measured or not view.mechanism.system.controller.closed_loop:
            return {}
        residual = view.residual()
        excess = residual**2 - 1.0
        whole = max(float(excess.sum()), 1e-9)
        spans = [span for span in _stretches(view, residual) if excess[span[0] : span[1]].sum() > _SLIGHT * whole]
        inside = np.zeros(len(excess), bool)
        for first, last in spans:
            inside[first:last] = True
        shares[role] = float(excess[inside].sum()) / whole
        if inside.mean() > _LONGEST or shares[role] < _HALF:
            continue
        found[role] = spans
        by_channel = excess[inside].sum(axis=0)
        by_joint = np.bincount([k for _, k in view.channels], np.maximum(by_channel, 0.0), len(joints))
        joints += by_joint / max(float(by_joint.sum()), 1e-9)
    several = bool(found) and float(joints.max()) <= _ALONE * len(found)
    return found if several and max(shares[role] for role in found) >= _MOSTLY else {}


def _stretches(view: JointResiduals, residual: Array) -> list[tuple[int, int]]:
    """First samples, and those behind the last, of what stands out from all else, until what it displaced is back. [T, C]."""
    period, count = view.record.period, len(residual)
    length = max(1, round(_BLOCK / period))
    blocks = np.add.reduceat((residual**2).mean(axis=1), np.arange(0, count, length)) / length
    loud = blocks > _LOUD * max(float(np.median(blocks)), 1.0)
    before = int(np.ceil(_BEFORE / period))
    back = int(np.ceil(_BEHIND * max(view.memory(k) for k in range(len(view.record.joints)))))
    inside = np.zeros(count, bool)
    for begin, end in stretches(loud):
        # What swings back through zero, or is quiet for a moment, is one touch.
        inside[max(0, begin * length - before) : end * length + back] = True
    return [(int(first), int(last)) for first, last in stretches(inside)]
