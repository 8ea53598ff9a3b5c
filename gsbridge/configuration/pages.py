"""What is made from the models for people and editors: the JSON schema, and the tables of `docs/configuration.md`.

`make schema` runs this module in the folder of the project; a test says where it was forgotten.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from gsbridge.configuration import experiment, scenes, whole
from gsbridge.configuration.base import Given, plain
from gsbridge.configuration.whole import Configuration, Sections
from gsbridge.errors import InputError

SCHEMA = Path("rules/schemas/config.schema.json")
PAGE = Path("docs/configuration.md")
_BLOCK = re.compile(r"<!-- keys: (\w+) -->\n.*?<!-- end -->\n", re.DOTALL)
_LINE = 160
_HEAD = "| key | default | allowed | meaning |\n|---|---|---|---|\n"


def json_schema() -> str:
    """The JSON schema of `config.yaml`, for editors that complete and check as one types."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **_untitled(Configuration.model_json_schema())}
    return _spread(schema) + "\n"


def filled(page: str) -> str:
    """A page whose blocks between `<!-- keys: NAME -->` and `<!-- end -->` are the tables of these models.

    Args:
        page: Markdown. NAME is a section of the configuration, or a class of `scenes` or `experiment`.

    Raises:
        InputError: There is no such model.
    """
    return _BLOCK.sub(lambda found: f"<!-- keys: {found[1]} -->\n\n{table(_model(found[1]))}\n<!-- end -->\n", page)


def table(model: type[BaseModel]) -> str:
    """Keys of some settings as a table in Markdown: default, allowed values, meaning."""
    schema = model.model_json_schema()
    rows = []
    # What an experiment is about goes before the sections of its stages.
    for name, field in sorted(model.model_fields.items(), key=lambda item: item[0] in Sections.model_fields):
        allowed = _allowed(schema["properties"][name], schema.get("$defs", {}))
        meaning = re.sub(r"docs/(\w+)\.md", r"[docs/\1.md](\1.md)", field.description or "")
        cells = [f"`{name}`", _default(model, name), allowed, meaning]
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n")
    return _HEAD + "".join(rows)


def write_pages(root: Path) -> None:
    """Write the schema and fill the page's tables anew.

    Args:
        root: Folder of the project.
    """
    page = root / PAGE
    (root / SCHEMA).parent.mkdir(parents=True, exist_ok=True)
    (root / SCHEMA).write_text(json_schema(), encoding="utf-8")
    page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


def _model(name: str) -> type[BaseModel]:
    """The settings of a section, or of a class of that name."""
    if name in Sections.model_fields:
        return type(Configuration.model_fields[name].get_default(call_default_factory=True))
    for place in (scenes, experiment, whole):
        if hasattr(place, name):
            return getattr(place, name)
    raise InputError(PAGE, f"there are no settings '{name}'", "Name a section, or a class of gsbridge.configuration")


def _default(model: type[BaseModel], name: str) -> str:
    """Default of a key, as YAML writes it."""
    field = model.model_fields[name]
    if field.is_required():
        return "must be given"
    if issubclass(model, Given):
        return ""
    value = field.get_default(call_default_factory=True)
    content = plain(value)
    if isinstance(value, BaseModel) and not isinstance(value, Given):
        return "see below"
    if content is None or (isinstance(content, int | float) and not isinstance(content, bool)):
        return "null" if content is None else f"{content}"
    return f"`{content}`" if isinstance(content, str) else f"`{json.dumps(content)}`".replace('"', "")


def _allowed(schema: Mapping[str, Any], defs: Mapping[str, Any]) -> str:
    """The values that a part of a JSON schema allows, in words."""
    if "$ref" in schema:
        return _allowed(defs[schema["$ref"].rsplit("/", 1)[1]], defs)
    if "anyOf" in schema:
        return ", or ".join(_allowed(part, defs) for part in schema["anyOf"])
    if "enum" in schema or "const" in schema:
        return ", ".join(f"`{json.dumps(word)}`".replace('"', "") for word in schema.get("enum", [schema.get("const")]))
    match schema.get("type"):
        case "integer":
            step = f", a multiple of {schema['multipleOf']}" if "multipleOf" in schema else ""
            return f"whole, {_range(schema)}{step}"
        case "number":
            return _range(schema)
        case "boolean":
            return "`true`, `false`"
        case "string":
            return "text"
        case "null":
            return "`null`"
        case "array" if "prefixItems" in schema:
            parts = [_allowed(part, defs) for part in schema["prefixItems"]]
            same = len(set(parts)) == 1
            return f"{len(parts)} values: " + (f"each {parts[0]}" if same else "; ".join(parts))
        case "array":
            return "list of " + _allowed(schema["items"], defs)
        case "object" if "properties" in schema:
            return "keys below"
        case "object":
            inner = [*schema.get("patternProperties", {}).values(), schema.get("additionalProperties", {})]
            return "names, each with " + _allowed(inner[0] if isinstance(inner[0], dict) else {}, defs)
    return "any value"


def _range(schema: Mapping[str, Any]) -> str:
    """The range of a number, in words."""
    if "minimum" in schema and "maximum" in schema:
        return f"{schema['minimum']} to {schema['maximum']}"
    words = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
    return ", ".join(f"{word} {schema[key]}" for key, word in words.items() if key in schema) or "a number"


def _spread(value: Any, indent: str = "\n") -> str:
    """JSON in which a block of keys stands on one line where it fits, so that a difference shows what was changed."""
    line = json.dumps(value, ensure_ascii=False)
    if len(line) <= _LINE or not isinstance(value, dict | list):
        return line
    inside = indent + " "
    if isinstance(value, list):
        return "[" + inside + f",{inside}".join(_spread(item, inside) for item in value) + indent + "]"
    items = (f"{json.dumps(key)}: {_spread(item, inside)}" for key, item in value.items())
    return "{" + inside + f",{inside}".join(items) + indent + "}"


def _untitled(schema: Any) -> Any:
    """The same without pydantic's titles, which repeat the keys."""
    if isinstance(schema, list):
        return [_untitled(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {key: _untitled(item) for key, item in schema.items() if key != "title" or not isinstance(item, str)}


if __name__ == "__main__":
    write_pages(Path())
