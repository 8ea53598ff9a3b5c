"""Files that appear whole or not at all, and the JSON record that each stage leaves."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge import __version__
from gsbridge.errors import NO_ROOM, InputError
from gsbridge.reading import refusing, regular_file

logger = logging.getLogger("gsbridge")

LARGEST_JSON = 64 * 2**20
"""Largest size of a JSON file, bytes. The longest that gsbridge writes has some megabytes."""


@contextlib.contextmanager
def _named(target: Path) -> Iterator[None]:
    """Add the name of the file that is being written to a full-disk error, which otherwise names no file."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            raise OSError(error.errno, error.strerror, str(target)) from error
        raise


def _sweep(folder: Path, start: str, end: str) -> None:
    """Remove temporary files of the same target, named `start`, process id, `end`, whose process no longer runs."""
    for left in folder.iterdir():
        if not (left.name.startswith(start) and left.name.endswith(end)):
            continue
        writer = left.name[len(start) : len(left.name) - len(end)]
        if not writer.isdigit() or _is_running(int(writer)):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    """Whether a process of this machine is alive."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


@contextlib.contextmanager
def atomic_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there only when the block ends without an error."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
    _sweep(target.parent, f".{target.stem}.", f".part{target.suffix}")
    try:
        with _named(target):
            yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_directory(path: str | Path) -> Iterator[Path]:
    """Yield an empty temporary folder; it replaces `path` only when the block ends without an error."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    _sweep(target.parent, f".{target.name}.", ".part")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        with _named(target):
            yield temporary
        shutil.rmtree(target, ignore_errors=True)
        os.replace(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _plain(value: Any) -> Any:
    """Turn numpy values and paths into JSON values; non-finite numbers, which JSON cannot hold, become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def write_json(path: str | Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file whole; numpy values are accepted, non-finite numbers become null."""
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(_plain(content), indent=2) + "\n", encoding="utf-8")


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a JSON object that a stage wrote; for files of the user's, see `gsbridge.given.read_given_json`.

    Raises:
        InputError: The file is missing, too large, or no JSON object.
    """
    source, again = Path(path), "Delete it and run the stage again"
    regular_file(source, "JSON file", "Check the path, or run the stage that makes it", LARGEST_JSON)
    with refusing(source, "this is not valid JSON", again):
        content = json.loads(source.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise InputError(source, "the JSON file holds no object", again)
    return content


def versions(*packages: str) -> dict[str, str]:
    """Versions of gsbridge and of the named distributions, for a stage's record."""
    return {"gsbridge": __version__, **{name: metadata.version(name) for name in packages}}


def write_stage(
    path: str | Path, *, reasons: Sequence[str] = (), seed: int | None = None, packages: Sequence[str] = (), **numbers: Any
) -> None:
    """Write the record `{stage}.json` of a stage.

    Args:
        path: The record, beside the stage's data.
        reasons: Why the result is degraded; empty for a pass.
        seed: Random seed the stage used, if any.
        packages: Distributions whose versions matter for the result.
        **numbers: The stage's own figures.
    """
    for reason in reasons:
        logger.warning("%s is degraded: %s", Path(path).stem, reason)
    write_json(
        path,
        {
            "status": "degraded" if reasons else "pass",
            "reasons": list(reasons),
            **numbers,
            "seed": seed,
            "versions": versions(*packages),
        },
    )
