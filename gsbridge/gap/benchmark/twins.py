"""Twins: effects with the same equation of motion, which no data can tell apart, derived by hand for each mechanism.

Axis (one revolute joint, weight carried by the controller, no losses in the model). W is the weight's torque at q = 0, I the
inertia, t the motor's torque, a the acceleration:

- `torque_gain` g and `link_mass` m: I a = (1 + g) t - W cos q and (1 + m) I a = t - (1 + m) W cos q are the same equation if
  1 + g = 1 / (1 + m).
- A `payload` of mass M at x, z adds M x to the moment and M (x^2 + z^2) to the inertia. Its three free numbers M, x and z can
  imitate any `link_mass`.
- `encoder_offset` e and `base_tilt` b about the axis: with the offset, the controller holds q + e while the weight is W cos q;
  with the tilt, it holds q while the weight is W cos(q - b). Nothing else depends on the angle. To first order, either adds
  e W sin q. So does a `payload` beside the arm, and a heavy one near the axis adds hardly any inertia.
- `command_delay` d and `lag` T: in a power series in d = T, the responses are equal to first order. The second-order term
  differs by d^2 / 2 times the acceleration, a share of w d / 2 at the angular frequency w. Below 2 ms and 2 Hz that is 1.3 %,
  about one standard deviation of a signature of twenty units.

The arm of the benchmark: its first axis is upright, so that the first link's weight has no torque about it. The mass of that
link acts only as inertia about the axis, as `armature` does: for a share m, it adds (M d^2 + I) m, where M, d and I are the
link's mass, distance from the axis and moment of inertia.

On any arm, `command_delay` and `lag` are equal to first order, too. If no efforts are logged, on axis and arms alike, `viscous`
and `gain_d` are one term of the equation of motion, and a delay of all commands shifts positions as `clock_offset` does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

SHORT = 2e-3
"""Delay and time constant below which `command_delay` and `lag` count as twins, s."""

_AXIS = (
    ("torque_gain", "link_mass", "payload"),
    ("encoder_offset", "base_tilt", "payload"),
)

_UPRIGHT = ("armature", "link_mass")
UPRIGHT = "lbr_iiwa_joint_1"
"""Joint of the arm whose axis is upright."""

_BLIND = (("viscous", "gain_d"), ("command_delay", "clock_offset"))


def twins_of(plant: str, hidden: Mapping[str, float], channels: Iterable[str]) -> tuple[frozenset[str], ...]:
    """Return the other sets of effects with the same equation of motion as the hidden ones.

    Args:
        plant: `axis`, `arm` or `machine`.
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
        # Twins are not transitive: a payload imitates several effects only because it has many parameters.
        alike = {effect}.union(*(group for group in groups if effect in group))
        alike |= set(_UPRIGHT) if joint == UPRIGHT and effect in _UPRIGHT else set()
        whole = ("payload", "base_tilt", "command_delay", "lag", "clock_offset", "clock_drift", "gravcomp")
        options = [other if other in whole or not joint else f"{other}:{joint}" for other in sorted(alike)]
        sets = {done | {option} for done in sets for option in options}
    return tuple(sorted(sets - {frozenset(hidden)}, key=sorted))
