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
    """Several environments, one process each. Every episode has its own seed, whichever environment plays it.

    Args:
        makers: Functions that make one environment each; all environments are alike.
    """

    def __init__(self, makers: Sequence[Callable[[], gymnasium.Env]]) -> None:
        # Forked, since the main module of a job is a script, which a fresh interpreter would run a second time.
        alone = [partial(_undisturbed, maker) for maker in makers]
        self._vector = AsyncVectorEnv(alone, autoreset_mode=AutoresetMode.DISABLED, context="fork")
        self._processes = [psutil.Process(process.pid) for process in self._vector.processes]

    def __len__(self) -> int:
        """Number of environments."""
        return int(self._vector.num_envs)

    def begin(self, seeds: Mapping[int, int]) -> dict[int, Seen]:
        """Begin episodes in some environments.

        Args:
            seeds: Seeds of the episodes, by number of the environment.

        Returns:
            Observation and `info` of each first state, by number of the environment.
        """
        chosen = np.array([number in seeds for number in range(len(self))])
        listed = [seeds.get(number) for number in range(len(self))]
        observations, infos = self._vector.reset(seed=listed, options={"reset_mask": chosen})
        return {number: _one(observations, infos, number) for number in seeds}

    def step(self, actions: Array) -> list[tuple[Seen, float, bool, bool]]:
        """Take a step in all environments.

        Args:
            actions: Action of each environment. [N, 5].

        Returns:
            For each environment: observation and `info`, the reward, and whether the episode is terminated or truncated.
        """
        observations, rewards, terminated, truncated, infos = self._vector.step(actions)
        return [
            (_one(observations, infos, number), float(rewards[number]), bool(terminated[number]), bool(truncated[number]))
            for number in range(len(self))
        ]

    def cpu_seconds(self) -> float:
        """Return the CPU time that the environments' processes have used so far, s."""
        return sum(times.user + times.system for times in (process.cpu_times() for process in self._processes))

    def close(self) -> None:
        """End the processes, including those that are in the middle of a step or have ended already."""
        for process in self._vector.processes:
            process.terminate()
        for process in self._vector.processes:
            process.join()
        self._vector.closed = True


def _undisturbed(maker: Callable[[], gymnasium.Env]) -> gymnasium.Env:
    """Make an environment whose process ignores Ctrl-C; its parent handles that and ends the process."""
    if multiprocessing.parent_process() is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return maker()


def _one(observations: Mapping[str, Array], infos: Mapping[str, Any], number: int) -> Seen:
    """Copy the observation and `info` of one environment: the vector draws its next pictures into the same memory."""
    return {name: np.array(values[number]) for name, values in observations.items()}, _row(infos, number)


def _row(table: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Select one environment's entries of gymnasium's `info` table, without the columns that say who has an entry."""
    return {
        name: _row(values, number) if isinstance(values, Mapping) else values[number]
        for name, values in table.items()
        if not name.startswith("_")
    }
