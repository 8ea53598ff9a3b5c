"""A two-finger gripper with the public dimensions of the Robotiq 2F-140, built from gsbridge's own boxes and prisms.

Gripper frame: origin on the mounting face, z out of the face towards the fingertips, the fingers open along y, left is +y.

Each finger is a parallel linkage: a bar turns by the angle `a` about its knuckle, and the fingertip turns back by `-a`, so that
the pads stay parallel at every opening. The pads therefore move on a circle: closing pushes them 25 mm outwards along z, as on
the real gripper. One coordinate drives all four joints; `a = 0` is a bar along z, growing `a` opens. The linkage's second bar
is not modelled, nor is the way in which the real fingers wrap around an object that touches them near the knuckles.

Source: stroke, force, speed, mass, overall length and width from the Robotiq 2F-85/2F-140 instruction manual, section
"Specifications"; bar length and pivots follow from the pad distances over the stroke. They reproduce the manual's length when
closed (233 mm) and width when open (202 mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.links import Colour, Joint, Link, LinkPart, box, cylinder_points, hull, solid_inertia, translation

BODY: Colour = (0.13, 0.13, 0.14)
BAR: Colour = (0.28, 0.28, 0.30)
RUBBER: Colour = (0.07, 0.07, 0.07)

DRIVER = "left_knuckle_joint"
"""The joint whose value is the gripper's coordinate; the others follow it."""

PADS = ("left_pad", "right_pad")
"""The links that carry the rubber pads."""


@dataclass(frozen=True)
class GripperDimensions:
    """Dimensions and ratings of a gripper; lengths in m.

    Args:
        stroke: Distance between the pads when open; they touch when closed.
        min_force: Smallest gripping force that can be set, N.
        max_force: Largest gripping force that can be set, N.
        min_speed: Smallest speed at which the pads approach each other, m/s.
        max_speed: Largest speed at which the pads approach each other, m/s.
        mass: Mass of the whole gripper without camera, kg.
        coupling: Thickness of the plate between the robot's flange and the gripper.
        knuckle_y: Distance of the knuckles from the middle plane.
        knuckle_z: Height of the knuckles over the gripper's lower face.
        bar: Distance between the two pivots of a finger's bar.
        pad_inset: Distance of the pad's face inwards from the upper pivot.
        pad_z: Height of the pad's centre over the upper pivot.
        pad_size: Thickness, width (x), length (z) of a pad.
    """

    stroke: float = 0.140
    min_force: float = 10.0
    max_force: float = 125.0
    min_speed: float = 0.030
    max_speed: float = 0.250
    mass: float = 1.025
    coupling: float = 0.014
    knuckle_y: float = 0.0306
    knuckle_z: float = 0.0549
    bar: float = 0.100
    pad_inset: float = 0.0271
    pad_z: float = 0.0457
    pad_size: tuple[float, float, float] = (0.008, 0.027, 0.065)

    def __post_init__(self) -> None:
        lengths = (self.stroke, self.coupling, self.knuckle_y, self.knuckle_z, self.bar, self.pad_inset, *self.pad_size)
        if not all(np.isfinite(value) and value > 0 for value in (*lengths, self.mass, self.min_force, self.min_speed)):
            raise InputError("gripper", "a length, mass, force or speed is not positive", "Give metres, kg and newtons")
        if self.max_force < self.min_force or self.max_speed < self.min_speed:
            raise InputError("gripper", "a largest force or speed lies below the smallest", "Exchange the two values")
        if not (abs(self._rest_half_gap) < self.bar and abs(self.stroke / 2 - self._rest_half_gap) < self.bar):
            raise InputError(
                "gripper",
                f"a bar of {1000 * self.bar:.0f} mm cannot open the pads by {1000 * self.stroke:.0f} mm",
                "Use a longer bar or a shorter stroke",
            )
        # The fingertip's body needs room behind the pad.
        if self.pad_inset - self.pad_size[0] < 0.010:
            raise InputError("gripper", "the pad is as thick as the fingertip", "Use a thinner pad or a larger inset")

    @property
    def _rest_half_gap(self) -> float:
        """Half the distance of the pads when the bars stand along z."""
        return self.knuckle_y - self.pad_inset

    @property
    def closed_angle(self) -> float:
        """Driver angle at which the pads touch, rad."""
        return float(self.angle(0.0))

    @property
    def open_angle(self) -> float:
        """Driver angle at the full stroke, rad."""
        return float(self.angle(self.stroke))

    @property
    def gripper_from_tool(self) -> Array:
        """Pose of the tool frame: axes of the gripper frame, origin between the pads' centres when closed. [4, 4].

        The pads reach farthest along z when closed. A tool point more than half a pad's length above the table therefore keeps
        the fingertips clear of the table at every opening.
        """
        return translation(0.0, 0.0, self.coupling + float(self.pad_height(self.closed_angle)))

    def aperture(self, angle: Array | float) -> Array:
        """Return the distance between the pads, m, for a driver angle, rad. [...]."""
        return 2.0 * (self._rest_half_gap + self.bar * np.sin(angle))

    def angle(self, aperture: Array | float) -> Array:
        """Return the driver angle, rad, for a distance between the pads, m (cut to 0..stroke). [...]."""
        gap = np.clip(aperture, 0.0, self.stroke)
        return np.arcsin((0.5 * gap - self._rest_half_gap) / self.bar)

    def aperture_rate(self, angle: Array | float) -> Array:
        """Return the change of the pad distance per driver angle, m/rad; it also converts pad force to driver torque. [...]."""
        return 2.0 * self.bar * np.cos(angle)

    def torque(self, force: Array | float, angle: Array | float) -> Array:
        """Return the torque on the driver, N m, at which each pad presses with `force`, N, by virtual work. [...].

        Closing torques are negative. The value is for the whole coupled linkage; if two knuckles share it, each takes half.
        """
        return -np.asarray(force) * self.aperture_rate(angle)

    def pad_height(self, angle: Array | float) -> Array:
        """Return the height of the pads' centres over the gripper's lower face (above the coupling), m. [...]."""
        return self.knuckle_z + self.bar * np.cos(angle) + self.pad_z

    def retreat(self, aperture: Array | float) -> Array:
        """Return how far the pads' centres lie behind the tool point at this opening, m >= 0. [...]."""
        highest = self.pad_height(self.closed_angle)
        return highest - self.pad_height(self.angle(aperture))

    def check_object(self, width: float, source: str) -> None:
        """Refuse an object that does not fit between the open pads.

        Args:
            width: Smallest horizontal extent of the object, m.
            source: The object's name or file, for the message.

        Raises:
            InputError: The object leaves less than 5 mm on each side.
        """
        if not np.isfinite(width) or width <= 0 or width > self.stroke - 0.010:
            raise InputError(
                source,
                f"the object is {1000 * width:.0f} mm wide, the gripper opens {1000 * self.stroke:.0f} mm",
                "Use an object that leaves at least 5 mm on each side, or check the scale of its scene",
            )


def gripper_links(dimensions: GripperDimensions, parent: str, parent_from_gripper: Array) -> tuple[list[Link], list[Joint]]:
    """Build the links and joints of the gripper.

    Args:
        dimensions: Dimensions of the gripper.
        parent: Link that carries the gripper: the robot's flange.
        parent_from_gripper: Pose of the gripper on that link, m. [4, 4].

    Returns:
        Links `palm`, `left_bar`, `left_pad`, `right_bar`, `right_pad` and the joints that connect them to `parent`. All moving
        joints follow `left_knuckle_joint`. The density is the same everywhere.
    """
    d = dimensions
    palm = _palm(d)
    bars = {"left": _bar(d), "right": _bar(d)}
    tips = {"left": _tip(d, inward=-1.0), "right": _tip(d, inward=1.0)}
    solids = [palm, *bars.values(), *tips.values()]
    density = d.mass / sum(part.mesh.volume() for parts in solids for part in parts)
    links = [Link("palm", palm, solid_inertia(palm, density))]
    joints = [Joint("palm_joint", parent, "palm", parent_from_gripper)]
    speed = d.max_speed / float(d.aperture_rate(max(abs(d.closed_angle), d.open_angle)))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        bar, tip = f"{side}_bar", f"{side}_pad"
        links += [
            Link(bar, bars[side], solid_inertia(bars[side], density)),
            Link(tip, tips[side], solid_inertia(tips[side], density)),
        ]
        # Turning about -x moves the bar's end towards +y, which opens the left finger; the right one is its mirror image.
        axis = (-sign, 0.0, 0.0)
        knuckle, pivot = f"{side}_knuckle_joint", f"{side}_pad_joint"
        effort = d.max_force * d.bar
        hinge = translation(0.0, sign * d.knuckle_y, d.coupling + d.knuckle_z)
        follows = None if knuckle == DRIVER else DRIVER
        joints += [
            Joint(knuckle, "palm", bar, hinge, "revolute", axis, d.closed_angle, d.open_angle, speed, effort, follows, 1.0),
            Joint(
                pivot, bar, tip, translation(0.0, 0.0, d.bar), "revolute", axis, -d.open_angle, -d.closed_angle, speed, effort,
                DRIVER, -1.0,
            ),
        ]  # fmt: skip
    return links, joints


def _palm(d: GripperDimensions) -> tuple[LinkPart, ...]:
    """Build the coupling plate and the body, which tapers towards the knuckles so that the wrist camera looks past it."""
    low, high = d.coupling, d.coupling + d.knuckle_z + 0.008
    wide, deep = d.knuckle_y + 0.012, 0.0375
    middle = low + 0.5 * (high - low)
    outline = [(deep, wide, low), (deep, wide, middle), (0.020, wide, high)]
    body = np.array([(sx * x, sy * y, z) for x, y, z in outline for sx in (-1, 1) for sy in (-1, 1)])
    return (
        hull(cylinder_points(0.0375, 0.0, d.coupling), BAR),
        hull(body, BODY),
    )


def _bar(d: GripperDimensions) -> tuple[LinkPart, ...]:
    """Build a bar from the knuckle (origin) to the upper pivot, with rounded ends, 20 mm wide and 8 mm thick."""
    half = np.linspace(0.0, np.pi, 9)
    radius = 0.004
    low = np.stack([radius * np.cos(half), -radius * np.sin(half)], axis=1)
    high = np.stack([radius * np.cos(half), d.bar + radius * np.sin(half)], axis=1)
    outline = np.concatenate([low, high])
    points = np.concatenate([np.c_[np.full(len(outline), x), outline] for x in (-0.010, 0.010)])
    return (hull(points, BAR),)


def _tip(d: GripperDimensions, inward: float) -> tuple[LinkPart, ...]:
    """Build a fingertip with its pad; `inward` is the sign of y towards the other finger. Origin: the upper pivot."""
    thickness, width, length = d.pad_size
    back = d.pad_inset - thickness
    low, high = d.pad_z - length / 2, d.pad_z + length / 2
    pad = box((width, thickness, length), (0.0, inward * (back + thickness / 2), d.pad_z), RUBBER)
    # The body reaches from the pad's back down to the pivot and thins out towards the tip.
    outline = [(back, low), (back, high), (back - 0.005, high), (-0.004, low), (-0.004, -0.006), (0.008, -0.006)]
    points = np.array([(x, inward * y, z) for y, z in outline for x in (-width / 2, width / 2)])
    return (hull(points, BODY), pad)
