"""What is wrong with a configuration, in one line: the key, the problem, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from math import isnan
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gsbridge.errors import InputError

_DOCS = "See docs/configuration.md"
_KINDS = {
    "int": "integer",
    "float": "number",
    "bool": "boolean",
    "string": "text",
    "list": "list",
    "tuple": "list",
    "dict": "block of keys",
    "model": "block of keys",
}
"""The words for what a value should have been, by the first word of pydantic's name for the fault."""
_RANGES = {
    "greater_than": "is not above {gt}",
    "greater_than_equal": "is less than the minimum of {ge}",
    "less_than": "is not below {lt}",
    "less_than_equal": "is greater than the maximum of {le}",
    "multiple_of": "is no multiple of {multiple_of}",
    "finite_number": "is no finite number",
}
_LARGEST_WHOLE = 2**53
"""Up to here a float tells whole numbers apart."""


class _Place:
    """What a fault is about.

    Args:
        model: The settings at fault.
        location: Where in them, as pydantic says it: keys, and behind them the alternative of a type that was tried.
    """

    def __init__(self, model: type[BaseModel], location: Sequence[int | str]) -> None:
        self.keys: list[str] = []
        self.kind: Any = model
        self.meaning = _DOCS
        for part in location:
            inside = self._inside(part)
            if inside is None:
                break
            self.keys.append(str(part))
            self.kind = inside

    def _inside(self, part: int | str) -> Any:
        """Type of what stands under a key or at a number; None where that is neither."""
        known = self.known
        if known:
            if part not in known:
                return None
            self.meaning = known[part].description or _DOCS
            return known[part].annotation
        for kind in _alternatives(self.kind):
            inner = [item for item in get_args(kind) if item is not Ellipsis]
            if get_origin(kind) is dict and part != "[key]":
                return inner[1]
            if get_origin(kind) in (list, tuple) and isinstance(part, int):
                return inner[min(part, len(inner) - 1)]
        return None

    @property
    def known(self) -> Mapping[Any, Any]:
        """The keys that may stand here; empty where this is no block of keys."""
        models = [kind for kind in _alternatives(self.kind) if isinstance(kind, type) and issubclass(kind, BaseModel)]
        return models[0].model_fields if models else {}

    @property
    def choices(self) -> list[Any]:
        """The values of which one must be given; empty where there is no such list."""
        return [choice for kind in _alternatives(self.kind) if get_origin(kind) is Literal for choice in get_args(kind)]


def _alternatives(kind: Any) -> list[Any]:
    """The types of which a value may be, without their ranges and without null."""
    if hasattr(kind, "__metadata__"):
        return _alternatives(kind.__origin__)
    if get_origin(kind) in (None, Literal, dict, list, tuple):
        return [kind]
    return [inner for argument in get_args(kind) if argument is not type(None) for inner in _alternatives(argument)]


def explain(model: type[BaseModel], error: ValidationError, source: str) -> InputError:
    """The first fault of some settings in one line.

    Args:
        model: The settings.
        error: What pydantic finds wrong with them.
        source: What is at fault as a whole, such as `config`.
    """
    found: dict[tuple[str, ...], list[tuple[_Place, ErrorDetails]]] = {}
    faults = error.errors(include_url=False)
    misspelt = {details["loc"][:-1] for details in faults if details["type"] == "extra_forbidden"}
    for details in faults:
        about_a_key = details["type"] in ("extra_forbidden", "missing")
        place = _Place(model, details["loc"][:-1] if about_a_key else details["loc"])
        if details["type"] == "missing" and details["loc"][:-1] in misspelt:
            continue  # the misspelt key stands for it
        # Alternatives of one type have their faults at one place.
        key = (*place.keys, "", str(details["loc"][-1])) if about_a_key else (*place.keys,)
        found.setdefault(key, []).append((place, details))
    place, details = _most_telling(found[min(found)])
    problem, remedy = _sentences(place, details)
    where = ".".join(place.keys[:-1] if _is_name(details) else place.keys)
    more = f" ({len(found) - 1} more fault{'s' if len(found) > 2 else ''})" if len(found) > 1 else ""
    return InputError(f"{source}: {where}" if where else source, problem + more, remedy)


def _most_telling(faults: list[tuple[_Place, ErrorDetails]]) -> tuple[_Place, ErrorDetails]:
    """Choose the alternative that the user meant where none fits: one of the words for a text, else the number."""
    # Numbers on the command line arrive as text.
    words = [fault for fault in faults if fault[1]["type"] == "literal_error" and _is_word(fault[1]["input"])]
    others = [fault for fault in faults if fault[1]["type"] != "literal_error"]
    return (words or others or faults)[0]


def _is_word(given: object) -> bool:
    """True for a text that is no number."""
    return isinstance(given, str) and _as_number(given) is None


def _is_name(details: ErrorDetails) -> bool:
    """Whether a fault is a name, under which something stands, that is no text."""
    return details["type"] == "string_type" and details["loc"][-1:] == ("[key]",)


def _sentences(place: _Place, details: ErrorDetails) -> tuple[str, str]:
    """Problem and remedy of a fault."""
    value, kind = details["input"], details["type"]
    context = details.get("ctx", {})
    match kind:
        case "extra_forbidden":
            unknown = details["loc"][-1]
            return f"'{unknown}' is no key", f"{near(unknown, place.known)}Keys here: {listed(place.known)}"
        case "missing" if place.known:
            missing = details["loc"][-1]
            return f"the key '{missing}' is missing", f"Add it: {place.known[missing].description or _DOCS}"
        case "missing" | "too_long" | "too_short":
            wanted = {"too_short": "at least ", "too_long": "at most "}.get(kind, "")
            count = context.get("min_length", context.get("max_length", len(get_args(place.kind))))
            return f"{len(value)} are given, {wanted}{count} wanted", place.meaning
        case "string_pattern_mismatch":
            return "the name becomes a folder and may hold only a-z, 0-9 and _, a letter first", "Rename it"
        case "literal_error":
            number = ", or a number" if {int, float} & set(_alternatives(place.kind)) else ""
            return f"'{value}' is not possible", f"{near(value, place.choices)}Give one of: {listed(place.choices)}{number}"
        case "string_type" if _is_name(details) or isinstance(value, bool):
            return _no_text(value, "" if _is_name(details) else f". {place.meaning}")
        case "fault":
            return context["problem"], context["remedy"]
    if kind in _RANGES:
        if kind != "finite_number" and _as_number(value) is None:
            return f"{value} is no number", place.meaning
        limits = {name: _digits(limit) for name, limit in context.items()}
        return f"{_digits(value)} {_RANGES[kind].format(**limits)}", place.meaning
    if kind.split("_")[0] in _KINDS and kind.split("_")[1] in ("type", "parsing", "from"):
        keys = f"Keys here: {listed(place.known)}" if place.known else place.meaning
        given = _as_number(value) if kind == "int_parsing" else None
        if given is not None and given.is_integer() and abs(given) < _LARGEST_WHOLE:
            keys = f"Write it out: {int(given)}. {keys}"
        return f"{value!r} is no {_KINDS[kind.split('_')[0]]}", keys
    return f"{value!r}: {details['msg']}", place.meaning


def _no_text(value: Any, meaning: str) -> tuple[str, str]:
    """Problem and remedy of what YAML takes for another thing than text, such as a scene with the name `yes`."""
    words = {"True": "yes, on or true", "False": "no, off or false", "None": "null or ~"}.get(str(value))
    if words is None:
        return f"a name here is {value}, which is no text", "Choose a name that begins with a letter"
    kind = "nothing" if value is None else "a switch"
    return (
        f"YAML reads {words} without quotes as {kind}, and text is wanted",
        f"Put it in quotes, or name it otherwise{meaning}",
    )


def _as_number(value: Any) -> float | None:
    """A number, which may be given as text; None for what is none, such as `nan`."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return None if isnan(number) else number


def _digits(value: Any) -> str:
    """A number as people write it: a whole one without an exponent."""
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < _LARGEST_WHOLE else f"{value:g}"
    return str(value)


def listed(values: Iterable[Any]) -> str:
    """Values beside one another, as YAML writes them."""
    return ", ".join({None: "null", True: "true", False: "false"}.get(value, str(value)) for value in values)


def near(word: Any, choices: Iterable[Any]) -> str:
    """A choice that a misspelt word may stand for, as a question; empty where there is none."""
    found = difflib.get_close_matches(str(word).lower(), [str(choice) for choice in choices], 1)
    return f"Did you mean '{found[0]}'? " if found else ""
