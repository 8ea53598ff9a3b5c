"""Reading of files that others made: limits on their size, and one clear line about whatever is wrong with a file.

A reader calls `regular_file` first, so that devices, pipes and oversized files are refused before they are opened. It does its
work inside `refusing`, which turns what any library raises about a broken file into an `InputError`.
"""

from __future__ import annotations

import contextlib
import os
import traceback
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from gsbridge.errors import NO_ROOM, GsbridgeError, InputError

LARGEST_TEXT = 16 * 2**20
"""Largest size of a YAML file, bytes. The longest that gsbridge writes has some kilobytes."""

MOST_YAML_NODES = 200_000
"""Largest number of values of a YAML file with its aliases expanded: some hundred bytes can expand to billions."""

DEEPEST_YAML = 60
MOST_FILES = 20_000
"""Largest number of files and folders below a folder that a user names as data."""

YAML_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Loader of YAML: libyaml's, which is ten times as fast and comes with every wheel of PyYAML, or else Python's."""


def regular_file(path: str | Path, what: str, remedy: str, largest: int | None = None) -> Path:
    """Check that a path names a file that can be read, and return it.

    Args:
        path: The file.
        what: What the file is, for the message: `record`, `model`.
        remedy: What the user can do, for the message.
        largest: Size limit, bytes; None for no limit.

    Raises:
        InputError: There is no such file, it is a folder, device or pipe, or it is too large.
    """
    source = Path(path)
    try:
        if not source.is_file():
            why = "it is a folder, a device or a pipe" if source.exists() else "it does not exist"
            raise InputError(source, f"the {what} cannot be read: {why}", remedy)
        size = source.stat().st_size
    except (OSError, ValueError) as error:
        # The name is too long, or holds a zero byte.
        raise InputError(str(path)[:200], f"the {what} cannot be read", remedy) from error
    if largest is not None and size > largest:
        raise InputError(source, f"the {what} has {size} bytes; at most {largest} are read", remedy)
    return source


@contextlib.contextmanager
def refusing(source: str | Path, problem: str, remedy: str) -> Iterator[None]:
    """Turn whatever goes wrong inside into one line about a file; gsbridge's own errors pass, and so do those of a full disk.

    Args:
        source: The file.
        problem: What is wrong; the first line of the error's text follows in brackets.
        remedy: What the user can do.

    Raises:
        InputError: Anything else was raised inside.
    """
    try:
        yield
    except GsbridgeError:
        raise
    except NameError as error:
        # In this package's code an unknown name is a bug; in a reader of others' a broken file can cause one.
        if _raised_here(error):
            raise
        raise InputError(source, f"{problem} ({_first_line(error)})", remedy) from error
    except PermissionError as error:
        raise InputError(source, "it may not be read", "Change its permissions") from error
    except OSError as error:
        # A reader may unpack or convert what it reads; a disk that is full then is no fault of the file.
        if error.errno in NO_ROOM:
            raise
        raise InputError(source, f"{problem} ({_first_line(error)})", remedy) from error
    except RecursionError:
        # `from None`, since the traceback of this error has a thousand lines.
        raise InputError(source, f"{problem} (it is nested too deeply)", remedy) from None
    except MemoryError as error:
        raise InputError(source, f"{problem} (it asks for more memory than there is)", remedy) from error
    except Exception as error:
        raise InputError(source, f"{problem} ({_first_line(error)})", remedy) from error


def _raised_here(error: BaseException) -> bool:
    """Whether an error was raised by this package's own code."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and str(frames[-1].f_globals.get("__name__", "")).partition(".")[0] == __package__


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0][:200] if lines else type(error).__name__


def absent(places: Sequence[str | Path]) -> str:
    """What is wrong, in words, with a file or folder that is in none of the places in which it was looked for."""
    names = list(dict.fromkeys(str(place) for place in places))
    return f"there is neither {' nor '.join(names)}" if len(names) > 1 else f"there is no {names[0]}"


def load_yaml(path: str | Path, what: str, remedy: str) -> Any:
    """Read a YAML file: plain values only, no tags of Python, and within limits that no hand-written file reaches.

    Args:
        path: The file.
        what: What the file is, for the message: `case`, `model`.
        remedy: What the user can do, for the message.

    Raises:
        InputError: The file cannot be read, is no YAML (with the line), is too large or nested too deeply, refers to itself,
            or a key stands twice in a block.
    """
    source = regular_file(path, what, remedy, LARGEST_TEXT)
    with refusing(source, "this is not valid YAML", remedy):
        text = source.read_text(encoding="utf-8")
        try:
            refuse_depth(text, source, remedy)
            loader = YAML_LOADER(text)
            root = loader.get_single_node()
            refuse_bombs(root, source, remedy)
            refuse_duplicates(root, source)
            return None if root is None else loader.construct_document(root)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
            raise InputError(source, f"this is not valid YAML ({place}{error.problem})", remedy) from error


def refuse_depth(text: str, source: Path, remedy: str) -> None:
    """Refuse YAML that is nested too deeply; stop at the first such block, since parsing time grows with the depth squared.

    Args:
        text: YAML.
        source: File that the text came from, for the message.
        remedy: What the user can do, for the message.

    Raises:
        InputError: The text is nested deeper than `DEEPEST_YAML` levels.
    """
    depth = 0
    for event in yaml.parse(text, Loader=YAML_LOADER):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST_YAML:
            raise InputError(source, f"it is nested deeper than {DEEPEST_YAML} levels", remedy)


def refuse_bombs(root: yaml.Node | None, source: Path, remedy: str) -> None:
    """Refuse documents whose aliases stand for too many values or for themselves; they are counted without expanding them.

    Args:
        root: Root of the composed document; None for an empty one.
        source: File that the document came from, for the message.
        remedy: What the user can do, for the message.

    Raises:
        InputError: An alias refers to a block that contains it, or the aliases stand for more than `MOST_YAML_NODES` values.
    """
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size(node: yaml.Node) -> int:
        if id(node) in open_nodes:
            raise InputError(source, "an alias stands inside what it refers to", remedy)
        if id(node) not in sizes:
            open_nodes.add(id(node))
            children: Iterable[yaml.Node] = ()
            if isinstance(node, yaml.SequenceNode):
                children = node.value
            elif isinstance(node, yaml.MappingNode):
                children = [item for pair in node.value for item in pair]
            sizes[id(node)] = 1 + sum(size(child) for child in children)
            open_nodes.discard(id(node))
        return sizes[id(node)]

    if root is not None and size(root) > MOST_YAML_NODES:
        raise InputError(source, f"its aliases stand for more than {MOST_YAML_NODES} values", remedy)


def refuse_duplicates(node: yaml.Node | None, source: Path, above: str = "") -> None:
    """Refuse a key that stands twice in a block: YAML would silently keep the last one.

    Args:
        node: Root of the composed document, in which no alias refers to a block that contains it (see `refuse_bombs`).
        source: File that the document came from, for the message.
        above: Keys of the blocks around the node, each followed by a dot, for the message.

    Raises:
        InputError: A key stands twice; the message names both lines.
    """
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            refuse_duplicates(item, source, above)
    if not isinstance(node, yaml.MappingNode):
        return
    lines: dict[tuple[str, str], int] = {}
    for key, value in node.value:
        name, line = str(key.value), key.start_mark.line + 1
        # A block may have several merge keys (`<<`): YAML uses all of them.
        if (key.tag, name) in lines and key.tag != "tag:yaml.org,2002:merge":
            raise InputError(
                source,
                f"the key '{above}{name}' stands twice, in lines {lines[key.tag, name]} and {line}; the first would be lost",
                f"Put both under one '{name}:'",
            )
        lines[key.tag, name] = line
        refuse_duplicates(value, source, f"{above}{name}.")


def files_below(folder: Path, suffixes: tuple[str, ...], what: str, remedy: str) -> list[Path]:
    """Files below a folder that end in one of the suffixes, sorted; links to folders are not followed.

    Args:
        folder: The folder.
        suffixes: Suffixes with their dots, in lower case.
        what: What the folder should be, for the message.
        remedy: What the user can do, for the message.

    Raises:
        InputError: More than `MOST_FILES` files and folders lie there, so the folder cannot be the one that was meant.
    """
    found, seen = [], 0
    for where, folders, names in os.walk(folder):
        seen += len(folders) + len(names)
        if seen > MOST_FILES:
            raise InputError(folder, f"more than {MOST_FILES} files lie there: this is no {what}", remedy)
        found += [Path(where) / name for name in names if name.lower().endswith(suffixes)]
    return sorted(path for path in found if path.is_file())
