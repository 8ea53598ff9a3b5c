"""Effects by name, and the check of lists of effects in model files: one for all models."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from gsbridge.effects.base import Effect
from gsbridge.errors import InputError

Kind = TypeVar("Kind", bound=Effect)


@dataclass(frozen=True)
class Applied:
    """An effect of a model: its name, the joint it acts on (empty for everything else), and its parameters."""

    name: str
    joint: str
    parameters: Mapping[str, float]

    def record(self) -> dict[str, Any]:
        """The entry that stands for it in a model file."""
        out: dict[str, Any] = {"name": self.name, "parameters": dict(self.parameters)}
        return {**out, "joint": self.joint} if self.joint else out


class Registry(Mapping[str, Kind], Generic[Kind]):
    """One effect of each class, by name, in the order of names.

    Classes are listed by hand, so that imports, and with them the digests of rules, show every file that counts.
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
        """An effect by name.

        Raises:
            InputError: There is none of that name.
        """
        if name not in self._effects:
            raise InputError(source, f"the effect '{name}' is unknown", f"Use one of: {', '.join(self)}")
        return self._effects[name]


def effect_of(
    applied: Applied, *registries: Registry[Any], source: str | Path = "model", joints: Collection[str] | None = None
) -> Any:
    """The effect that an entry of a model names, with all its parameters and the joint that it needs.

    Args:
        applied: The entry.
        registries: Effects that may be named. Where two share a name, only one of them acts on a joint.
        source: Where the entry stands, for messages.
        joints: Joints that there are; None where nothing is known of them.

    Raises:
        InputError: The effect or its joint is unknown, or parameters or the joint are missing or do not belong there.
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
        items: Its content: a list of `{name, parameters}`, of a joint's effects with `joint`.
        source: The file, for messages.
        registries: Effects that the model may hold.
        joints: Joints of the model; None where nothing is known of them.

    Raises:
        InputError: No list, an unknown effect, joint or parameter, a missing one, or a value outside its range.
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
    return tuple(effects)


_ACTS_ON = {"joint": "mechanisms", "mechanism": "mechanisms", "body": "thrown bodies", "camera": "pictures"}


def read_names(items: Any, source: str | Path, registry: Registry[Any], *others: Registry[Any]) -> tuple[str, ...] | None:
    """Check a case's list of the effects that may be the reason; None, for all, where it is empty or missing.

    Args:
        items: Its content: a list of names.
        source: The file, for messages.
        registry: Effects that may be named.
        others: Effects that act on something else.

    Raises:
        InputError: It is no list of names, or a name is unknown or that of an effect on something else.
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
    """A number of a model file, within its range.

    Args:
        value: Value as the file holds it.
        low, high: The range.
        key: Where it stands in the file, for messages.
        unit: Its unit, for messages.
        source: The file, for messages.

    Raises:
        InputError: It is no number, not finite, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(source, f"'{key}' is {value!r}, no number", f"Give {low:g} to {high:g} {unit}".rstrip())
    # The comparison also fails for not-a-number.
    if not low <= value <= high:
        raise InputError(source, f"'{key}' is {value:g}, outside its range", f"Give {low:g} to {high:g} {unit}".rstrip())
    return float(value)
