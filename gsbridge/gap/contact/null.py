"""Distances between replay and measurement that are expected where the model lacks nothing.

They have four causes: start states are measured with noise, each engine has its own length of step and its own way of pushing
bodies apart in a contact, bodies sink in while they touch, and chaos enlarges all of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import t as student

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.replay import ThrowReplay, distances, point_distances, touch_clocks
from gsbridge.gap.contact.starts import ThrowNoise, quat_from_turn
from gsbridge.gap.contact.world import Flight, Numerics
from gsbridge.geometry import Array, quat_multiply

REPLICATES = 6
"""Number of simulated sets of throws."""

FEW = 40
"""Number of throws in each set; more would tell little more about one throw."""

_DRAWS = 499

_STEPS = (0.7, 2.0)
"""Smallest and largest factor on the length of a step."""

_BIN = 0.02
"""Width of the intervals of time for which the spread of distances is measured, s."""

_UNSURE = 0.01
"""Share of a body's radius of gyration by which models and trackers are always wrong."""

_PUSHES = (0.05, 0.3)
"""Smallest and largest share of a penetration that is corrected in one step."""

SUNK = 0.03
"""Share of its size by which a body sinks in while it is pushed, at most: at 1 m/s, a contact that lasts 5 ms lets it sink in
by 1.6 mm at its deepest and by 1.2 mm on average, which is a thirtieth of 40 mm."""


@dataclass(frozen=True)
class ThrowNull:
    """Errors of effect-free replicates.

    Args:
        errors: Mean weighed distance of each throw, m. [K, M].
        early: Mean weighed distance before the first touch of sets drawn from them, m. [D].
        plain: Mean distance of the tracked point, m.
        spread: Expected distance at each moment of a throw, as `ThrowReplay.weigh` takes it.
    """

    errors: Array
    early: Array
    plain: float
    spread: Callable[[Array], Array] = field(repr=False)

    @property
    def floor(self) -> float:
        """Mean weighed distance that noise, chaos and the engine's choices explain, m."""
        return float(self.errors.mean())

    def p_value(self, errors: Array, early: Array) -> float:
        """Probability of an effect-free set at least as far apart, by the mean, the mean logarithm, or before the first touch.

        Each replicate stands for one engine. A handful of them tell how much engines differ as well as a handful of numbers
        do, which Student's law counts; a share of sets drawn from them would be far too sure. They are compared on the throws
        that replicates have: throws differ, and so would their means on other throws. The smallest of three probabilities is
        multiplied by three.

        Args:
            errors: Mean weighed distance of each throw, m. [N].
            early: Mean weighed distance of each throw before it first touches anything, m. [N].

        Source: Hahn and Meeker, Statistical Intervals, 1991, chapter 4 (prediction of one further observation).
        """
        engines, (count, few) = _sizes(self.errors), self.errors.shape
        apart = (_sizes(errors[None, :few])[0] - engines.mean(axis=0)) / np.maximum(engines.std(axis=0, ddof=1), 1e-12)
        looks = [*student.sf(apart / np.sqrt(1.0 + 1.0 / count), count - 1), self.p_early(early)]
        return float(min(1.0, len(looks) * min(looks)))

    def p_early(self, early: Array) -> float:
        """Share of effect-free sets at least as far apart before the first touch, where no engine has a choice.

        Args:
            early: Mean weighed distance of each throw before it, m. [N].
        """
        return float((1 + (self.early >= early.mean()).sum()) / (1 + len(self.early)))


def _sizes(errors: Array) -> Array:
    """Mean and mean logarithm of sets: what is large, and a small change of every throw. [D, N] -> [D, 2]."""
    return np.stack([errors.mean(axis=1), np.log(np.maximum(errors, 1e-9)).mean(axis=1)], axis=1)


def replicates(replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator) -> list[list[Flight]]:
    """Sets of throws of a model with these effects as truth, measured with noise.

    The bodies of the sets sink in while they touch, by up to `SUNK`, in equal steps. Friction then turns a body at an arm that
    is shorter by as much, as if its inertia were larger.

    Args:
        replay: Throws and model.
        effects: Effects of the truth.
        rng: Random numbers for noise, first states and the engine's choices.

    Returns:
        One flight per throw and set.
    """
    noise = replay.noise
    out = []
    for number in range(REPLICATES):
        step, push = (float(np.exp(rng.uniform(np.log(low), np.log(high)))) for low, high in (_STEPS, _PUSHES))
        heavy = Applied("inertia_scale", "", {"share": SUNK * (number + 0.5) / REPLICATES})
        truth = replay.simulate((*effects, heavy), replay.starts.shifted(noise, rng), Numerics(step, push))
        out.append([_measured(flight, noise, rng) for flight in truth])
    return out


def _measured(flight: Flight, noise: ThrowNoise, rng: np.random.Generator) -> Flight:
    """A flight as the tracker tells it."""
    turns = quat_from_turn(rng.normal(0.0, noise.angle, flight.position.shape))
    position = flight.position + rng.normal(0.0, noise.position, flight.position.shape)
    return replace(flight, position=position, quat=quat_multiply(turns, flight.quat))


def throw_null(replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator, *, weigh: bool = False) -> ThrowNull:
    """Errors of the first throws as they would be if these effects were the truth and the same model replayed it.

    Args:
        replay: Throws and model.
        effects: Effects of truth and replay.
        rng: Random numbers of noise, first states, the engine's choices and the draws of sets.
        weigh: Whether distances of the throws are weighted from now on by the spread that is found.
    """
    few = replay.part(FEW)
    sets = replicates(few, effects, rng)
    flights = few.flights(effects)
    spread = expected_spread(few, flights, sets)
    if weigh:
        replay.weigh(spread)
    places, turns = ([[getattr(flight, key) for flight in row] for row in sets] for key in ("position", "quat"))
    errors = np.stack([few.apart(flights, *row) for row in zip(places, turns, strict=True)])
    early = np.stack([few.apart(flights, *row, early=True) for row in zip(places, turns, strict=True)])
    plain = float(np.mean([distances(flights, row) for row in places]))
    # One engine makes all throws of a set, so that sets are drawn from one replicate each.
    which = rng.integers(0, len(errors), _DRAWS)
    throws = rng.integers(0, errors.shape[1], (_DRAWS, len(replay)))
    return ThrowNull(errors, early[which[:, None], throws].mean(axis=1), plain, spread)


def closure(before: float, after: float, floor: float) -> float:
    """Share of the gap above the floor that is closed; negative where it grew.

    Args:
        before: Mean distance between replay and measurement without effects, m.
        after: Mean distance with effects, m.
        floor: Mean distance that noise, chaos and the engine's choices explain, m.
    """
    return 1.0 - max(after - floor, 0.0) / max(before - floor, 1e-12)


def expected_spread(
    replay: ThrowReplay, flights: Sequence[Flight], sets: Sequence[Sequence[Flight]]
) -> Callable[[Array], Array]:
    """Mean distance of replicates by the time since the first touch, never falling, with what no model gets right on top.

    Args:
        replay: Throws and model.
        flights: Their replay.
        sets: Sets of throws as they are measured where the model lacks nothing.

    Returns:
        Time since the nominal replay's first touch, s, to a distance, m.
    """
    rows = [
        np.concatenate(
            [point_distances(f, seen.position, seen.quat, replay.radius) for f, seen in zip(flights, row, strict=True)]
        )
        for row in sets
    ]
    since, apart = np.concatenate(touch_clocks(replay)), np.mean(rows, axis=0)
    edges = np.arange(np.floor(since.min() / _BIN), np.ceil(since.max() / _BIN) + 1) * _BIN
    place = np.clip(np.digitize(since, edges) - 1, 0, len(edges) - 2)
    counts = np.bincount(place, minlength=len(edges) - 1)
    means = np.bincount(place, apart, minlength=len(edges) - 1) / np.maximum(counts, 1)
    grown = np.maximum.accumulate(means)
    middle, never = 0.5 * (edges[1:] + edges[:-1]), _UNSURE * replay.radius
    return lambda time: np.hypot(np.interp(time, middle, grown), never)
