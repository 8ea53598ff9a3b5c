"""Errors about targets that no rule makes, with the nearest name that one makes: snakemake only says that there is no rule."""

from __future__ import annotations

import argparse
import difflib
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from gsbridge.errors import InputError

_WILDCARD = re.compile(r"\{(\w+)(?:,((?:[^{}]|\{[\d,]+\})*))?\}")
"""A wildcard in a file's pattern, `{scene}` or `{scene,mug|bowl}`: its name, and the constraint on its value."""

_ALIKE = 0.5
"""Smallest similarity (difflib's ratio, 0..1) at which a value passes for a misspelt one."""

_NEAR = 0.7
"""Smallest similarity of a misspelt target and one that may be meant."""


class Rule(Protocol):
    """The attributes of snakemake's rules that are used here."""

    name: str
    output: Iterable[object]

    def is_producer(self, requested_output: str) -> bool:
        """Whether the rule makes a file."""


def targets_of(command: Sequence[str], parser: Callable[[], argparse.ArgumentParser]) -> list[str]:
    """Rules and files that a call of snakemake asks for; none where the program is another one.

    Args:
        command: The program and its arguments.
        parser: Returns the parser of snakemake's arguments.
    """
    program = Path(command[0])
    if "snakemake" not in (program.name, program.parent.name):
        return []
    return list(parser().parse_known_args(command[1:])[0].targets)


def check_targets(asked: Iterable[str], rules: Iterable[Rule]) -> None:
    """Refuse targets that no rule makes, and rules that make a file for each scene, policy or case.

    Args:
        asked: Names of rules and paths of files.
        rules: All rules of the workflow.

    Raises:
        InputError: A target is neither a rule nor a file that a rule makes (the message names the nearest one), or it is a rule
            whose files have wildcards.
    """
    known = list(rules)
    names = {rule.name: [_plain(str(file)) for file in rule.output] for rule in known}
    for target in asked:
        many = [file for file in names.get(target, []) if "{" in file]
        if many:
            record = next((file for file in many if file.endswith(".json")), many[0])
            raise InputError(target, "this rule makes a file for each scene, policy or case", f"Ask for one of them: {record}")
        path = os.path.relpath(target) if not os.path.isabs(target) else target
        if target not in names and not _is_made(path, known):
            raise InputError(target, "no rule makes this", f"{_advice(path, known)}docs/stages.md lists what can be asked for")


def _is_made(path: str, rules: Iterable[Rule]) -> bool:
    return any(rule.is_producer(path) for rule in rules)


def _advice(path: str, rules: Sequence[Rule]) -> str:
    """What may have been meant, as a sentence followed by a space; empty if no name is near."""
    inside = os.path.relpath(path)
    if os.path.isabs(path) and _is_made(inside, rules):
        return f"Name it from the folder of the run: {inside}. "
    above = next((str(folder) for folder in Path(inside).parents if _is_made(str(folder), rules)), None)
    if above:
        return f"It lies in {above}, which is made as a whole: ask for that. "
    patterns = [str(file) for rule in rules for file in rule.output]
    choices = {rule.name: rule.name for rule in rules} | {_filled(pattern, inside): "" for pattern in patterns}
    choices = {name if "/" in inside else Path(name).name: name for name in choices}
    # One with a wildcard in it names no file that can be asked for.
    likeness = {name: _likeness(inside, name) for name in choices if "{" not in name}
    near = max(likeness, key=likeness.__getitem__, default="")
    return f"Did you mean '{choices[near]}'? " if likeness.get(near, 0) >= _NEAR else ""


def _likeness(given: str, name: str) -> float:
    """How alike two paths are behind the folders that both lie in, which would make any two names in one folder alike."""
    ours, theirs = given.split("/"), name.split("/")
    while ours[1:] and theirs[1:] and ours[0] == theirs[0]:
        ours, theirs = ours[1:], theirs[1:]
    # The quick bounds spare most pairs the slow comparison.
    matcher = difflib.SequenceMatcher(None, "/".join(ours), "/".join(theirs))
    bounds = (matcher.real_quick_ratio, matcher.quick_ratio)
    return 0.0 if any(bound() < _NEAR for bound in bounds) else matcher.ratio()


def _filled(pattern: str, path: str) -> str:
    """Fill a pattern's wildcards with the values in a misspelt path, or the nearest allowed ones; else keep the braces.

    Args:
        pattern: A rule's file pattern, such as `results/scenes/{scene,mug|bowl}/mesh/mesh.json`.
        path: A misspelt path, such as `results/scenes/mugg/mesh.json`.
    """
    values: dict[str, str] = {}
    # A constraint may hold slashes, which separate no folders, so it is removed before the split.
    plain, allowed = _plain(pattern), dict(_WILDCARD.findall(pattern))
    for part, given in zip(plain.split("/"), path.split("/"), strict=False):
        found = re.fullmatch("".join(_loose(piece) for piece in re.split(r"(\{\w+\})", part)), given)
        for name, value in zip(_names(part), found.groups() if found else (), strict=False):
            values.setdefault(name, _allowed(value, name, allowed))
    return _WILDCARD.sub(lambda wildcard: values.get(wildcard[1], f"{{{wildcard[1]}}}"), plain)


def _plain(pattern: str) -> str:
    """A file's pattern without the constraints of its wildcards."""
    return _WILDCARD.sub(r"{\1}", pattern)


def _names(part: str) -> list[str]:
    return [name for name, _ in _WILDCARD.findall(part)]


def _loose(piece: str) -> str:
    """Regular expression for a piece of a pattern, in which a wildcard matches anything."""
    return "(.+?)" if _WILDCARD.fullmatch(piece) else re.escape(piece)


def _allowed(value: str, name: str, allowed: Mapping[str, str]) -> str:
    """A wildcard's value if its constraint allows it, else the nearest allowed value, else the wildcard in braces."""
    constraint = allowed.get(name) or ".+"
    if re.fullmatch(constraint, value):
        return value
    near = difflib.get_close_matches(value, constraint.split("|"), 1, _ALIKE)
    return near[0] if near else f"{{{name}}}"


__all__ = ["Rule", "check_targets", "targets_of"]
