"""Baseline controllers: pure functions of the privileged state, for N worlds at once, without memory.

They are the policies' teachers and label states in any order; therefore an action may depend on nothing but the state. What a
phase-based program would remember is inferred from the state instead: an object that both pads press is held; open pads low
around the object are about to close; pads that closed on nothing go up and open again.

Commands are integrated by the environment, and the arm follows with a lag of up to three steps. A step therefore corrects only
the share `GAIN` of an error, which is stable for that lag (see `stable_gain`), and less if commands are delayed further.

Source: the idea of a light controller from RL-GSBridge (SACwB); its hidden counters are not copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.asset.rim import Rim
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.sim.actions import ActionScale
from gsbridge.tasks.rules import Grasp, Place
from gsbridge.tasks.state import State

GAIN = 0.3
"""Share of an error that one step corrects, for an arm without delay."""

LAG = 3.0
"""Control steps by which an arm without delay lags behind its command."""

DESCENT = 2.0 / 3.0
"""Share of `GAIN` used while going down on the object: with a lag of three steps the full gain overshoots."""

APERTURE_GAIN = 0.15
"""Share of an error of the opening that one step corrects, so that fingers of 7.5 mm per step can follow the command."""

HALF_PAD = 0.0325
"""Distance from the tool point down to the fingertips, m."""

LOWEST_GRIP = 0.043
"""Lowest height of the tool point over the object's foot, m: fingertips 10 mm over the table, or over the plate."""

RIM_OPENING = 0.025
"""Opening beyond the thickness of a vessel's wall while approaching it, m; `gsbridge.asset.rim` seeks places with this room."""

SINKING = 0.15
"""Smallest action by which a carried object goes down over the plate, as a share of 1. A policy that imitates the controller
cannot tell smaller ones from rest: policies taught with 0.03 hung 8 to 15 mm above the height of release until the time-out."""


def gain_limit(lag: float) -> float:
    """Return the largest share of an error that a step may correct, if the error is seen `lag` steps late.

    With a larger share k, `e[t + 1] = e[t] - k e[t - lag]` oscillates with growing amplitude; at the limit a root `exp(i w)` of
    its characteristic equation lies on the unit circle, with `w = pi / (2 lag + 1)`.

    Source: Levin and May, A note on difference-delay equations, Theoretical Population Biology 9 (1976).
    """
    return float(2.0 * np.sin(np.pi / (4.0 * lag + 2.0)))


def stable_gain(delay: float) -> float:
    """Return the gain for delayed commands: the same share of the stability limit as `GAIN` is without delay.

    Args:
        delay: Delay of commands, control periods.
    """
    return GAIN * (gain_limit(LAG + delay) / gain_limit(LAG))


@dataclass(frozen=True)
class Grip:
    """How an object is gripped.

    Args:
        centre: Middle of the grip, body frame, m. [3]; z is the tool point's height over the object's foot.
        axes: Directions in the body's x-y plane along which the fingers may close, rad; each also means its opposite.
        width: Extent of the gripped part along the first of the axes, m.
        top: Height of the object, m.
        opening: Opening beyond that width while approaching, m.
        least: Fingers closer together than this share of the width have closed on nothing.
        hover: Height of the fingertips over the object's top while moving sideways, m.
        others: Alternative places: x, y, body frame, m, and the axis there, rad. Of all places, the one nearest to the middle
            of the working area is taken.
    """

    centre: tuple[float, float, float]
    axes: tuple[float, ...]
    width: float
    top: float
    opening: float = 0.045
    least: float = 0.6
    hover: float = 0.012
    others: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if not (self.axes and np.isfinite([*self.centre, *self.axes]).all() and self.width > 0 and self.top > 0):
            raise InputError("grip", f"{self} makes no sense", "Give a centre, an axis, a width and a height in metres")


def grip_of(points: Array, centre: Array | Sequence[float] | None = None, *, tolerance: float = 1.06) -> Grip:
    """Take an object across its narrowest side.

    Args:
        points: Vertices of its hulls, body frame, m. [P, 3].
        centre: Point x, y in the body frame to take it at, m, best its centre of mass; None for the middle of its extent along
            the grip. [2].
        tolerance: Largest ratio of the width along an axis of the grip to the smallest width.

    Returns:
        The grip; z halfway up, but not below `LOWEST_GRIP`.
    """
    points = np.asarray(points, dtype=np.float64)
    angles = np.deg2rad(np.arange(180))
    along = points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    widths = np.ptp(along, axis=0)
    narrow = widths <= tolerance * widths.min()
    # The narrowest direction of every run of good ones, runs across 180 degrees joined; a round object is good all round.
    axes: list[float] = []
    if narrow.all():
        axes = list(angles[::30])
    else:
        first = int(np.flatnonzero(~narrow)[0])
        run: list[int] = []
        for k in range(first, first + len(angles) + 1):
            if narrow[k % 180]:
                run.append(k)
            elif run:
                best = run[int(np.argmin([widths[j % 180] for j in run]))]
                axes.append(float(angles[best % 180]))
                run = []
        axes.sort(key=lambda angle: widths[round(np.rad2deg(angle)) % 180])
    middle = 0.5 * (points[:, :2].min(0) + points[:, :2].max(0)) if centre is None else np.asarray(centre, np.float64)[:2]
    top = float(points[:, 2].max())
    return Grip((float(middle[0]), float(middle[1]), max(0.5 * top, LOWEST_GRIP)), tuple(axes), float(widths.min()), top)


def rim_grip(rim: Rim, top: float) -> Grip:
    """Take a vessel by its wall, one finger inside.

    There is little room inside, so the fingers open less. `least` is small, because photos tell the thickness of a wall only to
    a millimetre or two.

    Args:
        rim: Places on the rim at which the wall can be taken.
        top: Height of the vessel, m.
    """
    height = max(rim.height - rim.depth + HALF_PAD, LOWEST_GRIP)
    (x, y, angle), others = rim.places[0], rim.places[1:]
    # `hover` is larger, since the arm goes on for a step or two, and a fingertip that comes down too early hits the rim.
    return Grip((x, y, height), (angle,), rim.thickness, top, RIM_OPENING, least=0.3, hover=0.030, others=others)


@dataclass(frozen=True)
class ReachController:
    """Relation of tool and object in N worlds; the common part of both controllers.

    Args:
        offset: Horizontal vector from the tool point to the grip's centre, table frame, m. [N, 2].
        turn: Turn from the tool's yaw to the nearest yaw in which the fingers close along an axis of the grip, rad. [N].
        height: Height of the tool point over the grip's centre, m. [N].
        held: Whether both pads press. bool [N].
    """

    offset: Array
    turn: Array
    height: Array
    held: Array


@dataclass(frozen=True)
class GraspController:
    """Take the object from above and lift it.

    Args:
        grip: Height, axes and opening with which the object is taken.
        scale: Motion that an action of 1 stands for.
        lift: Clearance to which the object is lifted, m. It is twice what success asks for: with a smaller margin, a policy
            that imitates the controller imperfectly slows down just below the mark and hangs there until the time-out.
        stroke: Largest opening, m.
        middle: Middle of the area in which the robot works, table frame, m.
        aligned: Largest horizontal error with which the tool may go down, m.
        turned: Largest error in yaw with which the tool may go down, rad.
        firm: Smallest force of each pad with which the object counts as held, N.
        gain: Share of an error that one step corrects.
    """

    grip: Grip
    scale: ActionScale = field(default_factory=ActionScale)
    lift: float = 0.20
    stroke: float = 0.14
    middle: tuple[float, float] = Grasp.area_centre
    aligned: float = 0.006
    turned: float = 0.08
    firm: float = 5.0
    gain: float = GAIN

    def __call__(self, state: State) -> Array:
        """Actions for N worlds. float32 [N, 5], each -1..1."""
        reach = self._reach(state)
        motion, opening = self._approach(state, reach)
        up = np.zeros_like(motion)
        up[:, 2] = self._towards(self.lift - state.object_clearance, self.scale.position)
        return _packed(np.where(reach.held[:, None], up, motion), np.where(reach.held, -1.0, opening))

    def _reach(self, state: State) -> ReachController:
        turn = rotation_from_quat(state.object_quat)
        tool = rotation_from_quat(state.tool_quat)
        point, axes = self._place(state.object_position, turn)
        yaw = np.arctan2(tool[:, 1, 0], tool[:, 0, 0])
        body = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
        # The fingers close along the tool's y, a quarter turn from its yaw, and it does not matter from which side.
        wanted = body[:, None] + axes + 0.5 * np.pi
        inside = (wanted + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        # At the ends of the range of yaw, the opposite direction is as near.
        choices = np.concatenate([inside, inside - np.pi, inside + np.pi], axis=1)
        away = np.where(np.abs(choices) <= 0.5 * np.pi + 0.05, choices - yaw[:, None], np.inf)
        nearest = np.take_along_axis(away, np.abs(away).argmin(1)[:, None], axis=1)[:, 0]
        return ReachController(
            point[:, :2] - state.tool_position[:, :2],
            nearest,
            state.tool_position[:, 2] - (state.object_clearance + self.grip.centre[2]),
            state.gripped(self.firm),
        )

    def _place(self, position: Array, turn: Array) -> tuple[Array, Array]:
        """Return where the object is taken, table frame, m [N, 3], and the axes there, body frame, rad [N, A] or [A].

        Of several places, the one nearest to `middle` is taken: at the far side, fingers would leave the working area.
        """
        first = np.array([*self.grip.centre[:2], 0.0])
        if not self.grip.others:
            return position + turn @ first, np.array(self.grip.axes)
        places = np.concatenate([first[None], [[x, y, 0.0] for x, y, _ in self.grip.others]])
        angles = np.array([self.grip.axes[0], *(angle for _, _, angle in self.grip.others)])
        points = position[:, None] + np.einsum("nij,pj->npi", turn, places)
        best = np.linalg.norm(points[..., :2] - self.middle, axis=-1).argmin(1)
        return np.take_along_axis(points, best[:, None, None], axis=1)[:, 0], angles[best][:, None]

    def _approach(self, state: State, reach: ReachController) -> tuple[Array, Array]:
        """Return motion [N, 4] and opening [N] while nothing is held: over the object, down, close; up after an empty grip."""
        free = min(self.grip.width + self.grip.opening, self.stroke)
        distance = np.hypot(*reach.offset.T)
        hover = max(self.grip.top + HALF_PAD + self.grip.hover - self.grip.centre[2], 0.04)
        low = reach.height < 0.010
        empty = state.aperture < self.grip.least * self.grip.width
        # Pads that go down must clear the object; pads on their way together may already touch it on one side.
        centred = (distance < self.aligned) & (np.abs(reach.turn) < self.turned)
        wide = state.aperture > free - 0.015
        closing = low & (distance < 0.02) & ~empty
        down = (centred & wide) | ((reach.height < hover - 0.015) & (distance < 2 * self.aligned) & ~empty)
        goal = np.where(down & ~(empty & low), 0.0, hover)
        rising = (goal > 0) & (reach.height < hover - 0.02)
        motion = np.zeros((len(state), 4))
        # Sideways only above the object, or as a small correction on the way down.
        sideways = self._towards(reach.offset, self.scale.position)
        motion[:, :2] = np.where((rising & (distance > 0.03))[:, None], 0.0, sideways)
        motion[:, 2] = self._towards(goal - reach.height, self.scale.position) * np.where(goal > 0, 1.0, DESCENT)
        motion[:, 3] = self._towards(reach.turn, self.scale.yaw)
        motion[closing] = 0.0
        share = APERTURE_GAIN * (self.gain / GAIN)
        opening = np.clip(share * (free - state.aperture) / self.scale.aperture, -1.0, 1.0)
        return motion, np.where(closing, -1.0, opening)

    def _towards(self, error: Array, step: float) -> Array:
        """Return the action that corrects a share of an error. Any shape."""
        return np.clip(self.gain * np.asarray(error) / step, -1.0, 1.0)


@dataclass(frozen=True)
class PlaceController(GraspController):
    """Take the object, carry it over the plate, set it down, let go, go up.

    Args:
        task: Rules of the task: where the plate is.
        carry: Clearance of the object while it is carried, m.
        drop: Clearance over the plate at which the object is released, m. It is high enough that even a policy that imitates
            the controller imperfectly does not press the object down or bring the fingers near the plate's rim.
        near: Horizontal distance from the plate's middle within which the object goes down, m; half of what success asks for.
        retreat: How far the tool goes up afterwards, m.
    """

    task: Place = field(default_factory=lambda: Place((0.0, 0.265)))
    carry: float = 0.055
    drop: float = 0.020
    near: float = 0.020
    retreat: float = 0.10

    def __call__(self, state: State) -> Array:
        """Actions for N worlds. float32 [N, 5], each -1..1."""
        reach = self._reach(state)
        away = np.asarray(self.task.plate_centre) - state.object_position[:, :2]
        distance = np.hypot(*away.T)
        above = state.object_clearance - self.task.plate_height
        over = distance < self.near
        # Carrying: up first, then over, then down; slower near the plate, since the arm goes on for a step or two. The way down
        # aims at the plate, not at the height of release: if it faded out there, a policy that imitates it would hang above.
        goal = np.where(over | ((distance < 1.5 * self.near) & (above < 0.5 * self.carry)), 0.0, self.carry)
        carried = np.zeros((len(state), 4))
        free_to_go = above > 0.7 * self.carry
        carried[:, :2] = np.where((free_to_go | over)[:, None], self._towards(away, self.scale.position), 0.0)
        carried[:, 2] = self._towards(goal - above, self.scale.position)
        # On the way down every step is short enough that the arm's lag does not press the object on the plate.
        lowering = goal < self.carry
        slow = np.maximum(0.1 * above / self.scale.position, SINKING)
        carried[:, 2] = np.where(lowering, np.maximum(carried[:, 2], -slow), carried[:, 2])
        release = reach.held & lowering & (above < self.drop)

        # The pads release the object while it still has to fall; it must not be gripped again.
        seated = (distance < self.task.tolerance) & (above < self.drop + self.task.seat) & ~reach.held
        motion, opening = self._approach(state, reach)
        motion = np.where(reach.held[:, None], carried, motion)
        opening = np.where(reach.held, -1.0, opening)
        motion[release] = 0.0
        # After the release, go up only when the pads are clear of the object.
        clear = state.aperture > np.minimum(self.grip.width + 0.015, 0.95 * self.stroke)
        back = np.zeros_like(motion)
        back[:, 2] = np.where(clear, self._towards(self.retreat - reach.height, self.scale.position), 0.0)
        motion = np.where(seated[:, None], back, motion)
        spread = np.where(clear, 0.0, 1.0)
        return _packed(motion, np.where(release, 1.0, np.where(seated, spread, opening)))


def _packed(motion: Array, opening: Array) -> Array:
    """Join motion [N, 4] and opening [N] to actions, zero where a world broke down. float32 [N, 5]."""
    return np.nan_to_num(np.clip(np.c_[motion, opening], -1.0, 1.0)).astype(np.float32)
