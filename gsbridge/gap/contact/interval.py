"""How well the size of an effect is known: which sizes would have been best for other throws of the same kind."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import ThrowFit

_POINTS = np.linspace(-1.0, 1.0, 5)
_DRAWS = 400
_RISES = (0.03, 0.3)
"""Smallest and largest relative rise of the mean error that is wanted at the ends of the profile."""

_TRIES = 4


def intervals(replay: ThrowReplay, fit: ThrowFit, rng: np.random.Generator) -> list[dict[str, tuple[float, float]]]:
    """90 % intervals of all parameters, one by one, by a bootstrap over throws of a parabola through the error's profile.

    Args:
        replay: The throws that were fitted.
        fit: Fit to these throws.
        rng: Random numbers for the bootstrap.
    """
    out, effects = [], fit.effects
    for place, applied in enumerate(effects):
        rows = {}
        for parameter in BODY_EFFECTS[applied.name].parameters:
            value = applied.parameters[parameter.name]

            def errors(at: float, place: int = place, key: str = parameter.name) -> np.ndarray:
                changed = list(effects)
                changed[place] = Applied(changed[place].name, "", {**changed[place].parameters, key: at})
                return replay.errors(changed)

            best = float(errors(value).mean())
            width = _width(fit.profiles[place, parameter.name], best) or max(0.15 * abs(value), 0.2 * abs(parameter.typical))
            for _ in range(_TRIES):
                rise = min(float(errors(value + sign * width).mean()) for sign in (-1.0, 1.0)) / best - 1.0
                if rise < _RISES[0]:
                    width *= 2.0
                elif rise > _RISES[1]:
                    width *= 0.5
                else:
                    break
            profile = np.stack([errors(value + width * point) for point in _POINTS])
            draws = rng.integers(0, len(replay), (_DRAWS, len(replay)))
            square, slope, _ = np.polyfit(_POINTS, profile[:, draws].mean(axis=2), 2)
            centre = np.clip(np.where(square > 0, -slope / (2.0 * np.maximum(square, 1e-300)), np.sign(-slope)), -1.0, 1.0)
            low, high = np.quantile(value + width * centre, [0.05, 0.95])
            # The interval is about the value that is named, which need not be the parabola's lowest point.
            low, high = min(float(low), value), max(float(high), value)
            rows[parameter.name] = (max(low, parameter.low), min(high, parameter.high))
        out.append(rows)
    return out


def _width(profile: Mapping[float, float], best: float) -> float | None:
    """Width at which the error has risen by the mean of `_RISES`, by what the search has seen; None where it tells nothing."""
    near = {value: error for value, error in profile.items() if error < (1.0 + 2.0 * _RISES[1]) * best}
    if len(near) < 3:
        return None
    square = np.polyfit(np.array(list(near)) - np.mean(list(near)), list(near.values()), 2)[0]
    return float(np.sqrt(float(np.mean(_RISES)) * best / square)) if square > 0 else None
