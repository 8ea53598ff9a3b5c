"""Kernels of the arm's controller: gravity torques, joint-space inertia and the torque law, once per physics step.

The chain is that of `gsbridge.robot.chain`: nodes with parents first. Every node belongs to the last arm joint above it. The
motion of the fingers changes where the hand's mass is, but adds no coordinates.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.robot.chain import cholesky_solve, place_links
from gsbridge.sim.arm_setup import play_drives, rub_joints, sense, shape_commands


@njit(nogil=True)
def arm_inertia(a: np.record) -> None:
    """Joint-space inertia of the arm and the torques that hold its weight, by composite bodies about the base's origin.

    Args:
        a: Record of the arm, see `joint_torques`; `inertia` and `weight` are filled.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2.
    """
    axes, poses, bodies, owner, nodes, gravity = a.axes, a.poses, a.bodies, a.owner, a.nodes, a.gravity
    inertia, weight, mass, moment, about, turn, move = a.inertia, a.weight, a.mass, a.moment, a.about, a.turn, a.move
    centre, part, push, force, torque, spare = a.centre, a.part, a.push, a.force, a.torque, a.spare
    count = len(nodes)
    mass[:], moment[:], about[:] = 0.0, 0.0, 0.0
    for k in range(len(bodies)):
        joint, kilos = owner[k], bodies[k, 0]
        if joint < 0 or kilos == 0.0:
            continue
        square = 0.0
        for i in range(3):
            centre[i] = poses[k, i, 3]
            for j in range(3):
                centre[i] += poses[k, i, j] * bodies[k, 1 + j]
            square += centre[i] * centre[i]
            for j in range(3):
                part[i, j] = 0.0
                for m in range(3):
                    part[i, j] += poses[k, i, m] * bodies[k, 4 + 3 * m + j]
        mass[joint] += kilos
        for i in range(3):
            moment[joint, i] += kilos * centre[i]
            for j in range(3):
                value = -kilos * centre[i] * centre[j]
                for m in range(3):
                    value += part[i, m] * poses[k, j, m]
                if i == j:
                    value += kilos * square
                about[joint, i, j] += value
    for joint in range(count - 2, -1, -1):
        mass[joint] += mass[joint + 1]
        for i in range(3):
            moment[joint, i] += moment[joint + 1, i]
            for j in range(3):
                about[joint, i, j] += about[joint + 1, i, j]
    for joint in range(count):
        k = nodes[joint]
        for i in range(3):
            turn[joint, i] = poses[k, i, 0] * axes[k, 0] + poses[k, i, 1] * axes[k, 1] + poses[k, i, 2] * axes[k, 2]
        cross(poses[k, 0, 3], poses[k, 1, 3], poses[k, 2, 3], turn[joint], move[joint])
    for j in range(count):
        h = moment[j]
        # Momentum of everything behind joint j when it alone turns at unit speed.
        cross(h[0], h[1], h[2], move[j], spare)
        cross(h[0], h[1], h[2], turn[j], push)
        for i in range(3):
            force[i] = mass[j] * move[j, i] - push[i]
            torque[i] = spare[i] + about[j, i, 0] * turn[j, 0] + about[j, i, 1] * turn[j, 1] + about[j, i, 2] * turn[j, 2]
        for i in range(j + 1):
            value = 0.0
            for m in range(3):
                value += turn[i, m] * torque[m] + move[i, m] * force[m]
            inertia[i, j] = value
            inertia[j, i] = value
        cross(h[0], h[1], h[2], gravity, spare)
        weight[j] = 0.0
        for m in range(3):
            weight[j] -= turn[j, m] * spare[m] + move[j, m] * mass[j] * gravity[m]


@njit(nogil=True)
def cross(x: float, y: float, z: float, b: Array, out: Array) -> None:
    """Cross product (x, y, z) x b.

    Args:
        x, y, z: Components of the first vector.
        b: Second vector. [3].
        out: Result. [3].
    """
    out[0] = y * b[2] - z * b[1]
    out[1] = z * b[0] - x * b[2]
    out[2] = x * b[1] - y * b[0]


@cache
def _record_type(fields: tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]) -> np.dtype[Any]:
    """Return one and the same dtype object for equal fields: numba recognises it at once, instead of comparing all fields."""
    return np.dtype(list(fields), align=True)


def packed(**arrays: Array) -> Array:
    """Arrays in one record: a kernel is called 50 times per control period, and every array handed over takes time. [1]."""
    out = np.zeros(1, _record_type(tuple((name, value.dtype, value.shape) for name, value in arrays.items())))
    for name, value in arrays.items():
        out[name][0] = value
    return out


def work_space(nodes: int, joints: int) -> dict[str, Array]:
    """Return scratch fields for the record of `joint_torques`, which are cheaper than new arrays in every call."""
    shapes: dict[str, tuple[int, ...]] = {
        **{"values": (nodes,), "poses": (nodes, 4, 4), "inertia": (joints, joints), "weight": (joints,)},
        **{"mass": (joints,), "moment": (joints, 3), "about": (joints, 3, 3), "turn": (joints, 3), "move": (joints, 3)},
        **{"part": (3, 3), "centre": (3,), "push": (3,), "force": (3,), "torque": (3,), "spare": (3,)},
        **{"matrix": (joints, joints), "load": (joints, 1)},
    }
    return {name: np.zeros(shape) for name, shape in shapes.items()}


@njit(nogil=True)
def plan_period(arm: Array, goal: Array, point: Array, opening: float, pressing: float, velocity: Array, speed: float) -> None:
    """Choose where the command stands at the end of the coming control period; see `Controller.begin_period`.

    Args:
        arm: As in `joint_torques`; its plan is updated. [1].
        goal: Posture, rad, and opening, m. [N + 1].
        point: The command in the same units, updated. [N + 1].
        opening: Measured distance of the pads, m.
        pressing: How far the opening's set point may be ahead of the fingers, m.
        velocity: Largest speed of each joint, rad/s. [N].
        speed: Largest speed of the opening, m/s.
    """
    plan, period, last = arm[0].plan, arm[0].grip[6], len(point) - 1
    # The set point may lie beyond the fingers only on the side to which they are to move, where it presses or leads.
    low = opening - pressing if goal[last] < opening else opening
    high = opening + pressing if goal[last] > opening else opening
    point[last] = min(max(point[last], low), high)
    slower = 1.0
    for i in range(last):
        slower = max(slower, abs(goal[i] - point[i]) / (period * velocity[i]))
    for i in range(last + 1):
        way = (goal[i] - point[i]) / period
        way = way / slower if i < last else min(max(way, -speed), speed)
        before = plan[1, i] + plan[2, i]
        plan[0, i] = point[i] - 0.5 * period * before
        plan[1, i], plan[2, i] = before, way - before
        point[i] += period * way


@njit(nogil=True)
def link_poses(arm: Array, measured: Array, table_from_base: Array, out: Array) -> None:
    """`table_from_link` of all links.

    Args:
        arm: As in `joint_torques`. [1].
        measured: See `joint_torques`. [2, N + 1].
        table_from_base: Pose of the robot's base in the table frame. [4, 4].
        out: Result. [K, 4, 4].
    """
    a = arm[0]
    sources, factors = a.sources, a.factors
    values, poses = a.values, a.poses
    for k in range(len(sources)):
        if sources[k] >= 0:
            values[k] = factors[k] * measured[0, sources[k]]
    place_links(a.parents, a.fixed, a.axes, values, poses)
    for k in range(len(sources)):
        for i in range(4):
            for j in range(4):
                out[k, i, j] = table_from_base[i, 0] * poses[k, 0, j] + table_from_base[i, 1] * poses[k, 1, j]
                out[k, i, j] += table_from_base[i, 2] * poses[k, 2, j] + table_from_base[i, 3] * poses[k, 3, j]


@njit(nogil=True)
def joint_torques(arm: Array, ring: Array, share: float, measured: Array, out: Array) -> None:
    """Torques of one physics step for the arm's N joints and the gripper's driver.

    Args:
        arm: See below. [1].
        ring: Set points that wait for the delay to pass: position and speed each. Updated. [L, 2, N + 1].
        share: How much of the control period is over at the end of this step, 0..1.
        measured: Row of angles and row of speeds; the last column is the gripper's driver. [2, N + 1].
        out: Rows: torques for the engine, motor torques as the robot would report them. [2, N + 1].

    Fields of `arm`:
        parents, fixed, axes: The chain.
        sources: Coordinate that each node follows, -1 for none. [K].
        factors: Value of the node's joint per coordinate. [K].
        bodies, owner, nodes, gravity: As in `arm_inertia`.
        law: Rows stiffness, damping, armature, viscous friction, largest torque, share of gravity carried. [6, N].
        grip: Rest half gap, bar length, stiffness, damping, largest force, time step, control period. [7].
        plan: Set point of this control period: rows position and speed at its start, change of speed until its end; the last
            column is the opening, m. [3, N + 1].
        slot: Index in the ring at which the next set point is stored. Updated. [1] int.
        memory: Rows: speeds and engine torques of the step before; [0, N] is 0 at the start, then 1. Updated. [2, N + 1].
        known_inertia: Joint-space inertia of the step before. Updated. [N, N].
        plays and so on: Effects of the model, see `gsbridge.sim.arm_setup.ArmSetup.record`.
        All others: `work_space`.
    """
    a = arm[0]
    sources, factors, nodes, slot = a.sources, a.factors, a.nodes, a.slot
    law, grip, plan, memory, known_inertia = a.law, a.grip, a.plan, a.memory, a.known_inertia
    count = len(nodes)
    time = share * grip[6]
    for i in range(count + 1):
        ring[slot[0], 0, i] = plan[0, i] + time * (plan[1, i] + 0.5 * share * plan[2, i])
        ring[slot[0], 1, i] = plan[1, i] + share * plan[2, i]
    # The place after the newest holds the oldest.
    slot[0] = (slot[0] + 1) % len(ring)
    step, plays, rough = grip[5], a.plays[0] > 0, False
    wanted, seen = a.shaped, a.seen
    wanted[:] = ring[slot[0]]
    seen[:] = measured
    if plays:
        sense(a, measured)
        shape_commands(a, step)
    values, inertia, weight = a.values, a.inertia, a.weight
    for k in range(len(sources)):
        if sources[k] >= 0:
            values[k] = factors[k] * seen[0, sources[k]]
    place_links(a.parents, a.fixed, a.axes, values, a.poses)
    arm_inertia(a)
    heavy = False
    for i in range(count):
        motor = law[0, i] * (wanted[0, i] - seen[0, i]) + law[1, i] * (wanted[1, i] - seen[1, i])
        motor = min(max(motor + law[5, i] * weight[i], -law[4, i]), law[4, i])
        out[1, i] = motor
        out[0, i] = motor - law[3, i] * measured[1, i]
        heavy = heavy or law[2, i] > 0.0
    if plays:
        rough = play_drives(a, measured, step, out)
    if heavy or rough:
        # The engine has no armature. The sum of all other torques in the step before, contacts included, follows from how the
        # arm moved. From that sum follow the acceleration that armature allows now, and the torque that makes the engine
        # accelerate so.
        matrix, load = a.matrix, a.load
        for i in range(count):
            others = weight[i]
            if memory[0, count] > 0.0:
                others = memory[1, i]
                for j in range(count):
                    others -= known_inertia[i, j] * (measured[1, j] - memory[0, j]) / step
            load[i, 0] = out[0, i] - others
            for j in range(count):
                matrix[i, j] = inertia[i, j]
            matrix[i, i] += law[2, i]
        if rough:
            columns = a.columns
            columns[:] = 0.0
            for i in range(count):
                columns[i, 0], columns[i, 1 + i] = load[i, 0], 1.0
            cholesky_solve(matrix, columns)
            rub_joints(a, measured, step, out)
        else:
            cholesky_solve(matrix, load)
            for i in range(count):
                out[0, i] -= law[2, i] * load[i, 0]
    for i in range(count):
        memory[0, i], memory[1, i] = measured[1, i], out[0, i]
    memory[0, count] = 1.0
    known_inertia[:] = inertia
    # The gripper's force acts between the pads; the linkage's lever turns it into a torque of the driver.
    angle = measured[0, count]
    opening, lever = 2.0 * (grip[0] + grip[1] * np.sin(angle)), 2.0 * grip[1] * np.cos(angle)
    force = grip[2] * (wanted[0, count] - opening) + grip[3] * (wanted[1, count] - lever * measured[1, count])
    force = min(max(force, -grip[4]), grip[4])
    out[0, count] = out[1, count] = force * lever
