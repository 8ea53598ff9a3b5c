"""The replay buffer: a ring of states that holds each frame once.

A slot holds one state. The transition that starts in it ends in the next slot, so that an episode of T steps takes T + 1 slots
and its pictures are stored once. The last state of an episode starts no transition. After a **termination**, the target
contains no value of the next state. After a **truncation** it does: the last state is stored, and its value is used like any
other.
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsbridge.environment.env import PROPRIO
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.policy.observation import POSITION, PRIVILEGED, TrainingState
from gsbridge.sim.actions import SIZE


@dataclass(frozen=True)
class Batch:
    """Transitions; pictures uint8 [B, H, W, 3], all else float32. `next_` marks the state that the step led to.

    Args:
        image, next_image: Pictures before and after the action. [B, H, W, 3] uint8.
        proprio, next_proprio: Proprioception before and after the action. [B, 12].
        privileged, next_privileged: Privileged vectors before and after the action. [B, 30].
        base, next_base: The controller's actions. [B, 5].
        position: Label of the auxiliary head. [B, 3].
        action: The action taken. [B, 5].
        reward: Reward for the action. [B].
        terminated: 1 if the task ended the episode, else 0. [B].
    """

    image: Tensor
    next_image: Tensor
    proprio: Tensor
    next_proprio: Tensor
    privileged: Tensor
    next_privileged: Tensor
    base: Tensor
    next_base: Tensor
    position: Tensor
    action: Tensor
    reward: Tensor
    terminated: Tensor

    def to(self, device: str) -> Batch:
        """Return this batch on a device of torch."""
        return Batch(**{name: value.to(device) for name, value in vars(self).items()})


class Replay:
    """Replay buffer of transitions; see the module.

    Args:
        capacity: Number of slots.
        image_size: Edge of the pictures, px.
    """

    def __init__(self, capacity: int, image_size: int) -> None:
        self.capacity, self.image_size = capacity, image_size
        self._arrays: dict[str, Array] = {
            "image": np.zeros((capacity, image_size, image_size, 3), np.uint8),
            "proprio": np.zeros((capacity, PROPRIO), np.float32),
            "privileged": np.zeros((capacity, PRIVILEGED), np.float32),
            "base": np.zeros((capacity, SIZE), np.float32),
            "position": np.zeros((capacity, POSITION), np.float32),
            "action": np.zeros((capacity, SIZE), np.float32),
            "reward": np.zeros(capacity, np.float32),
            "terminated": np.zeros(capacity, np.float32),
            "starts": np.zeros(capacity, bool),
        }
        self._next, self._filled, self._open = 0, 0, False

    def __len__(self) -> int:
        """Number of transitions that can be drawn."""
        return int(self._arrays["starts"].sum())

    @property
    def nbytes(self) -> int:
        """Memory of a full buffer, bytes."""
        return sum(array.nbytes for array in self._arrays.values())

    def begin(self, state: TrainingState) -> None:
        """Store the first state of an episode."""
        self._store(state)
        self._open = True

    def add(self, action: Array, reward: float, terminated: bool, state: TrainingState, *, ended: bool = False) -> None:
        """Store a step from the state stored last.

        Args:
            action: The action taken. [5].
            reward: Reward for the action.
            terminated: Whether the task ended the episode; False for a truncation.
            state: The state that the action led to.
            ended: Whether the episode is over, in either way; the next call must then be `begin`.

        Raises:
            ValueError: No episode has begun.
        """
        if not self._open:
            raise ValueError("no episode has begun")
        arrays, here = self._arrays, (self._next - 1) % self.capacity
        self._store(state)
        arrays["action"][here], arrays["reward"][here], arrays["terminated"][here] = action, reward, terminated
        arrays["starts"][here] = True
        self._open = not (ended or terminated)

    def sample(self, count: int, rng: np.random.Generator) -> Batch:
        """Draw transitions uniformly, with repetition.

        Args:
            count: Number of transitions, B.
            rng: Random generator.

        Raises:
            ValueError: The buffer holds no transition.
        """
        choices = np.flatnonzero(self._arrays["starts"])
        if len(choices) == 0:
            raise ValueError("the replay buffer holds no transition")
        at = choices[rng.integers(len(choices), size=count)]
        then = (at + 1) % self.capacity
        here = {name: torch.from_numpy(array[at]) for name, array in self._arrays.items() if name != "starts"}
        later = {
            f"next_{name}": torch.from_numpy(self._arrays[name][then]) for name in ("image", "proprio", "privileged", "base")
        }
        return Batch(**here, **later)

    def save(self, path: str | Path) -> None:
        """Write all that is stored, exactly, as `.npz`."""
        arrays: dict[str, Any] = {name: array[: self._filled] for name, array in self._arrays.items()}
        place = np.array([self.capacity, self.image_size, self._next, self._filled, int(self._open)], np.int64)
        with atomic_file(path) as temporary:
            np.savez(temporary, place=place, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Replay:
        """Read what `save` wrote.

        Raises:
            InputError: The file is missing or damaged.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                capacity, image_size, position, filled, opened = (int(value) for value in file["place"])
                out = cls(capacity, image_size)
                for name, array in out._arrays.items():
                    stored = file[name]
                    if stored.shape != (filled, *array.shape[1:]) or stored.dtype != array.dtype:
                        raise ValueError(f"{name} is {stored.dtype} {stored.shape}")
                    array[:filled] = stored
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error) as error:
            raise InputError(path, f"the replay buffer is damaged ({error})", "Delete it and train anew") from error
        out._next, out._filled, out._open = position, filled, bool(opened)
        return out

    def _store(self, state: TrainingState) -> None:
        """Fill the next slot, which discards the transition that started in it."""
        for name in ("image", "proprio", "privileged", "base", "position"):
            self._arrays[name][self._next] = getattr(state, name)
        self._arrays["starts"][self._next] = False
        self._next = (self._next + 1) % self.capacity
        self._filled = max(self._filled, self._next or self.capacity)
