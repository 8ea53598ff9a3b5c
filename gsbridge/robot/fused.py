"""The robot's description for an engine that moves it: links that a fixed joint holds are part of the link that they hang on.

An engine goes through all links for every contact force and every step, whether they can move or not. Of the robot's 15, four
cannot: the flange, the palm, the camera and the tool's frame.
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
    """A description with moving joints only: the same masses and shapes of contact in fewer links, and nothing to be drawn.

    Args:
        urdf: The robot's description. Every link has mass properties.
        loads: Changes of the mass properties of the link that each joint moves, by joint; links fixed to it do not count.

    Returns:
        The new description. Its meshes are named by absolute paths, so that it may lie anywhere.

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
    # Of every link: the one that it becomes part of, and its pose there.
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
    """Give an element another `origin`. [4, 4]."""
    old = element.find("origin")
    if old is not None:
        element.remove(old)
    element.insert(0, origin_element(transform))
