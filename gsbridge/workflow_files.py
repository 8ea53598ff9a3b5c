"""Checks of a run's command line before snakemake reads it, whose own messages about faults are hard to understand.

Snakemake reads the files of `--configfile` before the Snakefile, so checks in the Snakefile would come too late. It also
evaluates the expressions of a file that says `__use_yte__: true`. They are Python, and a configuration must not run code.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.configuration.files import check_files
from gsbridge.errors import InputError
from gsbridge.reading import LARGEST_TEXT, load_yaml, regular_file

_REMEDY = "Correct the path, or write KEY: VALUE in each line, as config.yaml does"
_TEMPLATE = "__use_yte__"
_QUIET = ("rules", "progress", "all", "host", "reason")
"""Values that snakemake's `--quiet` accepts."""
_SNAKEFILES = ("Snakefile", "snakefile", "workflow/Snakefile", "workflow/snakefile")
"""Where snakemake looks for a workflow."""


def configuration_files(arguments: Sequence[str]) -> list[Path]:
    """Files that a call of snakemake lays over config.yaml.

    Args:
        arguments: Arguments as on snakemake's command line.
    """
    # As with every option that is given twice, the last one counts.
    given = _words_of(arguments, "--configfile", "--configfiles")
    return [Path(path) for path in (given[-1] if given else [])]


def _words_of(arguments: Sequence[str], *options: str) -> list[list[str]]:
    """Values of an option, one list for each time that it is given: all words that follow it, up to the next option."""
    found = []
    before = list(itertools.takewhile(lambda argument: argument != "--", arguments))
    for place, argument in enumerate(before):
        option, given, value = argument.partition("=")
        if option in options:
            following = itertools.takewhile(lambda word: not word.startswith("-"), before[place + 1 :])
            found.append([value] if given else list(following))
    return found


def check_targets(arguments: Sequence[str]) -> None:
    """Refuse a target that follows an option and would be taken for one of its values.

    Args:
        arguments: Arguments as on snakemake's command line.

    Raises:
        InputError: `--config` is followed by a word without `=`, or `--quiet` by a word that it does not know.
    """
    settings = itertools.chain.from_iterable(_words_of(arguments, "--config", "-C"))
    quiet = itertools.chain.from_iterable(_words_of(arguments, "--quiet", "-q"))
    taken = [("--config", word) for word in settings if "=" not in word]
    taken += [("--quiet", word) for word in quiet if word not in _QUIET]
    for option, word in taken:
        raise InputError(
            "the command line", f"{option} takes '{word}' for a word of its own", f"Write -- before targets: -- {word}"
        )


def check_workflow(arguments: Sequence[str]) -> None:
    """Refuse a call in a folder without a workflow; snakemake would only list the names that it tried.

    Args:
        arguments: Arguments as on snakemake's command line.

    Raises:
        InputError: There is no Snakefile here, and the arguments name none.
    """
    # A profile that is named may name a Snakefile, too; for its version snakemake reads none.
    elsewhere = ("--snakefile", "-s", "--profile", "--version", "-v")
    if any(argument.startswith(elsewhere) for argument in arguments) or any(Path(name).is_file() for name in _SNAKEFILES):
        return
    raise InputError("Snakefile", "there is no such file here", "Go to the project's folder, or name it with --snakefile")


def check_configuration_files(paths: Iterable[str | Path]) -> None:
    """Refuse configuration files that snakemake could not read, or would read as a program.

    Args:
        paths: The configuration files in use.

    Raises:
        InputError: A file is missing, is no YAML (with the line), a key stands twice, it holds no keys at its top level, or it
            asks snakemake to evaluate expressions.
    """
    for path in paths:
        regular_file(path, "configuration", _REMEDY, LARGEST_TEXT)
        check_files([path])
        content = _content(path)
        if not isinstance(content, Mapping):
            raise InputError(path, "this is no configuration: it holds no keys at its top level", _REMEDY)
        if _TEMPLATE in content:
            raise InputError(path, f"with '{_TEMPLATE}' snakemake would run code that the file holds", "Write the values out")


def _content(path: str | Path) -> Any:
    try:
        # JSON first: JSON that is indented with tabs is not valid YAML.
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError:
        return load_yaml(path, "configuration", _REMEDY)


__all__ = ["check_configuration_files", "check_targets", "check_workflow", "configuration_files"]
