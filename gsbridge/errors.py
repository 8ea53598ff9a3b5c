"""Error types: one clear sentence that names the file, what is wrong, and what to do."""

from __future__ import annotations

import errno
from pathlib import Path

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that the user mends by making room: a full disk, a used-up quota, a file beyond the process's limit."""


class GsbridgeError(Exception):
    """Base of every error a user can cause and mend; shown without a traceback."""


class InputError(GsbridgeError):
    """A file or setting given by the user cannot be used.

    Args:
        source: The file, folder or setting at fault.
        problem: What is wrong with it, in plain words.
        remedy: What the user can do about it.
    """

    def __init__(self, source: str | Path, problem: str, remedy: str) -> None:
        self.source = str(source)
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{self.source}: {problem}. {remedy}")


class StageError(GsbridgeError):
    """A stage ran, but its result is not good enough for the stages behind it.

    Args:
        stage: Name of the stage, with the scene where there is one.
        problem: What was found, with figures.
        remedy: What the user can do about it.
    """

    def __init__(self, stage: str, problem: str, remedy: str) -> None:
        self.stage = stage
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{stage}: {problem}. {remedy}")
