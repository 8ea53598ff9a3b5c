"""Reader for the YAML files of cases and models, with one clear sentence for each possible fault."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import yaml

from gsbridge.effects.registry import checked_number
from gsbridge.errors import InputError
from gsbridge.reading import YAML_LOADER, load_yaml

_AS_TEXT = re.compile(r"[-+]?((0|[1-9]\d*)(\.\d*)?|\.\d+)([eE][-+]?\d+)?|[-+]?inf")
"""Numbers that YAML 1.1 reads as text: `5e-4` (it has no point before its exponent), `inf`, and any number in quotes."""


_MISREAD = re.compile(r"[-+]?(0[0-7_]+|\d[\d_]*(:[0-5]?\d)+(\.\d*)?)")
"""Unquoted text that YAML 1.1 reads as a different number than it shows: 060 as 48, 1:30 as 90."""


def plain_number(value: Any) -> float | None:
    """Convert a value from a YAML file to a number; None if it is not one (other text, truth values). `5e-4` is a number."""
    if isinstance(value, str) and _AS_TEXT.fullmatch(value):
        return float(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def stated_number(value: Any, low: float, high: float, key: str, unit: str, source: str | Path) -> float:
    """Return a number from a case or a model after checking its range.

    Args:
        value: Value as read from the file.
        low, high: The range, in `unit`.
        key: Its key in the file, for messages.
        unit: Its unit, for messages.
        source: The file, for messages.

    Raises:
        InputError: The value is not a number, not finite, or out of range.
    """
    number = plain_number(value)
    return checked_number(value if number is None else number, low, high, key, unit, str(source))


def read_yaml(path: str | Path, what: str, page: str) -> Any:
    """Read the content of a YAML file.

    Args:
        path: The file.
        what: Word for the kind of file, for messages: `case`, `model`.
        page: Page of the documentation that shows the layout, for messages.

    Raises:
        InputError: The file cannot be read, is not YAML (the message names the line), has a key twice in one block, or YAML
            reads a number as a different one than the file shows.
    """
    content = load_yaml(path, what, f"Check the path, or see how {page} writes it")
    for event in yaml.parse(Path(path).read_text(encoding="utf-8"), Loader=YAML_LOADER):
        if not (isinstance(event, yaml.ScalarEvent) and event.implicit[0] and _MISREAD.fullmatch(event.value)):
            continue
        # YAML reads some of these as text, such as 09:30, which is harmless.
        if not isinstance(yaml.safe_load(event.value), str):
            line = event.start_mark.line + 1 if event.start_mark else 1
            raise InputError(
                path, f"line {line}: YAML reads {event.value[:40]} as another number than it says",
                "Write it without zeros in front and without colons, or in quotes where it is a name",
            )  # fmt: skip
    return content


def read_case_file(path: str | Path, page: str, measured: str, known: Collection[str]) -> Mapping[str, Any]:
    """Read the content of a case's file, which names a model and measurements.

    Args:
        path: The file.
        page: Page of the documentation that shows the layout, for messages.
        measured: Key of the section that names the measurements.
        known: All keys that a case may have.

    Raises:
        InputError: The file cannot be read, 'model' or the section `measured` is missing, or a key is unknown.
    """
    content = read_yaml(path, "case", page)
    for key in content if isinstance(content, Mapping) else ():
        if key not in known:
            raise InputError(path, f"the key '{key}' is unknown", f"Use only: {', '.join(known)}")
    if not isinstance(content, Mapping) or "model" not in content or measured not in content:
        raise InputError(path, f"a case needs 'model' and '{measured}'", f"See {page}")
    if not isinstance(content[measured], Mapping):
        raise InputError(
            path, f"'{measured}' does not name a file for each role", f"Write '{measured}: {{ROLE: FILE}}'; see {page}"
        )
    return content
