"""A tree of joints and the mass properties that they move, as arrays for the kernels; links on fixed joints are merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.joints.mechanism.inertials import Inertial, Skeleton, rotation_of
from gsbridge.geometry import Array
from gsbridge.robot.urdf import Origin


@dataclass(frozen=True)
class Chain:
    """Joints of a mechanism, each after the one that carries it.

    Args:
        order: Column of each joint in the records. [N] int.
        parents: Index of the joint that carries each, -1 for the base. [N] int.
        fixed: Pose of each joint's frame at zero in the frame of the joint that carries it. [N, 4, 4].
        axes: Unit axis of each joint, joint frame. [N, 3].
        slides: Whether the joint slides instead of turning. [N] bool.
        links: By link: index of the joint that moves it, -1 for the base, and the link's pose in that joint's frame. [4, 4].
    """

    order: Array
    parents: Array
    fixed: Array
    axes: Array
    slides: Array
    links: Mapping[str, tuple[int, Array]]

    @classmethod
    def of(cls, skeleton: Skeleton, joints: tuple[str, ...]) -> Chain:
        """Build the tree of a description; joints other than `joints` are held at zero."""
        description = skeleton.description
        carriers = {joint.child: joint for joint in description.joints}
        links: dict[str, tuple[int, Array]] = {description.base: (-1, np.eye(4))}
        rows: list[tuple[int, int, Array, Array, bool]] = []
        waiting = [name for name in description.links if name != description.base]
        while waiting:
            for name in [name for name in waiting if carriers[name].parent in links]:
                joint = carriers[name]
                carrier, place = links[joint.parent]
                pose = place @ _pose(description.origins[joint.name])
                if joint.name in joints:
                    rows.append((joints.index(joint.name), carrier, pose, np.array(joint.axis), joint.kind == "prismatic"))
                    links[name] = (len(rows) - 1, np.eye(4))
                else:
                    links[name] = (carrier, pose)
            waiting = [name for name in waiting if name not in links]
        order, parents, fixed, axes, slides = (np.array(column) for column in zip(*rows, strict=True))
        return cls(order, parents, fixed, axes, slides, links)

    def place(self, link: str, q: Array) -> Array:
        """Compute the origin of a link's frame, base frame, m.

        Args:
            link: Name of the link.
            q: Positions in the order of the joints here, rad or m. [T, N].

        Returns:
            [T, 3].
        """
        joint, pose = self.links[link]
        return self.follow(joint, pose[:3, 3], q)

    def follow(self, joint: int, point: Array, q: Array) -> Array:
        """Compute the positions of a point that a joint moves, base frame, m.

        Args:
            joint: Index of the joint; -1 for the base.
            point: Point in the joint's frame, m. [3].
            q: Positions in the order of the joints here, rad or m. [T, N].

        Returns:
            [T, 3].
        """
        origin = np.tile(point, (len(q), 1))
        # Go back to the base: turn the point from each joint's frame into the frame of the joint that carries it.
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

    @property
    def outermost(self) -> int:
        """Index of the joint that the most others carry; of several, the one that is named last."""
        depths: list[int] = []
        for parent in self.parents.tolist():
            depths.append(0 if parent < 0 else depths[parent] + 1)
        return max(range(len(depths)), key=lambda k: (depths[k], int(self.order[k])))

    def end(self, tool: str = "") -> tuple[int, Array]:
        """Find the end of the mechanism.

        Args:
            tool: Link whose origin is the end; if empty, it is the farthest frame that the outermost joint carries.

        Returns:
            Index of the joint that moves the end, and the end's place in that joint's frame, m. [3].
        """
        if tool:
            joint, pose = self.links[tool]
            return joint, np.ascontiguousarray(pose[:3, 3])
        last = self.outermost
        places = [pose[:3, 3] for joint, pose in self.links.values() if joint == last]
        return last, np.ascontiguousarray(max(places, key=lambda place: float(np.linalg.norm(place))))

    def reach(self, joint: int, point: Array) -> float:
        """Return the farthest that a point can get from the base's origin by turning joints, m; infinite where one slides.

        Args:
            joint: Index of the joint that moves the point.
            point: Place of the point in that joint's frame, m. [3].
        """
        out = float(np.linalg.norm(point))
        while joint >= 0:
            out = np.inf if self.slides[joint] else out + float(np.linalg.norm(self.fixed[joint][:3, 3]))
            joint = int(self.parents[joint])
        return out

    def idle(self, bodies: Array) -> Array:
        """Find joints without inertia: neither they nor the joints that they carry move mass, or inertia about their axes.

        Args:
            bodies: Result of `bodies`. [N, 13].

        Returns:
            Whether each joint is without inertia, in the order of the records. [N] bool.
        """
        out = np.zeros(len(bodies), dtype=bool)
        busy = np.zeros(len(bodies), dtype=bool)
        for k in reversed(range(len(bodies))):
            axis, mass, centre, moments = self.axes[k], bodies[k, 0], bodies[k, 1:4], bodies[k, 4:].reshape(3, 3)
            arm = np.cross(axis, centre)
            resists = mass if self.slides[k] else axis @ moments @ axis + mass * (arm @ arm)
            busy[k] |= resists > 0.0
            out[self.order[k]] = not busy[k]
            if self.parents[k] >= 0:
                busy[self.parents[k]] |= busy[k]
        return out

    def bodies(self, inertials: Mapping[str, Inertial]) -> Array:
        """Compute mass, kg, centre (3), m, and inertia about it (9), kg m2, of what each joint moves, joint frame. [N, 13]."""
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


def _pose(origin: Origin) -> Array:
    """Make the transform of a URDF origin. [4, 4]."""
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = origin.xyz, rotation_of(origin)
    return out
