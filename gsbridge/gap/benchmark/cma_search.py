"""CMA-ES over the joint sizes of the likeliest candidates, with a budget of simulations.

Source: Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772, 2016.
"""

from __future__ import annotations

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate, Rules
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

BUDGET = Rules().budget
"""Number of simulations of a search: as many as a diagnosis has."""

_SPREAD = 0.5
"""Initial step size, relative to the sizes that screening estimates."""


def search(view: JointResiduals, screen: Screen, budget: int, seed: int) -> list[Applied]:
    """Search for the sizes of the candidates that screening ranks first, with both signs where effects allow both.

    Args:
        view: Residuals on the record to which sizes are fitted.
        screen: Signatures on that record.
        budget: Number of simulations.
        seed: Seed of the random draws.

    Returns:
        All candidates with their final sizes, including those of size zero.
    """
    import cma

    matches = screen.matches(view.residual())[: Rules().rivals]
    who = [match.candidate for match in matches]
    starts = [match.starts[0] for match in matches]
    lows = np.array([_lowest(candidate) for candidate in who])

    def effects(factors: Array) -> list[Applied]:
        return [
            candidate.applied(candidate.effect.scaled(values, float(factor)))
            for candidate, values, factor in zip(who, starts, factors, strict=True)
        ]

    def cost(factors: Array) -> float:
        return float((view.residual(effects(factors)) ** 2).sum())

    options = {"maxfevals": budget, "verbose": -9, "seed": seed + 1, "bounds": [lows.tolist(), None]}
    # Start from the likeliest candidate at its screened size, and the others at or near zero.
    begin = np.where(lows < 0, 0.0, 0.1 * _SPREAD)
    begin[0] = 1.0
    best = np.asarray(cma.fmin2(cost, begin, _SPREAD, options)[0])
    return effects(best)


def _lowest(candidate: Candidate) -> float:
    """Return the lower bound of the factor on a candidate's start: unbounded if its sizes may have either sign, else zero."""
    sizes = [p for p in candidate.effect.parameters if p.amplitude]
    return -np.inf if sizes and all(p.low < 0 for p in sizes) and not candidate.effect.threshold else 0.0
