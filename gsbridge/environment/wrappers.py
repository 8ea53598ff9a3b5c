"""Disturbances around an environment: image noise and jitter, late and lost actions. All draw from the episode's seed.

Every wrapper has its own generator, seeded anew by `reset(seed=...)`; without a seed it goes on, so that a run of episodes from
one seed is repeatable as a whole. With strength zero a wrapper changes nothing, bit by bit.

Source: RL-GSBridge trains on images with random attributes ("image augmentation") to bridge the gap of light and camera.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.sim.actions import checked_action

_HUE = np.array([[0.299, 0.587, 0.114]])
"""Weights of brightness in RGB (ITU-R BT.601)."""


class _Seeded(gymnasium.Wrapper):
    """A wrapper with a generator of its own; `stream` keeps those of stacked wrappers apart."""

    stream = 0

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.rng = np.random.default_rng([self.stream, 0])

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; a seed seeds the disturbances, too."""
        if seed is not None:
            self.rng = np.random.default_rng([self.stream, seed])
        observation, info = self.env.reset(seed=seed, options=options)
        self.begin()
        return self.seen(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Pass the disturbed action on and disturb what is seen."""
        observation, reward, terminated, truncated, info = self.env.step(self.done(action))
        return self.seen(observation), reward, terminated, truncated, info

    def begin(self) -> None:
        """What an episode draws once."""

    def seen(self, observation: dict[str, Array]) -> dict[str, Array]:
        """The observation that is handed on."""
        return observation

    def done(self, action: Array) -> Array:
        """The action that is carried out."""
        return action


class ImageNoise(_Seeded):
    """Normally distributed noise on every value of the image.

    Args:
        env: Environment with an `image` in its observation.
        sigma: Standard deviation, levels of 255.
    """

    stream = 1

    def __init__(self, env: gymnasium.Env, sigma: float = 5.0) -> None:
        super().__init__(env)
        self.sigma = _within("image noise", sigma, 0.0, 255.0)

    def seen(self, observation: dict[str, Array]) -> dict[str, Array]:
        """See `_Seeded`."""
        if self.sigma == 0:
            return observation
        image = observation["image"]
        noise = self.rng.standard_normal(image.shape, dtype=np.float32)
        return {**observation, "image": _bytes(image + np.float32(self.sigma) * noise)}


@dataclass(frozen=True)
class Jitter:
    """Ranges of random image attributes; 0 leaves an attribute alone.

    Args:
        brightness, contrast, saturation: Factors are drawn from 1 - value to 1 + value.
        tint: Each channel's factor is drawn from 1 - value to 1 + value.
        hue_deg: Turn of the colours about grey, from -value to value.
        shift_px: Shift of the picture along each axis, from -value to value, whole px; its edge is repeated.
    """

    brightness: float = 0.3
    contrast: float = 0.3
    saturation: float = 0.3
    tint: float = 0.1
    hue_deg: float = 10.0
    shift_px: int = 0

    def __post_init__(self) -> None:
        for name in ("brightness", "contrast", "saturation", "tint"):
            _within(f"jitter: {name}", getattr(self, name), 0.0, 0.95)
        _within("jitter: hue_deg", self.hue_deg, 0.0, 180.0)
        _within("jitter: shift_px", self.shift_px, 0, 16)


def jitter_matrix(jitter: Jitter, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw colour attributes: one 3x3 matrix and an offset do them all, on values 0..255.

    Returns:
        `out = matrix @ rgb + offset`. [3, 3], [3].
    """
    brightness, contrast, saturation = 1.0 + rng.uniform(-1, 1, 3) * [jitter.brightness, jitter.contrast, jitter.saturation]
    tint = 1.0 + rng.uniform(-jitter.tint, jitter.tint, 3)
    angle = np.deg2rad(rng.uniform(-jitter.hue_deg, jitter.hue_deg))
    grey = np.repeat(_HUE, 3, axis=0)
    axis = np.full(3, 1 / np.sqrt(3))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    # Rodrigues' formula: a turn about the grey diagonal of the colour cube.
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    colours = turn @ (saturation * np.eye(3) + (1 - saturation) * grey)
    return brightness * contrast * np.diag(tint) @ colours, np.full(3, 127.5 * (1 - contrast))


class ImageJitter(_Seeded):
    """Random attributes of the image: brightness, contrast, saturation, tint, hue, shift.

    Args:
        env: Environment with an `image` in its observation.
        jitter: Ranges.
        each_step: Draw anew for every image; otherwise once for an episode, as light and camera are.
    """

    stream = 2

    def __init__(self, env: gymnasium.Env, jitter: Jitter | None = None, *, each_step: bool = False) -> None:
        super().__init__(env)
        self.jitter, self.each_step = jitter or Jitter(), each_step
        self.begin()

    def begin(self) -> None:
        """See `_Seeded`."""
        self._matrix, self._offset = jitter_matrix(self.jitter, self.rng)
        limit = self.jitter.shift_px
        self._shift = self.rng.integers(-limit, limit + 1, 2)

    def seen(self, observation: dict[str, Array]) -> dict[str, Array]:
        """See `_Seeded`."""
        if self.each_step:
            self.begin()
        image = observation["image"].astype(np.float32)
        image = image @ self._matrix.T.astype(np.float32) + self._offset.astype(np.float32)
        if self._shift.any():
            rows = np.clip(np.arange(image.shape[0]) - self._shift[0], 0, image.shape[0] - 1)
            columns = np.clip(np.arange(image.shape[1]) - self._shift[1], 0, image.shape[1] - 1)
            image = image[rows[:, None], columns]
        return {**observation, "image": _bytes(image)}


class ActionLatency(_Seeded):
    """Actions that act some steps late; until the first arrives, the arm gets none (zeros).

    Args:
        env: Environment.
        steps: Fewest and most steps of delay; drawn once per episode.
    """

    stream = 3

    def __init__(self, env: gymnasium.Env, steps: tuple[int, int] = (0, 1)) -> None:
        super().__init__(env)
        self.steps = (int(_within("latency", steps[0], 0, 20)), int(_within("latency", steps[1], steps[0], 20)))
        self.begin()

    def begin(self) -> None:
        """See `_Seeded`."""
        delay = int(self.rng.integers(self.steps[0], self.steps[1] + 1))
        self._waiting = deque([np.zeros(self.action_space.shape, self.action_space.dtype)] * delay)

    def done(self, action: Array) -> Array:
        """See `_Seeded`."""
        checked_action(action)  # now, while it can be told whose it was
        # A copy, because the caller may write its next action into the same array.
        self._waiting.append(np.array(action))
        return self._waiting.popleft()


class DroppedActions(_Seeded):
    """Actions that are lost with a probability; the arm then holds its last command (a step of zeros).

    Args:
        env: Environment.
        probability: Of losing an action, 0 to 1.
    """

    stream = 4

    def __init__(self, env: gymnasium.Env, probability: float = 0.1) -> None:
        super().__init__(env)
        self.probability = _within("dropped actions", probability, 0.0, 1.0)
        self.dropped = 0

    def begin(self) -> None:
        """See `_Seeded`."""
        self.dropped = 0

    def done(self, action: Array) -> Array:
        """See `_Seeded`."""
        checked_action(action)  # a lost one, too
        # Drawn even where it cannot matter, so that every probability sees the same sequence.
        if self.rng.random() >= self.probability:
            return action
        self.dropped += 1
        return np.zeros_like(action)


def _bytes(image: Array) -> Array:
    """Clamp and round to 8 bits, so that nothing wraps around."""
    return np.rint(np.clip(image, 0.0, 255.0)).astype(np.uint8)


def _within(name: str, value: float, low: float, high: float) -> float:
    """A number within bounds.

    Raises:
        InputError: It is not.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not low <= value <= high:
        raise InputError(name, f"{value!r} is out of range", f"Give {low:g} to {high:g}")
    return value
