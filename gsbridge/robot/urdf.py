"""Reading the tree of a URDF: what kinematics and limits need of it, nothing more."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gsbridge.errors import InputError
from gsbridge.robot.links import Joint, rotation_from_rpy


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


def read_urdf(path: str | Path) -> Tree:
    """Read the tree of a robot's description.

    Raises:
        InputError: The file is missing, is no URDF, is no tree, or has a joint of another kind than fixed or revolute.
    """
    source = Path(path)
    try:
        robot = ElementTree.parse(source).getroot()
    except FileNotFoundError as error:
        raise InputError(source, "the robot's description does not exist", "Check the path, or build the robot") from error
    except ElementTree.ParseError as error:
        raise InputError(source, f"this is no valid XML ({error})", "Build the robot again") from error
    try:
        joints = [_read_joint(element) for element in robot.findall("joint")]
        links = [element.attrib["name"] for element in robot.findall("link")]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(source, f"a link or joint lacks what a URDF needs ({error})", "Build the robot again") from error
    for joint in joints:
        if joint.kind not in ("fixed", "revolute"):
            raise InputError(source, f"joint {joint.name} is {joint.kind}", "Only fixed and revolute joints are known here")
    return Tree(*_ordered(source, links, joints))


def _read_joint(element: ElementTree.Element) -> Joint:
    """One joint element."""
    origin, axis, limit, mimic = (element.find(tag) for tag in ("origin", "axis", "limit", "mimic"))
    placed = np.eye(4)
    if origin is not None:
        placed[:3, 3] = _three(origin.get("xyz", "0 0 0"))
        placed[:3, :3] = rotation_from_rpy(_three(origin.get("rpy", "0 0 0")))
    direction = np.array(_three("1 0 0" if axis is None else axis.attrib["xyz"]))
    if mimic is not None and float(mimic.get("offset", 0)) != 0:
        raise ValueError(f"{element.get('name')}: a coupling with an offset")
    bounds = {} if limit is None else {key: float(limit.get(key, 0)) for key in ("lower", "upper", "velocity", "effort")}
    return Joint(
        element.attrib["name"],
        element.find("parent").attrib["link"],
        element.find("child").attrib["link"],
        placed,
        element.attrib["type"],
        tuple(direction / np.linalg.norm(direction)),
        **bounds,
        follows=None if mimic is None else mimic.attrib["joint"],
        multiplier=1.0 if mimic is None else float(mimic.get("multiplier", 1)),
    )


def _three(text: str) -> tuple[float, float, float]:
    """Three numbers."""
    x, y, z = (float(value) for value in text.split())
    return x, y, z


def _ordered(source: Path, links: list[str], joints: list[Joint]) -> tuple[str, tuple[Joint, ...]]:
    """The base and the joints with parents first, otherwise in the file's order."""
    children = [joint.child for joint in joints]
    bases = [link for link in links if link not in children]
    if len(bases) != 1 or len(set(children)) != len(children):
        raise InputError(source, "the links form no tree with one base", "Build the robot again")
    known, ordered, waiting = {bases[0]}, [], list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in known]
        if not ready:
            raise InputError(source, f"the parent of joint {waiting[0].name} is not there", "Build the robot again")
        ordered += ready
        known |= {joint.child for joint in ready}
        waiting = [joint for joint in waiting if joint not in ready]
    return bases[0], tuple(ordered)
