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
from gsbridge.robot.links import Inertia, inertial_element, joined_inertia, origin_element, rotation_from_rpy

Load = Callable[[Inertia], Inertia]
"""Changes the mass properties of a link."""


def fused_description(urdf: str | Path, loads: Mapping[str, Sequence[Load]] | None = None) -> str:
    """A description with moving joints only: the same masses and shapes of contact in fewer links, and nothing to be drawn.

    Args:
        urdf: The robot's description. Every link has mass properties, and parents come before their children.
        loads: By joint: changes of the mass properties of the link that it moves, links fixed to it aside.

    Returns:
        The new description. Its meshes are named by absolute paths, so that it may lie anywhere.

    Raises:
        InputError: The file is missing or damaged, or a link has no mass properties.
    """
    path = Path(urdf)
    try:
        robot = ElementTree.parse(path).getroot()
        links = {element.attrib["name"]: element for element in robot.findall("link")}
        # Of every link: the one that it becomes part of, and its pose there.
        homes: dict[str, tuple[str, Array]] = {name: (name, np.eye(4)) for name in links}
        bodies = {name: [_inertia(element, np.eye(4))] for name, element in links.items()}
        for joint in robot.findall("joint"):
            for change in (loads or {}).get(joint.attrib["name"], ()):
                name = joint.find("child").attrib["link"]
                bodies[name] = [change(bodies[name][0])]
        for joint in robot.findall("joint"):
            parent = joint.find("parent")
            home, home_from_parent = homes[parent.attrib["link"]]
            home_from_child = home_from_parent @ _pose(joint.find("origin"))
            name = joint.find("child").attrib["link"]
            if joint.attrib["type"] != "fixed":
                parent.set("link", home)
                _place(joint, home_from_child)
                continue
            homes[name] = (home, home_from_child)
            bodies[home].append(_inertia(links[name], home_from_child))
            for shape in links[name].findall("collision"):
                _place(shape, home_from_child @ _pose(shape.find("origin")))
                links[home].append(shape)
            robot.remove(links[name])
            robot.remove(joint)
    except FileNotFoundError as error:
        raise InputError(path, "the robot's description does not exist", "Build the robot") from error
    except (ElementTree.ParseError, AttributeError, KeyError, ValueError) as error:
        raise InputError(path, f"the robot's description is damaged ({error!r})", "Build the robot again") from error
    for element in robot.findall("link"):
        for tag in ("visual", "inertial"):
            for old in element.findall(tag):
                element.remove(old)
        element.insert(0, inertial_element(joined_inertia(bodies[element.attrib["name"]])))
        for mesh in element.iter("mesh"):
            mesh.set("filename", str((path.parent / mesh.get("filename", "")).absolute()))
    return ElementTree.tostring(robot, encoding="unicode")


def _pose(origin: ElementTree.Element | None) -> Array:
    """Transform of an `origin`. [4, 4]."""
    out = np.eye(4)
    if origin is not None:
        out[:3, 3] = [float(value) for value in origin.get("xyz", "0 0 0").split()]
        out[:3, :3] = rotation_from_rpy([float(value) for value in origin.get("rpy", "0 0 0").split()])
    return out


def _place(element: ElementTree.Element, transform: Array) -> None:
    """Give an element another `origin`. [4, 4]."""
    old = element.find("origin")
    if old is not None:
        element.remove(old)
    element.insert(0, origin_element(transform))


def _inertia(link: ElementTree.Element, home_from_link: Array) -> Inertia:
    """Mass properties of a link, in the frame of the link that it becomes part of."""
    inertial = link.find("inertial")
    placed = home_from_link @ _pose(inertial.find("origin"))
    entries = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}
    tensor = np.array([[entries["i" + "".join(sorted(row + column))] for column in "xyz"] for row in "xyz"])
    return Inertia(float(inertial.find("mass").attrib["value"]), placed[:3, 3], placed[:3, :3] @ tensor @ placed[:3, :3].T)
