"""Effects of joints that slide instead of turning: the same laws, in metres and newtons.

A joint that slides is taken for one that turns a wheel of some radius on a rack: angles become metres, torques newtons, and
what is likely or makes sense is what would be at that wheel.
"""

from __future__ import annotations

from dataclasses import replace

from gsbridge.effects.base import Parameter
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.registry import Registry

WHEEL = 0.1
"""Radius of the wheel, m: a newton metre becomes ten newtons, a radian ten centimetres."""

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
"""Unit at a joint that slides of each unit that has an angle or a torque in it, and power of the wheel's radius in it."""

WORDS = {"torque": "force", "angle": "position", "inertia": "mass"}
"""Names of parameters in sentences about such a joint; files keep the effect's own."""


def _at_the_wheel(parameter: Parameter) -> tuple[str, float]:
    """Unit of a parameter at a joint that slides, and the factor of its figures."""
    unit, power = ("rad/m", -1) if parameter.per_angle else UNITS.get(parameter.unit, (parameter.unit, 0))
    # Rounding to the digits of the catalogue, so that a tenth stays one.
    return unit, float(f"{WHEEL**power:.12g}")


def _at(value: float, factor: float) -> float:
    return float(f"{value * factor:.12g}")


def _sliding(kind: type[JointEffect]) -> type[JointEffect]:
    """The same effect at a joint that slides."""
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
        """The parameters of the same effect at a joint that turns, at its wheel."""
        return tuple({name: _at(value, factors[name]) for name, value in row.items()} for row in turning.directions())

    def called(_: JointEffect, parameter: str) -> str:
        """What is a torque at a joint that turns is a force here."""
        return WORDS.get(parameter, parameter)

    changed = {"parameters": parameters, "directions": directions, "called": called}
    return type(f"Sliding{kind.__name__}", (kind,), changed)


SLIDING_EFFECTS: Registry[JointEffect] = Registry(
    *(_sliding(type(effect)) for effect in JOINT_EFFECTS.values() if effect.scope == "joint" and not effect.turns)
)
"""Effects on one joint as they are at a joint that slides; those on the whole mechanism do not differ."""
