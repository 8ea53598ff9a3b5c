"""Judgement of a state by a task: reward, success, and the reason for failure if the episode ended now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gsbridge.geometry import Array


class Failure(StrEnum):
    """Why an episode is no success; `none` for a success. The values are the words in the tables of trials."""

    NONE = "none"
    NOT_FINITE = "not_finite"
    """The world broke down: its state is not finite."""
    NOT_GRASPED = "not_grasped"
    """The two pads never held the object between them."""
    NOT_LIFTED = "not_lifted"
    """It was held, but never came off the table."""
    DROPPED = "dropped"
    """It was lifted and then lost."""
    TIME_OUT = "time_out"
    """Time ran out before the task was done, though nothing had gone wrong."""
    PUSHED_AWAY = "pushed_away"
    """It left the area in which the robot can work."""
    NOT_RELEASED = "not_released"
    """It lies on the plate, still held."""
    MISSED_PLATE = "missed_plate"
    """It was set down beside the plate."""
    EXCESS_CONTACT = "excess_contact"
    """The gripper touched plate or table while placing, or the carried object was pressed on them."""


@dataclass(frozen=True)
class Progress:
    """Memory of a task about an episode, per world; everything else is read off the state.

    Args:
        streak: Steps in a row in which the goal was met. int [N].
        gripped: Both pads have held the object. bool [N].
        lifted: The held object has come off the table. bool [N].
        excess: There was excess contact. bool [N].
    """

    streak: Array
    gripped: Array
    lifted: Array
    excess: Array

    def require(self, count: int) -> None:
        """Check that this memory has the given number of worlds.

        Raises:
            ValueError: It has another number.
        """
        if len(self.streak) != count:
            raise ValueError(f"the memory of {len(self.streak)} worlds does not fit {count} states")

    @classmethod
    def start(cls, count: int) -> Progress:
        """Memory at the beginning of an episode, in `count` worlds."""
        return cls(np.zeros(count, dtype=np.int64), *(np.zeros(count, dtype=bool) for _ in range(3)))

    def reset(self, rows: Array) -> Progress:
        """A copy in which some worlds are at the beginning of a new episode. rows: bool or int [N]."""
        values = {name: getattr(self, name).copy() for name in ("streak", "gripped", "lifted", "excess")}
        for value in values.values():
            value[rows] = 0
        return replace(self, **values)


@dataclass(frozen=True)
class Outcome:
    """Judgement of one step, per world.

    Args:
        reward: Sparse: 1 in the step of success, otherwise 0. [N].
        success: The task is done by all its rules. bool [N].
        success_tolerant: Success without the rule on excess contact; it ends the episode. bool [N].
        failure: `Failure` if the episode ended now. str [N].
        terms: Quantities that the judgement rests on, for records and plots. Each [N].
    """

    reward: Array
    success: Array
    success_tolerant: Array
    failure: Array
    terms: Mapping[str, Array]


REASONS = tuple(Failure)
_TEXTS = np.array([reason.value for reason in REASONS])


def texts(codes: Array) -> Array:
    """Return the reasons as text, for their indices in `REASONS`. int [N] -> str [N]."""
    return _TEXTS[codes]
