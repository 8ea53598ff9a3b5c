"""Replay of throws from their initial states, and the distances between replay and measurement."""

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
"""Default length of each throw that is replayed, s: later, the motion is chaotic and distances are chance."""

_IMPACT = 0.06
"""Length of the phase "impact" after the first touch, s."""

_SURE = 0.02
"""Margin before the nominal replay's first touch, s; until then, the body surely touches nothing."""

PHASES = ("flight", "impact", "after")
"""Phases of a throw: before the first touch, just after it, and the rest."""


class ThrowReplay:
    """Throws of one role and the model that replays them.

    Args:
        body: The model.
        throws: The measured throws.
        horizon: Length of each throw that is replayed, s.
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

    def numbers(self, count: int) -> Array:
        """Return the numbers of `count` throws, spread evenly over all: the first ones may be of one kind. int [count]."""
        count = min(count, len(self))
        return np.arange(count) * len(self) // count

    def part(self, count: int) -> ThrowReplay:
        """Return the replay of `count` throws, spread evenly over all; its simulations count in `passes`."""
        if count >= len(self):
            return self
        if count not in self._parts:
            numbers = self.numbers(count).tolist()
            self._parts[count] = ThrowReplay(self.body, self.throws.chosen(numbers), self.horizon)
            # All throws together determine the noise better than a few.
            self._parts[count].noise = self.noise
            self._parts[count].weights = [self.weights[number] for number in numbers]
        return self._parts[count]

    @property
    def passes(self) -> float:
        """Number of simulations so far, in passes over all throws."""
        return self.runs + sum(part.runs * len(part) / len(self) for part in self._parts.values())

    def __len__(self) -> int:
        return len(self.times)

    def flights(self, effects: Sequence[Applied] = ()) -> list[Flight]:
        """Return simulated throws, from a cache if the same figures were simulated before."""
        setup = body_setup(self.body, effects)
        key = tuple(setup.figures.values())
        if key not in self._known:
            self._known[key] = self.simulate(effects)
            if len(self._known) > 400:
                self._known.pop(next(item for item in self._known if item != self._plain))
        return self._known[key]

    def remember(self, flights: Mapping[tuple[float, ...], list[Flight]]) -> None:
        """Put simulated throws into the cache, by the figures of their setup."""
        self._known |= flights

    def simulate(
        self, effects: Sequence[Applied], starts: Starts | None = None, numerics: Numerics | None = None
    ) -> list[Flight]:
        """Simulate all throws, without the cache.

        Args:
            effects: Effects that are added to the model.
            starts: Initial states of the bodies; None for the measured ones.
            numerics: The engine's numerical choices; None for the defaults.

        Returns:
            One flight per throw.
        """
        self.runs += 1
        return simulate(self.body, body_setup(self.body, effects), starts or self.starts, self.times, numerics)

    @property
    def radius(self) -> float:
        """Root mean square distance that the body's points move per radian of rotation, m."""
        return float(np.sqrt(np.trace(self.body.inertia) / (3.0 * self.body.mass)))

    def gaps(self, effects: Sequence[Applied] = ()) -> Array:
        """Return the mean distance of the tracked point between replay and measurement, for each throw, m. [N]."""
        return distances(self.flights(effects), self.measured)

    def errors(self, effects: Sequence[Applied] = ()) -> Array:
        """Return the mean weighted distance of the body's points between replay and measurement, for each throw, m. [N]."""
        return self.apart(self.flights(effects), self.measured, self.attitudes)

    def apart(
        self, flights: Sequence[Flight], positions: Sequence[Array], attitudes: Sequence[Array], *, early: bool = False
    ) -> Array:
        """Return the mean weighted distance of the body's points between simulated throws and poses.

        Args:
            flights: Simulated throws.
            positions: Positions, m. Each [T, 3].
            attitudes: Attitudes, wxyz. Each [T, 4].
            early: Whether only samples before the nominal replay's first touch count.

        Returns:
            Mean distance of each throw, m, with the weights that `weigh` set. [N].
        """
        counted = self._untouched() if early else [np.ones(len(time)) for time in self.times]
        rows = zip(flights, positions, attitudes, self.weights, counted, strict=True)
        return np.array([(point_distances(f, at, to, self.radius) * w * c).sum() / max(c.sum(), 1) for f, at, to, w, c in rows])

    def _untouched(self) -> list[Array]:
        """Return 1 for every sample that is surely before the first touch, else 0. Each [T]."""
        return [(since < -_SURE).astype(np.float64) for since in touch_clocks(self)]

    def early(self, effects: Sequence[Applied] = ()) -> Array:
        """Return `errors` over the samples before the nominal replay's first touch only, where all engines agree. [N]."""
        return self.apart(self.flights(effects), self.measured, self.attitudes, early=True)

    def weigh(self, spread: Callable[[Array], Array]) -> None:
        """Weight distances by the inverse of the distance that is expected at that moment.

        A tenth of a millimetre in flight is as significant as a centimetre after the body has tumbled.

        Args:
            spread: Maps time since the nominal replay's first touch, s, to the distance that noise and chaos explain, as a
                multiple of its mean over the throws of the null. All throws that are compared need the same function.
        """
        for part in (self, *self._parts.values()):
            part.weights = [1.0 / spread(since) for since in touch_clocks(part)]

    def phases(self, effects: Sequence[Applied] = ()) -> dict[str, float]:
        """Return the mean distance in each phase that occurs, m; the first touch is that of the nominal replay."""
        sums = {phase: [0.0, 0] for phase in PHASES}
        for number, flight, measured in zip(phase_numbers(self), self.flights(effects), self.measured, strict=True):
            error = np.linalg.norm(flight.position - measured, axis=1)
            for place, phase in enumerate(PHASES):
                sums[phase][0] += float(error[number == place].sum())
                sums[phase][1] += int((number == place).sum())
        return {phase: total / count for phase, (total, count) in sums.items() if count}


def touch_clocks(replay: ThrowReplay) -> list[Array]:
    """Return the time of every sample since the nominal replay's first touch, s; negative before it. Each [T]."""
    out = []
    for plain, time in zip(replay.flights(), replay.times, strict=True):
        touch = time[np.argmax(plain.touched)] if plain.touched.any() else time[-1]
        out.append(time - touch)
    return out


def point_distances(flight: Flight, position: Array, attitude: Array, radius: float) -> Array:
    """Return the distance of a body's points between a simulated throw and measured poses, root mean square over the body.

    Args:
        flight: The simulated throw.
        position: Measured positions, m. [T, 3].
        attitude: Measured attitudes, wxyz. [T, 4].
        radius: Root mean square distance that the points move per radian, m.

    Returns:
        Distance at each sample, m. [T].
    """
    cosine = np.abs((flight.quat * attitude).sum(axis=1))
    turn = 2.0 * np.arctan2(np.sqrt(np.maximum(1.0 - cosine**2, 0.0)), cosine)
    return np.hypot(np.linalg.norm(flight.position - position, axis=1), radius * turn)


def phase_numbers(replay: ThrowReplay) -> list[Array]:
    """Return the index in `PHASES` of every sample; the first touch is that of the nominal replay. Each [T]."""
    out = []
    for plain, time in zip(replay.flights(), replay.times, strict=True):
        touch = time[np.argmax(plain.touched)] if plain.touched.any() else np.inf
        out.append((time >= touch).astype(int) + (time >= touch + _IMPACT))
    return out


def distances(flights: Sequence[Flight], positions: Sequence[Array]) -> Array:
    """Return the mean distance of each simulated throw to positions, m. [N]."""
    return np.array(
        [float(np.linalg.norm(flight.position - at, axis=1).mean()) for flight, at in zip(flights, positions, strict=True)]
    )
