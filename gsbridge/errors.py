"""Error types: one clear sentence that names the file, what is wrong, and what to do."""

from __future__ import annotations

import errno
from pathlib import Path

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that the user mends by making room: a full disk, a used-up quota, a file beyond the process's limit."""


class GsbridgeError(Exception):
    """Base of every error a user can cause and mend; shown without a traceback."""


class _ToldError(GsbridgeError):
    """An error of three parts that can be pickled, so that it passes whole from one process to another.

    Args:
        place: Where the fault is, or an error of this kind to copy.
        problem: What is wrong, in plain words.
        remedy: What the user can do about it.
    """

    parts: tuple[str, str, str]

    def __init__(self, place: str | Path | _ToldError, problem: str = "", remedy: str = "") -> None:
        # gymnasium raises `type(error)(error)` for what went wrong in the worker of a vector environment.
        self.parts = place.parts if isinstance(place, _ToldError) else (str(place), problem, remedy)
        if not all(self.parts):
            raise TypeError("an error tells a place, a problem and a remedy")
        where, self.problem, self.remedy = self.parts
        super().__init__(f"{where}: {self.problem}. {self.remedy}")

    def __reduce__(self) -> tuple[type[_ToldError], tuple[str, str, str]]:
        return type(self), self.parts


class InputError(_ToldError):
    """A file or setting given by the user cannot be used.

    Args:
        source: The file, folder or setting at fault.
        problem: What is wrong with it, in plain words.
        remedy: What the user can do about it.
    """

    def __init__(self, source: str | Path | _ToldError, problem: str = "", remedy: str = "") -> None:
        super().__init__(source, problem, remedy)
        self.source = self.parts[0]


class StageError(_ToldError):
    """A stage ran, but its result is not good enough for the stages that follow.

    Args:
        stage: Name of the stage, with the scene where there is one.
        problem: What was found, with figures.
        remedy: What the user can do about it.
    """

    def __init__(self, stage: str | _ToldError, problem: str = "", remedy: str = "") -> None:
        super().__init__(stage, problem, remedy)
        self.stage = self.parts[0]
