"""Joint controller of the simulated robot: set points on the way to a goal, their delay, and torques."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.links import Joint
from gsbridge.robot.urdf import read_description
from gsbridge.sim.arm_setup import ENCODER, ArmSetup, sense
from gsbridge.sim.dynamics import joint_torques, link_poses, packed, plan_period, work_space
from gsbridge.sim.model import Model


def read_bodies(urdf: str | Path, links: tuple[str, ...]) -> Array:
    """Mass properties from a description.

    Args:
        urdf: The description.
        links: Names of links, in the order wanted.

    Returns:
        Mass, centre of mass (3), inertia about it (9) in the link frame; kg, m, kg m2. [L, 13].

    Raises:
        InputError: A link has no mass properties.
    """
    inertials = read_description(urdf).inertials
    out = np.zeros((len(links), 13))
    for row, name in zip(out, links, strict=True):
        if name not in inertials:
            raise InputError(urdf, f"link {name} has no mass properties", "Build the robot again")
        inertia = inertials[name].seen_from(np.eye(4))
        row[0], row[1:4], row[4:] = inertia.mass, inertia.centre, inertia.tensor.ravel()
    return out


class Controller:
    """Joint controller and drives with their state; independent of the physics engine.

    A goal is a posture of the arm and an opening of the gripper. In every control period the command moves towards the goal,
    all arm joints in proportion, as far as the speed limit of every joint allows. The set point is this piecewise linear
    command, averaged over the last period. Its speed, which is fed forward, therefore has no jumps that would jerk the arm;
    the price is a lag of half a period.

    Args:
        robot: The robot's files.
        kinematics: Kinematics of the arm.
        model: The simulation model.
        gravity: Acceleration in the base frame, m/s2. [3].

    Attributes:
        misread: Whether an effect of the model makes the encoders report other angles than the true ones.
    """

    def __init__(self, robot: RobotFiles, kinematics: Kinematics, model: Model, gravity: Array) -> None:
        self.model, self.dimensions = model, robot.dimensions
        tree = kinematics.tree
        index = {name: k for k, name in enumerate(tree.links)}
        self.limits = kinematics.arm_limits
        arm = kinematics.arm_joints
        moving = [-1, *(self._coordinate(joint, arm) for joint in tree.joints)]
        parents = [-1, *(index[joint.parent] for joint in tree.joints)]
        owner: list[int] = []
        for source, parent in zip(moving, parents, strict=True):
            owner.append(source if 0 <= source < len(arm) else -1 if parent < 0 else owner[parent])
        turns = [joint.kind == "revolute" for joint in tree.joints]
        d, g = self.dimensions, model.gripper
        self.setup = setup = ArmSetup(model, arm, self.limits.effort, gravity)
        width = len(arm) + 1
        self._arm = packed(
            parents=np.array(parents, dtype=np.int64),
            fixed=np.stack([np.eye(4), *(joint.parent_from_child for joint in tree.joints)]),
            axes=np.array(
                [(0.0, 0.0, 0.0), *(j.axis if turn else (0.0, 0.0, 0.0) for j, turn in zip(tree.joints, turns, strict=True))]
            ),
            sources=np.array(moving, dtype=np.int64),
            factors=np.array([0.0, *(j.multiplier if turn else 0.0 for j, turn in zip(tree.joints, turns, strict=True))]),
            bodies=read_bodies(robot.urdf, tree.links),
            owner=np.array(owner, dtype=np.int64),
            nodes=np.array([moving.index(k) for k in range(len(arm))], dtype=np.int64),
            gravity=np.asarray(gravity, dtype=np.float64),
            law=setup.rows(),
            grip=np.array([d.knuckle_y - d.pad_inset, d.bar, g.stiffness, g.damping, g.force, model.time_step, model.period]),
            plan=np.zeros((3, width)),
            slot=np.zeros(1, dtype=np.int64),
            memory=np.zeros((2, width)),
            known_inertia=np.zeros((len(arm), len(arm))),
            **work_space(len(tree.links), len(arm)),
            **setup.record(),
        )
        self._plan, self._substeps = self._arm["plan"][0], model.substeps
        self.misread = any(setup.law[name].any() for name in ENCODER)
        self.torques = np.zeros((2, width))
        self.reset(kinematics.rest, self.dimensions.stroke)

    @staticmethod
    def _coordinate(joint: Joint, arm: tuple[str, ...]) -> int:
        """Column of the coordinate that moves a joint, -1 for a fixed one."""
        if joint.kind != "revolute":
            return -1
        return arm.index(joint.name) if joint.name in arm else len(arm)

    def reset(self, q: Array, aperture: float, later: float = 0.0) -> None:
        """Hold a posture and an opening, with no earlier command still on its way.

        Args:
            q: Angles of the arm, rad. [N].
            aperture: Distance of the pads, m.
            later: Dead time of commands beyond the model's until the next call, s.
        """
        self.point = np.append(q, aperture)
        self.goal = self.point.copy()
        delay, g = self.setup.delay + later, self.model.gripper
        # Not in the record, since its length depends on the delay: the kernels would be compiled anew for every other delay.
        self._ring = np.zeros((round(delay / self.model.time_step) + 1, 2, len(self.point)))
        self._ring[:, 0] = self.point
        # Largest lead of the opening's set point over the fingers: enough for the full force, and for moving fingers.
        self._pressing = g.force / g.stiffness + g.speed * (self.model.period + delay)
        self._arm["slot"], self._arm["memory"], self._arm["started"] = 0, 0.0, 0
        self._plan[:] = self.point, 0.0 * self.point, 0.0 * self.point

    def aim(self, q: Array, aperture: float) -> None:
        """Set the goal. q [N], aperture in m."""
        self.goal = np.empty(len(self.point))
        self.goal[:-1], self.goal[-1] = q, min(max(aperture, 0.0), self.dimensions.stroke)

    def begin_period(self, opening: float) -> None:
        """Choose where the command stands at the end of the coming control period.

        The gripper's command starts from the measured opening. Otherwise fingers that press on a wide object would let go only
        when the set point had come back from 0, many steps after the command to open.

        Args:
            opening: Measured distance of the pads, m.
        """
        plan_period(self._arm, self.goal, self.point, opening, self._pressing, self.limits.velocity, self.model.gripper.speed)

    def substep(self, number: int, measured: Array) -> Array:
        """Torques of one physics step.

        Args:
            number: Step within the control period, from 0.
            measured: Angles and speeds of the arm and of the gripper's driver. [2, N + 1].

        Returns:
            Torques for the engine and motor torques, N m; overwritten by the next call. [2, N + 1].
        """
        joint_torques(self._arm, self._ring, (number + 1) / self._substeps, measured, self.torques)
        return self.torques

    def sense(self, measured: Array) -> Array:
        """Return the angles and speeds that the encoders report for the true ones. [2, N + 1] -> [2, N + 1]."""
        if not self._arm["plays"][0, 0]:
            return measured
        self._arm["seen"][0] = measured
        sense(self._arm[0], measured)
        return self._arm["seen"][0]

    def place_links(self, measured: Array, table_from_base: Array) -> Array:
        """`table_from_link` of all links in the tree's order. measured [2, N + 1], table_from_base [4, 4] -> [L, 4, 4]."""
        out = np.empty((len(self._arm["parents"][0]), 4, 4))
        link_poses(self._arm, measured, table_from_base, out)
        return out
