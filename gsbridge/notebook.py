"""A small cache of facts in the user's cache folder: one process computes a fact, later ones look it up by a text key.

The cache only saves time: without it every fact is computed again, so errors of reading and writing are ignored.
"""

from __future__ import annotations

import atexit
import functools
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

MOST = 20_000
"""Largest number of facts that a notebook keeps; a process that would exceed it replaces the old facts by its own."""


def cache_root() -> Path:
    """Folder of everything that this package keeps between processes: below `XDG_CACHE_HOME` or `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gsbridge"


class Notebook:
    """A file of JSON values by text keys; new values are written once, when the process ends."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._new: dict[str, Any] = {}

    @functools.cached_property
    def _old(self) -> dict[str, Any]:
        """Facts that earlier processes wrote; none if the file is absent or broken."""
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def look_up(self, key: str, work_out: Callable[[], Any]) -> Any:
        """Return the fact with this key: from the notebook if it is there, else as `work_out` computes it."""
        if key in self._old:
            return self._old[key]
        if key not in self._new:
            if not self._new:
                atexit.register(self.save)
            self._new[key] = work_out()
        return self._new[key]

    def save(self) -> None:
        """Add the new facts to the file, whole or not at all."""
        if not self._new:
            return
        facts = self._new if len(self._old) + len(self._new) > MOST else {**self._old, **self._new}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile("w", dir=self.path.parent, suffix=".part", delete=False, encoding="utf-8") as file:
                json.dump(facts, file)
            os.replace(file.name, self.path)
        except OSError:
            return
