"""Sizes of effects by grid and golden section: errors of a chaotic motion have no useful slope."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.contact.replay import Replay
from gsbridge.gap.effects import effect_of
from gsbridge.gap.effects.base import Effect
from gsbridge.gap.system import Applied

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_SHRINK = 0.06
"""Part of its first width to which a bracket is narrowed."""

_WIDEN = 6
"""How often a bracket may be doubled while the error still falls at its edge."""


@dataclass(frozen=True)
class Match:
    """The best point of an effect's grid.

    Args:
        effect: With its parameters.
        error: Mean error over the throws, m.
        change: How far the grid's largest sizes move the replay, m: what cannot move it cannot be seen.
    """

    effect: Applied
    error: float
    change: float


@dataclass(frozen=True)
class Fit:
    """Effects with fitted sizes.

    Args:
        effects: The effects.
        error: Mean error over the throws, m.
        converged: Whether every size is inside its bounds and its bracket.
    """

    effects: tuple[Applied, ...]
    error: float
    converged: bool


def mean_error(replay: Replay, effects: Sequence[Applied]) -> float:
    """Mean error over the throws, m."""
    return float(replay.errors(effects).mean())


def screen(replay: Replay, name: str, base: Sequence[Applied] = ()) -> Match:
    """Walk an effect's grid on top of other effects."""
    effect = effect_of(name)
    plain = replay.flights(base)
    best, change = Match(Applied(name, "", effect.directions()[0]), np.inf, 0.0), 0.0
    for values in effect.directions():
        for size in effect.sizes:
            applied = Applied(name, "", effect.scaled(values, size))
            error = mean_error(replay, (*base, applied))
            if size == effect.sizes[-1]:
                moved = zip(plain, replay.flights((*base, applied)), strict=True)
                change = max(change, float(np.mean([np.linalg.norm(a.position - b.position, axis=1).mean() for a, b in moved])))
            if error < best.error:
                best = Match(applied, error, 0.0)
    return Match(best.effect, best.error, change)


def refine(replay: Replay, effects: Sequence[Applied], rounds: int = 1) -> Fit:
    """Fit all sizes together, one after the other, from where the grid found them.

    Args:
        replay: Throws.
        effects: Start values.
        rounds: Passes over all parameters; more than one only matters where there are several.
    """
    current = list(effects)
    inside = {}
    count = sum(len(effect_of(applied.name).parameters) for applied in current)
    for number in range(rounds if count > 1 else 1):
        for place, applied in enumerate(effects):
            effect = effect_of(applied.name)
            for parameter in effect.parameters:

                def error(value: float, place: int = place, key: str = parameter.name) -> float:
                    trial = list(current)
                    trial[place] = _with(current[place], key, value)
                    return mean_error(replay, trial)

                value = current[place].parameters[parameter.name]
                width = _width(effect, parameter.name, value) * 0.5**number
                found, free = golden(error, value, width, parameter.low, parameter.high)
                inside[place, parameter.name] = free or not parameter.amplitude
                current[place] = _with(current[place], parameter.name, found)
    return Fit(tuple(current), mean_error(replay, current), all(inside.values()))


def _with(applied: Applied, key: str, value: float) -> Applied:
    return Applied(applied.name, "", {**applied.parameters, key: value})


def _width(effect: Effect, key: str, value: float) -> float:
    """Half of the first bracket: to the next size of the grid."""
    typical = next(parameter.typical for parameter in effect.parameters if parameter.name == key)
    ratio = max([b / a for a, b in zip(effect.sizes[:-1], effect.sizes[1:], strict=True)], default=2.0)
    return max(abs(value) * (1.0 - 1.0 / ratio), abs(typical) * 0.5)


def golden(error: Callable[[float], float], start: float, width: float, low: float, high: float) -> tuple[float, bool]:
    """Minimum of one parameter by golden section, from a bracket that is widened while its edge is best.

    Args:
        error: Of a value.
        start: First value.
        width: Half of the first bracket.
        low: Smallest value.
        high: Largest value.

    Returns:
        The best value looked at, and whether it is inside its bounds and its bracket.

    Source: Kiefer, Proc. AMS 4(3), 1953.
    """
    start = float(start)
    known = {start: error(start)}

    def at(value: float) -> float:
        if value not in known:
            known[value] = error(value)
        return known[value]

    a, b, centre = max(start - width, low), min(start + width, high), start
    for _ in range(_WIDEN):
        edge = min((a, b), key=at)
        if at(edge) >= at(centre) or edge in (low, high):
            break
        # The edge is better: go on in its direction, twice as far.
        reach = 2.0 * (edge - centre)
        a, b, centre = (max(edge + reach, low), centre, edge) if edge < centre else (centre, min(edge + reach, high), edge)
    stop = _SHRINK * max(b - a, 1e-12)
    left, right = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    while b - a > stop:
        if at(left) <= at(right):
            b, right = right, left
            left = b - _GOLDEN * (b - a)
        else:
            a, left = left, right
            right = a + _GOLDEN * (b - a)
    at(_vertex(known))
    best = min(known, key=lambda value: known[value])
    return best, low < best < high and min(known) < best < max(known)


def _vertex(known: Mapping[float, float]) -> float:
    """Lowest point of the parabola through the best value and its neighbours, or that value."""
    values = sorted(known)
    place = values.index(min(known, key=lambda value: known[value]))
    if place in (0, len(values) - 1):
        return values[place]
    x = np.array(values[place - 1 : place + 2])
    square, slope, _ = np.polyfit(x - x[1], [known[value] for value in x.tolist()], 2)
    return float(np.clip(x[1] - slope / (2.0 * square), x[0], x[2])) if square > 0 else values[place]
