"""A user's case of throws: a YAML file that names a model and records."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import read_names
from gsbridge.errors import InputError
from gsbridge.gap.contact.body import FreeBody, number, read_body
from gsbridge.gap.contact.checks import check_throws
from gsbridge.gap.contact.replay import HORIZON
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.throws import COLUMNS, FEWEST, SHORTEST, Throws, read_throws
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.formats.columns import refuse_shared
from gsbridge.gap.formats.yaml_file import read_case_file
from gsbridge.reading import refusing

_LONGEST = 60.0
"""Largest accepted horizon, s; chaos dominates a replay long before."""

_KEYS = ("model", "records", "columns", "units", "effects", "horizon")


@dataclass(frozen=True)
class ThrowCase:
    """A checked case of throws.

    Args:
        model: The model's file.
        body: The model.
        throws: Throws by role.
        names: Effects to consider; None for all.
        horizon: Length of each throw that is replayed, s.
        reasons: Why the result is degraded.
    """

    model: Path
    body: FreeBody
    throws: Mapping[str, Throws]
    names: tuple[str, ...] | None
    horizon: float
    reasons: tuple[str, ...]


def read_throw_case(path: str | Path) -> ThrowCase:
    """Read and check a case of throws.

    Raises:
        InputError: The file, its model or its throws cannot be used.
    """
    path = Path(path)
    with refusing(path, "the case cannot be used", "Correct it after docs/gap_objects.md"):
        return _throw_case(path)


def _throw_case(path: Path) -> ThrowCase:
    content = read_case_file(path, "docs/gap_objects.md", "records", _KEYS)
    for key in ("columns", "units"):
        section, known = (
            content.get(key) or {},
            (*COLUMNS, *(() if key == "columns" else (name.split(".")[0] for name in COLUMNS))),
        )
        if not isinstance(section, Mapping):
            raise InputError(path, f"'{key}' is no section", "Write 'name: value' lines below it; see docs/gap_objects.md")
        for name, value in section.items():
            if name not in known:
                raise InputError(
                    path, f"'{name}' under '{key}' is no name of ours for a column", f"Ours are {', '.join(COLUMNS)}"
                )
            if not isinstance(value, str):
                raise InputError(path, f"{key}.{name} is {value!r}, which is no text", "Put it in quotes")
    refuse_shared(content.get("columns") or {}, path)
    horizon = number(content.get("horizon", HORIZON), path, "horizon", SHORTEST, _LONGEST)
    body = read_body(path.parent / str(content["model"]))
    body_setup(body)
    names = read_names(content.get("effects"), path, BODY_EFFECTS, JOINT_EFFECTS)
    throws = {}
    for role, file in content["records"].items():
        if role not in ROLES:
            raise InputError(path, f"'{role}' is no role of a record", f"The roles are {', '.join(ROLES)}")
        throws[role] = read_throws(path.parent / str(file), content.get("columns"), content.get("units"))
        check_throws(throws[role], body.figures["gravity"], path.parent / str(file))
    shared = shared_throws(throws)
    throws, reasons = split_throws(throws, path)
    return ThrowCase(path.parent / str(content["model"]), body, throws, names, horizon, (*shared, *reasons))


def shared_throws(throws: Mapping[str, Throws]) -> tuple[str, ...]:
    """Warn, in words, of throws that have two roles: effects would be judged on the data to which they were fitted."""
    seen = {role: {item.position.tobytes() + item.quat.tobytes() for item in items.items} for role, items in throws.items()}
    return tuple(
        f"{count} throws of '{first}' are in '{second}', too, so that they prove nothing: give each role throws of its own"
        for first, second in itertools.combinations(seen, 2)
        if (count := len(seen[first] & seen[second]))
    )


def split_throws(throws: Mapping[str, Throws], source: str | Path) -> tuple[dict[str, Throws], tuple[str, ...]]:
    """Make up missing roles by cutting one set of throws in order; return all roles and a reason that says so.

    Raises:
        InputError: There are no throws `fit`, or a role would have too few throws.
    """
    out = dict(throws)
    reasons: tuple[str, ...] = ()
    missing = [role for role in ROLES if role not in throws]
    if "fit" in missing:
        raise InputError(source, "there are no throws 'fit'", "Name the first of them fit")
    if missing:
        whole = "select" if "select" in throws else "fit"
        parts = [role for role in ROLES if role == whole or role in missing]
        edges = np.linspace(0, len(throws[whole]), len(parts) + 1).astype(int)
        for role, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
            out[role] = throws[whole].part(int(first), int(last))
        reasons = (f"the throws '{whole}' were cut into {' and '.join(parts)}, which share one day and one way of throwing",)
    for role in ROLES:
        if len(out[role]) < FEWEST:
            raise InputError(
                source, f"'{role}' has {len(out[role])} throws", f"Record at least {FEWEST} for each role, better 60"
            )
    return {role: out[role] for role in ROLES}, reasons
