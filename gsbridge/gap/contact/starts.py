"""Initial state of each throw and its uncertainty: replays start from it, and chaos amplifies its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2 as chi2_law
from scipy.stats import f as f_law

from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.geometry import Array, quat_multiply

WINDOW = 0.06
"""Length of the shortest stretch that start speeds are estimated from, s; the body should not touch anything in it."""

LONGEST = 0.25
"""Length of the longest stretch that start speeds are estimated from, s."""

_FEWEST = 6

_LONGER = (1.3, 1.6, 2.0, 2.5, 3.1, 3.8)
"""Multiples of `WINDOW` that are tried one after the other as longer stretches."""

_HALF = 0.6745
"""Standard deviations within which half of a normal distribution lies."""

_ALIKE = 0.75
"""Quantile of the F distribution up to which a parabola counts as describing a longer stretch as well as the first one."""


@dataclass(frozen=True)
class Starts:
    """Initial states of N throws in the log's frame.

    Args:
        position: First position of each throw, m. [N, 3].
        quat: First orientation of each throw, wxyz. [N, 4].
        velocity: First velocity of each throw, m/s. [N, 3].
        spin: First angular velocity of each throw, rad/s. [N, 3].
        logged: Whether speeds come from the log instead of from the poses.
    """

    position: Array
    quat: Array
    velocity: Array
    spin: Array
    logged: bool

    def shifted(self, noise: ThrowNoise, rng: np.random.Generator) -> Starts:
        """Draw other possible initial states, with the noise of the known ones."""
        draw = [rng.standard_normal(self.position.shape) for _ in range(4)]
        return Starts(
            self.position + noise.position * draw[0],
            quat_multiply(quat_from_turn(noise.angle * draw[1]), self.quat),
            self.velocity + noise.velocity * noise.shares[0][: len(draw[2]), None] * draw[2],
            self.spin + noise.spin * noise.shares[1][: len(draw[3]), None] * draw[3],
            self.logged,
        )


@dataclass(frozen=True)
class ThrowNoise:
    """Measurement noise of throws.

    Args:
        position: Standard deviation of one component of a position, m.
        angle: Standard deviation of one component of an attitude, rad.
        velocity: Standard deviation of one component of a start velocity, root mean square over the throws, m/s.
        spin: Standard deviation of one component of a start spin, root mean square over the throws, rad/s.
        shares: Factors from `velocity` and `spin` to the standard deviations of each throw. Each [N].
        logged: Whether speeds come from the log.
    """

    position: float
    angle: float
    velocity: float
    spin: float
    shares: tuple[Array, Array]
    logged: bool = False


def quat_from_turn(turn: Array) -> Array:
    """Convert rotation vectors, rad, to quaternions wxyz. [..., 3] -> [..., 4]."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * turn * np.sinc(half / np.pi)], axis=-1)


def turn_between(quats: Array, reference: Array) -> Array:
    """Return the rotation vectors, outer frame, rad, that turn `reference` into `quats`. [T, 4], [4] or [T, 4] -> [T, 3]."""
    change = quat_multiply(quats, np.broadcast_to(reference * np.array([1.0, -1.0, -1.0, -1.0]), quats.shape))
    change = np.where(change[..., :1] < 0, -change, change)
    sine = np.linalg.norm(change[..., 1:], axis=-1, keepdims=True)
    return 2.0 * change[..., 1:] * np.arctan2(sine, change[..., :1]) / np.maximum(sine, 1e-15)


def starts_of(throws: Throws) -> tuple[Starts, ThrowNoise]:
    """Return the initial states of throws, and their noise.

    Speeds are the logged ones if all throws have them, otherwise those of a parabola through the poses of the first stretch.
    The residual of the parabola gives the noise of the poses, since only gravity bends that stretch.
    """
    fits = [parabolas(throw) for throw in throws.items]
    position, quat = (np.stack([getattr(throw, key)[0] for throw in throws.items]) for key in ("position", "quat"))
    speeds, spins = np.stack([fit.speed for fit in fits]), np.stack([fit.spin for fit in fits])
    # Use medians, since a few throws may touch something in the first stretch.
    of_position = float(np.sqrt(np.median([fit.squares[0] for fit in fits])))
    of_angle = float(np.sqrt(np.median([fit.squares[1] for fit in fits])))
    # Throws fly for different times and so differ in accuracy; the root mean square describes the scatter of all of them.
    gain, turning = (float(np.sqrt(np.mean([getattr(fit, key) ** 2 for fit in fits]))) for key in ("gain", "turning"))
    shares = np.array([fit.gain for fit in fits]) / gain, np.array([fit.turning for fit in fits]) / turning
    noise = ThrowNoise(of_position, of_angle, gain * of_position, turning * of_angle, shares)
    logged = all(throw.velocity is not None and throw.spin is not None for throw in throws.items)
    if logged:
        given = [np.stack([getattr(throw, key) for throw in throws.items]) for key in ("velocity", "spin")]
        apart = [a - b for a, b in zip(given, (speeds, spins), strict=True)]
        known = [of_position * shares[0] * gain, of_angle * shares[1] * turning]
        rest = [_beyond(values, spread) for values, spread in zip(apart, known, strict=True)]
        noise = ThrowNoise(of_position, of_angle, rest[0], rest[1], (np.ones(len(fits)), np.ones(len(fits))), logged=True)
        speeds, spins = given
    return Starts(position, quat, speeds, spins, logged), noise


def pooled_speeds(noises: Sequence[ThrowNoise]) -> list[ThrowNoise]:
    """Give several sets of throws the same noise of logged speeds: a small set alone determines it badly, or not at all."""
    if not all(noise.logged for noise in noises):
        return list(noises)
    velocity, spin = (float(np.sqrt(np.mean([getattr(noise, key) ** 2 for noise in noises]))) for key in ("velocity", "spin"))
    return [replace(noise, velocity=velocity, spin=spin) for noise in noises]


def _beyond(apart: Array, known: Array) -> float:
    """Estimate the standard deviation of logged speeds from their differences to the speeds of the poses.

    Args:
        apart: Differences, component by component. [N, 3].
        known: Standard deviations of the poses' speeds. [N].

    Returns:
        Standard deviation in the unit of the speeds; zero if the noise of the poses alone explains the differences.
    """
    # Poses determine speeds best in long flights; the noise of short ones would hide that of the logged speeds.
    best = known <= np.median(known)
    sizes, spread = np.abs(apart - np.median(apart, axis=0))[best], known[best, None]

    def beyond(noise: float) -> float:
        return float(np.median(sizes / np.maximum(np.hypot(noise, spread), 1e-12))) - _HALF

    return 0.0 if beyond(0.0) <= 0.0 else float(brentq(beyond, 0.0, 10.0 * float(sizes.max())))


@dataclass(frozen=True)
class Parabolas:
    """Motion of a throw at its first sample, from parabolas through its first stretch.

    Args:
        speed: Velocity, m/s. [3].
        spin: Angular velocity, rad/s. [3].
        acceleration: Acceleration, m/s2. [3].
        squares: Noise variances of positions, m2, and of attitudes, rad2, from the residuals.
        gain: Standard deviation of a velocity per standard deviation of a position, 1/s.
        turning: Standard deviation of an angular velocity per standard deviation of an attitude, 1/s.
    """

    speed: Array
    spin: Array
    acceleration: Array
    squares: tuple[float, float]
    gain: float
    turning: float


def parabolas(throw: Throw) -> Parabolas:
    """Estimate a throw's initial motion from its poses alone, over the longest stretch that a parabola fits within the noise.

    A longer stretch determines speeds far better; the body's first touch, or a precessing spin, ends it.
    """
    places, turns = throw.position, turn_between(throw.quat, throw.quat[0])
    fits = [_longest(throw.time, values) for values in (places, turns)]
    (place, here, gain), (turn, there, turning) = fits
    # All rotation vectors are relative to the first sample and share its noise; the parabola's constant term absorbs that.
    return Parabolas(place[1], turn[1], place[2], (here, there), gain, turning)


def _longest(time: Array, values: Array) -> tuple[Array, float, float]:
    """Fit a parabola to the longest stretch that one describes.

    Args:
        time: Times of the samples, s. [T].
        values: Positions, m, or rotation vectors, rad. [T, 3].

    Returns:
        Its coefficients [3, 3], the noise variance from the first stretch, and the standard deviation of the slope per
        standard deviation of a sample, 1/s.
    """
    count = max(_FEWEST, int(np.searchsorted(time, WINDOW)))
    first = _parabola(time[:count], values[:count])
    kept, last = first, first
    for more in _LONGER:
        longer = int(np.searchsorted(time, more * WINDOW))
        if longer <= count or time[longer - 1] > LONGEST:
            continue
        tried = _parabola(time[:longer], values[:longer])
        if tried[1] > first[1] * f_law.ppf(_ALIKE, 3 * (longer - 3), 3 * (count - 3)):
            break
        # Keep the stretch before the longest one that passes: a touch changes the slope before it shows in the residual.
        kept, last = last, tried
    # The caller takes medians over throws: divide by the ratio of median to mean of a chi squared distribution.
    freedom = 3.0 * (count - 3)
    return kept[0], first[1] * freedom / float(chi2_law.median(freedom)), kept[2]


def _parabola(time: Array, values: Array) -> tuple[Array, float, float]:
    """Fit a parabola; return coefficients [3, 3], residual variance, and the slope's deviation per sample's. [T], [T, 3]."""
    rows = np.stack([np.ones_like(time), time, 0.5 * time**2], axis=1)
    inverse = np.linalg.pinv(rows)
    fit = inverse @ values
    left = float(((values - rows @ fit) ** 2).sum() / (3.0 * (len(time) - 3)))
    return fit, left, float(np.sqrt((inverse[1] ** 2).sum()))
