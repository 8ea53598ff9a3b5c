"""A twin of the simulated arm in MuJoCo: same description, gains, losses and commands, other engine, other code for torques.

It serves checks only: if two independent engines agree, an error in either is unlikely. Armature is MuJoCo's own here, while
the simulated world emulates it in the torque law; set points are computed by plainly averaging the commands.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.model import Model
from gsbridge.sim.world import SimWorld

PERIODS = 20
"""Length of the compared motion, control periods."""


@dataclass(frozen=True)
class Deviation:
    """Distance between two engines in one motion.

    Args:
        tool: Largest distance of the tool points, m.
        joints: Largest difference of all joints except the last, rad. The last joint has hardly any inertia besides its
            armature and may wander by a hundredth of a radian about the tool's own axis.
        travel: Extent of the tool's motion along x, y and z, m. [3].
        speed: Largest change of a joint in one control period, rad.
    """

    tool: float
    joints: float
    travel: Array
    speed: float


def twin(robot: RobotFiles, model: Model) -> mujoco.MjModel:
    """The robot's description with the model's armature and losses, without contacts; the engine cancels gravity itself."""
    spec = mujoco.MjSpec.from_file(str(robot.urdf))
    spec.option.timestep = model.time_step
    spec.option.gravity = [0.0, 0.0, -model.gravity]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for body in spec.bodies:
        body.gravcomp = 1.0
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0  # hulls of neighbouring links touch
    out = spec.compile()
    arm = model.arm
    for name, armature, friction in zip(robot.record["arm_joints"], arm.armature, arm.viscous_friction, strict=True):
        column = out.joint(name).dofadr[0]
        out.dof_armature[column], out.dof_damping[column] = armature, friction
    return out


def swing(number: int) -> tuple[Array, float]:
    """Return the command of one period of the compared motion, in which position, height and yaw vary: [3] m, rad."""
    share = np.sin(2 * np.pi * (number + 1) / PERIODS)
    rise = np.sin(4 * number / (PERIODS - 1))
    return np.array([0.10 * share, 0.265 + 0.10 * rise, 0.28 - 0.05 * share]), 0.8 * share


def set_points(goals: Array, substeps: int) -> Array:
    """Set points of the joints in each physics step: the piecewise linear commands, averaged over one control period.

    Args:
        goals: Joint goals, the start first. [P + 1, N].
        substeps: Physics steps per control period.

    Returns:
        [P * substeps + 1, N].
    """
    line = np.repeat(goals[:1], substeps + 1, axis=0)
    shares = (np.arange(substeps) + 1.0)[:, None] / substeps
    for start, end in zip(goals[:-1], goals[1:], strict=True):
        line = np.concatenate([line, start + shares * (end - start)])
    # The mean over one period by the trapezoidal rule, which is exact, since the corners of the commands lie on the grid.
    weights = np.r_[0.5, np.ones(substeps - 1), 0.5] / substeps
    return np.stack([np.convolve(column, weights, mode="valid") for column in line.T], axis=1)


def compare_with_twin(robot: RobotFiles, sim: SimWorld) -> Deviation:
    """Let both engines carry out the same commands in free motion.

    Args:
        robot: The robot's files.
        sim: The simulated world, in its rest posture; it is moved.
    """
    model, limits = sim.model, sim.controller.limits.effort
    home = sim.kinematics.rest
    q, tools, goals = [], [], [home]
    for number in range(PERIODS):
        position, yaw = swing(number)
        sim.command(position, yaw, sim.dimensions.stroke)
        sim.step()
        goals.append(sim.controller.point[:-1].copy())
        q.append(sim.joints()[0][: len(home)])
        tools.append(sim.state().tool_position[0])
    wanted = set_points(np.array(goals), model.substeps)
    speeds = np.gradient(wanted, model.time_step, axis=0)

    compiled = twin(robot, model)
    data = mujoco.MjData(compiled)
    columns = [compiled.joint(name).qposadr[0] for name in robot.record["arm_joints"]]
    for name, multiplier in robot.record["gripper"]["joints"].items():
        data.qpos[compiled.joint(name).qposadr[0]] = multiplier * robot.record["gripper"]["open_angle"]
    data.qpos[columns] = home
    mujoco.mj_forward(compiled, data)
    stiffness, damping = np.array(model.arm.stiffness), np.array(model.arm.damping)
    off = apart = 0.0
    for number in range(PERIODS * model.substeps):
        torque = stiffness * (wanted[number + 1] - data.qpos[columns]) + damping * (speeds[number + 1] - data.qvel[columns])
        data.qfrc_applied[columns] = np.clip(torque, -limits, limits)
        mujoco.mj_step(compiled, data)
        period, step = divmod(number, model.substeps)
        if step == model.substeps - 1:
            mujoco.mj_kinematics(compiled, data)
            tool = (sim.base_from_table @ [*tools[period], 1.0])[:3]
            off = max(off, float(np.linalg.norm(data.body("tool").xpos - tool)))
            apart = max(apart, float(np.abs(data.qpos[columns] - q[period])[:-1].max()))
    return Deviation(off, apart, np.ptp(np.array(tools), axis=0), float(np.abs(np.diff(np.array(q), axis=0)).max()))
