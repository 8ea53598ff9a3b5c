"""PyBullet against a MuJoCo twin: same description, gains, armature and commands, other engine, other code for the torques."""

import mujoco
import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import content, model, world

from gsbridge.sim.model import Arm

STEP = 0.001


def twin(arm: Arm) -> mujoco.MjModel:
    """The robot's description with the model's armature and losses; the engine itself cancels gravity."""
    spec = mujoco.MjSpec.from_file(str(robot().urdf))
    spec.option.timestep = STEP
    spec.option.gravity = [0.0, 0.0, -content()["gravity"]]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for body in spec.bodies:
        body.gravcomp = 1.0
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0  # free motion; hulls of neighbouring links touch
    out = spec.compile()
    for name, armature, friction in zip(robot().record["arm_joints"], arm.armature, arm.viscous_friction, strict=True):
        column = out.joint(name).dofadr[0]
        out.dof_armature[column], out.dof_damping[column] = armature, friction
    return out


def set_points(goals: np.ndarray, periods: int) -> np.ndarray:
    """What the joints are asked for in each step, by brute force: the commands' broken line, averaged over one period."""
    line = np.repeat(goals[:1], 51, axis=0)
    for number in range(periods):
        start, end = goals[number], goals[number + 1]
        line = np.concatenate([line, start + np.linspace(0.02, 1.0, 50)[:, None] * (end - start)])
    # The mean of a line over 50 steps, by the trapezoidal rule, exact as its corners lie on the grid.
    weights = np.r_[0.5, np.ones(49), 0.5] / 50
    return np.stack([np.convolve(column, weights, mode="valid") for column in line.T], axis=1)


@pytest.mark.parametrize("armature", [True, False])
def test_same_commands_same_free_motion(armature):
    changes = {} if armature else {"arm__armature": [0.0] * 7, "arm__stiffness": [2000.0] * 4 + [60.0, 60.0, 3.0],
                                   "arm__damping": [130.0] * 4 + [3.0, 3.0, 0.1]}  # fmt: skip
    nominal = model(**changes)
    compiled = twin(nominal.arm)
    data = mujoco.MjData(compiled)
    columns = [compiled.joint(name).qposadr[0] for name in robot().record["arm_joints"]]
    fingers = robot().record["gripper"]["joints"]
    with world(**changes) as sim:
        # A swing of 1 s over the object that uses speed, turn and height.
        home, q, tools, goals = sim.kinematics.rest, [], [], [sim.kinematics.rest]
        for number in range(20):
            share = np.sin(2 * np.pi * (number + 1) / 20.0)
            sim.command(
                np.array([0.0 + 0.10 * share, 0.265 + 0.10 * np.sin(4 * number / 19), 0.28 - 0.05 * share]), 0.8 * share, 0.14
            )
            sim.step()
            goals.append(sim.controller.point[:-1].copy())
            q.append(sim.joints()[0])
            tools.append(sim.state().tool_position[0])
        base_from_table = sim.base_from_table
    wanted = set_points(np.array(goals), 20)
    speeds = np.gradient(wanted, STEP, axis=0)
    for name, multiplier in fingers.items():
        data.qpos[compiled.joint(name).qposadr[0]] = multiplier * robot().record["gripper"]["open_angle"]
    data.qpos[columns] = home
    mujoco.mj_forward(compiled, data)
    gains, limits = nominal.arm, sim.controller.limits.effort
    off = apart = 0.0
    for number in range(1000):
        torque = np.array(gains.stiffness) * (wanted[number + 1] - data.qpos[columns])
        torque += np.array(gains.damping) * (speeds[number + 1] - data.qvel[columns])
        data.qfrc_applied[columns] = np.clip(torque, -limits, limits)
        mujoco.mj_step(compiled, data)
        if number % 50 == 49:
            mujoco.mj_kinematics(compiled, data)
            tool = data.body("tool").xpos
            period = number // 50
            off = max(off, float(np.linalg.norm(tool - (base_from_table @ [*tools[period], 1.0])[:3])))
            apart = max(apart, float(np.abs(data.qpos[columns] - q[period][:7])[:6].max()))
    assert np.ptp(np.array(tools), axis=0).min() > 0.08
    assert np.abs(np.diff(np.array(q), axis=0)).max() > 0.02
    assert off < 0.001  # m; the floor is 3 mm
    # The last joint alone, all but massless without armature, may wander by a hundredth of a radian about the tool's own axis.
    assert apart < 2e-3
