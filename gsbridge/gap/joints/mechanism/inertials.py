"""Mass properties of a URDF's links, which can be changed and written out again without shapes, for replays in free space."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.errors import InputError
from gsbridge.gap.joints.mechanism.description import read_mechanism_description
from gsbridge.geometry import Array
from gsbridge.robot.urdf import Description, InertialElement, Origin


@dataclass
class Inertial:
    """Mass properties of a link.

    Args:
        mass: Mass, kg.
        centre: Centre of mass, link frame, m. [3].
        inertia: Inertia about the centre, link axes, kg m2. [3, 3].
    """

    mass: float
    centre: Array
    inertia: Array

    def scaled(self, factor: float) -> Inertial:
        """Return mass properties of the same shape with its density multiplied by `factor`."""
        return Inertial(self.mass * factor, self.centre.copy(), self.inertia * factor)

    def with_point(self, mass: float, place: Array) -> Inertial:
        """Return mass properties with a point mass (kg) added at `place` (link frame, m, [3])."""
        total = self.mass + mass
        if total <= 0:
            return Inertial(self.mass, self.centre.copy(), self.inertia.copy())
        centre = (self.mass * self.centre + mass * place) / total
        return Inertial(total, centre, self.about(centre) + mass * _steiner(place - centre))

    def about(self, point: Array) -> Array:
        """Compute the inertia about a point (link frame, m, [3]), kg m2. [3, 3]."""
        return self.inertia + self.mass * _steiner(self.centre - point)


def _steiner(arm: Array) -> Array:
    """Compute the inertia of a point mass of 1 kg at `arm` (m, [3]) about the origin, kg m2. [3, 3]."""
    return float(arm @ arm) * np.eye(3) - np.outer(arm, arm)


@dataclass
class Skeleton:
    """A URDF's links and joints, without shapes.

    Args:
        tree: Root element; it is never changed after reading.
        description: Links and joints of the file.
        inertials: Mass properties by link; links without any are left out.
        child_of: Name of the link that each moving joint moves.
    """

    tree: ElementTree.Element
    description: Description
    inertials: dict[str, Inertial]
    child_of: dict[str, str]

    @classmethod
    def read(cls, urdf: str | Path, moving: tuple[str, ...]) -> Skeleton:
        """Read a description; joints other than `moving` become fixed.

        Raises:
            InputError: The description cannot be used, or a moved link has no mass properties.
        """
        description = read_mechanism_description(urdf)
        root = description.root
        moved = {joint.name: joint.child for joint in description.joints}
        inertials = {name: _in_link_frame(element) for name, element in description.inertials.items()}
        out = cls(root, description, inertials, {name: moved[name] for name in description.origins})
        for link in root.findall("link"):
            for kind in ("visual", "collision", "inertial"):
                for part in link.findall(kind):
                    link.remove(part)
        for joint in root.findall("joint"):
            if joint.get("name") not in moving:
                joint.set("type", "fixed")
            for kind in ("dynamics", "mimic", "safety_controller", "calibration"):
                for element in joint.findall(kind):
                    joint.remove(element)
        for other in [item for item in root if item.tag not in ("link", "joint")]:
            root.remove(other)
        for name in moving:
            out._gather(out.child_of[name], moving)
            if out.child_of[name] not in out.inertials:
                raise InputError(
                    urdf, f"the link '{out.child_of[name]}' that joint '{name}' moves has no mass", "Add <inertial>"
                )
        return out

    def _gather(self, link: str, moving: tuple[str, ...]) -> None:
        """Give a link without mass the masses of the links fixed to it, since some files have separate links for masses."""
        if link in self.inertials:
            return
        places, parts = {link: np.eye(4)}, list[tuple[Inertial, Array]]()
        for joint in self.description.joints:
            if joint.name not in moving and joint.parent in places:
                places[joint.child] = places[joint.parent] @ joint.parent_from_child
                if joint.child in self.inertials:
                    parts.append((self.inertials.pop(joint.child), places[joint.child]))
        total = sum(part.mass for part, _ in parts)
        if total <= 0.0:
            return
        seen = [
            Inertial(part.mass, place[:3, :3] @ part.centre + place[:3, 3], place[:3, :3] @ part.inertia @ place[:3, :3].T)
            for part, place in parts
        ]
        centre = np.asarray(sum(part.mass * part.centre for part in seen) / total)
        self.inertials[link] = Inertial(total, centre, np.asarray(sum(part.about(centre) for part in seen)))

    def write(self, path: str | Path, inertials: Mapping[str, Inertial]) -> None:
        """Write the skeleton with the given mass properties."""
        root = copy.deepcopy(self.tree)
        for link in root.findall("link"):
            name = str(link.get("name"))
            body = inertials.get(name)
            if name == self.description.base:
                # The base never moves, but PyBullet takes gravity along its principal axes, which for a ball are the frame's.
                body = Inertial(1.0, np.zeros(3), np.eye(3))
            if body is None:
                continue
            moments, axes = np.diag(body.inertia), np.eye(3)
            if np.abs(body.inertia - np.diag(moments)).max() > 1e-12:
                # Engines treat products of inertia differently; all of them understand principal axes.
                moments, axes = np.linalg.eigh(body.inertia)
                axes[:, 0] *= np.sign(np.linalg.det(axes))
            rpy = _rpy(axes)
            element = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(element, "origin", xyz=_text(body.centre), rpy=_text(rpy))
            ElementTree.SubElement(element, "mass", value=repr(float(body.mass)))
            ElementTree.SubElement(
                element, "inertia", ixx=repr(float(moments[0])), iyy=repr(float(moments[1])), izz=repr(float(moments[2])),
                ixy="0", ixz="0", iyz="0",
            )  # fmt: skip
        ElementTree.ElementTree(root).write(path, encoding="unicode")


def _rpy(rotation: Array) -> Array:
    """Compute roll, pitch and yaw of a rotation, rad. [3, 3] -> [3]."""
    with warnings.catch_warnings():
        # At a pitch of 90 degrees, roll and yaw are not unique; the pair that scipy chooses is right.
        warnings.simplefilter("ignore", UserWarning)
        return Rotation.from_matrix(rotation).as_euler("xyz")


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def _in_link_frame(element: InertialElement) -> Inertial:
    turn = rotation_of(element.origin)
    return Inertial(element.mass, np.array(element.origin.xyz), turn @ element.tensor @ turn.T)


def rotation_of(origin: Origin) -> Array:
    """Make the rotation matrix of a URDF origin. [3, 3]."""
    return Rotation.from_euler("xyz", origin.rpy).as_matrix()
