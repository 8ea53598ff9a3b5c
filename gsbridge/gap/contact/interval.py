"""Confidence intervals of effects' sizes: how the best size varies over other throws of the same kind and other engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact import null
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import ThrowFit, reach
from gsbridge.geometry import Array

_POINTS = np.linspace(-1.0, 1.0, 5)
_DRAWS = 400
_NINETY = 1.645
"""Half width of a 90 % interval of a normal distribution, in standard deviations."""
_RISES = (0.03, 0.3)
"""Range in which the relative rise of the mean error at the ends of the profile should lie."""

_TRIES = 4


def intervals(replay: ThrowReplay, fit: ThrowFit, rng: np.random.Generator) -> list[dict[str, tuple[float, float]]]:
    """Return 90 % intervals of all parameters, each from the minimum of a parabola through the profile of the error.

    The scatter of that minimum comes from two sources: a bootstrap over the throws, and replicates that have the fit as truth,
    with other initial states and other choices of the engine. A misfit beyond that of the replicates widens both.

    Args:
        replay: The throws that were fitted.
        fit: Fit to these throws.
        rng: Random numbers for the replicates and the bootstrap.

    Returns:
        For each effect, the ends of the interval of each parameter.
    """
    out, effects = [], fit.effects
    few = replay.part(null.FEW)
    sets = null.replicates(few, effects, rng)
    seen = [([flight.position for flight in row], [flight.quat for flight in row]) for row in sets]
    usual = float(np.mean([few.apart(few.flights(effects), *row) for row in seen]))
    misfit = max(1.0, float(few.errors(effects).mean()) / usual)
    for place, applied in enumerate(effects):
        rows = {}
        for parameter in BODY_EFFECTS[applied.name].parameters:
            value = applied.parameters[parameter.name]

            def at(size: float, place: int = place, key: str = parameter.name) -> list[Applied]:
                changed = list(effects)
                changed[place] = Applied(changed[place].name, "", {**changed[place].parameters, key: size})
                return changed

            def errors(size: float, at: Callable[[float], list[Applied]] = at) -> Array:
                return replay.errors(at(size))

            best = float(errors(value).mean())
            least, most = reach(replay, [*effects[:place], *effects[place + 1 :]], BODY_EFFECTS[applied.name], parameter)
            # At a bound, values beyond it change nothing, so the profile is one-sided there.
            bounds = {-1.0: least, 1.0: most}
            sides = [sign for sign, bound in bounds.items() if value != bound]
            level = [sign for sign in sides if _level(errors, bounds[sign], best, fit.profiles[place, parameter.name], value)]
            sides = [sign for sign in sides if sign not in level] or sides
            places = _POINTS if len(sides) == 2 else sides[0] * (1.0 + _POINTS) / 2.0
            width = _width(fit.profiles[place, parameter.name], best) or max(0.15 * abs(value), 0.2 * abs(parameter.typical))
            for _ in range(_TRIES):
                rise = min(float(errors(value + sign * width).mean()) for sign in sides) / best - 1.0
                if rise < _RISES[0]:
                    width *= 2.0
                elif rise > _RISES[1]:
                    width *= 0.5
                else:
                    break
            points = [value + width * point for point in places]
            draws = rng.integers(0, len(replay), (_DRAWS, len(replay)))
            centres = value + width * _lowest(np.stack([errors(point) for point in points])[:, draws].mean(axis=2), places)
            low, high = np.quantile(centres, [0.05, 0.95])
            for wide in (width, 2.0 * width, 4.0 * width):
                flights = [few.flights(at(value + wide * point)) for point in places]
                other = [
                    _lowest(np.stack([few.apart(row, *poses).mean(keepdims=True) for row in flights]), places) for poses in seen
                ]
                # A minimum at an end of the places is clipped there; widen the places until none is.
                if np.abs(other).max() < 1.0:
                    break
            engine = _NINETY * wide * float(np.sqrt(np.mean(np.square(other))))
            # At a bound, the bootstrap hardly moves the best size; extend the interval to where the error visibly rises.
            engine = engine if len(sides) == 2 else max(engine, width)
            # Centre the interval on the value that is named, which need not be the parabola's minimum.
            low = value - misfit * float(np.hypot(max(value - low, 0.0), engine))
            high = value + misfit * float(np.hypot(max(high - value, 0.0), engine))
            rows[parameter.name] = (
                least if -1.0 in level else max(low, least),
                most if 1.0 in level else min(high, most),
            )
        out.append(rows)
    return out


def _level(errors: Callable[[float], Array], bound: float, best: float, profile: Mapping[float, float], value: float) -> bool:
    """Whether the error stays level from the best value to a bound, so that the value is unbounded on that side.

    Args:
        errors: Returns the error of each throw at a value, m.
        bound: The bound.
        best: Mean error at the best value, m.
        profile: Values that the search has evaluated, and their errors, m.
        value: The best value.
    """
    beyond = [error for at, error in profile.items() if (at - value) * (bound - value) > 0.0]
    level = bool(beyond) and max(beyond) < (1.0 + _RISES[0]) * min(profile.values())
    return level and bool(np.isfinite(bound)) and float(errors(bound).mean()) < (1.0 + _RISES[0]) * best


def _lowest(profile: Array, places: Array) -> Array:
    """Return the minima of parabolas through profiles, clipped to the range of places. [P, D], [P] -> [D]."""
    square, slope, _ = np.polyfit(places, profile, 2)
    found = np.where(square > 0, -slope / (2.0 * np.maximum(square, 1e-300)), np.sign(-slope))
    return np.clip(found, places.min(), places.max())


def _width(profile: Mapping[float, float], best: float) -> float | None:
    """Estimate from the search's profile where the error rises by the mean of `_RISES`, as a width; None if it is too flat."""
    near = {value: error for value, error in profile.items() if error < (1.0 + 2.0 * _RISES[1]) * best}
    if len(near) < 3:
        return None
    square = np.polyfit(np.array(list(near)) - np.mean(list(near)), list(near.values()), 2)[0]
    return float(np.sqrt(float(np.mean(_RISES)) * best / square)) if square > 0 else None
