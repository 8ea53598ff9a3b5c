"""Noise and paint: non-repeating textures in space and on the plane.

The noises in space are pure functions of points, cell sizes (m) and integer seeds, so they do not depend on the order of
evaluation. `paint_strokes` and `plane_noise` draw from a random generator.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial import cKDTree

from gsbridge.geometry import Array

_PRIMES = tuple(np.uint64(prime) for prime in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))


def _hash(cells: Array, seed: int) -> Array:
    """Return a uniform number 0..1 for each integer cell. [..., 3] int64 -> [...]."""
    with np.errstate(over="ignore"):
        c = cells.astype(np.int64).view(np.uint64)
        return _mixed(c[..., 0] * _PRIMES[0] ^ c[..., 1] * _PRIMES[1] ^ c[..., 2] * _PRIMES[2], seed)


def _mixed(h: Array, seed: int) -> Array:
    """Return a uniform number 0..1 for each cell's integer key. uint64 [...] -> [...].

    Source: the finaliser of SplitMix64 (Steele et al., 2014).
    """
    with np.errstate(over="ignore"):
        h = h ^ np.uint64(seed * 0x2545F4914F6CDD1D % (1 << 64))
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return (h >> np.uint64(11)).astype(np.float64) / float(1 << 53)


def _turned(points: Array, cell: float, seed: int) -> Array:
    """Return points in units of the cell, turned at random so that the lattice is not aligned with a face. [..., 3]."""
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.asarray(points, dtype=np.float64) @ rotation.T / cell + 1000.0


def value_noise(points: Array, cell: float, seed: int) -> Array:
    """Return smooth noise in -1..1.

    Args:
        points: Points, m. [N, 3].
        cell: Size of the noise's features, m.
        seed: Random seed.

    Returns:
        Noise at each point. [N].
    """
    p = _turned(points, cell, seed)
    corner = np.floor(p).astype(np.int64)
    f = p - corner
    f = f * f * (3 - 2 * f)
    # Each axis has two weights and two keys; the eight corners of a cell combine them.
    weights = [(1 - f[:, k], f[:, k].copy()) for k in range(3)]
    with np.errstate(over="ignore"):
        keys = [[(corner[:, k] + step).view(np.uint64) * _PRIMES[k] for step in range(2)] for k in range(3)]
    total = np.zeros(len(p))
    for i, j, k in np.ndindex(2, 2, 2):
        weight = weights[0][i] * weights[1][j] * weights[2][k]
        total += weight * _mixed(keys[0][i] ^ keys[1][j] ^ keys[2][k], seed)
    return 2 * total - 1


def octaves(points: Array, coarsest: float, count: int, seed: int, fall: float = 0.7) -> Array:
    """Return a sum of noises of different scale, with a standard deviation of about 1.

    Args:
        points: Points, m. [N, 3].
        coarsest: Size of the largest features, m; the features of each further noise are half as large.
        count: Number of noises.
        seed: Random seed.
        fall: Strength of each noise relative to the one before.

    Returns:
        Noise at each point. [N].
    """
    total = np.zeros(len(points))
    power = 0.0
    for level in range(count):
        strength = fall**level
        total += strength * value_noise(points, coarsest / 2**level, seed + 101 * level)
        power += strength**2
    return total / (0.35 * np.sqrt(power))


def cells(points: Array, cell: float, seed: int) -> tuple[Array, Array, Array]:
    """Evaluate Voronoi cells around one random point per lattice cell.

    Args:
        points: Points, m. [N, 3].
        cell: Spacing of the lattice, m.
        seed: Random seed.

    Returns:
        Distances to the nearest and second nearest random point, in units of `cell`, and a random number 0..1 that belongs to
        the nearest. [N] each.

    Source: Worley, "A cellular texture basis function", SIGGRAPH 1996.
    """
    p = _turned(points, cell, seed)
    corner = np.floor(p).astype(np.int64)
    nearest = np.full(len(p), np.inf)
    second = np.full(len(p), np.inf)
    name = np.zeros(len(p))
    for offset in np.ndindex(3, 3, 3):
        c = corner + np.array(offset) - 1
        spot = c + np.stack([_hash(c, seed + 1), _hash(c, seed + 2), _hash(c, seed + 3)], axis=-1)
        distance = np.linalg.norm(p - spot, axis=-1)
        closer = distance < nearest
        second = np.where(closer, nearest, np.minimum(second, distance))
        name = np.where(closer, _hash(c, seed + 4), name)
        nearest = np.where(closer, distance, nearest)
    return nearest, second, name


def pick(palette: Sequence[Sequence[float]], name: Array) -> Array:
    """Pick a colour of the palette for each number 0..1. [N] -> [N, 3]."""
    table = np.asarray(palette, dtype=np.float64)
    return table[np.minimum((name * len(table)).astype(int), len(table) - 1)]


def blend(below: Array, above: Array | Sequence[float], weight: Array) -> Array:
    """Paint one colour over another.

    Args:
        below: Colours below. [N, 3].
        above: Colours above, or one for all points. [N, 3] or [3].
        weight: Share of `above` in the result, cut to 0..1. [N].

    Returns:
        Blended colours. [N, 3].
    """
    w = np.clip(weight, 0, 1)[..., None]
    return below * (1 - w) + np.asarray(above) * w


def step(value: Array, edge: Array | float, width: float) -> Array:
    """Return a smooth step from 0 to 1.

    Args:
        value: Values. [...].
        edge: Value at which the step reaches one half. [...], or one for all.
        width: Range of values over which the step rises.
    """
    t = np.clip((value - edge) / width + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


def paint_strokes(
    colours: Array,
    vertices: Array,
    normals: Array,
    *,
    count: int,
    length: tuple[float, float],
    width: tuple[float, float],
    palette: Sequence[Sequence[float]],
    rng: np.random.Generator,
    where: Array | None = None,
) -> Array:
    """Paint short straight strokes (sprinkles, scratches) on a dense mesh.

    Args:
        colours: Vertex colours. [N, 3].
        vertices, normals: Vertices, m, and vertex normals. [N, 3] each.
        count: Number of strokes.
        length, width: Ranges of the strokes' length and width, m.
        palette: Colours to draw from.
        rng: Random numbers.
        where: Vertices that may be the middle of a stroke; None for all. [N] bool.

    Returns:
        New colours. [N, 3].
    """
    out = colours.copy()
    tree = cKDTree(vertices)
    places = np.arange(len(vertices)) if where is None else np.flatnonzero(where)
    for middle in rng.choice(places, count):
        reach, half_width = rng.uniform(*length) / 2, rng.uniform(*width) / 2
        way = np.cross(normals[middle], rng.normal(size=3))
        way /= max(float(np.linalg.norm(way)), 1e-12)
        near = np.array(tree.query_ball_point(vertices[middle], reach + 2 * half_width), dtype=int)
        away = vertices[near] - vertices[middle]
        along = np.clip(away @ way, -reach, reach)
        distance = np.linalg.norm(away - along[:, None] * way, axis=1)
        colour = np.asarray(palette)[rng.integers(len(palette))]
        out[near] = blend(out[near], colour, 1 - step(distance, half_width, 1.2e-3))
    return out


def plane_noise(shape: tuple[int, int], sigma: float, rng: np.random.Generator) -> Array:
    """Return Gaussian noise of unit variance, smoothed over `sigma` pixels. [H, W] float32.

    Args:
        shape: H and W.
        sigma: Standard deviation of the smoothing Gaussian, px; 0 for white noise.
        rng: Random numbers.
    """
    if sigma > 8:  # broad noise is drawn coarse and enlarged: the same look at a fraction of the work
        factor = int(sigma // 4)
        small = plane_noise((shape[0] // factor + 8, shape[1] // factor + 8), sigma / factor, rng)
        large: Array = cv2.resize(small, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        return large[: shape[0], : shape[1]]
    noise: Array = rng.standard_normal(shape, dtype=np.float32)
    if sigma > 0:
        noise = cv2.GaussianBlur(noise, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    return noise / noise.std()
