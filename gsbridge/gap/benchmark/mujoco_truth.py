"""Truths of any mechanism, simulated in MuJoCo.

An effect uses MuJoCo's own mechanism if there is one. The step is a sixteenth of the model's, so that the error of the engine's
step is negligible beside the hidden effects.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from gsbridge.gap.benchmark.arm_loop import run_arm
from gsbridge.gap.benchmark.generate import NotShownError
from gsbridge.gap.benchmark.hidden_parts import PLACE, rest_of, size_at, true_links
from gsbridge.gap.benchmark.trajectories import Course
from gsbridge.gap.joints.mechanism.inertials import Skeleton
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

logger = logging.getLogger(__name__)

STEP = 6.25e-5
"""Step of MuJoCo, s; the controller acts every millisecond."""

_EVERY = 16

_PLAY = "_play"
"""Suffix of the name of a joint between a motor and its link."""

_LIGHTEST = 1e-5
"""Smallest inertia of a rotor with play or an elastic transmission, kg m2."""

_SPRUNG = 2e-4
"""Ratio of damping to stiffness of an elastic transmission, s."""

_HARD = 0.9999
"""Impedance of dry friction, which is the largest that MuJoCo allows."""

_DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def without_log_file() -> None:
    """Send MuJoCo's warnings to the log instead of a file in the working directory.

    Call it again after reading a model, which may reset the handler.
    """
    mujoco.set_mju_user_warning(logger.debug)


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether MuJoCo has reset a diverged simulation since the last reset by the caller.

    MuJoCo goes on from the initial state without an error, so what it logs afterwards is meaningless.
    """
    return any(data.warning[kind].number for kind in _DIVERGED)


class MujocoTruth:
    """A mechanism under a sampled joint controller with gravity compensation.

    Args:
        system: Model with description, gains and known losses; its effects are ignored.
    """

    def __init__(self, system: MechanismModel) -> None:
        self.system = system
        self._skeleton = Skeleton.read(system.urdf, system.joints)
        self._brain = self._compile({})

    def _compile(self, hidden: Mapping[str, float]) -> mujoco.MjModel:
        """Compile a model with those hidden effects for which MuJoCo has a mechanism."""
        system = self.system
        with tempfile.TemporaryDirectory(prefix="gsbridge-gap-") as folder:
            path = Path(folder) / "skeleton.urdf"
            self._skeleton.write(path, true_links(self._skeleton, hidden))
            spec = mujoco.MjSpec.from_file(str(path))
            spec.option.timestep = STEP
            spec.option.gravity = system.gravity.tolist()
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
            spec.compiler.balanceinertia = True
            spec.option.iterations = 50
            if "payload" in hidden:
                link = spec.body(self._skeleton.child_of[system.joints[-1]])
                load = link.add_body(pos=PLACE.tolist())
                load.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.001, 0, 0], mass=hidden["payload"], contype=0, conaffinity=0
                )
            for k, name in enumerate(system.joints):
                spec.add_actuator(
                    name=name,
                    target=name,
                    trntype=mujoco.mjtTrn.mjTRN_JOINT,
                    gear=[1.0 + size_at(hidden, "torque_gain", name)] + [0] * 5,
                )
                _loosen(spec.body(self._skeleton.child_of[name]), spec.joint(name), float(system.armature[k]), hidden)
            model = spec.compile()
        for k, name in enumerate(system.joints):
            column = model.joint(name).dofadr[0]
            model.dof_damping[column] = system.viscous[k] + size_at(hidden, "viscous", name)
            model.dof_frictionloss[column] = system.coulomb[k] + size_at(hidden, "coulomb", name)
            # As hard as MuJoCo allows: by default, a light joint that dry friction should hold creeps by more than the noise.
            model.dof_solref[column], model.dof_solimp[column, :2] = (2 * STEP, 1.0), _HARD
            rotor = system.armature[k] + size_at(hidden, "armature", name)
            soft = size_at(hidden, "compliance", name)
            if soft:
                spring = model.joint(name + _PLAY)
                model.jnt_stiffness[spring.id], model.dof_damping[spring.dofadr[0]] = 1.0 / soft, _SPRUNG / soft
            loose = soft or size_at(hidden, "backlash", name)
            model.dof_armature[column] = max(rotor, _LIGHTEST) if loose else rotor
            number = model.joint(name).id
            model.jnt_stiffness[number] = size_at(hidden, "spring", name)
            model.qpos_spring[model.joint(name).qposadr[0]] = rest_of(k, name in system.sliding)
            if size_at(hidden, "saturation", name):
                limit = 1.0 / size_at(hidden, "saturation", name)
                model.actuator_forcelimited[k], model.actuator_forcerange[k] = 1, (-limit, limit)
        if "base_tilt" in hidden:
            # The base is tilted about its y axis, so gravity is tilted the other way in its frame.
            turn, strength = hidden["base_tilt"], -system.gravity[2]
            model.opt.gravity[:] = [np.sin(turn) * strength, 0.0, -np.cos(turn) * strength]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def __call__(self, course: Course, duration: float, times: Array, hidden: Mapping[str, float]) -> dict[str, Array]:
        """Simulate the mechanism with hidden effects, and return its log; NaN after it diverges. See `generate.Truth`.

        Raises:
            NotShownError: Backlash and compliance are hidden at one joint.
        """
        without_log_file()
        last = self._skeleton.child_of[self.system.joints[-1]]
        engine = _MujocoArm(self._compile(hidden), self._brain, self.system.joints, last)
        return run_arm(engine, self.system, course, duration, times, hidden)


def _loosen(link: mujoco.MjsBody, motor: mujoco.MjsJoint, rotor: float, hidden: Mapping[str, float]) -> None:
    """Add play or a spring between a motor and its link: a second joint on the same axis, with the rotor on the first.

    Args:
        link: The link that the joint moves.
        motor: The joint, which becomes the motor's side.
        rotor: Inertia of the rotor, kg m2.
        hidden: Sizes of the hidden effects.

    Raises:
        NotShownError: The joint should have both play and a spring.
    """
    gap, soft = size_at(hidden, "backlash", motor.name), size_at(hidden, "compliance", motor.name)
    if not gap and not soft:
        return
    if gap and soft:
        # On one joint, play would only limit how far the spring gives way. In series, they need a body without mass between.
        name = f"compliance:{motor.name}"
        raise NotShownError(
            name if name in hidden else "compliance", f"the joint {motor.name} has either backlash or compliance, not both"
        )
    # The motor's side of the play needs an inertia of its own.
    motor.armature = max(rotor, _LIGHTEST)
    play = link.add_joint(name=f"{motor.name}{_PLAY}", type=motor.type, axis=motor.axis, pos=motor.pos)
    if gap:
        play.range, play.limited = [-gap / 2, gap / 2], mujoco.mjtLimited.mjLIMITED_TRUE
        play.solref_limit = [4 * STEP, 1.0]


class _MujocoArm:
    """A simulated arm in MuJoCo, and the nominal arm that its controller uses as a model."""

    steps = _EVERY

    def __init__(self, model: mujoco.MjModel, brain: mujoco.MjModel, joints: tuple[str, ...], last: str) -> None:
        self._model, self._brain = model, brain
        self._data, self._brain_data = mujoco.MjData(model), mujoco.MjData(brain)
        self._rows = [model.joint(name).qposadr[0] for name in joints]
        self._dofs = [model.joint(name).dofadr[0] for name in joints]
        # The nominal arm has its own indices, since hidden effects may add joints to the true one.
        self._own_rows = [brain.joint(name).qposadr[0] for name in joints]
        self._own_dofs = [brain.joint(name).dofadr[0] for name in joints]
        self.loose = model.njnt > brain.njnt
        self._bare = model.dof_frictionloss[self._dofs].copy()
        self._last, self._shown = model.body(last).id, mujoco.MjData(model)

    def begin(self, q: Array) -> None:
        self._data.qpos[self._rows] = q

    def state(self) -> tuple[Array, Array]:
        if has_diverged(self._data):
            return np.full(len(self._rows), np.nan), np.full(len(self._dofs), np.nan)
        # MuJoCo moves positions with the speed at the end of a step, so they are half a step ahead of speeds and torques.
        v = self._data.qvel[self._dofs]
        return self._data.qpos[self._rows] - 0.5 * STEP * v, v

    def advance(self, asked: Array, extra: Array, dry: Array | None, steps: int) -> None:
        if has_diverged(self._data):
            return
        self._data.ctrl[:] = asked
        self._data.qfrc_applied[self._dofs] = extra
        if dry is not None:
            self._model.dof_frictionloss[self._dofs] = self._bare + dry
        mujoco.mj_step(self._model, self._data, nstep=steps)

    def place(self) -> Array:
        if has_diverged(self._data):
            return np.full(3, np.nan)
        self._shown.qpos[:] = self._data.qpos - 0.5 * STEP * self._data.qvel
        mujoco.mj_kinematics(self._model, self._shown)
        return self._shown.xpos[self._last].copy()

    def touch(self, force: Array) -> None:
        self._data.xfrc_applied[self._last, :3] = force

    def weight(self, q: Array) -> Array:
        model, data = self._brain, self._brain_data
        data.qpos[self._own_rows] = q
        data.qvel[:] = 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        out = np.empty(model.nv)
        mujoco.mj_rne(model, data, 0, out)
        return out[self._own_dofs]
