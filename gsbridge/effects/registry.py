"""Look-up of effects by name, and the check of the lists of effects in model files, shared by all kinds of model."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from gsbridge.effects.base import Effect
from gsbridge.errors import InputError

Kind = TypeVar("Kind", bound=Effect)


@dataclass(frozen=True)
class Applied:
    """An effect in a model: its name, its joint (empty if it does not act on a single joint), and its parameter values."""

    name: str
    joint: str
    parameters: Mapping[str, float]

    def record(self) -> dict[str, Any]:
        """Return the entry of a model file that describes this effect."""
        out: dict[str, Any] = {"name": self.name, "parameters": dict(self.parameters)}
        return {**out, "joint": self.joint} if self.joint else out


class Registry(Mapping[str, Kind], Generic[Kind]):
    """One instance of each effect class, looked up by name and sorted by name.

    Classes are listed by hand instead of being discovered, so that the imports name every file that matters: the digests of
    the workflow's rules follow imports.
    """

    def __init__(self, *kinds: type[Kind]) -> None:
        self._effects = {kind.name: kind() for kind in sorted(kinds, key=lambda kind: kind.name)}
        if len(self._effects) < len(kinds):
            raise ValueError("two effects have one name")

    def __getitem__(self, name: str) -> Kind:
        return self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def effect(self, name: str, source: str | Path = "model") -> Kind:
        """Return the effect of a name.

        Raises:
            InputError: There is no effect of that name.
        """
        if name not in self._effects:
            raise InputError(source, f"the effect '{name}' is unknown", f"Use one of: {', '.join(self)}")
        return self._effects[name]


def effect_of(
    applied: Applied, *registries: Registry[Any], source: str | Path = "model", joints: Collection[str] | None = None
) -> Any:
    """Return the effect that an entry of a model names, after checking the entry's parameters and joint.

    Args:
        applied: The entry.
        registries: Effects that may be named. If two share a name, only one of them acts on a joint.
        source: File or place of the entry, for messages.
        joints: Names of the model's joints; None to skip the check of the joint's name.

    Raises:
        InputError: The effect or its joint is unknown, or a parameter or the joint is missing or superfluous.
    """
    found = [registry[applied.name] for registry in registries if applied.name in registry]
    if not found:
        known = ", ".join(sorted({name for registry in registries for name in registry}))
        raise InputError(source, f"the effect '{applied.name}' is unknown", f"Use one of: {known}")
    effect = next((one for one in found if (one.scope == "joint") == bool(applied.joint)), found[0])
    wanted = [parameter.name for parameter in effect.parameters]
    joint = "and a joint" if effect.scope == "joint" else "and no joint"
    wrong = sorted(set(applied.parameters) ^ set(wanted))
    if wrong or bool(applied.joint) != (effect.scope == "joint"):
        what = f"parameter {', '.join(wrong)}" if wrong else "a joint"
        raise InputError(source, f"effect '{applied.name}': {what} is unknown or missing", f"Give {', '.join(wanted)} {joint}")
    if applied.joint and joints is not None and applied.joint not in joints:
        raise InputError(source, f"effect '{applied.name}': there is no joint '{applied.joint}'", f"Use {', '.join(joints)}")
    return effect


def read_effects(
    items: Any, source: str | Path, *registries: Registry[Any], joints: Collection[str] | None = None
) -> tuple[Applied, ...]:
    """Check the list `effects` of a model file.

    Args:
        items: Content of the list: entries `{name, parameters}`, with `joint` for effects on one joint.
        source: The file, for messages.
        registries: Effects that the model may hold.
        joints: Names of the model's joints; None to skip the check of joint names.

    Raises:
        InputError: `items` is no list; an effect, joint or parameter is unknown or missing; a value is outside its range; or an
            effect that a model may hold only once is listed twice.
    """
    if not isinstance(items, list):
        raise InputError(source, "'effects' is no list", "Write effects: [] or a list of {name, parameters}")
    effects = []
    for item in items:
        keys = set(item) - {"joint"} if isinstance(item, Mapping) else set()
        if keys != {"name", "parameters"} or not isinstance(item["parameters"], Mapping):
            raise InputError(
                source, f"the entry {item!r} of 'effects' is no {{name, parameters}}",
                "List names with parameters, e.g. {name: restitution, parameters: {restitution: 0.1}}",
            )  # fmt: skip
        applied = Applied(str(item["name"]), str(item.get("joint", "")), item["parameters"])
        effect = effect_of(applied, *registries, source=source, joints=joints)
        values = {
            p.name: checked_number(
                item["parameters"][p.name], p.low, p.high, f"effects.{effect.name}.{p.name}", p.unit, str(source)
            )
            for p in effect.parameters
        }
        effects.append(Applied(applied.name, applied.joint, values))
    refuse_doubles(effects, source, *registries)
    return tuple(effects)


def refuse_doubles(effects: Sequence[Applied], source: str | Path, *registries: Registry[Any]) -> None:
    """Refuse a second entry of an effect that a model may hold only once on the same thing.

    Args:
        effects: Entries of a model.
        source: The file, for messages.
        registries: Effects that the model may hold.

    Raises:
        InputError: There is such an entry.
    """
    places = [(applied.name, applied.joint) for applied in effects]
    for applied, place in zip(effects, places, strict=True):
        if places.count(place) > 1 and effect_of(applied, *registries, source=source).alone:
            where = f" of joint '{applied.joint}'" if applied.joint else ""
            raise InputError(
                source, f"'effects' lists '{applied.name}'{where} {places.count(place)} times, which do not add up to one law",
                "Keep one of these entries",
            )  # fmt: skip


_ACTS_ON = {"joint": "mechanisms", "mechanism": "mechanisms", "body": "thrown bodies", "camera": "pictures"}


def read_names(items: Any, source: str | Path, registry: Registry[Any], *others: Registry[Any]) -> tuple[str, ...] | None:
    """Check the list `effects` of a case: the effects among which a diagnosis searches.

    Args:
        items: Content of the list: names of effects.
        source: The file, for messages.
        registry: Effects that may be named.
        others: Effects on other things, which are refused with a message that says what they act on.

    Returns:
        The names; None, which stands for all effects, if the list is empty or missing.

    Raises:
        InputError: `items` is no list of names, or a name is unknown or belongs to an effect on something else.
    """
    if isinstance(items, str) or not all(isinstance(name, str) for name in items or ()):
        raise InputError(source, "'effects' is no list of names", f"E.g. [{', '.join(list(registry)[:2])}]")
    for name in items or ():
        for other in others:
            if name in other and name not in registry:
                what = f"the effect '{name}' acts on {_ACTS_ON[other[name].scope]}"
                raise InputError(source, what, f"Use one of: {', '.join(registry)}")
        registry.effect(name, source)
    return tuple(items) if items else None


def checked_number(value: Any, low: float, high: float, key: str, unit: str, source: str) -> float:
    """Check that a value of a model file is a number within its range, and return it as a float.

    Args:
        value: Value as read from the file.
        low, high: The range, in `unit`.
        key: Key of the value in the file, for messages.
        unit: Unit of the value, for messages.
        source: The file, for messages.

    Raises:
        InputError: The value is no number, not finite, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(source, f"'{key}' is {value!r}, no number", f"Give {low:g} to {high:g} {unit}".rstrip())
    # Written so that NaN is refused, too.
    if not low <= value <= high:
        raise InputError(source, f"'{key}' is {value:g}, outside its range", f"Give {low:g} to {high:g} {unit}".rstrip())
    return float(value)
