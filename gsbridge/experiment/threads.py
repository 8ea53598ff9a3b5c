"""Threads of the jobs that work on one scene."""

from __future__ import annotations

import os
import re

from gsbridge.errors import InputError

VARIABLE = "GSBRIDGE_SCENE_THREADS"
"""Environment variable that a person sets who has cores to spare."""


def scene_threads() -> int:
    """Threads of each job of a scene: as many as the variable says, else one.

    With one thread, a repeated job gives the same bytes. With two, the cameras of a toy run differed in their last bits.

    Raises:
        InputError: The variable is no number of threads.
    """
    given = os.environ.get(VARIABLE) or "1"
    if not re.fullmatch(r"[1-9]\d{0,3}", given, re.ASCII):
        place = f"the environment variable {VARIABLE}"
        raise InputError(place, f"'{given[:80]}' is no number of threads", "Give a whole number from 1 to 9999, or unset it")
    return int(given)
