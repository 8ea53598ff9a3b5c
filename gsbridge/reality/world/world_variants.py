"""Further worlds of the mirror: the same laboratory on another day, or with named hidden changes.

The **laboratory** is where the table stands and how the wrist camera is mounted. It is drawn by the configuration's seed in
every world, so that one registration holds for all of them; a world's own seed and severity draw all else that is hidden.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.severity import Severity, worsened

LABORATORY = ("camera_shift", "camera_turn", "table_shift", "table_turn")


def world_variant(
    laboratory: int,
    seed: int,
    changes: Mapping[str, Any] | None = None,
    source: str = "worlds",
    severity: Severity | None = None,
) -> Hidden:
    """Hidden parameters of a world.

    Args:
        laboratory: Seed of the laboratory; the configuration's.
        seed: Seed of the rest; the laboratory's gives the mirror itself.
        changes: Values by name of a hidden parameter; a single number for a parameter of several values sets them all.
        source: Where the names were written, for the message.
        severity: How bad a day it is; None for severity 0.

    Raises:
        InputError: Unknown name, or a value that makes no sense.
    """
    home = Hidden.draw(laboratory)
    day = worsened(Hidden.draw(seed), seed, severity or Severity()).changed({name: getattr(home, name) for name in LABORATORY})
    return day.changed(changes or {}, source)


def configured_world(laboratory: int, world: Mapping[str, Any], name: str) -> Hidden:
    """Hidden parameters of a world as the configuration has it.

    Args:
        laboratory: Seed of the laboratory.
        world: Its `seed`, `severity` and `hidden`.
        name: Its name, for the message.

    Raises:
        InputError: As `world_variant`.
    """
    return world_variant(laboratory, world["seed"], world["hidden"], f"config: worlds.{name}", Severity.of(world["severity"]))
