"""Truths of any mechanism in MuJoCo, each effect by MuJoCo's own mechanism where it has one, at a quarter of the model's step.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from gsbridge.gap.benchmark.trajectories import Course
from gsbridge.gap.bodies import Skeleton
from gsbridge.gap.system import System
from gsbridge.geometry import Array

STEP = 2.5e-4
"""Of MuJoCo, s; the controller acts every millisecond."""

_EVERY = 4


class MujocoTruth:
    """A mechanism under a sampled joint controller with gravity compensation.

    Args:
        system: Description, gains and known losses; its effects are not looked at.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self._skeleton = Skeleton.read(system.urdf, system.joints)
        self._brain = self._compile({})
        self._brain_data = mujoco.MjData(self._brain)

    def _compile(self, hidden: Mapping[str, float]) -> mujoco.MjModel:
        """A model with what MuJoCo itself can hide."""
        system = self.system
        with tempfile.TemporaryDirectory(prefix="gsbridge-gap-") as folder:
            path = Path(folder) / "skeleton.urdf"
            self._skeleton.write(path, self._skeleton.inertials)
            spec = mujoco.MjSpec.from_file(str(path))
            spec.option.timestep = STEP
            spec.option.gravity = system.gravity.tolist()
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
            spec.compiler.balanceinertia = True
            spec.option.iterations = 50
            if "payload" in hidden:
                link = spec.body(self._skeleton.child_of[system.joints[-1]])
                load = link.add_body(pos=[0.0, 0.0, 0.08])
                load.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.001, 0, 0], mass=hidden["payload"], contype=0, conaffinity=0
                )
            for name in system.joints:
                spec.add_actuator(
                    name=name,
                    target=name,
                    trntype=mujoco.mjtTrn.mjTRN_JOINT,
                    gear=[1.0 + _of(hidden, "torque_gain", name)] + [0] * 5,
                )
            model = spec.compile()
        for k, name in enumerate(system.joints):
            column = model.joint(name).dofadr[0]
            model.dof_damping[column] = system.viscous[k] + _of(hidden, "viscous", name)
            model.dof_frictionloss[column] = system.coulomb[k] + _of(hidden, "coulomb", name)
            model.dof_armature[column] = system.armature[k] + _of(hidden, "armature", name)
            number = model.joint(name).id
            model.jnt_stiffness[number] = _of(hidden, "spring", name)
            model.qpos_spring[model.joint(name).qposadr[0]] = 0.0
            body = model.body(self._skeleton.child_of[name]).id
            change = 1.0 + _of(hidden, "link_mass", name)
            model.body_mass[body] *= change
            model.body_inertia[body] *= change
            if _of(hidden, "saturation", name):
                limit = 1.0 / _of(hidden, "saturation", name)
                model.actuator_forcelimited[k], model.actuator_forcerange[k] = 1, (-limit, limit)
        if "base_tilt" in hidden:
            # The base leans about its y axis: in its own frame, gravity leans the other way.
            turn, strength = hidden["base_tilt"], -system.gravity[2]
            model.opt.gravity[:] = [np.sin(turn) * strength, 0.0, -np.cos(turn) * strength]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def __call__(self, course: Course, duration: float, times: Array, hidden: Mapping[str, float]) -> dict[str, Array]:
        """What the mechanism with something hidden would log; see `generate.Truth`."""
        system, names = self.system, self.system.joints
        model = self._compile(hidden)
        data = mujoco.MjData(model)
        count, steps = len(names), int(np.ceil(duration * 1000)) + 150
        rows = [model.joint(name).qposadr[0] for name in names]
        dofs = [model.joint(name).dofadr[0] for name in names]

        def row(name: str) -> Array:
            return np.array([_of(hidden, name, joint) for joint in names])

        stiff, damp = system.controller.stiffness * (1 + row("gain_p")), system.controller.damping * (1 + row("gain_d"))
        share = system.controller.gravity_compensation + hidden.get("gravcomp", 0.0)
        offset, scale, push, drag = row("encoder_offset"), 1 + row("encoder_scale"), row("effort_offset"), row("quadratic_drag")
        cubic, shake, patchy = row("cubic_spring"), row("shaking"), row("patchy_friction")
        bare, dead = model.dof_frictionloss.copy(), hidden.get("command_delay", 0.0)
        slow, wanted = hidden.get("lag", 0.0), np.asarray(course(0.0), dtype=np.float64)
        data.qpos[rows] = (wanted - offset) / scale
        out = np.empty((3, steps, count))
        extra = drag.any() or cubic.any() or shake.any() or push.any()
        for number in range(steps):
            time = number * 1e-3
            # The filter's exact answer to commands that are held over a millisecond; none without one.
            wanted = wanted + (course(max(time - dead, 0.0)) - wanted) * (1 - np.exp(-1e-3 / slow) if slow else 1.0)
            q, v = data.qpos[rows], data.qvel[dofs]
            seen, rate = scale * q + offset, scale * v
            asked = stiff * (wanted - seen) - damp * rate + share * self._weight(seen, rows, dofs)
            data.ctrl[:] = asked
            out[:, number] = (
                seen,
                rate,
                asked
                if not model.actuator_forcelimited.any()
                else np.clip(
                    asked,
                    np.where(model.actuator_forcelimited, model.actuator_forcerange[:, 0], -np.inf),
                    np.where(model.actuator_forcelimited, model.actuator_forcerange[:, 1], np.inf),
                ),
            )
            if patchy.any():
                model.dof_frictionloss[dofs] = bare[dofs] + patchy * (1 + np.sin(5 * q))
            for _ in range(_EVERY):
                if extra:
                    v = data.qvel[dofs]
                    data.qfrc_applied[dofs] = push - drag * v * np.abs(v) - cubic * data.qpos[rows] ** 3
                    data.qfrc_applied[dofs] += shake * np.sin(2 * np.pi * 3.3 * data.time)
                mujoco.mj_step(model, data)
        grid, late = np.arange(steps) * 1e-3, hidden.get("clock_offset", 0.0)
        shift = {"position": late, "velocity": late, "effort": 0.0}
        return {
            kind: np.stack([np.interp(times - shift[kind], grid, column) for column in values.T], axis=1)
            for kind, values in zip(shift, out, strict=True)
        }

    def _weight(self, q: Array, rows: list[int], dofs: list[int]) -> Array:
        """Torques that hold the nominal mechanism. [N]."""
        data = self._brain_data
        data.qpos[rows] = q
        mujoco.mj_kinematics(self._brain, data)
        mujoco.mj_comPos(self._brain, data)
        mujoco.mj_crb(self._brain, data)
        out = np.empty(self._brain.nv)
        data.qvel[:] = 0.0
        mujoco.mj_comVel(self._brain, data)
        mujoco.mj_rne(self._brain, data, 0, out)
        return out[dofs]


def _of(hidden: Mapping[str, float], name: str, joint: str) -> float:
    """Size of an effect at a joint: `name:joint`, or `name` where the mechanism has one joint."""
    return hidden.get(f"{name}:{joint}", hidden.get(name, 0.0))
