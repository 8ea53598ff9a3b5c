"""Commands of the benchmark as functions of time, with different excitation for fitting, selecting and verifying."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsbridge.geometry import Array

Course = Callable[[float], Array]
"""Function of time, s, that returns commanded positions, rad or m. [N]."""

KINDS = {"fit": "multisine", "select": "steps", "verify": "chirp"}
"""Kind of excitation of each role's record."""


def course(kind: str, centre: Array, reach: Array, duration: float, rng: np.random.Generator) -> Course:
    """Draw a random course.

    Args:
        kind: `multisine`, `steps` (smooth, between random postures) or `chirp`.
        centre: Middle posture, where the course starts at rest, rad or m. [N].
        reach: Largest distance of each joint from the middle posture, rad or m. [N].
        duration: Length of the course, s.
        rng: Random numbers for phases, postures and frequencies.
    """
    count = len(centre)
    if kind == "multisine":
        waves = rng.uniform(0.2, 1.6, (4, count))
        sizes = rng.uniform(0.4, 1.0, (4, count))
        phases = rng.uniform(0, 2 * np.pi, (4, count))
        sizes *= reach / sizes.sum(axis=0)

        def sines(time: float) -> Array:
            return (sizes * np.sin(2 * np.pi * waves * time + phases)).sum(axis=0)

        return lambda time: centre + _fade(time) * sines(time)
    if kind == "steps":
        stops = max(3, round(duration / 0.8))
        goals = np.concatenate([centre[None], centre + rng.uniform(-1, 1, (stops, count)) * reach])
        edges = np.linspace(0.3, duration, stops + 1)
        ways = rng.uniform(0.35, 0.9, stops)

        def steps(time: float) -> Array:
            place = min(int(np.searchsorted(edges, time, side="right")) - 1, stops - 1)
            if place < 0:
                return goals[0]
            share = min((time - edges[place]) / (ways[place] * (edges[1] - edges[0])), 1.0)
            return goals[place] + (goals[place + 1] - goals[place]) * share**3 * (10 - 15 * share + 6 * share**2)

        return steps
    start, end = rng.uniform(0.2, 0.4, count), rng.uniform(1.2, 2.0, count)
    sizes = reach * rng.uniform(0.5, 0.9, count)

    def chirp(time: float) -> Array:
        phase = 2 * np.pi * (start * time + 0.5 * (end - start) * time**2 / duration)
        return centre + _fade(time) * sizes * np.sin(phase)

    return chirp


def _fade(time: float) -> float:
    """Return a factor that rises smoothly from 0 to 1 in the first 0.5 s, so that courses start at rest."""
    share = min(time / 0.5, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)
