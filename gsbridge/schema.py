"""Check of the configuration against its JSON schema, with one line per fault instead of the schema's text."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from gsbridge.errors import InputError

_NAMES = "^[a-z][a-z0-9_]*$"
"""Pattern of the names that become folders."""
_KINDS = {"object": "block of keys", "array": "list", "string": "text"}
_DOCS = "See docs/configuration.md"


def check_schema(config: Mapping[str, Any], schema: str | Path) -> None:
    """Check a configuration as the user wrote it.

    Args:
        config: The configuration, before defaults are filled in.
        schema: YAML file with a JSON schema.

    Raises:
        InputError: A key is misspelt or missing, or a value has a wrong type or range; names the key.
    """
    validator = Draft202012Validator(yaml.safe_load(Path(schema).read_text(encoding="utf-8")))
    faults = sorted(validator.iter_errors(config), key=lambda error: [str(part) for part in error.absolute_path])
    if not faults:
        return
    key, problem, remedy = _explain(_deepest(faults[0]))
    more = f" ({len(faults) - 1} more faults)" if len(faults) > 1 else ""
    raise InputError(f"config: {key}" if key else "config", problem + more, remedy)


def _deepest(error: ValidationError) -> ValidationError:
    """Of alternatives, the fault in the one that was meant: not the one that a null would choose."""
    while error.context:
        # Of null and a block of keys, the block was meant.
        inner = [fault for fault in error.context if fault.validator_value != "null"]
        error = max(inner, key=lambda fault: len(fault.absolute_path))
    return error


def _listed(values: Iterable[Any]) -> str:
    return ", ".join("null" if value is None else str(value) for value in values)


def _near(word: Any, choices: Iterable[Any]) -> str:
    """A choice that a misspelt word may stand for, as a question; empty where there is none."""
    found = difflib.get_close_matches(str(word).lower(), [str(choice) for choice in choices], 1)
    return f"Did you mean '{found[0]}'? " if found else ""


def _explain(error: ValidationError) -> tuple[str, str, str]:
    """Place, problem and remedy of a fault."""
    key = ".".join(str(part) for part in error.absolute_path)
    value, wanted, schema = error.instance, error.validator_value, error.schema
    match error.validator:
        case "additionalProperties":
            known = schema.get("properties", {})
            unknown = next(name for name in value if name not in known)
            return key, f"'{unknown}' is no key", f"{_near(unknown, known)}Keys here: {_listed(known)}"
        case "required":
            missing = next(name for name in wanted if name not in value)
            return key, f"the key '{missing}' is missing", f"Add it: {_what(schema, missing)}"
        case "pattern" if wanted == _NAMES:
            return (
                ".".join(filter(None, (key, str(value)))),
                "the name becomes a folder and may hold only a-z, 0-9 and _, a letter first",
                "Rename it",
            )
        case "enum" | "const":
            choices = wanted if isinstance(wanted, list) else [wanted]
            return key, f"'{value}' is not possible", f"{_near(value, choices)}Give one of: {_listed(choices)}"
        case "minProperties" | "maxProperties" if key:
            given = _listed(value) or "none"
            return key, f"exactly one of these is wanted, and {given} given", f"Keep one of: {_listed(schema['properties'])}"
        case "type":
            kinds = [kind for kind in (wanted if isinstance(wanted, list) else [wanted]) if kind != "null"]
            kind = " or ".join(_KINDS.get(kind, kind) for kind in kinds)
            keys = f"Keys here: {_listed(schema['properties'])}" if "properties" in schema else schema.get("description", _DOCS)
            return key, f"{value!r} is no {kind}", keys
    return key, error.message, schema.get("description", _DOCS)


def _what(schema: Mapping[str, Any], key: str) -> str:
    """What a key of a block means."""
    return schema.get("properties", {}).get(key, {}).get("description", _DOCS)
