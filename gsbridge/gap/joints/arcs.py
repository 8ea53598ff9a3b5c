"""Arcs: ripples of which less than one wave was in view, which draw any smooth curve together with a second torque by angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.residuals import JointResiduals

_RIPPLE = "ripple"

_BESIDE = ("coulomb_asym", "effort_offset", "spring")
"""Names of effects that add a constant or a line over the angle of their own joint."""

_WHOLE = 1.0
"""Waves of a ripple that a joint must pass before the ripple is told from any other curve over the angle."""


def arcs_of(views: Sequence[JointResiduals], who: Sequence[Candidate], effects: Sequence[Applied]) -> tuple[Candidate, ...]:
    """Find ripples in an explanation that may stand for any smooth torque over the angle of their joint.

    A ripple has a free size, phase and wave number. If less than one wave was in view, nothing shows that it repeats, and its
    arc and a constant or a line beside it follow whatever pulls there: a cable that stiffens, a rubber stop.

    Args:
        views: Residuals on the records on which the explanation is judged.
        who: Effects of the explanation.
        effects: The same with their parameters.
    """
    beside = {candidate.joint for candidate in who if candidate.name in _BESIDE}
    return tuple(
        candidate
        for candidate, applied in zip(who, effects, strict=True)
        if candidate.name == _RIPPLE and candidate.joint in beside and _waves(views, applied) < _WHOLE
    )


def arc_warning(arcs: Sequence[Candidate]) -> str:
    """Return the sentence that tells a reader why such an explanation is not proven, and what would prove it."""
    joints = " and ".join(f"'{arc.joint}'" for arc in arcs)
    return (
        f"Less than one wave of the torque ripple at {joints} was in view. Beside another torque by the angle it may stand for "
        "any smooth curve, such as a cable that stiffens. To tell, move the joint slowly both ways over its whole range."
    )


def _waves(views: Sequence[JointResiduals], ripple: Applied) -> float:
    """Count the waves of a ripple that its joint passed, on the record on which it went farthest."""
    k = views[0].record.joints.index(ripple.joint)
    return abs(ripple.parameters["waves"]) * max(_range(view, k) for view in views) / (2.0 * np.pi)


def _range(view: JointResiduals, k: int) -> float:
    """Compute how far joint `k` went on a record, rad or m; as commanded if only the tool was logged."""
    record = view.record
    positions = record.measured.get("position", record.commands.get("command"))
    return 0.0 if positions is None else float(np.nanmax(positions[:, k]) - np.nanmin(positions[:, k]))
