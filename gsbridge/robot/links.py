"""Links and joints as data: solid parts, their mass properties, and how they are written in a URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class LinkPart:
    """One convex solid of a link.

    Args:
        mesh: Surface of the part, link frame, m.
        colour: sRGB 0..1.
        extents: Edge lengths, m, if the part is a box along the link's axes: physics then gets the exact box. [3] or None.
    """

    mesh: Mesh
    colour: Colour
    extents: tuple[float, float, float] | None = None

    def centre(self) -> Array:
        """Return the middle of the part's bounding box, link frame, m. [3]."""
        return 0.5 * (self.mesh.vertices.min(0) + self.mesh.vertices.max(0))


@dataclass(frozen=True)
class Inertia:
    """Mass properties of a rigid body.

    Args:
        mass: Mass, kg.
        centre: Centre of mass, link frame, m. [3].
        tensor: Inertia tensor about the centre of mass, along the link's axes, kg m2. [3, 3].
    """

    mass: float
    centre: Array
    tensor: Array


NO_INERTIA = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
"""Inertia of links that only mark a frame. Without an `inertial` element PyBullet would give them 1 kg and 1 kg m2."""


@dataclass(frozen=True)
class Link:
    """A rigid link: its name, its parts and its mass properties."""

    name: str
    parts: tuple[LinkPart, ...] = ()
    inertia: Inertia = NO_INERTIA


@dataclass(frozen=True)
class Joint:
    """A joint of the description.

    Args:
        name: Unique name.
        parent: Parent link.
        child: Child link.
        parent_from_child: Pose of the child frame in the parent's at joint value zero, m. [4, 4].
        kind: `fixed`, `revolute`, or another type of URDF.
        axis: Axis in the child's frame. [3].
        lower: Lower limit, rad (prismatic joints: m, and so on).
        upper: Upper limit, rad.
        velocity: Speed limit, rad/s.
        effort: Torque limit, N m.
        follows: The joint that this one is coupled to, or None.
        multiplier: Value of this joint per value of the joint it follows.
        offset: Value of this joint where the joint it follows is at zero, rad.
        damping: Viscous friction, N m s/rad.
        friction: Coulomb friction, N m.
    """

    name: str
    parent: str
    child: str
    parent_from_child: Array
    kind: str = "fixed"
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    follows: str | None = None
    multiplier: float = 1.0
    offset: float = 0.0
    damping: float = 0.0
    friction: float = 0.0


def translation(x: float, y: float, z: float) -> Array:
    """Return a transform without rotation. [4, 4].

    Args:
        x, y, z: Shift, m.
    """
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def box(extents: Sequence[float], centre: Sequence[float], colour: Colour) -> LinkPart:
    """Return a box along the link's axes.

    Args:
        extents: Edges along x, y and z, m. [3].
        centre: Middle of the box, link frame, m. [3].
        colour: Colour of the part.
    """
    import trimesh

    solid = trimesh.creation.box(extents=extents)
    mesh = Mesh(np.asarray(solid.vertices) + np.asarray(centre, dtype=np.float64), np.asarray(solid.faces, dtype=np.int64))
    return LinkPart(mesh, colour, (float(extents[0]), float(extents[1]), float(extents[2])))


def hull(points: Array, colour: Colour) -> LinkPart:
    """Return the convex hull of points as a part of a link. [N, 3]."""
    return LinkPart(convex_hull(points), colour)


def convex_hull(points: Array) -> Mesh:
    """Return the watertight convex hull of points, with outward faces. [N, 3]."""
    import trimesh

    solid = trimesh.convex.convex_hull(np.asarray(points, dtype=np.float64))
    return Mesh(np.asarray(solid.vertices, dtype=np.float64), np.asarray(solid.faces, dtype=np.int64))


def support_hull(points: Array, directions: int) -> Mesh:
    """Return the convex hull of those points that lie farthest out in evenly spread directions.

    The number of its vertices is bounded. Physics engines test every hull vertex in contact, and the arm's full hulls have up
    to 600 vertices. With a few hundred directions, the result lies inside the full hull and within about a millimetre of it.

    Args:
        points: Points to enclose, m. [N, 3].
        directions: Number of directions, at least 8.

    Source: directions after Vogel, Mathematical Biosciences 44, 1979 (golden-angle spiral on a sphere).
    """
    index = np.arange(directions) + 0.5
    z = 1.0 - 2.0 * index / directions
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z * z)
    spread = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    # The six axis directions keep the flat ends (mounting plane, flange) exact.
    spread = np.concatenate([spread, np.eye(3), -np.eye(3)])
    return convex_hull(np.asarray(points)[np.unique(np.argmax(np.asarray(points) @ spread.T, axis=0))])


def cylinder_points(radius: float, low: float, high: float, sides: int = 32) -> Array:
    """Return the corner points of an upright prism whose corners lie on a cylinder along z.

    Args:
        radius: Radius of the cylinder, m.
        low, high: z of its two ends, m.
        sides: Number of corners of each end.

    Returns:
        The lower ring, then the upper one, m. [2 * sides, 3].
    """
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return np.concatenate([np.c_[ring, np.full(sides, low)], np.c_[ring, np.full(sides, high)]])


def solid_inertia(parts: Sequence[LinkPart], density: float) -> Inertia:
    """Compute the mass properties of a body made of solid parts of one density.

    Args:
        parts: Watertight parts that may touch but do not overlap.
        density: Density of all parts, kg/m3.

    Returns:
        Mass properties of all parts together, by the parallel-axis theorem.
    """
    properties = []
    for part in parts:
        solid = part.mesh.trimesh()
        solid.density = density
        properties.append((float(solid.mass), np.asarray(solid.center_mass), np.asarray(solid.moment_inertia)))
    return joined_inertia([Inertia(*item) for item in properties])


def joined_inertia(bodies: Sequence[Inertia]) -> Inertia:
    """Join the mass properties of bodies that move as one, all given in one frame, by the parallel-axis theorem."""
    mass = float(sum(body.mass for body in bodies))
    if mass == 0.0:
        return NO_INERTIA
    centre = sum((body.mass * body.centre for body in bodies), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for body in bodies:
        offset = body.centre - centre
        tensor += body.tensor + body.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return Inertia(mass, centre, tensor)


def number(value: float) -> str:
    """Format a number for the description: twelve significant digits, without rounding noise and negative zero."""
    return f"{round(float(value), 15) + 0.0:.12g}"


def numbers(values: Sequence[float] | Array) -> str:
    """Format several numbers, separated by blanks. [N]."""
    return " ".join(number(value) for value in values)


def rpy_from_rotation(rotation: Array) -> Array:
    """Return URDF's fixed-axis roll, pitch, yaw of a rotation, rad; R = Rz(yaw) Ry(pitch) Rx(roll). [3, 3] -> [3]."""
    r = np.asarray(rotation, dtype=np.float64)
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    if np.hypot(r[0, 0], r[1, 0]) < 1e-9:
        # Gimbal lock: roll and yaw turn about the same axis, so yaw is set to zero and the whole turn is given to roll.
        return np.array([np.arctan2(-r[1, 2], r[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(r[2, 1], r[2, 2]), pitch, np.arctan2(r[1, 0], r[0, 0])])


def rotation_from_rpy(rpy: Sequence[float] | Array) -> Array:
    """Return the rotation of URDF's fixed-axis roll, pitch, yaw, rad. [3] -> [3, 3]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def origin_element(transform: Array) -> ElementTree.Element:
    """Return the URDF element `origin` of a transform. [4, 4]."""
    return ElementTree.Element("origin", xyz=numbers(transform[:3, 3]), rpy=numbers(rpy_from_rotation(transform[:3, :3])))


def inertial_element(inertia: Inertia) -> ElementTree.Element:
    """Return the URDF element `inertial` of a link."""
    out = ElementTree.Element("inertial")
    ElementTree.SubElement(out, "origin", xyz=numbers(inertia.centre), rpy="0 0 0")
    ElementTree.SubElement(out, "mass", value=number(inertia.mass))
    entries = {
        f"i{'xyz'[row]}{'xyz'[column]}": number(inertia.tensor[row, column]) for row in range(3) for column in range(row, 3)
    }
    ElementTree.SubElement(out, "inertia", entries)
    return out


def joint_element(joint: Joint) -> ElementTree.Element:
    """Return the URDF element `joint`. Damping and friction are zero, because only the simulation model sets them."""
    out = ElementTree.Element("joint", name=joint.name, type=joint.kind)
    out.append(origin_element(joint.parent_from_child))
    ElementTree.SubElement(out, "parent", link=joint.parent)
    ElementTree.SubElement(out, "child", link=joint.child)
    if joint.kind == "fixed":
        return out
    ElementTree.SubElement(out, "axis", xyz=numbers(joint.axis))
    limits = {"lower": joint.lower, "upper": joint.upper, "velocity": joint.velocity, "effort": joint.effort}
    ElementTree.SubElement(out, "limit", {key: number(value) for key, value in limits.items()})
    ElementTree.SubElement(out, "dynamics", damping="0", friction="0")
    if joint.follows is not None:
        ElementTree.SubElement(out, "mimic", joint=joint.follows, multiplier=number(joint.multiplier), offset="0")
    return out
