"""Threads of the jobs that work on one scene: those that scenes side by side leave each other."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable

VARIABLE = "GSBRIDGE_SCENE_THREADS"
"""Set by a person, or by the main process for its jobs, which see other targets than a person named."""


def scene_threads(cores: int | None, arguments: Iterable[str], scenes: Collection[str]) -> int:
    """Threads of each job of a scene; results do not depend on them.

    Scenes side by side use cores better than threads do, so that only cores which they leave idle are shared out.

    Args:
        cores: Of this run; None where the profile says nothing of them, as on a cluster.
        arguments: Of the command line.
        scenes: Those of the preset, which run when no results of single scenes are asked for.
    """
    given = os.environ.get(VARIABLE, "")
    if re.fullmatch(r"[1-9]\d*", given):
        return int(given)
    wanted, others = set(), False
    for argument in arguments:
        if re.match(r"(?:\./)?results/", argument):
            found = re.match(r"(?:\./)?results/scenes/([^/]+)/", argument)
            others |= found is None
            if found:
                wanted.add(found[1])
    count = len(wanted) if wanted and not others else len(wanted | set(scenes))
    return max(1, (cores or 1) // max(1, count))
