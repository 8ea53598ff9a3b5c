"""Places at which a vessel can be grasped by its wall, with one finger inside and one outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.cavity import CELL_M, heights_from_above, water_depth

_CAVITY = 0.020
"""Vessels less deep than this are grasped like solid objects, m."""
_DEPTHS = (0.030, 0.025, 0.020, 0.016, 0.012)
"""Depths below the rim that fingertips try to reach, m; the deeper they reach, the less the vessel turns in the grip."""
_BOTTOM = 0.006
"""Room left below a fingertip, m."""
_THICK = 0.020
"""Largest thickness of a wall, m."""
_FINGER = (0.010, 0.048)
"""Distances from the wall's face between which an open finger may be, m: half the opening, and the finger's thickness."""
_PAD = 0.0135
"""Half the width of a pad, m."""
_BESIDE = 0.004
"""Room to each side of a finger, m."""
_ALIKE = 0.004
"""Largest difference in thickness and in height of the rim among the places of one grip, m."""
_DIRECTIONS = 72
"""Number of directions round the rim that are tried."""
_SKEW = np.deg2rad([0.0, -10.0, 10.0, -20.0, 20.0, -30.0, 30.0])
"""Angles by which the fingers may be turned from the line to the cavity's middle, rad, as a wall need not be round."""


@dataclass(frozen=True)
class Rim:
    """Places at which two fingers from above can grasp a vessel's wall; body frame, m.

    Args:
        places: Middle of the wall (x, y) and direction across it, from inside to outside (rad); the best place first.
        thickness: Distance between parallel pads that close on the wall, at the thickest of these places.
        height: Height of the rim at the best place.
        depth: How far below the rim fingertips may go.
    """

    places: tuple[tuple[float, float, float], ...]
    thickness: float
    height: float
    depth: float

    @classmethod
    def from_json(cls, content: Mapping[str, Any] | None) -> Rim | None:
        """The rim of a record; None if the record has none.

        Raises:
            KeyError, TypeError, ValueError: The record is damaged.
        """
        if content is None:
            return None
        places = tuple((float(x), float(y), float(angle)) for x, y, angle in content["places"])
        if not places:
            raise ValueError("a rim without a place")
        return cls(places, float(content["thickness"]), float(content["height"]), float(content["depth"]))


@dataclass(frozen=True)
class _Heights:
    """Heights as seen from above, on a grid [nx, ny] whose first sample is at `low`."""

    values: Array
    low: Array

    def along(self, start: Array, angle: float, away: Array, half: float) -> Array:
        """Largest height across a strip of half width `half` at distances `away` from `start` along `angle`. [D] -> [D], m."""
        ahead = np.array([np.cos(angle), np.sin(angle)])
        beside = np.array([-ahead[1], ahead[0]])
        across = np.arange(-half, half + 0.5 * CELL_M, CELL_M)
        places = start + away[:, None, None] * ahead + across[None, :, None] * beside
        index = np.moveaxis((places - self.low) / CELL_M, -1, 0)
        return np.asarray(ndimage.map_coordinates(self.values, index, order=1, mode="constant").max(1))


def find_rim(mesh: Mesh) -> Rim | None:
    """Find where a vessel can be grasped by its wall; None if the object is no vessel or leaves no room for a finger.

    Places are those where fingers reach farthest down, one every 10 degrees. The best is in the middle of the longest stretch
    of such places, far from a handle.

    Args:
        mesh: Closed surface, body frame, standing on z = 0, m.
    """
    low = mesh.vertices[:, :2].min(0) - 3 * CELL_M
    heights = heights_from_above(mesh, low, mesh.vertices[:, :2].max(0) + 3 * CELL_M)
    depth = water_depth(heights)
    labels, count = ndimage.label(depth > 0.5 * _CAVITY)
    if count == 0:
        return None
    largest = labels == 1 + int(np.argmax(ndimage.sum_labels(depth, labels, np.arange(1, count + 1))))
    if depth[largest].max() < _CAVITY:
        return None
    middle = low + CELL_M * np.array(ndimage.center_of_mass(largest))
    grid = _Heights(heights, low + 0.37 * CELL_M)
    level = float((heights + depth)[largest].max())
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    found = [_best_across(grid, middle, angle, level) for angle in angles]
    deepest = max((rim.depth for rim in found if rim is not None), default=0.0)
    good = np.array([rim is not None and rim.depth == deepest for rim in found])
    if not good.any():
        return None
    first = _middle_of_longest_run(good)
    # Take every second direction, without the ends of a stretch, beside which something is in the way.
    firm = ndimage.binary_erosion(good, np.ones(3, bool)) if not good.all() else good
    chosen = [found[first], *(found[k] for k in range(first % 2, _DIRECTIONS, 2) if k != first and firm[k])]
    best = found[first]
    assert best is not None  # it is one of the good ones
    alike = [rim for rim in chosen if rim is not None and rim.thickness < best.thickness + _ALIKE]
    alike = [rim for rim in alike if abs(rim.height - best.height) < _ALIKE]
    places = tuple(place for rim in alike for place in rim.places)
    return Rim(places, max(rim.thickness for rim in alike), best.height, best.depth)


def _best_across(grid: _Heights, middle: Array, angle: float, level: float) -> Rim | None:
    """Best grasp of the wall in one direction: the deepest possible, and among those the one where the wall is thinnest."""
    best: Rim | None = None
    away = np.arange(0.0, CELL_M * (sum(grid.values.shape) + 60), 0.5 * CELL_M)
    walls = grid.along(middle, angle, away, 0.0)
    inside = np.flatnonzero(walls > level - _DEPTHS[-1])
    if len(inside) == 0:
        return None
    place = middle + away[inside[0]] * np.array([np.cos(angle), np.sin(angle)])
    for turned in angle + _SKEW:
        for depth in _DEPTHS:
            rim = _across(grid, place, float(turned), depth)
            if rim is not None:
                if best is None or (rim.depth, -rim.thickness) > (best.depth, -best.thickness + CELL_M):
                    best = rim
                break
    return best


def _across(grid: _Heights, place: Array, angle: float, depth: float) -> Rim | None:
    """Grasp across the wall at a place, in one direction, with fingertips `depth` below its rim; None if that is impossible."""
    away = np.arange(-2 * _THICK, 2 * _THICK, 0.5 * CELL_M)
    wall = grid.along(place, angle, away, _PAD)
    near = np.abs(away) < _THICK
    height = float(wall[near].max())
    there = np.flatnonzero((wall > height - depth) & near)
    first, last = int(there[0]), int(there[-1])
    # Across its thickness the wall must have no gap, and it must end on both sides.
    if np.any(wall[first : last + 1] <= height - depth) or away[last] - away[first] > _THICK:
        return None
    if max(wall[first - 1], wall[last + 1]) > height - depth:
        return None
    inner, outer = float(away[first]), float(away[last])
    reach = np.arange(_FINGER[0], _FINGER[1], CELL_M)
    room = grid.along(place, angle, np.concatenate([inner - reach, outer + reach]), _PAD + _BESIDE)
    if room.max() > height - depth - _BOTTOM:
        return None
    x, y = place + 0.5 * (inner + outer) * np.array([np.cos(angle), np.sin(angle)])
    return Rim(((float(x), float(y), angle),), outer - inner + 0.5 * CELL_M, height, depth)


def _middle_of_longest_run(good: Array) -> int:
    """Index in the middle of the longest run of True on a circle. [N] bool, any True."""
    if good.all():
        return 0
    start = int(np.flatnonzero(~good)[0])
    turned = np.roll(good, -start)
    labels, count = ndimage.label(turned)
    sizes = ndimage.sum_labels(turned, labels, np.arange(1, count + 1))
    run = np.flatnonzero(labels == 1 + int(np.argmax(sizes)))
    return int((run[len(run) // 2] + start) % len(good))
