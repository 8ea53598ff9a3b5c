"""A tree of joints with the mass properties they move, as arrays for the kernels; links on fixed joints are merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.errors import InputError
from gsbridge.gap.joints.mechanism.inertials import Inertial, Skeleton
from gsbridge.geometry import Array


@dataclass(frozen=True)
class Chain:
    """Joints of a mechanism, each after the one that carries it.

    Args:
        order: Column of each joint in the records.
        parents: Index of the joint that carries each, -1 for the base. [N] int.
        fixed: Pose of each joint's frame at zero in the frame of the joint that carries it. [N, 4, 4].
        axes: Direction, joint frame. [N, 3].
        slides: Whether the joint slides instead of turning. [N] bool.
        links: By link: index of the joint that moves it, and the link's pose in that joint's frame.
    """

    order: Array
    parents: Array
    fixed: Array
    axes: Array
    slides: Array
    links: Mapping[str, tuple[int, Array]]

    @classmethod
    def of(cls, skeleton: Skeleton, joints: tuple[str, ...], urdf: str | Path) -> Chain:
        """The tree of a description; joints other than `joints` are held at zero.

        Raises:
            InputError: The links form no tree.
        """
        elements = {joint.find("child").get("link"): joint for joint in skeleton.tree.findall("joint")}
        names = [str(link.get("name")) for link in skeleton.tree.findall("link")]
        roots = [name for name in names if name not in elements]
        if len(roots) != 1:
            raise InputError(urdf, f"its links form no single tree (roots: {', '.join(roots) or 'none'})", "Mend the URDF")
        links: dict[str, tuple[int, Array]] = {roots[0]: (-1, np.eye(4))}
        rows: list[tuple[int, int, Array, Array, bool]] = []
        waiting = [name for name in names if name in elements]
        while waiting:
            ready = [name for name in waiting if elements[name].find("parent").get("link") in links]
            if not ready:
                raise InputError(urdf, f"the link '{waiting[0]}' hangs on nothing", "Mend the URDF")
            for name in ready:
                joint = elements[name]
                carrier, place = links[joint.find("parent").get("link")]
                pose = place @ _pose(joint.find("origin"))
                if joint.get("name") in joints:
                    axis = joint.find("axis")
                    direction = np.array([1.0, 0.0, 0.0] if axis is None else [float(x) for x in axis.get("xyz").split()])
                    rows.append(
                        (joints.index(joint.get("name")), carrier, pose, direction / np.linalg.norm(direction),
                         joint.get("type") == "prismatic")
                    )  # fmt: skip
                    links[name] = (len(rows) - 1, np.eye(4))
                else:
                    links[name] = (carrier, pose)
            waiting = [name for name in waiting if name not in links]
        order, parents, fixed, axes, slides = (np.array(column) for column in zip(*rows, strict=True))
        return cls(order, parents, fixed, axes, slides, links)

    def place(self, link: str, q: Array) -> Array:
        """Where a link's frame is, base frame, m.

        Args:
            link: Its name.
            q: Positions in the order of the joints here. [T, N].

        Returns:
            [T, 3].
        """
        joint, pose = self.links[link]
        origin = np.tile(pose[:3, 3], (len(q), 1))
        # From the link back to the base: a point of each joint's frame in the frame of the one that carries it.
        while joint >= 0:
            axis, values = self.axes[joint], q[:, joint]
            if self.slides[joint]:
                origin = origin + values[:, None] * axis
            else:
                cosine, sine = np.cos(values)[:, None], np.sin(values)[:, None]
                along = (origin @ axis)[:, None] * axis
                origin = along + cosine * (origin - along) + sine * np.cross(axis, origin)
            turn, shift = self.fixed[joint][:3, :3], self.fixed[joint][:3, 3]
            origin = origin @ turn.T + shift
            joint = int(self.parents[joint])
        return origin

    def bodies(self, inertials: Mapping[str, Inertial]) -> Array:
        """Mass, centre (3) and inertia about it (9) of what each joint moves, joint frame. [N, 13]."""
        groups: list[list[tuple[float, Array, Array]]] = [[] for _ in self.parents]
        for name, body in inertials.items():
            joint, pose = self.links[name]
            if joint >= 0 and body.mass > 0:
                turn = pose[:3, :3]
                groups[joint].append((body.mass, turn @ body.centre + pose[:3, 3], turn @ body.inertia @ turn.T))
        out = np.zeros((len(self.parents), 13))
        for row, group in zip(out, groups, strict=True):
            row[0] = sum(mass for mass, _, _ in group)
            if row[0] == 0.0:
                continue
            row[1:4] = sum(mass * centre for mass, centre, _ in group) / row[0]
            total = np.zeros((3, 3))
            for mass, centre, inertia in group:
                arm = centre - row[1:4]
                total += inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
            row[4:] = total.ravel()
        return out


def _pose(origin: ElementTree.Element | None) -> Array:
    """Transform of a URDF `<origin>`. [4, 4]."""
    out = np.eye(4)
    if origin is not None:
        out[:3, 3] = [float(value) for value in origin.get("xyz", "0 0 0").split()]
        out[:3, :3] = Rotation.from_euler("xyz", [float(value) for value in origin.get("rpy", "0 0 0").split()]).as_matrix()
    return out
