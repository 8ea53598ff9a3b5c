"""Test whether the gap comes from how commands go on between two samples: held, or joined by straight lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gsbridge.gap.diagnosis.results import Finding
from gsbridge.gap.diagnosis.wording import plain
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

_OTHER = {"hold": "line", "line": "hold"}
_DOES = {"hold": "held", "line": "joined by straight lines"}

_SEEN = 1.5
"""Periods of the control loop between two logged commands from which on it matters how commands go on between them."""

_HALF = 0.5
"""Share of the gap's squares that may be left, under the other assumption, for it to be reported."""


@dataclass(frozen=True)
class OtherWay:
    """The gap of the model without effects, under both assumptions on commands between their samples.

    Args:
        stated: Assumption of the model, `hold` or `line`.
        before: Squared residual of all records under the model's assumption.
        after: Squared residual under the other assumption.
        freedom: Degrees of freedom of the residuals.
    """

    stated: str
    before: float
    after: float
    freedom: int

    @property
    def better(self) -> bool:
        """Whether most of the gap is gone under the other assumption."""
        return self.after - self.freedom < _HALF * (self.before - self.freedom)

    def tells(self, finding: Finding) -> bool:
        """Tell whether a reader should know of the other assumption.

        On average, held commands come late by half the time between two samples. If the model holds commands and lines fit
        better, the arm would be ahead of its commands, which none is. If the model uses lines, the arm may really be late, so
        that holding must also explain as much as the effects that were found.
        """
        return self.better and (self.stated == "hold" or self.rivals(finding))

    def rivals(self, finding: Finding) -> bool:
        """Tell whether the other assumption explains as much as the best effects."""
        best = finding.best
        return self.better and best is not None and self.after <= best.chi2 + float((best.first**2).sum())

    @property
    def sentence(self) -> str:
        """A sentence for the reader."""
        sizes = [(squares / self.freedom) ** 0.5 for squares in (self.before, self.after)]
        other = _OTHER[self.stated]
        return (
            f"The model says that commands are {_DOES[self.stated]} between two samples. If they were {_DOES[other]}, it would "
            f"leave {plain(sizes[1])} instead of {plain(sizes[0])} times the noise without any effect: ask what sent them, and "
            f"write 'between: {other}' under 'controller' if that is how they went on."
        )


def other_way(views: Sequence[JointResiduals]) -> OtherWay | None:
    """Replay records under the other assumption on commands; None if it makes no difference, or if an observer follows them.

    Args:
        views: Residuals on the records.
    """
    system = views[0].mechanism.system
    logged = [view for view in views if "command" in view.record.commands and not system.controller.observes]
    if len(logged) < len(views) or max(view.record.period for view in views) * system.controller.rate < _SEEN:
        return None
    other = Mechanism(replace(system, controller=replace(system.controller, between=_OTHER[system.controller.between])))
    squares = [[float((part**2).sum()) for part in (view.residual(), view.residual_of(other))] for view in views]
    views[0].mechanism.runs += other.runs
    before, after = (sum(column) for column in zip(*squares, strict=True))
    return OtherWay(system.controller.between, before, after, sum(view.freedom for view in views))
