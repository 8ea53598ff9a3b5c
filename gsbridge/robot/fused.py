"""The robot's description for a physics engine: a link on a fixed joint is merged into the link that carries it.

An engine goes through all links for every contact force and every step, whether they can move or not. Of the robot's 15 links,
four cannot move: the flange, the palm, the camera and the tool's frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.links import Inertia, inertial_element, joined_inertia, origin_element
from gsbridge.robot.urdf import read_description, read_origin

Load = Callable[[Inertia], Inertia]
"""Changes the mass properties of a link."""


def fused_description(urdf: str | Path, loads: Mapping[str, Sequence[Load]] | None = None) -> str:
    """Return a description with moving joints only: the same masses and collision shapes in fewer links, and no visuals.

    Args:
        urdf: The robot's description. Every link has mass properties.
        loads: By joint name, changes of the mass properties of the joint's child link. They apply to the child link alone,
            before the links that are fixed to it are merged into it.

    Returns:
        The new description. It names its meshes by absolute paths, so that it can be stored in any folder.

    Raises:
        InputError: The file cannot be used, or a link has no mass properties.
    """
    path, description = Path(urdf), read_description(urdf)
    for name in description.links:
        if name not in description.inertials:
            raise InputError(path, f"link '{name}' has no mass properties", "Build the robot again")
    robot = description.root
    links = dict(zip(description.links, robot.findall("link"), strict=True))
    elements = dict(zip(description.origins, robot.findall("joint"), strict=True))
    # For every link: the link that it is merged into, and its pose in that link's frame.
    homes: dict[str, tuple[str, Array]] = {name: (name, np.eye(4)) for name in description.links}
    bodies = {name: [inertial.seen_from(np.eye(4))] for name, inertial in description.inertials.items()}
    for joint in description.joints:
        for change in (loads or {}).get(joint.name, ()):
            bodies[joint.child] = [change(bodies[joint.child][0])]
    for joint in description.joints:
        home, home_from_parent = homes[joint.parent]
        home_from_child = home_from_parent @ joint.parent_from_child
        element, name = elements[joint.name], joint.child
        if joint.kind != "fixed":
            for parent in element.findall("parent"):
                parent.set("link", home)
            _place(element, home_from_child)
            continue
        homes[name] = (home, home_from_child)
        bodies[home].append(description.inertials[name].seen_from(home_from_child))
        for shape in links[name].findall("collision"):
            _place(shape, home_from_child @ read_origin(shape, name).transform())
            links[home].append(shape)
        robot.remove(links[name])
        robot.remove(element)
    for element in robot.findall("link"):
        for tag in ("visual", "inertial"):
            for old in element.findall(tag):
                element.remove(old)
        element.insert(0, inertial_element(joined_inertia(bodies[element.attrib["name"]])))
        for mesh in element.iter("mesh"):
            mesh.set("filename", str((path.parent / mesh.get("filename", "")).absolute()))
    return ElementTree.tostring(robot, encoding="unicode")


def _place(element: ElementTree.Element, transform: Array) -> None:
    """Replace the `origin` of an element by a transform. [4, 4]."""
    old = element.find("origin")
    if old is not None:
        element.remove(old)
    element.insert(0, origin_element(transform))
