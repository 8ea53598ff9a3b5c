"""Further worlds of the mirror: the same laboratory on another day, or with named hidden changes.

The **laboratory** is the pose of the table and of the wrist camera. In every world it is drawn with the configuration's seed,
so that one registration holds for all worlds. All other hidden parameters are drawn with the world's own seed and severity.
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
    """Return the hidden parameters of a world.

    Args:
        laboratory: Seed of the laboratory, which is the configuration's seed.
        seed: Seed of all other hidden parameters; the laboratory's seed gives the mirror itself.
        changes: Values by name of a hidden parameter; a single number for a parameter of several values sets them all.
        source: Where the names were written, for the error message.
        severity: Severity of the world; None for severity 0.

    Raises:
        InputError: A name is unknown, or a value is not possible.
    """
    home = Hidden.draw(laboratory)
    day = worsened(Hidden.draw(seed), seed, severity or Severity()).changed({name: getattr(home, name) for name in LABORATORY})
    return day.changed(changes or {}, source)


def configured_world(laboratory: int, world: Mapping[str, Any], name: str) -> Hidden:
    """Return the hidden parameters of a world of the configuration.

    Args:
        laboratory: Seed of the laboratory.
        world: The world's `seed`, `severity` and `hidden`.
        name: The world's name, for the error message.

    Raises:
        InputError: As `world_variant`.
    """
    return world_variant(laboratory, world["seed"], world["hidden"], f"config: worlds.{name}", Severity.of(world["severity"]))
