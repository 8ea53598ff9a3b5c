"""Effects that a model file may add to the nominal model. Each entry here has one implementation in `sim` or `scene`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from gsbridge.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: its symbol, its unit, and the range in which it makes sense."""

    symbol: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Description:
    """An effect as the catalogue tells it.

    Args:
        parameters: By name.
        channels: Where it shows: `position`, `effort`, `object`, `gripper`, `image`.
        reference: Source.
    """

    parameters: Mapping[str, Parameter]
    channels: tuple[str, ...]
    reference: str


@dataclass(frozen=True)
class Effect:
    """An effect switched on: its name in the catalogue and the values of all its parameters."""

    name: str
    parameters: Mapping[str, float]


CATALOGUE: Final[Mapping[str, Description]] = MappingProxyType({})
"""Effects of the physics by name: none, since what the gap finds in an arm has its place in the model. Effects of pictures
are the renderer's (`gsbridge.environment.lens.EFFECTS`)."""


def read_effects(items: Any, source: str, catalogue: Mapping[str, Description] = CATALOGUE) -> tuple[Effect, ...]:
    """Check the list `effects` of a model file.

    Args:
        items: Its content: a list of `{name, parameters}`.
        source: The file, for messages.
        catalogue: Effects that exist.

    Raises:
        InputError: No list, an unknown effect or parameter, a missing one, or a value outside its range.
    """
    if not isinstance(items, list):
        raise InputError(source, "'effects' is no list", "Write effects: [] or a list of {name, parameters}")
    known = ", ".join(catalogue) or "there are none yet"
    effects = []
    for item in items:
        if not isinstance(item, dict) or set(item) != {"name", "parameters"} or not isinstance(item["parameters"], dict):
            raise InputError(source, f"the effect {item!r} is no {{name, parameters}}", "Give exactly these two keys")
        name, given = item["name"], item["parameters"]
        if name not in catalogue:
            raise InputError(source, f"the effect '{name}' is unknown", f"Use one of the catalogue: {known}")
        wanted = catalogue[name].parameters
        if set(given) != set(wanted):
            wrong = ", ".join(sorted(set(given) ^ set(wanted)))
            raise InputError(source, f"effect '{name}': parameter {wrong} is unknown or missing", f"Give {', '.join(wanted)}")
        values = {}
        for key, parameter in wanted.items():
            values[key] = checked_number(
                given[key], parameter.low, parameter.high, f"effects.{name}.{key}", parameter.unit, source
            )
        effects.append(Effect(name, MappingProxyType(values)))
    return tuple(effects)


def checked_number(value: Any, low: float, high: float, key: str, unit: str, source: str) -> float:
    """A number of a model file, within its range.

    Raises:
        InputError: It is no number, not finite, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(source, f"'{key}' is {value!r}, no number", f"Give {low:g} to {high:g} {unit}".rstrip())
    # The comparison also fails for not-a-number.
    if not low <= value <= high:
        raise InputError(source, f"'{key}' is {value:g}, outside its range", f"Give {low:g} to {high:g} {unit}".rstrip())
    return float(value)
