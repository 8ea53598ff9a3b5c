"""Test whether logged efforts follow the integral of the position error: the model's controller has no such term."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

_EXPLAINED = 0.8
"""Share of the squared efforts beyond the model's controller that integrals must explain to be reported."""

_OTHERS = 0.5
"""Largest squared residual after a fit of integrals, as a share of that after a fit of other gains and a delayed command."""

_LARGE = 3.0
"""Size of the efforts beyond the model's controller, in units of their noise, from which on they are examined."""


@dataclass(frozen=True)
class IntegralAction:
    """Efforts that follow integrals of position errors.

    Args:
        gains: Torque by integrated error, N m/(rad s), of the joints that have such efforts.
        explained: Share of the squared efforts beyond the model's controller that the integrals explain: the least of these
            joints' shares.
    """

    gains: dict[str, float]
    explained: float

    @property
    def sentence(self) -> str:
        """A sentence for the reader."""
        listed = ", ".join(f"{joint} {gain:.3g} N m/(rad s)" for joint, gain in self.gains.items())
        return (
            "The machine's controller is not the model's: logged efforts hold the integral of the position's error besides "
            f"stiffness and damping ({listed}), which explains {100 * self.explained:.0f} % of what they are more than those. "
            "What the mechanism lacks cannot be told beside it: switch the integral off and log again, or write 'mode: torque' "
            "and log the efforts as commands."
        )


def integral_action(views: Sequence[JointResiduals]) -> IntegralAction | None:
    """Test whether efforts contain integrals of position errors; None if not, or if the records cannot tell.

    Args:
        views: Residuals on records of one mechanism.
    """
    places = {channel: column for column, channel in enumerate(views[0].channels)}
    controller = views[0].mechanism.system.controller
    if controller.mode != "pd" or any("command" not in view.record.commands for view in views):
        return None
    gains, explained = dict[str, float](), 1.0
    for k, joint in enumerate(views[0].record.joints):
        if any((kind, k) not in places for kind in ("position", "velocity", "effort")):
            continue
        position, speed, effort = (places[(kind, k)] for kind in ("position", "velocity", "effort"))
        stiffness, damping = controller.stiffness[k], controller.damping[k]
        sigma = views[0].sigma
        noise = np.hypot(sigma[effort], np.hypot(stiffness * sigma[position], damping * sigma[speed]))
        more, integrals, others = list[Array](), list[Array](), list[Array]()
        for view in views:
            logged, wanted = view.stack(view.record.measured), view.record.commands["command"][:, k]
            apart = logged - view.replay()
            error = wanted - logged[:, position]
            # Take off the response of the model's controller to the difference between logged and simulated motion.
            more.append(_centred(apart[:, effort] + stiffness * apart[:, position] + damping * apart[:, speed]))
            integrals.append(_centred(np.cumsum(error) * view.record.period))
            rate = np.gradient(wanted, view.record.period)
            others.append(np.stack([_centred(row) for row in (error, logged[:, speed], rate)], axis=1))
        asked, table = np.concatenate(more), np.concatenate(integrals)
        size = float(asked @ asked)
        if not np.isfinite(size) or size < _LARGE**2 * noise**2 * len(asked):
            continue
        gain = float(table @ asked) / max(float(table @ table), 1e-300)
        left = float(((asked - gain * table) ** 2).sum())
        plain = np.concatenate(others)
        elsewise = float(((asked - plain @ np.linalg.lstsq(plain, asked, rcond=1e-9)[0]) ** 2).sum())
        if gain > 0.0 and left <= (1.0 - _EXPLAINED) * size and left <= _OTHERS * elsewise:
            gains[joint], explained = gain, min(explained, 1.0 - left / size)
    return IntegralAction(gains, explained) if gains else None


def _centred(values: Array) -> Array:
    """Take off the mean, since the value of an integral at the start of the log is unknown. [T]."""
    centred: Array = values - values.mean()
    return centred
