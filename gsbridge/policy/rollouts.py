"""Episodes in several environments at a time, one process each, so that the actor sees a batch of pictures."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import psutil
from gymnasium.vector import AsyncVectorEnv, AutoresetMode

from gsbridge.geometry import Array

Seen = tuple[dict[str, Array], dict[str, Any]]
"""Observation and `info` of one environment."""


class Rollouts:
    """See the module. Every episode begins with a seed of its own, whichever environment it is played in.

    Args:
        makers: Functions that make one environment each, all alike.
    """

    def __init__(self, makers: Sequence[Callable[[], gymnasium.Env]]) -> None:
        # Forked: the main module of a job is a script, which a fresh interpreter would run a second time.
        alone = [partial(_undisturbed, maker) for maker in makers]
        self._vector = AsyncVectorEnv(alone, autoreset_mode=AutoresetMode.DISABLED, context="fork")
        self._processes = [psutil.Process(process.pid) for process in self._vector.processes]

    def __len__(self) -> int:
        """Environments."""
        return int(self._vector.num_envs)

    def begin(self, seeds: Mapping[int, int]) -> dict[int, Seen]:
        """Begin episodes in some environments.

        Args:
            seeds: Seeds of the episodes, by number of the environment.

        Returns:
            What is seen first, by number.
        """
        chosen = np.array([number in seeds for number in range(len(self))])
        listed = [seeds.get(number) for number in range(len(self))]
        observations, infos = self._vector.reset(seed=listed, options={"reset_mask": chosen})
        return {number: _one(observations, infos, number) for number in seeds}

    def step(self, actions: Array) -> list[tuple[Seen, float, bool, bool]]:
        """A step of all environments.

        Args:
            actions: Action of each environment. [N, 5].

        Returns:
            Of each what is seen, the reward, and whether the episode is terminated or truncated.
        """
        observations, rewards, terminated, truncated, infos = self._vector.step(actions)
        return [
            (_one(observations, infos, number), float(rewards[number]), bool(terminated[number]), bool(truncated[number]))
            for number in range(len(self))
        ]

    def cpu_seconds(self) -> float:
        """CPU seconds of the environments' processes so far, s."""
        return sum(times.user + times.system for times in (process.cpu_times() for process in self._processes))

    def close(self) -> None:
        """End the processes, also those that are in the middle of something or gone."""
        for process in self._vector.processes:
            process.terminate()
        for process in self._vector.processes:
            process.join()
        self._vector.closed = True


def _undisturbed(maker: Callable[[], gymnasium.Env]) -> gymnasium.Env:
    """An environment whose process leaves Ctrl-C to its parent, which ends it."""
    if multiprocessing.parent_process() is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return maker()


def _one(observations: Mapping[str, Array], infos: Mapping[str, Any], number: int) -> Seen:
    """Copy of what one environment saw: the vector draws its next pictures into the same memory."""
    return {name: np.array(values[number]) for name, values in observations.items()}, _row(infos, number)


def _row(table: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Select one environment's entries of gymnasium's `info` table, without the columns that say who has an entry."""
    return {
        name: _row(values, number) if isinstance(values, Mapping) else values[number]
        for name, values in table.items()
        if not name.startswith("_")
    }
