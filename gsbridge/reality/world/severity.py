"""Severity, 0 to 4, of a world: it changes the hidden parameters that the world's seed draws, in directions set by the seed.

The table of sizes, with a reason for each line, is in docs/mirror.md; a test compares it with the table here.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.reality.world.hidden import Hidden

WORST = 4
"""Highest severity."""

PHYSICS, LOOK = "physics", "look"


@dataclass(frozen=True)
class Severity:
    """How much a world of the mirror differs from what the simulation assumes.

    Args:
        look: Severity of camera, light, surfaces and surroundings, 0 to 4.
        physics: Severity of arm and object, 0 to 4.

    Raises:
        InputError: A severity is not a whole number from 0 to 4.
    """

    look: int = 0
    physics: int = 0

    def __post_init__(self) -> None:
        for value in (self.look, self.physics):
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= WORST:
                raise InputError("severity", f"{value!r} is none", f"Give a whole number from 0 to {WORST}")

    @classmethod
    def of(cls, given: int | dict[str, int]) -> Severity:
        """Read the severity from the configuration: one number for both, or `look` and `physics`."""
        return cls(**given) if isinstance(given, dict) else cls(given, given)


@dataclass(frozen=True)
class Line:
    """A line of the table.

    Args:
        name: Name of the hidden parameter.
        part: `look` or `physics`.
        form: How the size changes the parameter (`away`, `down`, `up`, `least`, `signed`, `exact`, `add`); see docs/mirror.md.
        sizes: Sizes of the change at severities 0 to 4.
    """

    name: str
    part: str
    form: str
    sizes: tuple[float, float, float, float, float]


LINES = (
    Line("encoder_offset", PHYSICS, "signed", (0, 0.001, 0.0015, 0.002, 0.003)),
    Line("link_offset", PHYSICS, "signed", (0, 0.00006, 0.0001, 0.00015, 0.0003)),
    Line("gravity_error", PHYSICS, "signed", (0, 0.01, 0.03, 0.05, 0.08)),
    Line("latency", PHYSICS, "least", (0, 0.02, 0.06, 0.1, 0.14)),
    Line("latency_jitter", PHYSICS, "add", (0, 0.005, 0.01, 0.015, 0.025)),
    Line("joint_friction", PHYSICS, "add", (0, 0.002, 0.005, 0.008, 0.012)),
    Line("lost_commands", PHYSICS, "add", (0, 0, 0.01, 0.02, 0.05)),
    Line("mass", PHYSICS, "away", (0, 0.1, 0.3, 0.5, 0.6)),
    Line("object_com", PHYSICS, "add", (0, 0.05, 0.1, 0.15, 0.2)),
    Line("friction_table", PHYSICS, "down", (0, 0.1, 0.25, 0.4, 0.6)),
    Line("friction_plate", PHYSICS, "down", (0, 0.1, 0.25, 0.4, 0.6)),
    Line("friction_pad", PHYSICS, "down", (0, 0.1, 0.25, 0.4, 0.6)),
    Line("full_well", LOOK, "down", (0, 0.25, 0.4, 0.55, 0.7)),
    Line("read_noise", LOOK, "up", (0, 0.5, 1, 2, 3)),
    Line("exposure_time", LOOK, "add", (0, 0.004, 0.008, 0.012, 0.016)),
    Line("readout", LOOK, "exact", (0, 0, 0, 0.02, 0.028)),
    Line("auto_exposure", LOOK, "add", (0, 0, 0.4, 0.6, 0.8)),
    Line("auto_balance", LOOK, "add", (0, 0, 0.2, 0.3, 0.4)),
    Line("distortion", LOOK, "signed", (0, 0.005, 0.01, 0.02, 0.03)),
    Line("focal_error", LOOK, "signed", (0, 0.002, 0.005, 0.01, 0.015)),
    Line("compression", LOOK, "exact", (0, 0, 0, 40, 60)),
    Line("dropped_frames", LOOK, "add", (0, 0, 0, 0, 0.1)),
    Line("late_frames", LOOK, "add", (0, 0, 0, 0, 0.4)),
    Line("light_power", LOOK, "away", (0, 0.1, 0.2, 0.3, 0.4)),
    Line("light_turn", LOOK, "away", (0, 0.1, 0.3, 0.4, 0.5)),
    Line("light_rise", LOOK, "away", (0, 0.05, 0.1, 0.15, 0.2)),
    Line("light_hue", LOOK, "signed", (0, 0.01, 0.03, 0.05, 0.08)),
    Line("lamp_dim", LOOK, "exact", (0, 0, 0, 0.3, 1)),
    Line("window", LOOK, "add", (0, 0, 0.3, 0.5, 0.8)),
    Line("passer", LOOK, "add", (0, 0, 0, 0.25, 0.3)),
    Line("gloss_object", LOOK, "add", (0, 0.2, 0.45, 0.7, 0.9)),
    Line("gloss_plate", LOOK, "add", (0, 0.2, 0.5, 0.8, 1)),
    Line("gloss_robot", LOOK, "add", (0, 0.2, 0.4, 0.6, 0.9)),
    Line("gloss_table", LOOK, "add", (0, 0, 0.1, 0.2, 0.4)),
    Line("clutter", LOOK, "exact", (0, 3, 7, 9, 12)),
    Line("cables", LOOK, "exact", (0, 0, 1, 2, 3)),
    Line("decoys", LOOK, "exact", (0, 0, 0, 1, 2)),
)
"""The table, in the order of docs/mirror.md."""


def worsened(drawn: Hidden, seed: int, severity: Severity) -> Hidden:
    """Return the hidden parameters of a world at a severity.

    Args:
        drawn: Hidden parameters of the world at severity 0.
        seed: Seed of the world; it decides the direction of each change and its share of the size.
        severity: Severity that decides the sizes; 0 leaves the parameters as they are.
    """
    levels = {PHYSICS: severity.physics, LOOK: severity.look}
    values = {line.name: _grown(line, drawn, seed, levels[line.part]) for line in LINES if levels[line.part]}
    if severity.look:
        values["window_heading"] = float(_stream(seed, "window_heading").uniform(-np.pi, np.pi))
        values["clutter_seed"] = float(seed)
    return replace(drawn, **values)


def _stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of a line; it depends on the seed and the line's name, not on the severity."""
    return np.random.default_rng([seed, zlib.crc32(f"severity {name}".encode())])


def _grown(line: Line, drawn: Hidden, seed: int, level: int) -> Any:
    """Return the value of a line's parameter at a severity above 0."""
    rng, size, before = _stream(seed, line.name), line.sizes[level], getattr(drawn, line.name)
    if line.name == "object_com":
        heading, share = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 1.0)
        return share * size * np.cos(heading), share * size * np.sin(heading)
    count = len(before) if isinstance(before, tuple) else 1
    shares, signs = rng.uniform(0.5, 1.0, count), rng.choice([-1.0, 1.0], count)
    if isinstance(before, tuple):
        return tuple((signs * shares * size).tolist())
    share, sign = float(shares[0]), float(signs[0])
    match line.form:
        case "away":
            return before + np.copysign(share * size, before - getattr(Hidden, line.name))
        case "down":
            return before * (1.0 - share * size)
        case "up":
            return before * (1.0 + share * size)
        case "least":
            return max(before, share * size)
        case "signed":
            return sign * share * size
        case "exact":
            return size
    return before + share * size
