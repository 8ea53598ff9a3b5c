"""Start poses of the object: uniform draws for training, stratified sets for tests.

A pose is (x, y, yaw) of the body frame on the table, table frame, m and rad. The square region has four quadrants, numbered as
in the paper's tests: 1 far right (+x, -y), 2 far left (+x, +y), 3 near right (-x, -y), 4 near left (-x, +y).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array

QUADRANTS = (1, 2, 3, 4)
PER_QUADRANT = 8
POSES = PER_QUADRANT * len(QUADRANTS)
"""Number of start poses in a set."""

POSE_SETS = ("fixed", "unseen", "outside")
"""Names of the sets: two inside the start square of the training, and one beyond it, where the tool still reaches."""

REACH = 0.33
"""Edge of the square within which the poses of `outside` lie, m: 5 mm less on each side than the tool may go."""

MARGIN = 0.005
"""Smallest distance of the poses of `outside` from the start square of the training, m."""

_SIGNS = {1: (1.0, -1.0), 2: (1.0, 1.0), 3: (-1.0, -1.0), 4: (-1.0, 1.0)}

_CELLS = 4
"""Cells along one side of a quadrant; `fixed` takes the 8 black cells of this chessboard, `unseen` the 8 white ones."""

_BORDER = 0.08
"""Share of a cell left free on each side, so that poses of the two sets never come close."""

_TRIES = 256
"""Number of candidate places that are drawn in a cell."""

_DRAWS = 1024
"""Largest number of draws per pose; enough if at least a hundredth of the quadrant is free."""


@dataclass(frozen=True)
class KeepOut:
    """A disc in which no object may start, such as the plate with room for the object around it; table frame, m."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class StartRegion:
    """The square on the table in which objects start.

    Args:
        centre: Middle of the region, table frame, m.
        side: Edge of the region, m.
        yaw: Smallest and largest yaw of the object, rad.
        keep_out: Discs inside it that stay free.
    """

    centre: tuple[float, float] = (0.0, 0.265)
    side: float = 0.30
    yaw: tuple[float, float] = (-0.25 * np.pi, 0.25 * np.pi)
    keep_out: Sequence[KeepOut] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite([*self.centre, self.side, *self.yaw]).all() and self.side > 0 and self.yaw[0] <= self.yaw[1]):
            raise InputError(
                "start region", "its centre, side or yaw range makes no sense", "Give metres and radians, low <= high"
            )

    def contains(self, xy: Array) -> Array:
        """Whether points lie in the square. [..., 2] -> bool [...]."""
        return np.asarray(np.all(np.abs(np.asarray(xy) - self.centre) <= 0.5 * self.side + 1e-12, axis=-1))

    def corners(self) -> Array:
        """Corners of the square. [4, 2]."""
        half = 0.5 * self.side
        return np.array([(self.centre[0] + x, self.centre[1] + y) for x in (-half, half) for y in (-half, half)])

    def free(self, xy: Array) -> Array:
        """Whether points lie in the square and outside every disc. [..., 2] -> bool [...]."""
        xy = np.asarray(xy)
        out = self.contains(xy)
        for disc in self.keep_out:
            out &= np.hypot(xy[..., 0] - disc.x, xy[..., 1] - disc.y) >= disc.radius
        return out

    def quadrant(self, xy: Array) -> Array:
        """Quadrant 1 to 4 of points; the middle lines belong to the + sides. [..., 2] -> int [...]."""
        offset = np.asarray(xy) - self.centre
        return np.where(offset[..., 0] >= 0, 1, 3) + (offset[..., 1] >= 0)

    def sample(self, rng: np.random.Generator, count: int) -> Array:
        """Draw poses uniformly from the free part of each quadrant, and from all quadrants equally often.

        The test sets, too, have equally many poses in each quadrant, even where a plate leaves little room in one.

        Args:
            rng: Random generator.
            count: Number of poses.

        Returns:
            x, y, yaw. [count, 3].

        Raises:
            InputError: The discs leave almost nothing of a quadrant.
        """
        signs = np.array([_SIGNS[quadrant] for quadrant in rng.choice(QUADRANTS, count)])
        found = np.full((count, 2), np.nan)
        for _ in range(_DRAWS):
            missing = np.isnan(found[:, 0])
            if not missing.any():
                break
            draw = self.centre + 0.5 * self.side * rng.uniform(size=(missing.sum(), 2)) * signs[missing]
            found[missing] = np.where(self.free(draw)[:, None], draw, np.nan)
        if np.isnan(found).any():
            raise _crowded("a quadrant")
        return np.c_[found, rng.uniform(*self.yaw, count)]


def sets_of(region: StartRegion) -> tuple[str, ...]:
    """Return the names of a region's sets; no `outside` if the region fills the tool's reach or has a plate in it."""
    return POSE_SETS if region.side + 2 * MARGIN < REACH and not region.keep_out else POSE_SETS[:2]


def trial_seed(name: str, index: int) -> int:
    """Return the seed of the trial from one start pose; it depends on neither the world nor the number of trials.

    Args:
        name: One of `POSE_SETS`.
        index: Number of the start pose in the set.
    """
    return 1000 * POSE_SETS.index(name) + index


def pose_set(name: str, region: StartRegion, seed: int = 0) -> Array:
    """One of the test sets: 4 quadrants with 8 poses each, spread evenly over places and yaws.

    Every quadrant is a chessboard of 4 x 4 cells; `fixed` has one pose in each black cell, `unseen` in each white one, so that
    both cover each row and column of cells alike and no pose of one lies near a pose of the other. Yaws are stratified too:
    every eighth of the range occurs once per quadrant. If a disc covers a cell, its pose moves to the roomiest free place in
    the quadrant's other cells of the same colour, or of the other colour if all cells of the same colour are covered.

    `outside` has its poses in the narrow frame round the square: a quadrant's part of the frame is divided along its length
    into eight pieces, each with one pose.

    Args:
        name: `fixed`, `unseen` or `outside`.
        region: The start region.
        seed: Seed of the places within the cells.

    Returns:
        x, y, yaw, quadrant 1 first. [32, 3].

    Raises:
        InputError: Unknown set, or one that the region does not have, or a quadrant without room.
    """
    if name not in (known := sets_of(region)):
        raise InputError("pose set", f"'{name}' is unknown here", f"Use one of: {', '.join(known)}")
    colour = POSE_SETS.index(name)
    rng = np.random.default_rng([seed, colour])
    poses = []
    for quadrant in QUADRANTS:
        xy = _framed(region, quadrant, rng) if name == "outside" else _places(region, quadrant, colour, rng)
        bins = rng.permutation(PER_QUADRANT) + rng.uniform(size=PER_QUADRANT)
        poses.append(np.c_[xy, region.yaw[0] + (region.yaw[1] - region.yaw[0]) * bins / PER_QUADRANT])
    return np.concatenate(poses)


def _places(region: StartRegion, quadrant: int, colour: int, rng: np.random.Generator) -> Array:
    """Choose eight places in a quadrant's cells of one colour, or of the other if all of these are covered. [8, 2]."""
    free, candidates = _free_places(region, quadrant, colour, rng)
    if not free.any():
        free, candidates = _free_places(region, quadrant, 1 - colour, rng)
    if not free.any():
        raise _crowded(f"quadrant {quadrant}")
    out = np.full((len(candidates), 2), np.nan)
    for cell in np.flatnonzero(free.any(1)):
        out[cell] = candidates[cell][free[cell]][0]
    spare = candidates[free]
    for cell in np.flatnonzero(~free.any(1)):
        placed = out[~np.isnan(out[:, 0])]
        out[cell] = spare[np.argmax(np.linalg.norm(spare[:, None] - placed[None], axis=-1).min(1))]
    return out


def _framed(region: StartRegion, quadrant: int, rng: np.random.Generator) -> Array:
    """Eight places in a quadrant's part of the frame round the square. [8, 2]."""
    inner, outer = 0.5 * region.side + MARGIN, 0.5 * REACH
    # Position along a quadrant's part of the frame, 0 to 2: up one side, then back along the other.
    along = (np.arange(PER_QUADRANT) + _BORDER + (1.0 - 2.0 * _BORDER) * rng.uniform(size=PER_QUADRANT)) / PER_QUADRANT * 2.0
    away = inner + (outer - inner) * rng.uniform(size=PER_QUADRANT)
    beside = outer * np.where(along < 1.0, along, 2.0 - along)
    xy = np.where((along < 1.0)[:, None], np.c_[away, beside], np.c_[beside, away])
    return np.asarray(region.centre) + xy * np.asarray(_SIGNS[quadrant])


def _free_places(region: StartRegion, quadrant: int, colour: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw candidate places in each cell of one colour; return which are free, bool [8, T], and the places, [8, T, 2]."""
    edge = 0.5 * region.side / _CELLS
    cells = [(i, j) for i in range(_CELLS) for j in range(_CELLS) if (i + j) % 2 == colour]
    # Every cell draws the same number of candidates, free or not, so that a disc in one cell moves no pose in another.
    inside = _BORDER + (1.0 - 2.0 * _BORDER) * rng.uniform(size=(len(cells), _TRIES, 2))
    candidates = region.centre + edge * (np.array(cells)[:, None, :] + inside) * _SIGNS[quadrant]
    return region.free(candidates), candidates


def _crowded(where: str) -> InputError:
    """Error for a region without room."""
    return InputError("start region", f"{where} has no free place outside the keep-out discs", "Move the plate or the region")
