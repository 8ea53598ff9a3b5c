"""Null distribution: the distances between replay and measurement that are expected if the model lacks nothing.

They have four causes. Initial states are measured with noise; each engine has its own step length and its own way of pushing
bodies apart in a contact; bodies sink in while they touch; and chaos amplifies all of these.
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
"""Number of simulated sets of throws, each with its own engine choices."""

FEW = 40
"""Number of throws in each set; more throws add little."""

_DRAWS = 499

_STEPS = (0.7, 2.0)
"""Smallest and largest factor on the length of a step."""

_BIN = 0.02
"""Width of the time bins in which the expected distance is measured, s."""

_UNSURE = 0.01
"""Distance by which models and trackers are always wrong, as a share of the body's radius (`ThrowReplay.radius`)."""

_PUSHES = (0.05, 0.3)
"""Smallest and largest share of a penetration that is corrected in one step."""

SUNK = 0.03
"""Largest share of its size by which a body sinks in during a contact.

At 1 m/s, a contact that lasts 5 ms lets it sink in by at most 1.6 mm and by 1.2 mm on average, which is 3 % of 40 mm.
"""


@dataclass(frozen=True)
class ThrowNull:
    """Errors of K effect-free replicates of M throws.

    Args:
        errors: Mean weighted distance of each throw, m. [K, M].
        early: Mean weighted distance before the first touch, of D sets drawn from the replicates, m. [D].
        plain: Mean distance of the tracked point over all replicates, m.
        spread: Expected distance at each moment of a throw, in the form that `ThrowReplay.weigh` takes.
        numbers: Numbers of these throws among the N that were measured. int [M].
    """

    errors: Array
    early: Array
    plain: float
    spread: Callable[[Array], Array] = field(repr=False)
    numbers: Array

    @property
    def floor(self) -> float:
        """Mean weighted distance that noise, chaos and the engine's choices explain, m."""
        return float(self.errors.mean())

    def p_value(self, errors: Array, early: Array) -> float:
        """Return the p-value of errors under the null: the smallest of three p-values, times three.

        The three statistics are the mean error, the mean logarithm, and the mean before the first touch. Each replicate stands
        for one engine. How much engines differ is estimated from only K replicates, so the first two use Student's t; a
        bootstrap of sets from K replicates would be far too confident. They are compared on the same M throws that the
        replicates have, since the mean depends on the throws.

        Args:
            errors: Mean weighted distance of each throw, m. [N].
            early: Mean weighted distance of each throw before it first touches anything, m. [N].

        Source: Hahn and Meeker, Statistical Intervals, 1991, chapter 4 (prediction of one further observation).
        """
        engines, count = _sizes(self.errors), len(self.errors)
        apart = (_sizes(errors[None, self.numbers])[0] - engines.mean(axis=0)) / np.maximum(engines.std(axis=0, ddof=1), 1e-12)
        looks = [*student.sf(apart / np.sqrt(1.0 + 1.0 / count), count - 1), self.p_early(early)]
        return float(min(1.0, len(looks) * min(looks)))

    def p_early(self, early: Array) -> float:
        """Return the p-value of the mean error before the first touch, where all engines agree, over the same M throws.

        Args:
            early: Mean weighted distance of each throw before the first touch, m. [N].
        """
        return float((1 + (self.early >= early[self.numbers].mean()).sum()) / (1 + len(self.early)))


def _sizes(errors: Array) -> Array:
    """Return each set's mean and mean logarithm, which show large errors and small changes of all throws. [D, N] -> [D, 2]."""
    return np.stack([errors.mean(axis=1), np.log(np.maximum(errors, 1e-9)).mean(axis=1)], axis=1)


def replicates(replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator) -> list[list[Flight]]:
    """Simulate sets of throws of a model with these effects as truth, measured with noise.

    From set to set, bodies sink in more during contact, in equal steps up to `SUNK`. Sinking in shortens the lever arm of
    friction, which is modelled as a larger inertia.

    Args:
        replay: Throws and model.
        effects: Effects of the truth.
        rng: Random numbers for noise, initial states and the engine's choices.

    Returns:
        For each set, one flight per throw.
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
    """Add the tracker's noise to a flight."""
    turns = quat_from_turn(rng.normal(0.0, noise.angle, flight.position.shape))
    position = flight.position + rng.normal(0.0, noise.position, flight.position.shape)
    return replace(flight, position=position, quat=quat_multiply(turns, flight.quat))


def throw_null(replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator, *, weigh: bool = False) -> ThrowNull:
    """Simulate the errors of `FEW` throws under the null that these effects are the truth and also replayed.

    Args:
        replay: Throws and model.
        effects: Effects of both truth and replay.
        rng: Random numbers for noise, initial states, the engine's choices and the draws of sets.
        weigh: Whether to weight distances of `replay` from now on by the expected distances found here.
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
    # All throws of a real set share one engine, so each drawn set comes from a single replicate.
    which = rng.integers(0, len(errors), _DRAWS)
    throws = rng.integers(0, errors.shape[1], (_DRAWS, errors.shape[1]))
    return ThrowNull(errors, early[which[:, None], throws].mean(axis=1), plain, spread, replay.numbers(FEW))


def closure(before: float, after: float, floor: float) -> float:
    """Return the share of the gap above the floor that is closed; negative if the gap grew.

    Args:
        before: Mean distance between replay and measurement without effects, m.
        after: Mean distance with effects, m.
        floor: Mean distance that noise, chaos and the engine's choices explain, m.
    """
    return 1.0 - max(after - floor, 0.0) / max(before - floor, 1e-12)


def expected_spread(
    replay: ThrowReplay, flights: Sequence[Flight], sets: Sequence[Sequence[Flight]]
) -> Callable[[Array], Array]:
    """Estimate the expected distance as a function of time since the first touch, relative to its mean; it never decreases.

    It is the mean distance of the replicates, combined with the error that every model has (`_UNSURE`).

    Args:
        replay: Throws and model.
        flights: Replay of the throws.
        sets: Effect-free sets of throws, as measured.

    Returns:
        Function from time since the nominal replay's first touch, s, to the expected distance as a multiple of its mean over
        the samples of these throws. One such function weights all throws that are compared: were each set of throws divided by
        its own mean, their distances would have different units.
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
    whole = float(np.hypot(np.interp(since, middle, grown), never).mean())
    return lambda time: np.hypot(np.interp(time, middle, grown), never) / whole
