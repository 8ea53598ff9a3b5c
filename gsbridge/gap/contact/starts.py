"""How each throw begins, and how well that is known: a replay starts there, and chaos enlarges what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.geometry import Array, quat_multiply

WINDOW = 0.06
"""Length of the first stretch that start speeds are taken from, s: a body should not touch anything in it."""

_FEWEST = 6


@dataclass(frozen=True)
class Starts:
    """First states of N throws in the log's frame.

    Args:
        position: First position of each throw, m. [N, 3].
        quat: First orientation of each throw, wxyz. [N, 4].
        velocity: First velocity of each throw, m/s. [N, 3].
        spin: First angular velocity of each throw, rad/s. [N, 3].
        acceleration: Acceleration of the first stretch, m/s2. [N, 3].
        logged: Whether speeds come from the log rather than from the poses.
    """

    position: Array
    quat: Array
    velocity: Array
    spin: Array
    acceleration: Array
    logged: bool

    def shifted(self, noise: ThrowNoise, rng: np.random.Generator) -> Starts:
        """First states as they might have been, drawn with the noise with which they are known."""
        draw = [rng.standard_normal(self.position.shape) for _ in range(4)]
        return Starts(
            self.position + noise.position * draw[0],
            quat_multiply(quat_from_turn(noise.angle * draw[1]), self.quat),
            self.velocity + noise.velocity * draw[2],
            self.spin + noise.spin * draw[3],
            self.acceleration,
            self.logged,
        )


@dataclass(frozen=True)
class ThrowNoise:
    """Standard deviations of one component: position (m), angle (rad), start velocity (m/s) and start spin (rad/s)."""

    position: float
    angle: float
    velocity: float
    spin: float


def quat_from_turn(turn: Array) -> Array:
    """Quaternions wxyz of rotation vectors. [..., 3] -> [..., 4]."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * turn * np.sinc(half / np.pi)], axis=-1)


def turn_between(quats: Array, reference: Array) -> Array:
    """Rotation vectors that lead from one attitude to others, in the outer frame. [T, 4], [4] or [T, 4] -> [T, 3]."""
    change = quat_multiply(quats, np.broadcast_to(reference * np.array([1.0, -1.0, -1.0, -1.0]), quats.shape))
    change = np.where(change[..., :1] < 0, -change, change)
    sine = np.linalg.norm(change[..., 1:], axis=-1, keepdims=True)
    return 2.0 * change[..., 1:] * np.arctan2(sine, change[..., :1]) / np.maximum(sine, 1e-15)


def starts_of(throws: Throws) -> tuple[Starts, ThrowNoise]:
    """First states of throws, and their noise.

    Speeds are the logged ones where all throws have them. Otherwise a parabola through the poses of the first stretch gives
    them; it also gives the noise of the poses, since nothing but gravity bends that stretch.
    """
    fits = [parabolas(throw) for throw in throws.items]
    position, quat = (np.stack([getattr(throw, key)[0] for throw in throws.items]) for key in ("position", "quat"))
    speeds, spins = np.stack([fit.speed for fit in fits]), np.stack([fit.spin for fit in fits])
    # Medians: a few throws may touch something in the first stretch.
    of_position = float(np.sqrt(np.median([fit.squares[0] for fit in fits])))
    of_angle = float(np.sqrt(np.median([fit.squares[1] for fit in fits])))
    gain = float(np.median([fit.gain for fit in fits]))
    noise = ThrowNoise(of_position, of_angle, gain * of_position, gain * of_angle)
    logged = all(throw.velocity is not None and throw.spin is not None for throw in throws.items)
    if logged:
        given = [np.stack([getattr(throw, key) for throw in throws.items]) for key in ("velocity", "spin")]
        # How far logged speeds scatter about those of the poses beyond the scatter of the latter.
        apart = [a - b for a, b in zip(given, (speeds, spins), strict=True)]
        spread = [1.4826 * np.median(np.abs(values - np.median(values, axis=0))) for values in apart]
        rest = [np.sqrt(max(s**2 - f**2, 0.0)) for s, f in zip(spread, (noise.velocity, noise.spin), strict=True)]
        noise = ThrowNoise(of_position, of_angle, float(rest[0]), float(rest[1]))
        speeds, spins = given
    acceleration = np.stack([fit.acceleration for fit in fits])
    return Starts(position, quat, speeds, spins, acceleration, logged), noise


@dataclass(frozen=True)
class Parabolas:
    """Parabolas through the first stretch: speeds at its first sample, mean squared residuals, spread of a speed per spread of
    a sample (1/s)."""

    speed: Array
    spin: Array
    acceleration: Array
    squares: tuple[float, float]
    gain: float


def parabolas(throw: Throw) -> Parabolas:
    """Motion of a throw's first stretch, from its poses alone."""
    count = max(_FEWEST, int(np.searchsorted(throw.time, WINDOW)))
    time = throw.time[:count]
    rows = np.stack([np.ones_like(time), time, 0.5 * time**2], axis=1)
    inverse = np.linalg.pinv(rows)
    values = (throw.position[:count], turn_between(throw.quat[:count], throw.quat[0]))
    fits = [inverse @ value for value in values]
    free = 3.0 * (len(time) - 3)
    squares = tuple(float(((value - rows @ fit) ** 2).sum() / free) for value, fit in zip(values, fits, strict=True))
    # Rotation vectors about the first sample carry its noise in all of them, which their constant takes up.
    return Parabolas(fits[0][1], fits[1][1], fits[0][2], squares, float(np.sqrt((inverse[1] ** 2).sum())))  # type: ignore[arg-type]
