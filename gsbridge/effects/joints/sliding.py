"""Effects on prismatic joints: the laws of revolute joints, in metres and newtons.

A prismatic joint is treated as a revolute one that drives a wheel of radius `WHEEL` on a rack: angles become metres and torques
become newtons. The bounds and typical sizes of parameters are converted from the wheel's in the same way.
"""

from __future__ import annotations

from dataclasses import replace

from gsbridge.effects.base import Parameter
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.registry import Registry

WHEEL = 0.1
"""Radius of the wheel, m: 1 N m becomes 10 N, and 1 rad becomes 0.1 m."""

UNITS = {
    "rad": ("m", 1),
    "rad/s": ("m/s", 1),
    "s/rad": ("s/m", -1),
    "N m": ("N", -1),
    "1/(N m)": ("1/N", 1),
    "N m/rad": ("N/m", -2),
    "N m s/rad": ("N s/m", -2),
    "N m s2/rad2": ("N s2/m2", -3),
    "rad/(N m)": ("m/N", 2),
    "kg m2": ("kg", -2),
}
"""Unit at a prismatic joint for each unit that contains an angle or a torque, and the power of the wheel's radius by which
values are multiplied."""

WORDS = {"torque": "force", "angle": "position", "inertia": "mass"}
"""Names of parameters in sentences about a prismatic joint; files keep the names of the revolute effect."""


def _at_the_wheel(parameter: Parameter) -> tuple[str, float]:
    """Return the unit of a parameter at a prismatic joint, and the factor that converts its values."""
    unit, power = ("rad/m", -1) if parameter.per_angle else UNITS.get(parameter.unit, (parameter.unit, 0))
    # Rounding removes floating-point dust, so that 0.1 stays 0.1.
    return unit, float(f"{WHEEL**power:.12g}")


def _at(value: float, factor: float) -> float:
    return float(f"{value * factor:.12g}")


def _sliding(kind: type[JointEffect]) -> type[JointEffect]:
    """Derive the class of an effect on prismatic joints from that on revolute joints."""
    turning = kind()
    factors = {parameter.name: _at_the_wheel(parameter)[1] for parameter in turning.parameters}
    parameters = tuple(
        replace(
            parameter,
            unit=_at_the_wheel(parameter)[0],
            low=_at(parameter.low, factors[parameter.name]),
            high=_at(parameter.high, factors[parameter.name]),
            typical=_at(parameter.typical, factors[parameter.name]),
        )
        for parameter in turning.parameters
    )

    def directions(_: JointEffect) -> tuple[dict[str, float], ...]:
        """Convert the start directions of the revolute effect."""
        return tuple({name: _at(value, factors[name]) for name, value in row.items()} for row in turning.directions())

    def called(_: JointEffect, parameter: str) -> str:
        """Name a parameter in the terms of a prismatic joint, such as force for torque."""
        return WORDS.get(parameter, parameter)

    changed = {"parameters": parameters, "directions": directions, "called": called}
    return type(f"Sliding{kind.__name__}", (kind,), changed)


SLIDING_EFFECTS: Registry[JointEffect] = Registry(
    *(_sliding(type(effect)) for effect in JOINT_EFFECTS.values() if effect.scope == "joint" and not effect.turns)
)
"""Effects on a single prismatic joint; effects on the whole mechanism are the same for both kinds of joint."""
