"""Fit of effects' sizes by grid and line search: the error of a chaotic motion has no useful gradient."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.effects.base import Parameter
from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.bodies.base import BodyEffect
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.grid import grid_ways, vanishing
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.setup import BOUNDS, body_setup
from gsbridge.gap.contact.world import Flight
from gsbridge.geometry import Array

_GOLDEN = 0.5 * (3.0 - np.sqrt(5.0))
"""Position of a golden section step in the wider half of a bracket, as a share of that half."""

_SHRINK = 0.12
"""Share of its first width to which a bracket is narrowed."""

_GAIN = 2e-3
"""Smallest gain, as a share of the error, that a parabola must predict for the search to go on.

It applies once the bracket is at most half as wide as at first: errors rise like a V, so a parabola over a wide bracket says
little. It is also the difference up to which errors count as equal on a plateau."""

_WIDEN = 6
"""Largest number of times that a bracket is doubled while the error still falls at its edge."""

_BETWEEN = 0.1
"""Share of the squared distances that a size below the grid's smallest must be predicted to explain before it is simulated."""

_NEARER = 0.8
"""Such a size must also be below this share of the grid's smallest one; a size closer to that one adds nothing."""

_LOOKS = 12
"""Largest number of values that a search evaluates within its bracket."""


@dataclass(frozen=True)
class GridMatch:
    """The best point of an effect's grid.

    Args:
        effect: The effect with its parameters.
        error: Mean error over the throws, m.
        change: Mean distance by which the grid's largest sizes move the replay, m; an effect that does not move it is unseen.
    """

    effect: Applied
    error: float
    change: float


@dataclass(frozen=True)
class ThrowFit:
    """Effects with fitted sizes.

    Args:
        effects: The effects.
        error: Mean error over the throws, m.
        converged: Whether every size is inside its bounds and its bracket, is the start of a plateau on which all larger sizes
            do as well, or makes a non-negative figure zero (a body may well slide without friction).
        profiles: Evaluated values and their errors, m, by the effect's index and the parameter's name.
    """

    effects: tuple[Applied, ...]
    error: float
    converged: bool
    profiles: Mapping[tuple[int, str], Mapping[float, float]] = field(default_factory=dict, repr=False)


def body_effects(replay: ThrowReplay, names: Collection[str] | None) -> tuple[str, ...]:
    """Return the names of the effects to consider for these throws, restricted to `names` if given."""
    return tuple(
        name
        for name, effect in BODY_EFFECTS.items()
        if (names is None or name in names) and (replay.starts.logged or not effect.needs_speeds)
    )


def mean_error(replay: ThrowReplay, effects: Sequence[Applied]) -> float:
    """Return the mean error over the throws, m."""
    return float(replay.errors(effects).mean())


def screen(replay: ThrowReplay, name: str, base: Sequence[Applied] = ()) -> GridMatch:
    """Simulate an effect's grid on top of other effects, and return the best point.

    Args:
        replay: Throws and model.
        name: Name of the effect.
        base: Effects that are already part of the model.
    """
    effect = BODY_EFFECTS[name]
    plain, grid = replay.flights(base), grid_ways(replay.body, name)
    points = [applied for way in grid for applied in way]
    errors = [mean_error(replay, (*base, applied)) for applied in points]
    change = 0.0
    for applied in (way[-1] for way in grid):
        moved = zip(plain, replay.flights((*base, applied)), strict=True)
        change = max(change, float(np.mean([np.linalg.norm(a.position - b.position, axis=1).mean() for a, b in moved])))
    unchanged = mean_error(replay, base)
    ends = np.cumsum([0, *map(len, grid)])
    ways = [range(first, last) for first, last in itertools.pairwise(ends.tolist())]
    # A tumbling motion may fit a far too large size by chance, while the smallest one overshoots; so look below the smallest.
    smallest = [way[0] for way in ways if errors[way[0]] > unchanged or errors[way[0]] == min(errors[k] for k in way)]
    for applied in (points[k] for k in smallest):
        share, explained = _projected(replay, plain, replay.flights((*base, applied)))
        if 0.0 < share < _NEARER and explained > _BETWEEN:
            points.append(Applied(name, "", effect.scaled(applied.parameters, share)))
            errors.append(mean_error(replay, (*base, points[-1])))
    together = _together(effect, points, errors, unchanged)
    if together is not None:
        points.append(together)
        errors.append(mean_error(replay, (*base, together)))
    best = int(np.argmin(errors))
    return GridMatch(points[best], errors[best], change)


def promised(replay: ThrowReplay, name: str, base: Sequence[Applied]) -> tuple[Applied, float]:
    """Predict, by superposition and without a simulation, how much an effect explains on top of others.

    The motion that each grid point of the effect causes alone is known. Amplitudes that help alone are solved for together by
    least squares. Motions of tumbling bodies do not add up, so the result only says which effects are worth a simulation, and
    from where to start.

    Args:
        replay: Throws and model; the effect's grid and `base` are in its cache.
        name: Name of the effect.
        base: Effects that are already part of the model.

    Returns:
        The effect with the sizes that explain most, and the share of the squared distances left by `base` that it explains.
    """
    effect, plain = BODY_EFFECTS[name], _stacked(replay, replay.flights())
    left = _stacked(replay, replay.measured) - _stacked(replay, replay.flights(base))
    amplitudes = [parameter.name for parameter in effect.parameters if parameter.amplitude]
    best: dict[str, tuple[float, Applied, Array]] = {}
    points = [applied for way in grid_ways(replay.body, name) for applied in way]
    for applied in points:
        shift = _stacked(replay, replay.flights((applied,))) - plain
        explained = max(float(shift @ left), 0.0) ** 2 / max(float(shift @ shift) * float(left @ left), 1e-300)
        own = next(key for key in amplitudes if applied.parameters[key] != 0.0)
        if explained > best.get(own, (0.0,))[0]:
            best[own] = (explained, applied, shift)
    if not best:
        return points[0], 0.0
    points, shifts = [point for _, point, _ in best.values()], np.stack([shift for *_, shift in best.values()], axis=1)
    shares = np.linalg.lstsq(shifts, left, rcond=None)[0]
    bounds = {parameter.name: (parameter.low, parameter.high) for parameter in effect.parameters}
    wanted = zip(best, shares, points, strict=True)
    sizes = {key: float(np.clip(share * point.parameters[key], *bounds[key])) for key, share, point in wanted}
    kept = np.array([sizes[key] / point.parameters[key] for key, point in zip(best, points, strict=True)])
    explained = 1.0 - float(((left - shifts @ kept) ** 2).sum()) / max(float(left @ left), 1e-300)
    return Applied(name, "", {**points[0].parameters, **sizes}), explained


def _stacked(replay: ThrowReplay, rows: Sequence[Flight] | Sequence[Array]) -> Array:
    """Return the weighted positions of all S samples as one vector, m. [3 S]."""
    places = [row.position if isinstance(row, Flight) else row for row in rows]
    return np.concatenate([weight[:, None] * at for weight, at in zip(replay.weights, places, strict=True)]).ravel()


def _projected(replay: ThrowReplay, plain: Sequence[Flight], moved: Sequence[Flight]) -> tuple[float, float]:
    """Project the difference between measurement and replay onto a change of the replay.

    Args:
        replay: Throws.
        plain: The replay.
        moved: The replay with the change.

    Returns:
        The best factor on the change, and the share of the squared distances that the change explains with it.
    """
    start = _stacked(replay, plain)
    rest, shift = _stacked(replay, replay.measured) - start, _stacked(replay, moved) - start
    along, size, left = float(rest @ shift), float(shift @ shift), float(rest @ rest)
    return along / max(size, 1e-300), along**2 / max(size * left, 1e-300)


def _together(effect: BodyEffect, points: Sequence[Applied], errors: Sequence[float], plain: float) -> Applied | None:
    """Combine the best value of each amplitude into one point; None if fewer than two amplitudes help alone.

    Example: the point of a table that tilts about both axes is far from both axes of the grid, and a search along one axis
    after the other would stop in the first valley.

    Args:
        effect: The effect.
        points: The points of its grid.
        errors: Mean error at each point, m.
        plain: Mean error without the effect, m.
    """
    amplitudes = [parameter.name for parameter in effect.parameters if parameter.amplitude]
    found: dict[str, float] = {}
    for name in amplitudes:
        own = [
            k for k, point in enumerate(points) if all((point.parameters[key] != 0.0) == (key == name) for key in amplitudes)
        ]
        best = min(own, key=lambda k: errors[k], default=None)
        if best is not None and errors[best] < plain:
            found[name] = points[best].parameters[name]
    return (
        Applied(effect.name, "", {**points[0].parameters, **dict.fromkeys(amplitudes, 0.0), **found})
        if len(found) > 1
        else None
    )


def reach(replay: ThrowReplay, others: Sequence[Applied], effect: BodyEffect, parameter: Parameter) -> tuple[float, float]:
    """Return the bounds of a parameter: the tighter of its own and those of the figure that it changes.

    Args:
        replay: Throws and model.
        others: Effects that are also present.
        effect: The effect.
        parameter: The parameter.
    """
    figure = effect.figures[parameter.name]
    now, (low, high) = body_setup(replay.body, others).figures[figure], BOUNDS[figure]
    if effect.relative:
        low, high = (low / now - 1.0, high / now - 1.0) if now > 0 else (-np.inf, np.inf)
    else:
        low, high = low - now, high - now
    return max(low, parameter.low), min(high, parameter.high)


def refine(replay: ThrowReplay, effects: Sequence[Applied], share: float = 1.0, *, held: int = 0) -> ThrowFit:
    """Fit all sizes by one pass of line searches, one parameter after the other.

    Args:
        replay: Throws.
        effects: Effects with their start values, such as the best grid points.
        share: Width of the first brackets, as a share of the grid's spacing.
        held: Number of effects at the front of `effects` that keep their sizes.
    """
    current = list(effects)
    inside, profiles = {}, {}
    for place, applied in enumerate(effects):
        effect = BODY_EFFECTS[applied.name]
        for parameter in effect.parameters if place >= held else ():

            def error(value: float, place: int = place, key: str = parameter.name) -> float:
                return mean_error(replay, [*current[:place], _with(current[place], key, value), *current[place + 1 :]])

            value = current[place].parameters[parameter.name]
            others = (*current[:place], *current[place + 1 :])
            width = share * _width(effect, parameter, value, vanishing(replay.body, others, effect, parameter))
            known, free = lowest(error, value, width, *reach(replay, others, effect, parameter))
            best = min(known, key=lambda at: known[at])
            profiles[place, parameter.name] = known
            if not free:
                best, free = _plateau(known, best)
            free = free or best == vanishing(replay.body, others, effect, parameter)
            inside[place, parameter.name] = free or not parameter.amplitude
            current[place] = _with(current[place], parameter.name, best)
    return ThrowFit(tuple(current), mean_error(replay, current), all(inside.values()), profiles)


def _plateau(known: Mapping[float, float], best: float) -> tuple[float, bool]:
    """Find the start of the plateau on which a search ended, e.g. a body that sticks does so with any larger friction.

    Args:
        known: Evaluated values and their errors.
        best: The best value.

    Returns:
        The value closest to zero, of the best one's sign, from which on all values are as good as the best one. And whether
        it differs from the best one and values on both sides of it were evaluated.
    """
    begin = best
    for value in sorted((value for value in known if value * best > 0.0 and abs(value) < abs(best)), key=abs, reverse=True):
        if known[value] > (1.0 + _GAIN) * known[best]:
            break
        begin = value
    return begin, begin != best and min(known) < begin < max(known)


def _with(applied: Applied, key: str, value: float) -> Applied:
    return Applied(applied.name, "", {**applied.parameters, key: float(value)})


def _width(effect: BodyEffect, parameter: Parameter, value: float, nothing: float | None) -> float:
    """Return half the width of the first bracket: the distance to the next size of the grid.

    Close to a vanishing figure the bracket is narrower, since the grid halves such a figure from size to size.

    Args:
        effect: The effect.
        parameter: The parameter.
        value: Its value.
        nothing: Value at which its figure is zero; None if there is none.
    """
    ratio = max([b / a for a, b in zip(effect.sizes[:-1], effect.sizes[1:], strict=True)], default=2.0)
    width = max(abs(value) * (1.0 - 1.0 / ratio), abs(parameter.typical) * 0.5)
    if nothing is None or value > 0.5 * nothing:
        return width
    return min(width, max(value - nothing, 0.125 * abs(nothing)))


def lowest(
    error: Callable[[float], float], start: float, width: float, low: float, high: float
) -> tuple[dict[float, float], bool]:
    """Search the minimum over one parameter: widen the bracket while its edge is best, then use parabolas and golden sections.

    Args:
        error: Returns the error at a value.
        start: First value.
        width: Half the width of the first bracket.
        low: Smallest allowed value.
        high: Largest allowed value.

    Returns:
        The evaluated values with their errors, and whether the best one is inside its bounds and its bracket.

    Source: Brent, Algorithms for Minimization without Derivatives, 1973, chapter 5.
    """
    start = float(np.clip(start, low, high))
    known = {start: error(start)}

    def at(value: float) -> float:
        if value not in known:
            known[value] = error(value)
        return known[value]

    a, b, centre = float(max(start - width, low)), float(min(start + width, high)), start
    for _ in range(_WIDEN):
        edge = min((a, b), key=at)
        if at(edge) >= at(centre) or edge in (low, high):
            break
        # The edge is better: move the bracket in that direction, and double the step.
        far = 2.0 * (edge - centre)
        a, b, centre = (max(edge + far, low), centre, edge) if edge < centre else (centre, min(edge + far, high), edge)
    stop = _SHRINK * (b - a)
    for _ in range(_LOOKS):
        best = min(known, key=lambda value: known[value])
        left, right = (max((v for v in known if v < best), default=low), min((v for v in known if v > best), default=high))
        if right - left <= stop or not low < best < high:
            break
        vertex, promised = _parabola(known, left, best, right)
        if promised < _GAIN * known[best] and right - left <= 0.5 * (b - a):
            break
        # A vertex close to a known value adds nothing; step into the wider half instead.
        if min(abs(vertex - left), abs(vertex - best), abs(right - vertex)) < 0.25 * stop:
            vertex = best + _GOLDEN * (right - best if right - best > best - left else left - best)
        at(vertex)
    best = min(known, key=lambda value: known[value])
    return known, low < best < high and min(known) < best < max(known)


def _parabola(known: Mapping[float, float], left: float, best: float, right: float) -> tuple[float, float]:
    """Return the lowest point of the parabola through three values, and its depth below the middle one.

    Returns `best` and infinity if the parabola does not open upwards, or an outer value is not known.
    """
    if left not in known or right not in known:
        return best, np.inf
    x = np.array([left, best, right]) - best
    square, slope, _ = np.polyfit(x, [known[value] for value in (left, best, right)], 2)
    if square <= 0:
        return best, np.inf
    step = float(np.clip(-slope / (2.0 * square), x[0], x[2]))
    return best + step, float(-(square * step + slope) * step)
