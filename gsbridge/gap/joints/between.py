"""What becomes of a gap if commands went on otherwise between two samples than the model says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gsbridge.gap.diagnosis.results import Finding
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

_OTHER = {"hold": "line", "line": "hold"}
_DOES = {"hold": "held", "line": "joined by straight lines"}

_SEEN = 1.5
"""Periods of the controller between two logged commands from which on it matters how they go on."""

_HALF = 0.5
"""Share of the gap's squares that the other way may leave to be told."""


@dataclass(frozen=True)
class OtherWay:
    """The model without effects, with commands that go on otherwise between their samples.

    Args:
        stated: What the model says, `hold` or `line`.
        before: Squared residual of both records as the model says.
        after: Squared residual with the other way.
        freedom: Independent numbers in both.
    """

    stated: str
    before: float
    after: float
    freedom: int

    @property
    def better(self) -> bool:
        """Whether most of the gap is gone with it."""
        return self.after - self.freedom < _HALF * (self.before - self.freedom)

    def tells(self, finding: Finding) -> bool:
        """Whether a reader should know.

        Held commands come late by half the time between two samples. An arm that comes before its commands is none; one that
        comes late may be as it is, so that there the other way must explain as much as what was found.
        """
        return self.better and (self.stated == "hold" or self.rivals(finding))

    def rivals(self, finding: Finding) -> bool:
        """Whether it explains as much as what was named."""
        best = finding.best
        return self.better and best is not None and self.after <= best.chi2 + float((best.first**2).sum())

    @property
    def sentence(self) -> str:
        """What a reader must know."""
        sizes = [(squares / self.freedom) ** 0.5 for squares in (self.before, self.after)]
        other = _OTHER[self.stated]
        return (
            f"The model says that commands are {_DOES[self.stated]} between two samples. If they were {_DOES[other]}, it would "
            f"leave {sizes[1]:.3g} instead of {sizes[0]:.3g} times the noise without any effect: ask what sent them, and write "
            f"'between: {other}' under 'controller' if that is how they went on."
        )


def other_way(views: Sequence[JointResiduals]) -> OtherWay | None:
    """Replay records with the other way of the commands; None where it makes no difference.

    Args:
        views: Records.
    """
    system = views[0].mechanism.system
    logged = [view for view in views if "command" in view.record.commands]
    if len(logged) < len(views) or max(view.record.period for view in views) * system.controller.rate < _SEEN:
        return None
    other = Mechanism(replace(system, controller=replace(system.controller, between=_OTHER[system.controller.between])))
    squares = [[float((part**2).sum()) for part in (view.residual(), view.residual_of(other))] for view in views]
    views[0].mechanism.runs += other.runs
    before, after = (sum(column) for column in zip(*squares, strict=True))
    return OtherWay(system.controller.between, before, after, sum(view.freedom for view in views))
