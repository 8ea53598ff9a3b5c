"""Forward and inverse kinematics of a robot's description, in double precision and independent of any physics engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.chain import place_links, solve_inverse, tool_jacobian
from gsbridge.robot.limits import JointLimits
from gsbridge.robot.nominal import REST_POSTURE
from gsbridge.robot.urdf import Tree, read_urdf

TOLERANCE = 1e-7
"""Error at which inverse kinematics stops, m (and rad times 0.3 m)."""

ITERATIONS = 200

REACHED_M, REACHED_RAD = 1e-4, 1e-3
"""Errors up to which a pose counts as reached: a tenth of a millimetre is far below what the arm's control can follow."""


@dataclass(frozen=True)
class Inverse:
    """Result of inverse kinematics.

    Args:
        q: Arm joints, within their limits, rad. [N].
        position_error_m: Distance of the tool from the wanted point, m.
        angle_error_rad: Angle between the tool's and the wanted axes, rad.
        converged: Whether both errors are small enough for the pose to count as reached.
        iterations: Number of steps taken.
    """

    q: Array
    position_error_m: float
    angle_error_rad: float
    converged: bool
    iterations: int


@dataclass(frozen=True)
class Kinematics:
    """Forward and inverse kinematics of one robot. The coordinates `q` are its independent joints; coupled joints follow them.

    Args:
        tree: Links and joints.
        rest: Posture that the arm prefers among those with the same tool pose, rad. [N].
        tip: Link that inverse kinematics brings to the wanted pose.
    """

    tree: Tree
    rest: Array
    tip: str = "tool"

    @classmethod
    def read(cls, urdf: str | Path, rest: Array | Sequence[float] = REST_POSTURE, tip: str = "tool") -> Kinematics:
        """Read a description.

        Args:
            urdf: File of the description.
            rest: Posture that is preferred where the tool's pose leaves a choice, rad. [N].
            tip: Name of the link that inverse kinematics brings to the wanted pose.

        Raises:
            InputError: The file cannot be used, has no link `tip`, or the rest posture does not fit its arm.
        """
        tree = read_urdf(urdf)
        if tip not in tree.links:
            raise InputError(urdf, f"the description has no link '{tip}'", "Build the robot again")
        out = cls(tree, np.asarray(rest, dtype=np.float64), tip)
        limits = out.arm_limits
        if out.rest.shape != limits.lower.shape or not limits.inside(out.rest).all():
            raise InputError(
                "rest posture", "it does not fit the arm's joints and their limits", "Give one angle per arm joint"
            )
        return out

    _index: dict[str, int] = field(init=False, repr=False, compare=False)
    _parents: Array = field(init=False, repr=False, compare=False)
    _fixed: Array = field(init=False, repr=False, compare=False)
    _axes: Array = field(init=False, repr=False, compare=False)
    _source: Array = field(init=False, repr=False, compare=False)
    _factor: Array = field(init=False, repr=False, compare=False)
    _arm_nodes: Array = field(init=False, repr=False, compare=False)
    _arm_limits: JointLimits = field(init=False, repr=False, compare=False)
    _pull: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        joints, index = self.tree.joints, {name: k for k, name in enumerate(self.tree.links)}
        names = [joint.name for joint in self.tree.independent]
        arrays = {
            "_index": index,
            # Node 0 is the base; node k + 1 is the child link of joint k.
            "_parents": np.array([-1, *(index[joint.parent] for joint in joints)], dtype=np.int64),
            "_fixed": np.stack([np.eye(4), *(joint.parent_from_child for joint in joints)]),
            "_axes": np.array([(0.0, 0.0, 0.0), *(j.axis if j.kind == "revolute" else (0.0, 0.0, 0.0) for j in joints)]),
            "_source": np.array([-1, *(names.index(j.follows or j.name) if j.kind == "revolute" else -1 for j in joints)]),
            "_factor": np.array([0.0, *(j.multiplier if j.kind == "revolute" else 0.0 for j in joints)]),
        }
        for key, value in arrays.items():
            object.__setattr__(self, key, value)
        nodes = np.array(self._path(self.tip), dtype=np.int64)
        # The last joint only turns the hand. If it were drawn to rest, too, the elbow would swing aside to keep the hand's yaw.
        pull = np.arange(len(nodes)) < len(nodes) - 1
        for key, value in (
            ("_arm_nodes", nodes),
            ("_arm_limits", JointLimits.of([joints[node - 1] for node in nodes])),
            ("_pull", pull.astype(np.float64)),
        ):
            object.__setattr__(self, key, value)

    def _path(self, link: str) -> list[int]:
        """Return the nodes of the moving joints on the path from the base to a link."""
        node, path = self._node(link), []
        while node > 0:
            if self._source[node] >= 0:
                path.append(node)
            node = int(self._parents[node])
        return path[::-1]

    def _node(self, link: str) -> int:
        """Return the node index of a link, or raise an `InputError` if there is no such link."""
        if link not in self._index:
            raise InputError(f"link '{link}'", "the robot has no such link", f"Use one of: {', '.join(self.tree.links)}")
        return self._index[link]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the coordinates `q`: the arm's joints, then the gripper's driver."""
        return tuple(joint.name for joint in self.tree.independent)

    @property
    def arm_joints(self) -> tuple[str, ...]:
        """Names of the joints that move the tip."""
        return tuple(self.tree.joints[node - 1].name for node in self._arm_nodes)

    @property
    def arm_limits(self) -> JointLimits:
        """Limits of the joints that move the tip."""
        return self._arm_limits

    def joint_values(self, q: Array) -> dict[str, Array]:
        """Return the value of every moving joint, rad, coupled ones included, by name. q [..., Q] -> each [...]."""
        q = self._checked(q)
        return {
            joint.name: self._factor[k + 1] * q[..., self._source[k + 1]]
            for k, joint in enumerate(self.tree.joints)
            if joint.kind == "revolute"
        }

    def _checked(self, q: Array) -> Array:
        """Return all coordinates as float64; if only the arm's are given, the gripper gets 0 (bars along the tool's axis)."""
        out = np.asarray(q, dtype=np.float64)
        count, arm = len(self.joints), len(self._arm_nodes)
        if out.ndim == 0 or out.shape[-1] not in (count, arm):
            raise ValueError(f"expected {count} joint values (or {arm} of the arm), got the shape {out.shape}")
        if out.shape[-1] < count:
            out = np.concatenate([out, np.zeros((*out.shape[:-1], count - arm))], axis=-1)
        return out

    def poses(self, q: Array) -> Array:
        """Return `base_from_link` of all links in the order of `tree.links`. q [..., Q] -> [..., L, 4, 4]."""
        q = self._checked(q)
        values = np.where(self._source >= 0, q[..., self._source] * self._factor, 0.0)
        # Indexing may change the memory order, and numba would compile its kernels a second time for another order.
        flat = np.ascontiguousarray(values.reshape(-1, values.shape[-1]))
        out = np.empty((*flat.shape, 4, 4))
        for row, place in zip(flat, out, strict=True):
            place_links(self._parents, self._fixed, self._axes, row, place)
        return out.reshape(*values.shape, 4, 4)

    def fk(self, q: Array, links: Sequence[str] | None = None) -> dict[str, Array]:
        """Compute the poses of links by forward kinematics.

        Args:
            q: Coordinates in the order of `joints`, rad; or the arm's alone. [..., Q].
            links: Links whose poses are wanted; None for all.

        Returns:
            `base_from_link` by link name. Each [..., 4, 4].

        Raises:
            InputError: The robot has no such link.
        """
        nodes = {link: self._node(link) for link in (self.tree.links if links is None else links)}
        poses = self.poses(q)
        return {link: poses[..., node, :, :] for link, node in nodes.items()}

    def jacobian(self, q: Array, link: str | None = None) -> Array:
        """Compute the geometric Jacobian of a link's origin.

        Args:
            q: Coordinates, or the arm's alone, rad. [Q].
            link: The link; None for the tip.

        Returns:
            Velocity of the origin (m/s, three rows) and angular velocity (rad/s, three rows) in the base frame per rad/s of
            each coordinate; a coupled joint counts for the coordinate it follows. [6, number of coordinates].
        """
        poses = self.poses(q)
        nodes = np.array(self._path(link or self.tip), dtype=np.int64)
        parts = np.empty((6, len(nodes)))
        tool_jacobian(self._axes, nodes, poses, self._node(link or self.tip), parts)
        out = np.zeros((6, len(self.joints)))
        for column, node in zip(parts.T, nodes, strict=True):
            out[:, self._source[node]] += self._factor[node] * column
        return out

    def inverse(
        self, base_from_tool: Array, start: Array | None = None, *, tolerance: float = TOLERANCE, iterations: int = ITERATIONS
    ) -> Inverse:
        """Find arm joints that bring the tip to a pose; where several do, prefer those near the rest posture.

        The method is damped least squares on the whole pose; a step leaves out joints that it would push beyond their limits.
        The remaining freedom (the elbow) is drawn to the rest posture until it no longer moves, so that the answer depends on
        the wanted pose and hardly on the start.

        Args:
            base_from_tool: Wanted pose of the tip, m. [4, 4].
            start: Arm joints to begin from, rad, usually the last command; None for the rest posture. [N].
            tolerance: Error at which to stop, m (and rad times 0.3 m).
            iterations: Largest number of steps.

        Returns:
            The best joints found, whether they reach the pose or not.

        Raises:
            InputError: The wanted pose or the start is not finite.

        Source: damping after Sugihara, IEEE T-RO 27(5), 2011.
        """
        target = np.array(base_from_tool, dtype=np.float64)
        limits = self.arm_limits
        q = np.array(self.rest if start is None else start, dtype=np.float64)
        fits = target.shape == (4, 4) and q.shape == self.rest.shape
        if not fits or not all(map(isfinite, (*target.ravel().tolist(), *q.tolist()))):
            raise InputError("inverse kinematics", "the pose or the start is no finite pose", "Check the command for NaN")
        position, angle, done = solve_inverse(
            self._parents, self._fixed, self._axes, self._arm_nodes, self._node(self.tip), target, self.rest, self._pull,
            limits.lower, limits.upper, tolerance, iterations, q,
        )  # fmt: skip
        reached = position <= REACHED_M and angle <= REACHED_RAD
        return Inverse(q, float(position), float(angle), bool(reached), int(done))
