"""Small facts that one process works out and later ones look up, kept in the user's cache folder under the key of their source.

A notebook is a convenience: without it everything is worked out again, so what cannot be read or written is passed over.
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
"""Largest number of facts that a notebook keeps; one that holds more starts anew with those of the last process."""


def cache_root() -> Path:
    """Folder of everything that this package keeps between processes: below `XDG_CACHE_HOME` or `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gsbridge"


class Notebook:
    """Facts as JSON values by text keys; what is new is written once, when the process ends."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._new: dict[str, Any] = {}

    @functools.cached_property
    def _old(self) -> dict[str, Any]:
        """What earlier processes wrote down; nothing where the file is absent or broken."""
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def look_up(self, key: str, work_out: Callable[[], Any]) -> Any:
        """The fact with this key, from the notebook or worked out now."""
        if key in self._old:
            return self._old[key]
        if key not in self._new:
            if not self._new:
                atexit.register(self.save)
            self._new[key] = work_out()
        return self._new[key]

    def save(self) -> None:
        """Add what is new to the file, whole or not at all."""
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
