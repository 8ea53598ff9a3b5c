"""Truths of any arm, simulated in PyBullet.

An effect uses the engine's own mechanism if there is one. The step is an eighth of the model's, so that the error of the
engine's step is negligible beside the hidden effects.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from gsbridge.gap.benchmark.arm_loop import PERIOD, run_arm
from gsbridge.gap.benchmark.hidden_parts import PLACE, rest_of, size_at, true_links
from gsbridge.gap.benchmark.trajectories import Course
from gsbridge.gap.joints.mechanism.inertials import Inertial, Skeleton
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

_EVERY = 8
"""Number of engine steps per period of the controller."""


class BulletTruth:
    """An arm under a sampled joint controller with gravity compensation.

    Args:
        system: Model with description, gains and known losses; its effects are ignored.
    """

    def __init__(self, system: MechanismModel) -> None:
        self.system = system
        self._skeleton = Skeleton.read(system.urdf, system.joints)

    def __call__(self, course: Course, duration: float, times: Array, hidden: Mapping[str, float]) -> dict[str, Array]:
        """Simulate the arm with hidden effects, and return its log; see `generate.Truth`."""
        with _BulletArm(self.system, self._skeleton, hidden) as engine:
            return run_arm(engine, self.system, course, duration, times, hidden)


class _BulletArm:
    """A simulated arm in PyBullet, and the nominal arm that its controller uses as a model."""

    steps, loose = _EVERY, False

    def __init__(self, system: MechanismModel, skeleton: Skeleton, hidden: Mapping[str, float]) -> None:
        self._system, self._skeleton, self._hidden = system, skeleton, hidden
        self._step, joints = PERIOD / _EVERY, system.joints
        self._gain = 1.0 + np.array([size_at(hidden, "torque_gain", name) for name in joints])
        self._spring = np.array([size_at(hidden, "spring", name) for name in joints])
        self._rest = np.array([rest_of(k, name in system.sliding) for k, name in enumerate(joints)])
        self._rub = system.coulomb + np.array([size_at(hidden, "coulomb", name) for name in joints])
        lean, strength = hidden.get("base_tilt", 0.0), -system.gravity[2]
        self._gravity = [np.sin(lean) * strength, 0.0, -np.cos(lean) * strength]
        self._clients: list[BulletClient] = []
        self._force = np.zeros(3)
        self._sprung, self._touched = bool(self._spring.any()), False

    def __enter__(self) -> _BulletArm:
        bodies = true_links(self._skeleton, self._hidden)
        if "payload" in self._hidden:
            link = self._skeleton.child_of[self._system.joints[-1]]
            bodies[link] = _joined(bodies[link], self._hidden["payload"])
        self._world, self._body, self._columns = self._load(bodies, self._gravity)
        self._brain, self._brain_body, _ = self._load(self._skeleton.inertials, self._system.gravity.tolist())
        damping = self._system.viscous + np.array([size_at(self._hidden, "viscous", name) for name in self._system.joints])
        for number, value in zip(self._columns, damping, strict=True):
            self._world.changeDynamics(self._body, number, jointDamping=float(value))
        self._velocity_motors(self._rub)
        return self

    def __exit__(self, *error: object) -> None:
        for client in self._clients:
            client.disconnect()

    def _load(self, bodies: Mapping[str, Inertial], gravity: list[float]) -> tuple[BulletClient, int, list[int]]:
        client = BulletClient(pybullet.DIRECT)
        self._clients.append(client)
        client.setPhysicsEngineParameter(fixedTimeStep=self._step, numSubSteps=0, numSolverIterations=50)
        client.setGravity(*gravity)
        with tempfile.TemporaryDirectory(prefix="gsbridge-gap-") as folder:
            path = Path(folder) / "skeleton.urdf"
            self._skeleton.write(path, bodies)
            body = client.loadURDF(str(path), useFixedBase=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
        numbers = {client.getJointInfo(body, k)[1].decode(): k for k in range(client.getNumJoints(body))}
        for k in (-1, *numbers.values()):
            client.changeDynamics(body, k, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e3)
        return client, body, [numbers[name] for name in self._system.joints]

    def _velocity_motors(self, forces: Array) -> None:
        """Set dry friction as motors that brake towards rest with a limited torque."""
        self._world.setJointMotorControlArray(
            self._body, self._columns, self._world.VELOCITY_CONTROL, forces=np.abs(forces).tolist()
        )

    def begin(self, q: Array) -> None:
        for number, value in zip(self._columns, q, strict=True):
            self._world.resetJointState(self._body, number, float(value), 0.0)

    def state(self) -> tuple[Array, Array]:
        # The engine moves positions with the speed at the end of a step, so they are half a step ahead of speeds and torques.
        q, v = np.array([item[:2] for item in self._world.getJointStates(self._body, self._columns)]).T
        return q - 0.5 * self._step * v, v

    def advance(self, asked: Array, extra: Array, dry: Array | None, steps: int) -> None:
        if dry is not None:
            self._velocity_motors(self._rub + dry)
        # Bound once, since the client looks up a function anew on every access.
        drive, step, mode = self._world.setJointMotorControlArray, self._world.stepSimulation, self._world.TORQUE_CONTROL
        torque = self._gain * asked + extra
        forces = torque.tolist()
        for _ in range(steps):
            if self._sprung:
                forces = (torque - self._spring * (self.state()[0] - self._rest)).tolist()
            drive(self._body, self._columns, mode, forces=forces)
            if self._touched:
                # PyBullet forgets forces after every step.
                place = self._world.getLinkState(self._body, self._columns[-1])[0]
                self._world.applyExternalForce(
                    self._body, self._columns[-1], self._force.tolist(), place, self._world.WORLD_FRAME
                )
            step()

    def place(self) -> Array:
        for number, value in zip(self._columns, self.state()[0], strict=True):
            self._brain.resetJointState(self._brain_body, number, float(value))
        return np.array(self._brain.getLinkState(self._brain_body, self._columns[-1], computeForwardKinematics=1)[4])

    def touch(self, force: Array) -> None:
        self._force, self._touched = force, bool(force.any())

    def weight(self, q: Array) -> Array:
        zero = [0.0] * len(q)
        return np.array(self._brain.calculateInverseDynamics(self._brain_body, q.tolist(), zero, zero))


def _joined(body: Inertial, mass: float) -> Inertial:
    """Add a point mass at `PLACE` to a link, by the parallel axis theorem about the common centre of mass."""
    total = body.mass + mass
    centre = (body.mass * body.centre + mass * PLACE) / total
    inertia = body.inertia.copy()
    for part, place in ((body.mass, body.centre), (mass, PLACE)):
        x, y, z = place - centre
        inertia += part * np.array(
            [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z], [-x * z, -y * z, x * x + y * y]]
        )
    return Inertial(total, centre, inertia)
