"""Warnings that stand before the figures of a diagnosis: doubtful noise, and effects of which nothing is said."""

from __future__ import annotations

from gsbridge.gap.diagnosis.results import Finding
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.signatures import SignatureBank

_FAR = 50.0
"""Gap, in units of the noise, above which the estimate of the noise itself is doubted."""


def to_know_noise(repeatable: bool, key: str) -> str:
    """Tell what to do so that the noise is known.

    Args:
        repeatable: Whether repeats of a motion would tell it.
        key: What may be stated instead of repeats, with its article.
    """
    return f"log one motion twice and name it under 'repeats', or state {key}" if repeatable else f"state {key}"


def warnings_of(finding: Finding, bank: SignatureBank, view: JointResiduals, stated: bool) -> tuple[str, ...]:
    """List warnings that belong before the figures.

    Args:
        finding: The finding.
        bank: Signatures of the effects.
        view: Residuals on the second record, whose noise may be coloured.
        stated: Whether the case states noise or tolerance.
    """
    advice, out = to_know_noise(view.mechanism.system.controller.repeatable, "a 'tolerance'"), list[str]()
    if finding.before > _FAR and not stated:
        out.append(
            f"The gap is {plain(finding.before)} times the noise that neighbouring samples show. Filters in an encoder hide "
            f"noise from them: {advice}."
        )
    if finding.lost:
        out.append(f"These fits did not converge, so that nothing is said of them: {', '.join(finding.lost)}.")
    if bank.diverged:
        names = ", ".join(map(str, bank.diverged))
        out.append(f"The simulation diverged with these, so that nothing is said of them: {names}.")
    if view.colour is not None:
        memory = float(view.colour.memory.max()) * view.record.period * 1e3
        out.append(
            f"The noise remembers itself for up to {memory:.0f} ms, as that of a filter in a sensor does, and exceeds what "
            "neighbouring samples show. It was taken from what the effects leave, in which no channel moves with another. To "
            f"be sure of it, {advice}."
        )
    return tuple(out)
