"""Threads of the jobs that work on one scene."""

from __future__ import annotations

import os
import re

VARIABLE = "GSBRIDGE_SCENE_THREADS"
"""Set by a person who has cores to spare."""


def scene_threads() -> int:
    """Threads of each job of a scene: those that a person asks for, else one.

    One thread gives the same bytes whenever a job is made again. On two, a toy's cameras came out with other last bits.
    """
    given = os.environ.get(VARIABLE, "")
    return int(given) if re.fullmatch(r"[1-9]\d*", given) else 1
