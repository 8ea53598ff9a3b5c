"""Throws replayed from their first states, and how far replay and measurement are apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

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

_SURE = 0.02
"""How long before the nominal replay's first touch a body surely touches nothing, s."""

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
        self.attitudes = [throw.quat[:count] for throw, count in zip(throws.items, counts, strict=True)]
        self.weights: list[Array] = [np.ones(count) for count in counts]
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
            self._parts[count].weights = self.weights[:count]
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

    @property
    def radius(self) -> float:
        """Distance by which the body's points move when it turns by one radian, root mean square, m."""
        return float(np.sqrt(np.trace(self.body.inertia) / (3.0 * self.body.mass)))

    def gaps(self, effects: Sequence[Applied] = ()) -> Array:
        """Mean distance between the tracked point of replay and measurement of each throw, m. [N]."""
        return distances(self.flights(effects), self.measured)

    def errors(self, effects: Sequence[Applied] = ()) -> Array:
        """Mean distance between the body's points in replay and measurement of each throw, m, weighed as `weigh` says. [N]."""
        return self.apart(self.flights(effects), self.measured, self.attitudes)

    def apart(
        self, flights: Sequence[Flight], positions: Sequence[Array], attitudes: Sequence[Array], *, early: bool = False
    ) -> Array:
        """Mean weighed distance of the body's points between simulated throws and poses.

        Args:
            flights: Simulated throws.
            positions: Positions, m. Each [T, 3].
            attitudes: Attitudes, wxyz. Each [T, 4].
            early: Whether only samples before the nominal replay's first touch count.

        Returns:
            m. [N].
        """
        counted = self._untouched() if early else [np.ones(len(time)) for time in self.times]
        rows = zip(flights, positions, attitudes, self.weights, counted, strict=True)
        return np.array([(point_distances(f, at, to, self.radius) * w * c).sum() / max(c.sum(), 1) for f, at, to, w, c in rows])

    def _untouched(self) -> list[Array]:
        """One for every sample that is surely before the first touch, else zero. Each [T]."""
        return [(since < -_SURE).astype(np.float64) for since in touch_clocks(self)]

    def early(self, effects: Sequence[Applied] = ()) -> Array:
        """Like `errors`, before the nominal replay's first touch alone, where no engine has a choice. [N]."""
        return self.apart(self.flights(effects), self.measured, self.attitudes, early=True)

    def weigh(self, spread: Callable[[Array], Array]) -> None:
        """Let a distance count by how well it is known at that moment.

        What is a tenth of a millimetre in flight tells as much as what is a centimetre after the body has tumbled.

        Args:
            spread: Time since the nominal replay's first touch, s, to the distance that noise and chaos explain, m.
        """
        for part in (self, *self._parts.values()):
            expected = [spread(since) for since in touch_clocks(part)]
            whole = float(np.concatenate(expected).mean())
            part.weights = [whole / row for row in expected]

    def phases(self, effects: Sequence[Applied] = ()) -> dict[str, float]:
        """Mean distance in each phase, m; the first touch is the nominal replay's. Phases that do not occur are missing."""
        sums = {phase: [0.0, 0] for phase in PHASES}
        for number, flight, measured in zip(phase_numbers(self), self.flights(effects), self.measured, strict=True):
            error = np.linalg.norm(flight.position - measured, axis=1)
            for place, phase in enumerate(PHASES):
                sums[phase][0] += float(error[number == place].sum())
                sums[phase][1] += int((number == place).sum())
        return {phase: total / count for phase, (total, count) in sums.items() if count}


def touch_clocks(replay: ThrowReplay) -> list[Array]:
    """Time of every sample since the nominal replay's first touch, s; negative before it. Each [T]."""
    out = []
    for plain, time in zip(replay.flights(), replay.times, strict=True):
        touch = time[np.argmax(plain.touched)] if plain.touched.any() else time[-1]
        out.append(time - touch)
    return out


def point_distances(flight: Flight, position: Array, attitude: Array, radius: float) -> Array:
    """Distance of a body's points between a simulated throw and measured poses, root mean square over the body, m.

    Args:
        flight: The simulated throw.
        position: Measured, m. [T, 3].
        attitude: Measured, wxyz. [T, 4].
        radius: Distance by which the points move per radian, m.

    Returns:
        [T].
    """
    cosine = np.abs((flight.quat * attitude).sum(axis=1))
    turn = 2.0 * np.arctan2(np.sqrt(np.maximum(1.0 - cosine**2, 0.0)), cosine)
    return np.hypot(np.linalg.norm(flight.position - position, axis=1), radius * turn)


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
