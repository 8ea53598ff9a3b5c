"""How effect-free residuals look: replicates are drawn from reference photos, which hold what no theory knows of splats."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gsbridge.gap.image.floor import LEVELS
from gsbridge.gap.image.model import ImageCandidate
from gsbridge.gap.image.screen import Group, features, gains_of, signatures
from gsbridge.gap.image.view import View
from gsbridge.geometry import Array

SCALES = (1, 4, 12)
"""Edges of the blocks over which residuals are averaged, px: an effect is wider than noise."""


def coherence(groups: Sequence[Group], rows: Array, members: Array) -> float:
    """Mean squared scalar product of effect-free residuals with unit signatures of runs of photos.

    One where residuals are white; more where the same splats are off in all photos, and that is not known yet.

    Args:
        groups: Signatures on the reference.
        rows: Its residuals. [N, D].
        members: Photos of each run. [R, n].
    """
    shares: dict[str, list[float]] = {}
    for group in groups:
        along, gram = group.along(rows)[members].sum(axis=1), group.grams()[members].sum(axis=1)
        gain, _ = gains_of(along, gram, np.full(along.shape[1], -np.inf))
        shares.setdefault(group.key, []).append(float(gain.mean()) / along.shape[1])
    return float(np.mean([np.mean(row) for row in shares.values()]))


def block_sums(view: View, table: Array) -> Array:
    """Squares of block means, in units of white noise, of each photo: at every scale and colour, and of the grain. [N, K]."""
    count, height, width = view.shots.photos.shape[:3]
    white = table[: count * height].reshape(count, height, width, 3)
    out = []
    for scale in SCALES:
        tall, wide = height // scale, width // scale
        parts = white[:, : tall * scale, : wide * scale].reshape(count, tall, scale, wide, scale, 3)
        means = parts.sum(axis=(2, 4)) / scale
        out.append((means.astype(np.float64) ** 2).mean(axis=(1, 2)))
    grain = table[count * height :].astype(np.float64) ** 2
    used = np.maximum((view.flats.counts >= 20).sum(axis=1) * 3, 1)
    return np.concatenate([*out, (grain.sum(axis=1) / used)[:, None]], axis=1)


@dataclass(frozen=True)
class _Kind:
    """What is needed of one effect's groups on the reference: per photo and group."""

    alongs: tuple[Array, ...]
    grams: tuple[Array, ...]
    lows: tuple[Array, ...]

    def gains(self, draws: Array) -> Array:
        """Largest gain in replicates. [R, n] -> [R]."""
        best = np.zeros(len(draws))
        for along, gram, low in zip(self.alongs, self.grams, self.lows, strict=True):
            best = np.maximum(best, gains_of(along[draws].sum(axis=1), gram[draws].sum(axis=1), low)[0])
        return best


@dataclass(frozen=True)
class Reference:
    """Effect-free photos, prepared for replicates.

    Args:
        blocks: As `block_sums`. [N, K].
        squares: Squared residual of each photo. [N].
        kinds: By effect and feature.
    """

    blocks: Array
    squares: Array
    kinds: dict[str, _Kind]

    @classmethod
    def of(cls, view: View, who: Sequence[ImageCandidate], run: int) -> tuple[Reference, dict[str, float]]:
        """From the reference photos; and the coherence of runs of photos, by effect."""
        table = view.residual()
        rows = view.by_photo(table)
        shared, parts = {}, {}
        members = runs(len(rows), run)
        for candidate in (*who, None):
            groups = features(view) if candidate is None else signatures(view, (candidate,))
            for key in dict.fromkeys(group.key for group in groups):
                mine = [group for group in groups if group.key == key]
                grams = tuple(group.grams() for group in mine)
                parts[key] = _Kind(tuple(g.along(rows) for g in mine), grams, tuple(g.lows for g in mine))
            if candidate is not None:
                shared[str(candidate)] = coherence(groups, rows, members)
        return cls(block_sums(view, table), (rows.astype(np.float64) ** 2).sum(axis=1), parts), shared

    def joined(self, other: Reference) -> Reference:
        """With the photos of another, in their order."""
        kinds = {
            key: _Kind(
                tuple(np.concatenate(pair) for pair in zip(kind.alongs, other.kinds[key].alongs, strict=True)),
                tuple(np.concatenate(pair) for pair in zip(kind.grams, other.kinds[key].grams, strict=True)),
                kind.lows,
            )
            for key, kind in self.kinds.items()
        }
        squares = np.concatenate([self.squares, other.squares])
        return Reference(np.concatenate([self.blocks, other.blocks]), squares, kinds)

    def scaled(self, scale: float) -> Reference:
        """With all variances of the floor multiplied."""
        kinds = {
            key: _Kind(tuple(a / scale for a in kind.alongs), tuple(g / scale for g in kind.grams), kind.lows)
            for key, kind in self.kinds.items()
        }
        return Reference(self.blocks / scale, self.squares / scale, kinds)

    def null(self, photos: int) -> Null:
        """Replicates of a role with some photos."""
        # Runs of a film, not photos drawn one by one: a role sees the same things in all of its photos.
        draws = runs(len(self.squares), photos)
        gains = {key: kind.gains(draws) for key, kind in self.kinds.items()}
        free = len(self.squares) // photos
        return Null(self.blocks[draws].mean(axis=1), gains, float(self.squares.mean()) * photos, free, 3.0 * LEVELS * photos)


def runs(count: int, length: int) -> Array:
    """Photos that follow one another, from each on, in a circle. [count, length]."""
    return (np.arange(count)[:, None] + np.arange(min(length, count))) % count


@dataclass(frozen=True)
class Null:
    """Replicates of a role.

    Args:
        blocks: Block sums. [R, K].
        gains: Of every effect and feature. [R] each.
        floor: Squared residual that is to be expected.
        independent: How many of them have no photo in common.
        grains: Measured grains of a role.
    """

    blocks: Array
    gains: dict[str, Array]
    floor: float
    independent: int
    grains: float

    def p_blocks(self, blocks: Array) -> float:
        """Probability of larger block sums. [N, K]."""
        middle, spread = self.blocks.mean(axis=0), np.maximum(self.blocks.std(axis=0, ddof=1), 1e-12)
        table = (self.blocks - middle) / spread
        seen = float(((blocks.mean(axis=0) - middle) / spread).max())
        return self._p_value(np.exp(0.5 * table.max(axis=1)), float(np.exp(0.5 * min(seen, 1e3))))

    def p_gains(self, gains: dict[str, float]) -> float:
        """Probability that any of these is as much larger than it is without effects."""
        keys = [key for key in gains if key in self.gains]
        if not keys:
            return 1.0
        usual = np.array([max(float(self.gains[key].mean()), 0.3) for key in keys])
        table = np.stack([self.gains[key] for key in keys], axis=1) / usual
        return self._p_value(table.max(axis=1), float((np.array([gains[key] for key in keys]) / usual).max()))

    def structure(self, keys: Collection[str]) -> float:
        """Mean sum of gains, and of grain, as `Identification.structure` takes it."""
        return float(sum(self.gains[key].mean() for key in keys) + self.blocks[:, -1].mean() * self.grains)

    def _p_value(self, replicates: Array, seen: float) -> float:
        """Of a statistic whose logarithm is taken for Student's: few photos say little about the far tail. [R]."""
        values = np.log(np.maximum(replicates, 1e-6))
        # Of a further value, where mean and spread themselves come from few.
        spread = max(float(values.std(ddof=1)), 0.1) * np.sqrt(1.0 + 1.0 / max(self.independent, 1))
        free = max(self.independent - 1, 3)
        return float(student.sf((np.log(max(seen, 1e-6)) - values.mean()) / spread, free))
