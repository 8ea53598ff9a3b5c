"""Screening by signatures: how much of a difference between photos each image effect could explain, before any fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.image.residuals import ImageResiduals
from gsbridge.geometry import Array

_SHOWN = 1.0
"""Smallest squared length, in units of the noise, at which a signature counts as visible."""

_SLIGHT = 1e-3
"""Share of the largest eigenvalue of a group's Gram matrix below which a direction is ignored as ill-conditioned."""


@dataclass(frozen=True)
class Group:
    """Signatures of one effect at fixed shape parameters, one per amplitude; their weighted sums are signatures, too.

    Args:
        who: The effect.
        values: Parameters of each signature. [S].
        lows: Smallest weight that each signature may have. [S].
        tables: Change of the residual for each signature, in units of the noise. [S, D] float32.
    """

    who: Candidate
    values: tuple[Mapping[str, float], ...]
    lows: Array
    tables: Array


@dataclass(frozen=True)
class ImageMatch:
    """Gain that an effect could bring, estimated before any fit.

    Args:
        candidate: The effect.
        gain: Reduction of the squared residual by the best of the effect's groups.
        start: Parameters from which to start a fit.
    """

    candidate: Candidate
    gain: float
    start: dict[str, float]


def signatures(view: ImageResiduals, who: Sequence[Candidate]) -> list[Group]:
    """Compute the signatures of effects in the views of a role."""
    plain, out = view.residual(), []
    for candidate in who:
        effect = candidate.effect
        for shape in effect.shapes():
            for size in effect.sizes:
                values, lows, tables = [], [], []
                for parameter in effect.amplitudes:
                    amount = min(parameter.typical * size, parameter.high)
                    row = {p.name: shape.get(p.name, 0.0) for p in effect.parameters} | {parameter.name: amount}
                    values.append(row)
                    lows.append(parameter.low / amount)
                    tables.append((plain - view.residual([candidate.applied(row)])).ravel())
                out.append(Group(candidate, tuple(values), np.array(lows), np.stack(tables)))
    return out


def gains_of(along: Array, gram: Array, lows: Array) -> tuple[float, Array]:
    """Return the reduction of the squared residual by a weighted sum of signatures, and the weights. [S].

    Args:
        along: Scalar products of the signatures with the residual. [S].
        gram: Scalar products among the signatures (Gram matrix). [S, S].
        lows: Smallest allowed weights. [S].
    """
    values, vectors = np.linalg.eigh(gram)
    inverse = np.where(values > _SLIGHT * max(values[-1], 1e-300), 1.0 / np.maximum(values, 1e-300), 0.0)
    factors = np.maximum(vectors @ (inverse * (vectors.T @ along)), lows)
    # If a weight was clipped, the others are no longer optimal, and the sum may even increase the residual.
    return max(float(2.0 * factors @ along - factors @ gram @ factors), 0.0), factors


def screen(groups: Sequence[Group], residual: Array) -> list[ImageMatch]:
    """Rank effects by their estimated gain, the largest first.

    Args:
        groups: Signatures.
        residual: Residual in units of the noise, as from `ImageResiduals.residual`. [N * h + N, 3 * w].
    """
    flat = residual.ravel()
    best: dict[Any, Any] = {}
    for group in groups:
        along = (group.tables @ flat).astype(np.float64)
        gain, factors = gains_of(along, (group.tables @ group.tables.T).astype(np.float64), group.lows)
        if group.who not in best or gain > best[group.who].gain:
            effect = group.who.effect
            start = dict(group.values[0])
            for parameter, factor, values in zip(effect.amplitudes, factors, group.values, strict=True):
                start[parameter.name] = float(factor) * values[parameter.name]
            best[group.who] = ImageMatch(group.who, gain, effect.clipped(start))
    return sorted(best.values(), key=lambda match: -match.gain)


def lengths(groups: Sequence[Group]) -> dict[str, float]:
    """Return the squared length of the longest signature of each effect, at its start sizes and shapes."""
    out: dict[str, float] = {}
    for group in groups:
        longest = float((group.tables**2).sum(axis=1).max())
        out[str(group.who)] = max(out.get(str(group.who), 0.0), longest)
    return out


def unseen_of(view: ImageResiduals, who: Sequence[Candidate], groups: Sequence[Group]) -> tuple[str, ...]:
    """Return the names of candidates that these photos cannot identify or in which they do not show at their start sizes.

    Args:
        view: Residuals on the photos.
        who: Candidate effects.
        groups: Signatures of the candidates.
    """
    seen = lengths(groups)
    return tuple(sorted(str(one) for one in who if not view.tells(one) or seen.get(str(one), 0.0) < _SHOWN))


def cosines(groups: Sequence[Group]) -> tuple[list[str], Array]:
    """Return the effects' names, and the absolute cosines between their longest signatures as similarities. [N, N]."""
    longest: dict[str, Array] = {}
    for group in groups:
        row = max(group.tables, key=lambda table: float((table**2).sum()))
        if float((row**2).sum()) > float((longest.get(str(group.who), np.zeros(1)) ** 2).sum()):
            longest[str(group.who)] = row
    rows = [row / np.linalg.norm(row) for row in longest.values()]
    return list(longest), np.abs([[one @ other for other in rows] for one in rows])
