"""The only reader of URDFs in gsbridge: it checks all links and joints of a description when it reads the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.reading import LARGEST_TEXT, refusing, regular_file
from gsbridge.robot.links import Inertia, Joint, rotation_from_rpy

KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
WORLD = "world"
"""Name of the link that a joint may name as its parent although the file has no such link."""

_MEND = "Correct the URDF, or export it again"
_INDEFINITE = 1e-9
"""Largest negative eigenvalue of an inertia tensor that is accepted as rounding, as a share of the tensor's trace."""


@dataclass(frozen=True)
class Tree:
    """Links and joints of a robot.

    Args:
        base: The link without a parent.
        joints: Every joint, parents before children.
    """

    base: str
    joints: tuple[Joint, ...]

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, base first, then in the order of `joints`."""
        return (self.base, *(joint.child for joint in self.joints))

    @property
    def moving(self) -> tuple[Joint, ...]:
        """Joints that are not fixed, in the order of `joints`."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    @property
    def independent(self) -> tuple[Joint, ...]:
        """Moving joints that follow no other: the robot's coordinates."""
        return tuple(joint for joint in self.moving if joint.follows is None)


@dataclass(frozen=True)
class Origin:
    """A frame as the file gives it: position, m, then roll, pitch and yaw about fixed axes, rad."""

    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)

    def transform(self) -> Array:
        """Return the frame's pose as a transform. [4, 4]."""
        out = np.eye(4)
        out[:3, 3] = self.xyz
        out[:3, :3] = rotation_from_rpy(self.rpy)
        return out


@dataclass(frozen=True)
class InertialElement:
    """An `inertial` element.

    Args:
        mass: Mass, kg.
        origin: Frame at the centre of mass, in the link's frame.
        tensor: Inertia about the centre of mass along the axes of `origin`, kg m2. [3, 3].
    """

    mass: float
    origin: Origin
    tensor: Array

    def seen_from(self, frame_from_link: Array) -> Inertia:
        """Return the link's mass properties in another frame, given the link's pose `frame_from_link` in it. [4, 4]."""
        placed = frame_from_link @ self.origin.transform()
        return Inertia(self.mass, placed[:3, 3], placed[:3, :3] @ self.tensor @ placed[:3, :3].T)


@dataclass(frozen=True)
class Description:
    """A URDF as it was read.

    Args:
        root: XML of the description, for callers that write a changed copy.
        links: Names of the links in the file's order.
        base: The link without a parent.
        joints: Every joint, parents before children, otherwise in the file's order. Prismatic joints have limits in metres.
            Limits that the file does not state are infinite; speeds and efforts that it does not state are 0.
        origins: Frame of each joint in its parent link's frame, by the joint's name, in the file's order.
        inertials: Mass properties by link; links without the element are left out.
    """

    root: ElementTree.Element
    links: tuple[str, ...]
    base: str
    joints: tuple[Joint, ...]
    origins: Mapping[str, Origin]
    inertials: Mapping[str, InertialElement]


def read_description(path: str | Path) -> Description:
    """Read a URDF.

    Raises:
        InputError: The file is missing, too large, xacro, or not a URDF; a link or joint lacks a required part, or has a
            damaged number, an unknown type, an axis of length zero, impossible limits or impossible mass properties; or the
            links do not form a tree.
    """
    source = regular_file(path, "URDF", "Check the path, or build the robot", LARGEST_TEXT)
    with refusing(source, "this is no valid XML", "Export it, or build the robot, again"):
        root = ElementTree.parse(source).getroot()
    return description_of(root, source)


def description_of(root: ElementTree.Element, source: str | Path) -> Description:
    """Read a description from the root element of a URDF.

    Args:
        root: The element. It is changed in place: tags lose their name spaces, and the link `world` is added if joints need it.
        source: The file that it comes from, for error messages.

    Raises:
        InputError: As `read_description`.
    """
    _refuse_xacro(root, source)
    _tidy(root)
    if root.tag != "robot":
        raise InputError(source, "this is no URDF: its root is no <robot>", "Export the URDF again")
    try:
        links = tuple(_named(element, "a link") for element in root.findall("link"))
        joints = tuple(_joint(element) for element in root.findall("joint"))
        inertials = {}
        for name, element in zip(links, root.findall("link"), strict=True):
            if element.find("inertial") is not None:
                inertials[name] = _inertial(element, name)
        origins = {
            joint.name: read_origin(element, joint.name) for joint, element in zip(joints, root.findall("joint"), strict=True)
        }
        base, ordered = _ordered(links, joints)
    except _DamageError as error:
        raise InputError(source, str(error), _MEND) from error
    return Description(root, links, base, ordered, origins, inertials)


def _refuse_xacro(root: ElementTree.Element, source: str | Path) -> None:
    """Refuse a xacro file, which must be expanded first.

    Raises:
        InputError: The file has elements or expressions of xacro.
    """
    if any(isinstance(element.tag, str) and "xacro}" in element.tag for element in root.iter()) or any(
        mark in value
        for element in root.iter()
        for key, value in element.attrib.items()
        for mark in ("${", "$(")
        if mark == "${" or key != "filename"
    ):
        plain = Path(source).name.removesuffix(".xacro").removesuffix(".urdf")
        raise InputError(source, "this is a xacro file", f"Expand it first: xacro {Path(source).name} > {plain}_expanded.urdf")


def _tidy(root: ElementTree.Element) -> None:
    """Remove name spaces from tags, and add the link `world` if a joint has it as its parent and the file does not define it.

    Published files use name spaces and leave out `world`, because some tools know it without a definition.
    """
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    links = {link.get("name") for link in root.findall("link")}
    parents = {parent.get("link") for parent in root.findall("joint/parent")}
    if WORLD in parents - links:
        root.insert(0, ElementTree.Element("link", name=WORLD))


def read_urdf(path: str | Path) -> Tree:
    """Read the tree of a robot that has only fixed and revolute joints.

    Raises:
        InputError: As `read_description`; or a joint is neither fixed nor revolute, is coupled with an offset, or lacks limits.
    """
    description = read_description(path)
    for joint in description.joints:
        if joint.kind not in ("fixed", "revolute"):
            raise InputError(path, f"joint {joint.name} is {joint.kind}", "Only fixed and revolute joints are known here")
        if joint.offset != 0.0:
            raise InputError(path, f"joint {joint.name} is coupled with an offset", "Only couplings without one are known here")
        if joint.kind == "revolute" and not (isfinite(joint.lower) and isfinite(joint.upper)):
            raise InputError(path, f"joint {joint.name} lacks <limit lower= upper=>", "State the joint's range")
    return Tree(description.base, description.joints)


def collision_meshes(path: str | Path) -> list[Path]:
    """Return the collision meshes that a URDF names; empty if the file cannot be read, which its next reader reports."""
    try:
        with refusing(path, "this is no valid XML", _MEND):
            root = ElementTree.parse(regular_file(path, "URDF", _MEND, LARGEST_TEXT)).getroot()
    except InputError:
        return []
    _tidy(root)
    names = [mesh.attrib.get("filename", "") for mesh in root.iterfind("link/collision/geometry/mesh")]
    return [Path(path).parent / name.removeprefix("package://") for name in names if name]


class _DamageError(Exception):
    """A fault in a description, in plain words."""


def _named(element: ElementTree.Element, what: str) -> str:
    name = element.get("name")
    if not name:
        raise _DamageError(f"{what} lacks its name")
    return name


def _numbers(element: ElementTree.Element | None, key: str, default: str, what: str, count: int = 1) -> tuple[float, ...]:
    """Read the numbers of an attribute, or those of `default` if the attribute is missing."""
    text = default if element is None else element.get(key, default)
    try:
        values = tuple(float(value) for value in text.split())
    except ValueError:
        values = ()
    # Only a default may be infinite: infinity means that the limit is not stated.
    if len(values) != count or not (text == default or all(map(isfinite, values))):
        raise _DamageError(f'{what}: {key}="{text}" is no {"number" if count == 1 else f"row of {count} numbers"}')
    return values


def read_origin(element: ElementTree.Element, what: str) -> Origin:
    """Read the `origin` of an element; the identity if it has none. `what` names the element in error messages."""
    origin = element.find("origin")
    return Origin(_numbers(origin, "xyz", "0 0 0", what, 3), _numbers(origin, "rpy", "0 0 0", what, 3))


def _inertial(link: ElementTree.Element, name: str) -> InertialElement:
    """Read the mass properties of a link that has an element `inertial`."""
    what = f"link '{name}' has damaged mass properties"
    element = link.find("inertial")
    mass_element, moments = link.find("inertial/mass"), link.find("inertial/inertia")
    if element is None or mass_element is None or moments is None or mass_element.get("value") is None:
        raise _DamageError(f"{what}: it lacks <mass value=> or <inertia>")
    (mass,) = _numbers(mass_element, "value", "nan", what)
    xx, yy, zz, xy, xz, yz = (_numbers(moments, key, "0", what)[0] for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not mass >= 0.0:
        raise _DamageError(f"{what}: its mass is {mass:g} kg")
    if not np.linalg.eigvalsh(tensor)[0] >= -_INDEFINITE * abs(xx + yy + zz):
        raise _DamageError(f"{what}: no body has its inertia (a principal moment is negative)")
    return InertialElement(mass, read_origin(element, what), tensor)


def _joint(element: ElementTree.Element) -> Joint:
    """Read one joint element."""
    name = _named(element, "a joint")
    what = f"joint {name}"
    kind = element.get("type")
    if kind not in KINDS:
        raise _DamageError(f"{what} is of the unknown type {kind!r}; URDF knows {', '.join(KINDS)}")
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = None if end is None else end.get("link")
        if not link:
            raise _DamageError(f"{what} lacks <{tag} link=>")
        ends.append(link)
    axis, limit, mimic, losses = (element.find(tag) for tag in ("axis", "limit", "mimic", "dynamics"))
    direction = np.array(_numbers(axis, "xyz", "1 0 0", what, 3))
    length = np.linalg.norm(direction)
    if kind not in ("fixed", "floating") and not length > 0.0:
        raise _DamageError(f"{what} has an axis of no length")
    x, y, z = direction / length if length > 0.0 else direction
    bounded = limit if kind in ("revolute", "prismatic") else None
    follows = None if mimic is None else mimic.get("joint")
    if mimic is not None and not follows:
        raise _DamageError(f"{what} lacks <mimic joint=>")
    (lower,), (upper,) = (_numbers(bounded, key, str(sign * inf), what) for key, sign in (("lower", -1), ("upper", 1)))
    if lower > upper:
        raise _DamageError(f"{what} has a lower limit of {lower:g} above its upper one of {upper:g}")
    # Some programs write -1 for a speed or an effort without a limit; 0 means that no limit is stated.
    most = {key: max(_numbers(limit, key, "0", what)[0], 0.0) for key in ("velocity", "effort")}
    lost = {key: _numbers(losses, key, "0", what)[0] for key in ("damping", "friction")}
    below = next((key for key, value in lost.items() if value < 0.0), None)
    if below is not None and kind != "fixed":
        raise _DamageError(f"{what} has a {below} below zero")
    return Joint(
        name,
        ends[0],
        ends[1],
        read_origin(element, what).transform(),
        kind,
        (x, y, z),
        lower=lower,
        upper=upper,
        velocity=most["velocity"],
        effort=most["effort"],
        follows=follows,
        multiplier=_numbers(mimic, "multiplier", "1", what)[0],
        offset=_numbers(mimic, "offset", "0", what)[0],
        damping=lost["damping"],
        friction=lost["friction"],
    )


def _ordered(links: Sequence[str], joints: Sequence[Joint]) -> tuple[str, tuple[Joint, ...]]:
    """Return the base link and the joints, parents first and otherwise in the file's order; refuse links that form no tree."""
    for names, what in ((links, "link"), ([joint.name for joint in joints], "joint"), ([j.child for j in joints], "child")):
        twice = next((name for name, count in Counter(names).items() if count > 1), None)
        if twice is not None:
            raise _DamageError(f"the links form no tree: '{twice}' is there twice as a {what}")
    there, called = set(links), {joint.name for joint in joints}
    for joint in joints:
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in there:
                raise _DamageError(f"the {end} of joint {joint.name}, '{name}', is not there: no <link> has that name")
        if joint.follows is not None and joint.follows not in called:
            raise _DamageError(f"joint {joint.name} follows '{joint.follows}', which is no joint")
    children = {joint.child for joint in joints}
    bases = [link for link in links if link not in children]
    if len(bases) != 1:
        raise _DamageError(
            f"the links form no tree: {len(bases)} links have no parent ({', '.join(bases) or 'they go in a circle'})"
        )
    # Go through the tree by generations from the base; within a generation keep the file's order.
    carried: dict[str, list[Joint]] = {}
    for joint in joints:
        carried.setdefault(joint.parent, []).append(joint)
    place = {joint.name: number for number, joint in enumerate(joints)}
    ordered, ready = list[Joint](), carried.get(bases[0], [])
    while ready:
        ordered += ready
        ready = sorted((below for joint in ready for below in carried.get(joint.child, [])), key=lambda one: place[one.name])
    if len(ordered) < len(joints):
        reached = {joint.name for joint in ordered}
        lost = next(joint.name for joint in joints if joint.name not in reached)
        raise _DamageError(f"the links form no tree: joint {lost} hangs on itself")
    return bases[0], tuple(ordered)
