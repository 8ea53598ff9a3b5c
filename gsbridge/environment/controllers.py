"""Baseline controllers: pure functions of the privileged state, for N worlds at once, without memory.

They are the teachers of the policies, which label states in any order, so that an action may depend on nothing but the state.
What a phase-based program would remember is read off the state instead: an object that both pads press is held; open pads low
around the object are about to close; pads that closed on nothing go up and open again.

Commands are integrated by the environment, and the arm follows with a lag of up to three steps. Errors are therefore
answered by `GAIN` per step, which is stable for that lag, see `stable_gain`; where commands take longer, by less.

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
"""Share of an error that one step answers, of an arm without delay."""

LAG = 3.0
"""Control steps by which an arm without delay lags behind its command."""

DESCENT = 2.0 / 3.0
"""Share of `GAIN` used while going down on the object: with a lag of three steps the whole of it overshoots."""

APERTURE_GAIN = 0.15
"""Share of an error of the opening that one step answers: the command must not run away from fingers of 7.5 mm per step."""

HALF_PAD = 0.0325
"""Distance from the tool point down to the fingertips, m."""

LOWEST_GRIP = 0.043
"""Lowest height of the tool point over the object's foot, m: fingertips 10 mm over the table, or over the plate."""

RIM_OPENING = 0.025
"""Opening beyond the thickness of a vessel's wall while approaching it, m: `gsbridge.asset.rim` looks for room for it."""

SINKING = 0.15
"""Least share of a step by which a carried object goes down over the plate. Slower, a copy cannot tell it from rest: policies
taught at 0.03 hung 8 to 15 mm above the height of release until time was out."""


def gain_limit(lag: float) -> float:
    """Largest share of an error that may be answered per step, if the error is seen `lag` steps late.

    Above it `e[t + 1] = e[t] - k e[t - lag]` swings up; at it a root `exp(i w)` of its characteristic equation lies on the unit
    circle, with `w = pi / (2 lag + 1)`.

    Source: Levin and May, A note on difference-delay equations, Theoretical Population Biology 9 (1976).
    """
    return float(2.0 * np.sin(np.pi / (4.0 * lag + 2.0)))


def stable_gain(delay: float) -> float:
    """`GAIN`, or less where commands are late: as far below the limit as `GAIN` is without delay.

    Args:
        delay: Delay of commands, control periods.
    """
    return GAIN * (gain_limit(LAG + delay) / gain_limit(LAG))


@dataclass(frozen=True)
class Grip:
    """The grip by which an object is taken.

    Args:
        centre: Middle of the grip, body frame, m. [3]; z is the tool point's height over the object's foot.
        axes: Directions in the body's x-y plane along which the fingers may close, rad; each also means its opposite.
        width: Extent of what is taken along the first of them, m.
        top: Height of the object, m.
        opening: Opening beyond that width while approaching, m.
        least: Fingers closer together than this share of the width have closed on nothing.
        hover: Fingertips over the object's top while moving sideways, m.
        others: Further places that do as well: x, y, and the axis there; the one nearest to the middle of the table's working
            area is taken.
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
        tolerance: Directions in which it is wider than the narrowest by up to this factor do as well.

    Returns:
        The grip; z halfway up, but not below `LOWEST_GRIP`.
    """
    points = np.asarray(points, dtype=np.float64)
    angles = np.deg2rad(np.arange(180))
    along = points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    widths = np.ptp(along, axis=0)
    narrow = widths <= tolerance * widths.min()
    # The middle of every run of good directions, runs across 180 degrees joined; a round object is good all round.
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

    Inside there is little room, so the fingers open less; and how thick a wall is photos tell to a millimetre or two only.

    Args:
        rim: Places on the rim at which the wall can be taken.
        top: Height of the vessel, m.
    """
    height = max(rim.height - rim.depth + HALF_PAD, LOWEST_GRIP)
    (x, y, angle), others = rim.places[0], rim.places[1:]
    # A fingertip that comes down too early hits the rim: the arm goes on for a step or two.
    return Grip((x, y, height), (angle,), rim.thickness, top, RIM_OPENING, least=0.3, hover=0.030, others=others)


@dataclass(frozen=True)
class ReachController:
    """Relation of tool and object in N worlds; the common part of both controllers.

    Args:
        offset: From the tool point to the grip's, horizontal, m. [N, 2].
        turn: From the tool's yaw to the nearest that closes along one of the grip's axes, rad. [N].
        height: Tool point over the grip's height, m. [N].
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
        lift: Clearance to which the object is lifted, m. Twice what success asks for: with little more a policy's imperfect
            copy slows down just below the mark and hangs there until time is out.
        stroke: Largest opening, m.
        middle: Middle of the area in which the robot works, table frame, m.
        aligned: Horizontal error at which it may go down, m.
        turned: Error in yaw at which it may go down, rad.
        firm: Force of each pad from which the object counts as held, N.
        gain: Share of an error that one step answers.
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
        """Where the object is taken, table frame [N, 3], and the axes there, body frame [N, A] or [A].

        Of several places the one nearest to the middle: from its far side, fingers would leave the working area.
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
        """Motion [N, 4] and opening [N] while nothing is held: over the object, down, close; up again from an empty grip."""
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
        """Action that answers an error by a share of it. Any shape."""
        return np.clip(self.gain * np.asarray(error) / step, -1.0, 1.0)


@dataclass(frozen=True)
class PlaceController(GraspController):
    """Take the object, carry it over the plate, set it down, let go, go up.

    Args:
        task: Rules of the task: where the plate is.
        carry: Clearance of the object while it is carried, m.
        drop: Clearance over the plate at which it is let go, m. It must not be pressed down, by a policy's imperfect copy of
            this controller either, nor may the fingers come near the plate's rim.
        near: Horizontal distance from the plate's middle at which it goes down, m. Half of what success asks for.
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
        # Carrying: up first, then over, then down; slower near the plate, for the arm goes on for a step or two. It aims at the
        # plate, not at the height of release: a way down that fades out short of it is one that a copy hangs in.
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

        # The pads let go while it still has to fall: it is not to be caught again.
        seated = (distance < self.task.tolerance) & (above < self.drop + self.task.seat) & ~reach.held
        motion, opening = self._approach(state, reach)
        motion = np.where(reach.held[:, None], carried, motion)
        opening = np.where(reach.held, -1.0, opening)
        motion[release] = 0.0
        # Let go: up only when the pads are clear of the object.
        clear = state.aperture > np.minimum(self.grip.width + 0.015, 0.95 * self.stroke)
        back = np.zeros_like(motion)
        back[:, 2] = np.where(clear, self._towards(self.retreat - reach.height, self.scale.position), 0.0)
        motion = np.where(seated[:, None], back, motion)
        spread = np.where(clear, 0.0, 1.0)
        return _packed(motion, np.where(release, 1.0, np.where(seated, spread, opening)))


def _packed(motion: Array, opening: Array) -> Array:
    """Actions from motion [N, 4] and opening [N]; a world that broke down gets none. float32 [N, 5]."""
    return np.nan_to_num(np.clip(np.c_[motion, opening], -1.0, 1.0)).astype(np.float32)
