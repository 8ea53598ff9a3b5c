"""A baseline controller that is wrong on purpose: what a policy learns from it shows what reinforcement adds to imitation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.geometry import Array
from gsbridge.tasks.state import State


@dataclass(frozen=True)
class BiasedController:
    """Takes the object for one that stands elsewhere.

    Args:
        controller: From states of N worlds to actions [N, 5].
        offset: Where it believes the object to be, from where it is, along x and y of the table, m.
    """

    controller: Callable[[State], Array]
    offset: tuple[float, float]

    def __call__(self, state: State) -> Array:
        """Actions [N, 5]."""
        believed = state.object_position + np.array([*self.offset, 0.0])
        return self.controller(replace(state, object_position=believed))
