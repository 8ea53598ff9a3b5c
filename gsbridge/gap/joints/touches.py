"""Touches: moments in which something outside the model moved a mechanism, such as a hand, a cable or a push.

A push on a link moves all joints that carry it at once, for a short time, and far more than most effects do. No effect of the
catalogue does that. Such moments therefore tell nothing of what the model lacks, and hide what the rest of the record tells.
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
"""Length of the blocks over which squared residuals are averaged, s."""

_LOUD = 10.0
"""Multiple of the median squared residual, and of the noise's, above which a block belongs to a touch."""

_BEFORE = 0.05
"""Time before such a block in which the touch may have begun, s."""

_BEHIND = 4.0
"""Time constants of the controller after which a displaced joint is back."""

_LONGEST = 0.4
"""Largest share of a record that touches may take."""

_MOSTLY, _HALF = 0.8, 0.5
"""Least share of the excess over the noise that must fall into touches: on at least one record, and on every other record of
which touches are left out."""

_SLIGHT = 0.1
"""Share of the excess over the noise up to which a stretch does not count as a touch."""

_ALONE = 0.9
"""Share of the excess within touches on one joint above which something may be wrong with that joint instead."""

_TOLD = 0.4
"""Share of the excess over the noise on `fit` that the signatures of one candidate must explain for nothing to be left out."""


def leave_out_touches(views: Mapping[str, JointResiduals], bank: SignatureBank) -> dict[str, list[tuple[float, float]]]:
    """Leave out moments in which something touched the mechanism, unless an effect may explain them.

    Args:
        views: Residuals by role, which are changed: they leave out these moments from then on.
        bank: Signatures on `fit`.

    Returns:
        Start and end of each stretch that was left out, s from the record's first sample, by role; empty if there is none.
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
    """Write a sentence on the touches that were left out.

    Args:
        left_out: Start and end of each touch, s, by role.
        alone: Whether simulation and measurement agree at all other times, so that the touches are the whole finding.
    """
    where = "; ".join(
        f"'{role}' {' and '.join(f'from {begin:.2f} to {end:.2f} s' for begin, end in spans)}"
        for role, spans in left_out.items()
    )
    happened = f"omething that is not in the model moved several joints at once, as a push or a cable does ({where})"
    if alone:
        return f"S{happened}. At all other times, simulation and measurement differ by no more than the noise."
    return f"s{happened}: these moments count neither in the fit nor in the verdict"


def touches(views: Mapping[str, JointResiduals]) -> dict[str, list[tuple[int, int]]]:
    """Find the touches on each record.

    Args:
        views: Residuals by role.

    Returns:
        First sample of each touch, and the one behind its last, by role. Empty if nothing looks like a touch, or if the fault
        of a single joint might look the same.
    """
    found: dict[str, list[tuple[int, int]]] = {}
    shares, joints = dict[str, float](), np.zeros(len(next(iter(views.values())).record.joints))
    for role, view in views.items():
        controller = view.mechanism.system.controller
        if TOOL in view.record.measured or not controller.closed_loop or controller.observes:
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
    """Find stretches that stand out from the rest of a residual [T, C], until the displaced joints are back.

    Returns:
        First sample of each stretch, and the one behind its last.
    """
    period, count = view.record.period, len(residual)
    length = max(1, round(_BLOCK / period))
    blocks = np.add.reduceat((residual**2).mean(axis=1), np.arange(0, count, length)) / length
    loud = blocks > _LOUD * max(float(np.median(blocks)), 1.0)
    before = int(np.ceil(_BEFORE / period))
    back = int(np.ceil(_BEHIND * max(view.memory(k) for k in range(len(view.record.joints)))))
    inside = np.zeros(count, bool)
    for begin, end in stretches(loud):
        # Stretches that overlap become one touch: a joint swings back through zero, or is quiet for a moment.
        inside[max(0, begin * length - before) : end * length + back] = True
    return [(int(first), int(last)) for first, last in stretches(inside)]
