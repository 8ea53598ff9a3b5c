"""Signatures of image effects, and of what no effect of the catalogue is: how much of a residual each could explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.gap.image import common
from gsbridge.gap.image.model import ImageCandidate
from gsbridge.gap.image.view import View
from gsbridge.gap.system import Applied
from gsbridge.geometry import Array

_SLIGHT = 1e-3
"""Share of the longest axis of a group's signatures below which an axis says nothing."""


@dataclass(frozen=True)
class Group:
    """Signatures that add up: those of one effect at one shape, or one feature in the three colours.

    Args:
        who: The effect; None for a feature.
        values: Parameters of each signature. [S].
        lows: Smallest factor that each may have. [S].
        tables: In units of the floor. [N, S, D] float32.
        title: Of a feature.
    """

    who: ImageCandidate | None
    values: tuple[Mapping[str, float], ...]
    lows: Array
    tables: Array
    title: str = ""

    @property
    def key(self) -> str:
        """Name of the effect or feature."""
        return str(self.who) if self.who else self.title

    def along(self, rows: Array) -> Array:
        """Scalar products with the residual of each photo. [N, D] -> [N, S]."""
        return (self.tables @ rows[:, :, None])[:, :, 0].astype(np.float64)

    def grams(self) -> Array:
        """Scalar products of the signatures in each photo. [N, S, S]."""
        return (self.tables @ self.tables.transpose(0, 2, 1)).astype(np.float64)


@dataclass(frozen=True)
class Match:
    """What an effect could explain.

    Args:
        candidate: The effect.
        gain: Squared residual that its best group would take away.
        start: Parameters to begin a fit with.
    """

    candidate: ImageCandidate
    gain: float
    start: dict[str, float]


def gains_of(along: Array, gram: Array, lows: Array) -> tuple[Array, Array]:
    """Squared residual that signatures take away, and their factors, none below its smallest.

    Args:
        along: Scalar products with the residual. [..., S].
        gram: Among each other. [..., S, S].
        lows: Smallest factors. [S].

    Returns:
        [...] and [..., S].
    """
    values, vectors = np.linalg.eigh(gram)
    longest = np.maximum(values[..., -1:], 1e-300)
    inverse = np.where(values > _SLIGHT * longest, 1.0 / np.maximum(values, 1e-300), 0.0)
    factors = np.einsum("...st,...t,...ut,...u->...s", vectors, inverse, vectors, along)
    factors = np.maximum(factors, lows)
    gains = 2.0 * (factors * along).sum(axis=-1) - np.einsum("...s,...st,...t->...", factors, gram, factors)
    # Where a bound was met the others no longer fit; half of them is better than none.
    return np.maximum(gains, 0.0), factors


def signatures(view: View, who: Sequence[ImageCandidate], base: Sequence[Applied] = ()) -> list[Group]:
    """Signatures of effects on top of others.

    Args:
        view: Photos that they would show in.
        who: Effects.
        base: Effects that are there already.
    """
    how = view.shooting(base)
    pictures, grain = view.model.expected(view.shots, how), view.grain(how)
    out = []
    for candidate in who:
        effect = candidate.effect
        for shape in effect.shapes():
            for size in effect.sizes:
                values, lows, tables = [], [], []
                for parameter in effect.amplitudes:
                    amount = min(parameter.typical * size, parameter.high)
                    row = {p.name: shape.get(p.name, 0.0) for p in effect.parameters} | {parameter.name: amount}
                    how = view.shooting([*base, candidate.applied(row)])
                    apart = np.zeros_like(pictures) if effect.grain else view.model.expected(view.shots, how) - pictures
                    values.append(row)
                    lows.append(parameter.low / amount)
                    tables.append(view.rows(apart, view.grain(how) - grain))
                out.append(Group(candidate, tuple(values), np.array(lows), np.stack(tables, axis=1)))
    return out


def features(view: View, base: Sequence[Applied] = ()) -> list[Group]:
    """What an effect outside the catalogue may look like: slopes, brightness and places, in every colour on its own.

    Args:
        view: Photos.
        base: Effects that are there already.
    """
    quiet = np.zeros((*view.flats.counts.shape, 3))
    free, out = np.full(3, -np.inf), []
    for title, shape in common.features(view.pictures(base)).items():
        tables = [view.rows(only, quiet) for only in common.coloured(shape)]
        out.append(Group(None, ({},) * 3, free, np.stack(tables, axis=1), title))
    return out


def screen(view: View, groups: Sequence[Group], residual: Array) -> list[Match]:
    """Effects, the largest gain first.

    Args:
        view: Photos.
        groups: Signatures on them.
        residual: In units of the floor.
    """
    rows, best = view.by_photo(residual), {}
    for group in groups:
        if group.who is None:
            continue
        along, gram = group.along(rows).sum(axis=0), group.grams().sum(axis=0)
        gain, factors = gains_of(along, gram, group.lows)
        if group.who not in best or gain > best[group.who].gain:
            effect = group.who.effect
            start: dict[str, Any] = dict(group.values[0])
            for parameter, factor, values in zip(effect.amplitudes, factors, group.values, strict=True):
                start[parameter.name] = float(factor) * values[parameter.name]
            best[group.who] = Match(group.who, float(gain), effect.clipped(start))
    return sorted(best.values(), key=lambda match: -match.gain)


def lengths(groups: Sequence[Group]) -> dict[str, float]:
    """Squared length of the longest signature of each effect, at the sizes where one begins to look."""
    out: dict[str, float] = {}
    for group in groups:
        longest = float((group.tables**2).sum(axis=(0, 2)).max())
        out[group.key] = max(out.get(group.key, 0.0), longest)
    return out
