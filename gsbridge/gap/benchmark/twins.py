"""Effects with the same equation on a mechanism, which no data can tell apart: derived by hand for each mechanism.

Axis (one revolute joint, weight carried by the controller, no losses in the model), with W the weight's torque, I the inertia:

- `torque_gain` g and `link_mass` m: I a = (1 + g) t - W cos q and (1 + m) I a = t - (1 + m) W cos q are one equation for
  1 + g = 1 / (1 + m).
- `payload` adds M x to the moment and M (x^2 + z^2) to the inertia with three free numbers: `link_mass` is one choice of them.
- `encoder_offset` e and `base_tilt` b about the axis: the controller holds q + e where the weight is W cos q, or q where it is
  W cos(q - b); nothing else depends on the angle. To first order either adds e W sin q. So does a `payload` beside the arm,
  and a heavy one near the axis adds hardly any inertia.
- `command_delay` d and `lag` T: expanded in them, the responses are equal to first order and differ by d^2 / 2 times the
  acceleration to second, a share of w d / 2 at the frequency w; below 2 ms and 2 Hz that is 1.3 %, about one standard deviation
  of a signature of twenty units.

The arm of the benchmark: its first axis is upright, so that the first link's weight turns nothing, and its mass acts as inertia
about that axis alone, as `armature` does: mass M, distance d and moment I of the link give (M d^2 + I) m for a share m.

On any arm, `command_delay` and `lag` are equal to first order, too. Where no efforts are logged, on axis and arms alike,
`viscous` and `gain_d` are one term of the equation of motion, and a delay of all commands shifts positions as `clock_offset`
does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

SHORT = 2e-3
"""Delay and time constant below which both are the same to first order, s."""

_AXIS = (
    ("torque_gain", "link_mass", "payload"),
    ("encoder_offset", "base_tilt", "payload"),
)

_UPRIGHT = ("armature", "link_mass")
UPRIGHT = "lbr_iiwa_joint_1"
"""The arm's joint whose axis is upright."""

_BLIND = (("viscous", "gain_d"), ("command_delay", "clock_offset"))


def twins_of(plant: str, hidden: Mapping[str, float], channels: Iterable[str]) -> tuple[frozenset[str], ...]:
    """Sets of effects with the same equation as the hidden ones; the hidden set itself is left out.

    Args:
        plant: `axis` or `arm`.
        hidden: Sizes by name, `name:joint` for one joint.
        channels: Channels that are logged.
    """
    groups: list[tuple[str, ...]] = list(_AXIS if plant == "axis" else ())
    if "effort" not in channels:
        groups += _BLIND
    if max(hidden.get("command_delay", 0.0), hidden.get("lag", 0.0)) < SHORT:
        groups.append(("command_delay", "lag") if "effort" in channels else ("command_delay", "lag", "clock_offset"))
    sets: set[frozenset[str]] = {frozenset()}
    for name in hidden:
        effect, _, joint = name.partition(":")
        # Not from twin to twin: a payload is like many things because it has many parameters.
        alike = {effect}.union(*(group for group in groups if effect in group))
        alike |= set(_UPRIGHT) if joint == UPRIGHT and effect in _UPRIGHT else set()
        whole = ("payload", "base_tilt", "command_delay", "lag", "clock_offset", "clock_drift", "gravcomp")
        options = [other if other in whole or not joint else f"{other}:{joint}" for other in sorted(alike)]
        sets = {done | {option} for done in sets for option in options}
    return tuple(sorted(sets - {frozenset(hidden)}, key=sorted))
