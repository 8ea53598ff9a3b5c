"""One description of the whole robot: KUKA LBR iiwa, gripper, wrist camera and tool frame, with its meshes beside it.

The arm's tree, masses and meshes are those of the iiwa that PyBullet's data package ships (BSD licence; its notice is kept in
the file). Three things are changed on purpose. Joint limits are those of the data sheet. Damping is zero, because the model of
the simulation sets it. The base has a mass of 5 kg, because other engines refuse a body without mass; the world fixes the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pybullet_data

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, read_json, write_json
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.robot.gripper import DRIVER, PADS, GripperDimensions, gripper_links
from gsbridge.robot.links import (
    Colour,
    Joint,
    Link,
    box,
    inertial_element,
    joint_element,
    numbers,
    origin_element,
    solid_inertia,
    support_hull,
    translation,
)
from gsbridge.robot.nominal import REST_POSTURE, flange_from_gripper
from gsbridge.robot.nominal import flange_from_camera as nominal_camera

URDF, RECORD = "robot.urdf", "robot.json"
LARGEST_REACH = 10.0
"""Largest coordinate of a pose, m; a larger one is taken for a value in millimetres."""

ARM_LINKS = tuple(f"lbr_iiwa_link_{index}" for index in range(8))
ARM_JOINTS = tuple(f"lbr_iiwa_joint_{index}" for index in range(1, 8))

FLANGE_HEIGHT = 0.045
"""Height of the media flange over the last arm link's frame, m: the height at which that link's mesh ends."""

ARM_VELOCITY_DEG = (85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0)
"""Joint speed limits, deg/s. Source: KUKA LBR iiwa 14 R820 specification, axis data."""

ARM_EFFORT = (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0)
"""Joint torque limits, N m. Source: as above."""

BASE_MASS = 5.0
HULL_DIRECTIONS = 400

CAMERA_MASS = 0.072
CAMERA_SIZE = (0.090, 0.025, 0.025)
"""Width, height, depth of the camera body, m, and its mass, kg. Source: Intel RealSense D435i data sheet."""

_GREY: Colour = (0.75, 0.75, 0.74)
_ORANGE: Colour = (0.92, 0.45, 0.10)
_ALUMINIUM: Colour = (0.60, 0.61, 0.62)
ARM_COLOURS: tuple[Colour, ...] = (_GREY, _GREY, _GREY, _ORANGE, _GREY, _GREY, _ORANGE, _ALUMINIUM)


@dataclass(frozen=True)
class RobotFiles:
    """Files of the robot that `build_robot` wrote.

    Args:
        folder: Folder of the description and its meshes.
        record: Content of `robot.json`.
    """

    folder: Path
    record: Mapping[str, Any]

    @property
    def urdf(self) -> Path:
        """Path of the description for physics engines."""
        return self.folder / URDF

    @property
    def dimensions(self) -> GripperDimensions:
        """Dimensions of the gripper that the robot was built with."""
        values = dict(self.record["gripper"]["dimensions"])
        return GripperDimensions(**{**values, "pad_size": tuple(values["pad_size"])})

    @property
    def flange_from_camera(self) -> Array:
        """Pose of the wrist camera, OpenCV axes. [4, 4]."""
        return np.array(self.record["flange_from_camera"])

    @property
    def flange_from_tool(self) -> Array:
        """Pose of the tool frame. [4, 4]."""
        return np.array(self.record["flange_from_tool"])

    def visuals(self) -> dict[str, list[tuple[Mesh, Colour]]]:
        """Read the drawn meshes of every link, link frame, m, with their sRGB colours; links without meshes are left out."""
        return {
            link: [(read_mesh(self.folder / item["mesh"]), tuple(item["colour"])) for item in items]
            for link, items in self.record["visuals"].items()
        }

    @classmethod
    def read(cls, folder: str | Path) -> RobotFiles:
        """Read the files that `build_robot` wrote.

        Raises:
            InputError: The folder holds no complete robot.
        """
        record = read_json(Path(folder) / RECORD)
        needed = [Path(folder) / URDF, *(Path(folder) / item["mesh"] for items in record["visuals"].values() for item in items)]
        for path in needed:
            if not path.is_file():
                raise InputError(path, "the robot's description is incomplete", "Build the robot again")
        return cls(Path(folder), record)


def build_robot(
    folder: str | Path, dimensions: GripperDimensions | None = None, flange_from_camera: Array | None = None
) -> RobotFiles:
    """Write the robot's description: `robot.urdf`, `robot.json` and OBJ meshes. The same input gives the same bytes.

    Args:
        folder: Folder to create; an existing one is replaced as a whole.
        dimensions: Dimensions of the gripper; None for the Robotiq 2F-140.
        flange_from_camera: Pose of the wrist camera, OpenCV axes, m; None for the nominal one. [4, 4].

    Returns:
        The files. Links besides the arm's: `flange` (KUKA's), `palm` (gripper frame), `left_bar`, `left_pad`, `right_bar`,
        `right_pad`, `tool` (between the pads, z along the approach), `camera` (OpenCV axes).

    Raises:
        InputError: The camera pose is no rigid transform.
    """
    d = dimensions or GripperDimensions()
    camera = check_rigid(nominal_camera() if flange_from_camera is None else flange_from_camera, "flange_from_camera")
    data = Path(pybullet_data.getDataPath()) / "kuka_iiwa"
    source = (data / "model.urdf").read_text(encoding="utf-8")
    robot = ElementTree.fromstring(source)
    robot.set("name", "gsbridge_iiwa_2f140")
    # Everything before the root is the arm's licence and history.
    header = source[: source.index("<robot")].rstrip() + "\n"
    with atomic_directory(folder) as temporary:
        visuals: dict[str, list[dict[str, Any]]] = {}
        for material in robot.findall("material"):
            robot.remove(material)
        for index, name in enumerate(ARM_LINKS):
            visuals[name] = _arm_link(_named(robot, "link", name), data / "meshes" / f"link_{index}.obj", index, temporary)
        for index, name in enumerate(ARM_JOINTS):
            joint = _named(robot, "joint", name)
            limit, losses = _part(joint, "limit"), _part(joint, "dynamics")
            limit.set("velocity", numbers([np.deg2rad(ARM_VELOCITY_DEG[index])]))
            limit.set("effort", numbers([ARM_EFFORT[index]]))
            losses.set("damping", "0")
            losses.set("friction", "0")
        links, joints = _hand(d, camera)
        for link in links:
            robot.append(_link_element(link, temporary, visuals))
        robot.extend(joint_element(joint) for joint in joints)
        # Settings for MuJoCo: keep links without mass, keep drawn shapes, and read meshes by the paths given here.
        extension = ElementTree.SubElement(robot, "mujoco")
        ElementTree.SubElement(extension, "compiler", fusestatic="false", discardvisual="false", strippath="false")
        ElementTree.indent(robot)
        body = ElementTree.tostring(robot, encoding="unicode")
        (temporary / URDF).write_text(header + body + "\n", encoding="utf-8")
        write_json(temporary / RECORD, _record(robot, d, camera, visuals))
    return RobotFiles(Path(folder), read_json(Path(folder) / RECORD))


def check_rigid(matrix: Array, source: str) -> Array:
    """Check that a matrix given by a user is a rigid transform, and return it as float64. [4, 4].

    Raises:
        InputError: The shape is wrong, a value is not finite, or the upper left block is not a rotation.
    """
    out = np.array(matrix, dtype=np.float64)
    rigid = out.shape == (4, 4) and np.isfinite(out).all() and np.allclose(out[3], [0, 0, 0, 1], atol=1e-9)
    if not (rigid and np.allclose(out[:3, :3].T @ out[:3, :3], np.eye(3), atol=1e-6) and np.linalg.det(out[:3, :3]) > 0):
        raise InputError(source, "this is no rigid transform", "Give a 4x4 matrix: a rotation and a translation in metres")
    return out


def check_reach(poses: Array, source: str | Path) -> Array:
    """Check that no coordinate of rigid transforms exceeds `LARGEST_REACH`, and return them. [..., 4, 4].

    The parts of a table-top arm are never that far apart.

    Raises:
        InputError: A coordinate is larger, so the pose was probably given in millimetres.
    """
    farthest = float(np.abs(poses[..., :3, 3]).max(initial=0.0))
    if farthest > LARGEST_REACH:
        raise InputError(source, f"a pose is {farthest:.4g} m away: it looks like millimetres", "Give metres")
    return poses


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write vertices, rounded to a micrometre, and triangles; a general exporter may write other bytes in another version."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices + 0.0]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    path.write_text("\n".join(lines).replace("-0.000000", "0.000000") + "\n", encoding="utf-8")


def _named(robot: ElementTree.Element, tag: str, name: str) -> ElementTree.Element:
    """Return the child element with this tag and name, or raise as `_part` does."""
    return _part(robot, f"{tag}[@name='{name}']")


def _part(element: ElementTree.Element, path: str) -> ElementTree.Element:
    """Return the element at `path` below an element of the description; raise an `InputError` if it is missing."""
    found = element.find(path)
    if found is None:
        raise InputError("pybullet_data", f"its iiwa has no {path}", "Install the pinned version of pybullet")
    return found


def _arm_link(element: ElementTree.Element, source: Path, index: int, folder: Path) -> list[dict[str, Any]]:
    """Replace the shapes of one arm link by gsbridge's mesh, hull and colour, and return its visuals for the record."""
    if index == 0:
        _part(element, "inertial/mass").set("value", numbers([BASE_MASS]))
    loaded = read_mesh(source).trimesh()
    # The source repeats vertices for each smoothing group; merge them, as only positions are needed here.
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    mesh = Mesh(np.asarray(loaded.vertices), np.asarray(loaded.faces))
    names = f"arm_{index}.obj", f"arm_{index}_hull.obj"
    write_obj(folder / names[0], mesh)
    write_obj(folder / names[1], support_hull(mesh.vertices, HULL_DIRECTIONS))
    for old in (*element.findall("visual"), *element.findall("collision")):
        element.remove(old)
    element.append(_visual(names[0], names[0].removesuffix(".obj"), ARM_COLOURS[index]))
    element.append(_collision(names[1], None, None))
    return [{"mesh": names[0], "colour": ARM_COLOURS[index]}]


def _hand(d: GripperDimensions, flange_from_camera: Array) -> tuple[list[Link], list[Joint]]:
    """Return the links and joints beyond the arm's last link: flange, gripper, camera and tool."""
    links, joints = gripper_links(d, "flange", flange_from_gripper())
    width, height, depth = CAMERA_SIZE
    # The optical centre lies just in front of the body, so that the camera never sees its own housing.
    housing = (box(CAMERA_SIZE, (0.0, 0.0, -depth / 2 - 0.002), (0.70, 0.71, 0.72)),)
    camera = Link("camera", housing, solid_inertia(housing, CAMERA_MASS / (width * height * depth)))
    flange = Joint("flange_joint", ARM_LINKS[-1], "flange", translation(0.0, 0.0, FLANGE_HEIGHT))
    return (
        [Link("flange"), *links, camera, Link("tool")],
        [
            flange,
            *joints,
            Joint("camera_joint", "flange", "camera", flange_from_camera),
            Joint("tool_joint", "flange", "tool", flange_from_gripper() @ d.gripper_from_tool),
        ],
    )


def _link_element(link: Link, folder: Path, visuals: dict[str, list[dict[str, Any]]]) -> ElementTree.Element:
    """Write a link's meshes and return its element; its visuals are added to `visuals`."""
    out = ElementTree.Element("link", name=link.name)
    out.append(inertial_element(link.inertia))
    for index, part in enumerate(link.parts):
        name = link.name if len(link.parts) == 1 else f"{link.name}_{index}"
        write_obj(folder / f"{name}.obj", part.mesh)
        out.append(_visual(f"{name}.obj", name, part.colour))
        visuals.setdefault(link.name, []).append({"mesh": f"{name}.obj", "colour": part.colour})
        out.append(_collision(f"{name}.obj", part.extents, part.centre()))
    return out


def _visual(mesh: str, material: str, colour: Colour) -> ElementTree.Element:
    """Return the element `visual` of a mesh in the link frame."""
    out = ElementTree.Element("visual")
    out.append(origin_element(np.eye(4)))
    geometry = ElementTree.SubElement(out, "geometry")
    ElementTree.SubElement(geometry, "mesh", filename=mesh)
    ElementTree.SubElement(ElementTree.SubElement(out, "material", name=material), "color", rgba=numbers((*colour, 1.0)))
    return out


def _collision(mesh: str, extents: tuple[float, float, float] | None, centre: Array | None) -> ElementTree.Element:
    """Return the element `collision` of a box (extents and centre, m) or, without extents, of a convex mesh; link frame."""
    out = ElementTree.Element("collision")
    out.append(origin_element(np.eye(4) if extents is None or centre is None else translation(*centre)))
    geometry = ElementTree.SubElement(out, "geometry")
    if extents is None:
        ElementTree.SubElement(geometry, "mesh", filename=mesh)
    else:
        ElementTree.SubElement(geometry, "box", size=numbers(extents))
    return out


def _record(
    robot: ElementTree.Element, d: GripperDimensions, flange_from_camera: Array, visuals: Mapping[str, Any]
) -> dict[str, Any]:
    """Return names and numbers that other modules look up here instead of guessing them from the URDF."""
    moving = [joint for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    coupled = {
        joint.get("name"): 1.0 if joint.find("mimic") is None else float(_part(joint, "mimic").attrib["multiplier"])
        for joint in moving
        if joint.get("name") not in ARM_JOINTS
    }
    masses = {link.get("name"): float(_part(link, "inertial/mass").attrib["value"]) for link in robot.findall("link")}
    return {
        "urdf": URDF,
        "arm_joints": ARM_JOINTS,
        "arm_links": ARM_LINKS,
        "rest_posture": REST_POSTURE,
        "base": ARM_LINKS[0],
        "flange": "flange",
        "tool": "tool",
        "camera": "camera",
        "gripper": {
            "driver": DRIVER,
            "joints": coupled,
            "pads": PADS,
            "closed_angle": d.closed_angle,
            "open_angle": d.open_angle,
            "dimensions": vars(d),
        },
        "flange_from_camera": flange_from_camera,
        "flange_from_gripper": flange_from_gripper(),
        "flange_from_tool": flange_from_gripper() @ d.gripper_from_tool,
        "limits": {joint.get("name"): {k: float(v) for k, v in _part(joint, "limit").attrib.items()} for joint in moving},
        "masses": masses,
        "visuals": visuals,
    }
