"""The replay in PyBullet itself: a check of the compiled kernel, and the engine's own share of the noise floor.

Nothing is left to the engine's defaults: its motors, dampings and shapes are off; losses are torques that the model computes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.joint_kernel import LAW
from gsbridge.gap.joints.mechanism.replay import Mechanism, Span, State, command_grid
from gsbridge.gap.joints.mechanism.setup import JointSetup
from gsbridge.geometry import Array

UNDERSTOOD = ("stiffness", "damping", "gravity_share", "torque_limit", "viscous", "coulomb", "stribeck_speed", "ripple_waves")
"""Figures of the law that this replay knows; the others must be zero."""


def run_in_bullet(
    mechanism: Mechanism, record: Record, setup: JointSetup, spans: Sequence[Span], states: Sequence[State]
) -> dict[str, Array]:
    """Simulate stretches of a record as `Mechanism.run` does, in PyBullet.

    Raises:
        InputError: PyBullet cannot load the mechanism, or the setup has figures that this replay does not know.
    """
    strange = [name for name in LAW if name not in UNDERSTOOD and setup.law[name].any()]
    if strange or setup.clocks or mechanism.system.controller.mode == "position":
        raise InputError(
            "replay in PyBullet", f"it does not know {strange or 'wrong clocks or mode position'}", "Use Mechanism.run"
        )
    system, law = mechanism.system, setup.law
    step, count = system.time_step, len(record.joints)
    every = round(system.physics_rate / system.controller.rate)
    steps = int(np.ceil(record.duration / step)) + 2
    target, speed, extra = command_grid(record, system, setup, steps)
    dry, driven = law["coulomb"].tolist(), system.controller.mode == "pd"
    out = {kind: np.full((len(record.time), count), np.nan) for kind in ("position", "velocity", "effort")}
    with tempfile.TemporaryDirectory(prefix="gsbridge-gap-") as folder:
        world, body, columns = _load(mechanism, setup, Path(folder))
        brain, brain_body, _ = _load(mechanism, mechanism.setup(), Path(folder))
        try:
            for (first, end), (q0, v0) in zip(spans, states, strict=True):
                begin = int(round(record.time[first] / step))
                length = min(int(np.ceil((record.time[end - 1] - record.time[first]) / step)) + 2, steps - begin)
                raw = np.full((3, length, count), np.nan)
                for k, number in enumerate(columns):
                    world.resetJointState(body, number, float(q0[k]), float(v0[k]))
                for number in range(length):
                    q, v = np.array([item[:2] for item in world.getJointStates(body, columns)]).T
                    if number % every == 0:
                        asked = target[begin + number] + extra[begin + number]
                        if driven:
                            asked = law["stiffness"] * (asked - q) + law["damping"] * (speed[begin + number] - v)
                            weight = brain.calculateInverseDynamics(brain_body, q.tolist(), [0.0] * count, [0.0] * count)
                            asked = asked + extra[begin + number] + law["gravity_share"] * np.array(weight)
                        asked = np.clip(asked, -law["torque_limit"], law["torque_limit"])
                    raw[:, number] = q, v, asked
                    world.setJointMotorControlArray(body, columns, world.VELOCITY_CONTROL, forces=dry)
                    world.setJointMotorControlArray(
                        body, columns, world.TORQUE_CONTROL, forces=(asked - law["viscous"] * v).tolist()
                    )
                    world.stepSimulation()
                grid = (begin + np.arange(length)) * step
                channels = dict(zip(("position", "velocity", "effort"), raw, strict=True))
                for kind, values in channels.items():
                    for k in range(count):
                        out[kind][first:end, k] = np.interp(record.time[first:end], grid, values[:, k])
        finally:
            world.disconnect()
            brain.disconnect()
    return out


def _load(mechanism: Mechanism, setup: JointSetup, folder: Path) -> tuple[BulletClient, int, list[int]]:
    """An engine with every setting stated, the mechanism in it, and the engine's numbers of its joints."""
    system, path = mechanism.system, folder / "skeleton.urdf"
    mechanism.skeleton.write(path, setup.inertials)
    client = BulletClient(pybullet.DIRECT)
    client.setPhysicsEngineParameter(fixedTimeStep=system.time_step, numSubSteps=0, numSolverIterations=50)
    client.setGravity(*setup.gravity.tolist())
    try:
        body = client.loadURDF(str(path), useFixedBase=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
    except pybullet.error as error:
        client.disconnect()
        raise InputError(system.urdf, f"PyBullet cannot load it ({error})", "Check the URDF with another viewer") from error
    numbers = {client.getJointInfo(body, k)[1].decode(): k for k in range(client.getNumJoints(body))}
    for k in (-1, *numbers.values()):
        client.changeDynamics(body, k, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e3)
    return client, body, [numbers[name] for name in system.joints]
