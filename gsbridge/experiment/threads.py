"""Threads of the jobs that work on one scene."""

from __future__ import annotations

import os
import re

VARIABLE = "GSBRIDGE_SCENE_THREADS"
"""Environment variable that a person sets who has cores to spare."""


def scene_threads() -> int:
    """Threads of each job of a scene: as many as the variable says, else one.

    With one thread, a repeated job gives the same bytes. With two, the cameras of a toy run differed in their last bits.
    """
    given = os.environ.get(VARIABLE, "")
    return int(given) if re.fullmatch(r"[1-9]\d*", given) else 1
