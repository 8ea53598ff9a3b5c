"""Throws replayed from their first states, and how far replay and measurement are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.body import FreeBody
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.starts import Starts, starts_of
from gsbridge.gap.contact.throws import Throws
from gsbridge.gap.contact.world import Flight, Numerics, simulate
from gsbridge.geometry import Array

HORIZON = 0.75
"""Length that is replayed, s: longer replays of a chaotic motion compare chance with chance."""

_IMPACT = 0.06
"""How long behind the first touch errors count as those of the impact, s."""

PHASES = ("flight", "impact", "after")
"""Before the first touch, just behind it, and the rest."""


class ThrowReplay:
    """Throws of one role and the model that replays them.

    Args:
        body: The model.
        throws: Measured.
        horizon: Length that is replayed, s.
    """

    def __init__(self, body: FreeBody, throws: Throws, horizon: float = HORIZON) -> None:
        self.body, self.throws, self.horizon = body, throws, horizon
        self.starts, self.noise = starts_of(throws)
        counts = [int(np.searchsorted(throw.time, horizon, side="right")) for throw in throws.items]
        self.times = [throw.time[:count] for throw, count in zip(throws.items, counts, strict=True)]
        self.measured = [throw.position[:count] for throw, count in zip(throws.items, counts, strict=True)]
        self.runs = 0
        self._parts: dict[int, ThrowReplay] = {}
        self._known: dict[tuple[float, ...], list[Flight]] = {}
        self._plain = tuple(body_setup(body).figures.values())

    def part(self, count: int) -> ThrowReplay:
        """The first throws, whose simulations count with these."""
        if count >= len(self):
            return self
        if count not in self._parts:
            self._parts[count] = ThrowReplay(self.body, self.throws.part(0, count), self.horizon)
            # A few throws know their own noise less well than all.
            self._parts[count].noise = self.noise
        return self._parts[count]

    @property
    def passes(self) -> float:
        """Simulations so far, in passes over all throws."""
        return self.runs + sum(part.runs * len(part) / len(self) for part in self._parts.values())

    def __len__(self) -> int:
        return len(self.times)

    def flights(self, effects: Sequence[Applied] = ()) -> list[Flight]:
        """Simulated throws; figures that were simulated before cost nothing."""
        setup = body_setup(self.body, effects)
        key = tuple(setup.figures.values())
        if key not in self._known:
            self._known[key] = self.simulate(effects)
            if len(self._known) > 400:
                self._known.pop(next(item for item in self._known if item != self._plain))
        return self._known[key]

    def remember(self, flights: Mapping[tuple[float, ...], list[Flight]]) -> None:
        """Take simulated throws from elsewhere, by the figures of their setup."""
        self._known |= flights

    def simulate(
        self, effects: Sequence[Applied], starts: Starts | None = None, numerics: Numerics | None = None
    ) -> list[Flight]:
        """Simulate all throws, with other starts or other choices of the engine where they are given.

        Args:
            effects: What is added to the model.
            starts: First states of the bodies; the measured ones when None.
            numerics: The engine's choices; its usual ones when None.

        Returns:
            One flight per throw.
        """
        self.runs += 1
        return simulate(self.body, body_setup(self.body, effects), starts or self.starts, self.times, numerics)

    def errors(self, effects: Sequence[Applied] = ()) -> Array:
        """Mean distance between replay and measurement of each throw, m. [N]."""
        return distances(self.flights(effects), self.measured)

    def phases(self, effects: Sequence[Applied] = ()) -> dict[str, float]:
        """Mean distance in each phase, m; the first touch is the nominal replay's. Phases that do not occur are missing."""
        sums = {phase: [0.0, 0] for phase in PHASES}
        for number, flight, measured in zip(phase_numbers(self), self.flights(effects), self.measured, strict=True):
            error = np.linalg.norm(flight.position - measured, axis=1)
            for place, phase in enumerate(PHASES):
                sums[phase][0] += float(error[number == place].sum())
                sums[phase][1] += int((number == place).sum())
        return {phase: total / count for phase, (total, count) in sums.items() if count}


def phase_numbers(replay: ThrowReplay) -> list[Array]:
    """Place in `PHASES` of every sample; the first touch is the nominal replay's. Each [T]."""
    out = []
    for plain, time in zip(replay.flights(), replay.times, strict=True):
        touch = time[np.argmax(plain.touched)] if plain.touched.any() else np.inf
        out.append((time >= touch).astype(int) + (time >= touch + _IMPACT))
    return out


def distances(flights: Sequence[Flight], positions: Sequence[Array]) -> Array:
    """Mean distance of each simulated throw to positions, m. [N]."""
    return np.array(
        [float(np.linalg.norm(flight.position - at, axis=1).mean()) for flight, at in zip(flights, positions, strict=True)]
    )
