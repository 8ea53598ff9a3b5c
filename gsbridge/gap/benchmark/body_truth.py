"""Throws of a body in MuJoCo, whose contact model differs from that of the engine used by the diagnosis.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import brentq

from gsbridge.gap.benchmark.mujoco_truth import has_diverged, without_log_file
from gsbridge.gap.contact.starts import quat_from_turn
from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.geometry import Array, quat_multiply, rotation_from_quat

STEP = 5e-4
"""Step of MuJoCo, s."""

_REBOUND = 1500.0
"""Natural frequency of a contact with restitution, rad/s."""

_FINER = 10
"""Number of engine steps per `STEP` if contacts have restitution. Such a contact lasts about four times `STEP`; with so few
steps, the rebound of a ball would depend on the moment within a step at which it touches."""

_SHAKEN = (7.0, 2 * np.pi)
"""Frequencies of a gust along x and along y, rad/s."""


class RunawayError(ValueError):
    """The simulation of a throw diverges."""


@dataclass(frozen=True)
class ThrowScene:
    """A body, a surface, and how the body is thrown and logged.

    Args:
        shape: `box` or `ball`.
        edges: Edges of the box, m; the diameter of a ball is the first of them.
        mass: Mass, kg.
        inertia: Factor on the moments of inertia of the solid body.
        com: Centre of mass in the body frame, m. [3].
        friction: Coefficient of sliding friction between body and surface.
        spinning: Lever arm of spinning friction, m; zero for none.
        rolling: Lever arm of rolling friction, m; zero for none.
        restitution: Coefficient of restitution.
        compliance: Compliance of the contact, m/N; zero for a hard contact.
        softened: Damping of a soft contact, N s/m.
        gravity: Gravity, m/s2.
        linear: Damping of the velocity, 1/s; it acts at the origin of the body frame.
        angular: Damping of the spin, 1/s.
        force: Steady force along x and y, N. [2].
        density: Density of the air, kg/m3, for MuJoCo's drag.
        height: Height of the surface, m.
        tilt: Tilt of the surface about x and y, rad. [2].
        slowness: Time constant of the contact, s.
        rate: Sampling rate, Hz.
        duration: Length of a throw, s.
        noise: Standard deviations of the noise of positions, m, and of attitudes, rad.
        offset: Tracked point in the body frame, m. [3].
        stretched: Factor on all logged lengths.
        clock: Factor on all logged times.
        lag: Delay of logged start speeds, s; None if start speeds are not logged.
        magnus: Magnus force per velocity and spin, kg.
        patchy: Amplitude of the change of friction along x.
        slosh: Share of the mass that swings inside on springs.
        gust: Amplitude of a periodic wind force, N.
        bent: Quadratic nonlinearity of tracked positions, 1/m.
        bump: Amplitude of waves in the surface, m.
    """

    shape: str = "box"
    edges: Sequence[float] = (0.1, 0.1, 0.1)
    mass: float = 0.4
    inertia: float = 1.0
    com: Sequence[float] = (0.0, 0.0, 0.0)
    friction: float = 0.2
    spinning: float = 0.0
    rolling: float = 0.0
    restitution: float = 0.0
    compliance: float = 0.0
    softened: float = 0.0
    gravity: float = 9.81
    linear: float = 0.0
    angular: float = 0.0
    force: Sequence[float] = (0.0, 0.0)
    density: float = 0.0
    height: float = 0.0
    tilt: Sequence[float] = (0.0, 0.0)
    slowness: float = 0.004
    rate: float = 150.0
    duration: float = 0.75
    noise: tuple[float, float] = (1e-4, 5e-4)
    offset: Sequence[float] = (0.0, 0.0, 0.0)
    stretched: float = 1.0
    clock: float = 1.0
    lag: float | None = None
    magnus: float = 0.0
    patchy: float = 0.0
    slosh: float = 0.0
    gust: float = 0.0
    bent: float = 0.0
    bump: float = 0.0


def throw_box(scene: ThrowScene, count: int, seed: int, *, shaken: tuple[float, float] = (0.0, 0.0)) -> Throws:
    """Throw a body `count` times, from a low height, at 0.5-1.5 m/s, with spins of a few rad/s.

    Args:
        scene: Body, surface, throw and log.
        count: Number of throws.
        seed: Seed of the throws and of the noise.
        shaken: Standard deviations of random errors that are added to the start speeds, m/s and rad/s; the throws are otherwise
            the same.

    Raises:
        RunawayError: A throw diverges, since its contacts are too stiff for the engine's step.
    """
    rng, other = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    without_log_file()
    model = _compile(scene)
    data = mujoco.MjData(model)
    items = []
    for number in range(count):
        mujoco.mj_resetData(model, data)
        turn = rng.normal(size=4)
        reach = float(np.linalg.norm(scene.edges))
        data.qpos[:3] = 0.0, 0.0, rng.uniform(1.0, 2.0) * reach
        data.qpos[3:7] = turn / np.linalg.norm(turn)
        along, speed = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.5, 1.5)
        data.qvel[:3] = speed * np.cos(along), speed * np.sin(along), rng.uniform(-0.3, 0.3)
        data.qvel[3:6] = rng.normal(0.0, 2.5, 3)
        data.qvel[:3] += other.normal(0.0, 1.0, 3) * shaken[0]
        data.qvel[3:6] += other.normal(0.0, 1.0, 3) * shaken[1]
        # MuJoCo's velocity belongs to half a step before its position, so half a step's fall is taken back.
        data.qvel[2] += 0.5 * _step(scene) * scene.gravity
        mujoco.mj_forward(model, data)
        items.append(_logged(scene, model, data, rng, str(number)))
        if has_diverged(data):
            raise RunawayError(f"throw {number} runs away")
    return Throws(tuple(items))


def _logged(scene: ThrowScene, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator, name: str) -> Throw:
    """Simulate one throw and log it as a tracker does."""
    time = np.arange(int(scene.duration * scene.rate) + 1) / scene.rate
    steps = np.round(time / STEP).astype(int)
    rows: list[Array] = []
    late = 0 if scene.lag is None else max(round(scene.lag / STEP), 0)
    steps += late
    data.xfrc_applied[1, :2] = scene.force
    restless = bool(scene.gust or scene.magnus or scene.patchy or scene.bump)
    speeds, now = None, 0
    for step in [steps[0] - late, *steps]:
        while now < step:
            if restless:
                _disturb(scene, model, data)
            ahead = 1 if restless else int(step) - now
            mujoco.mj_step(model, data, nstep=ahead * round(STEP / _step(scene)))
            now += ahead
        if speeds is None:
            speeds = _speeds(data, scene)
        else:
            rows.append(data.qpos.copy())
    poses = np.array(rows)
    place = poses[:, :3] + rotation_from_quat(poses[:, 3:7]) @ np.asarray(scene.offset, dtype=np.float64)
    place = scene.stretched * place * (1.0 + scene.bent * place)
    position = place + rng.normal(0.0, scene.noise[0], (len(time), 3))
    quat = quat_multiply(quat_from_turn(rng.normal(0.0, scene.noise[1], (len(time), 3))), poses[:, 3:7])
    stamps = (steps - steps[0]) * STEP * scene.clock
    if scene.lag is None or speeds is None:
        return Throw(name, stamps, position, quat)
    velocity, spin = speeds
    velocity = scene.stretched / scene.clock * velocity + rng.normal(0.0, 20 * scene.noise[0], 3)
    return Throw(name, stamps, position, quat, velocity, spin / scene.clock + rng.normal(0.0, 20 * scene.noise[1], 3))


def _speeds(data: mujoco.MjData, scene: ThrowScene) -> tuple[Array, Array]:
    """Return the velocity of the tracked point, m/s, and the angular velocity, rad/s, both in the world frame. [3], [3]."""
    turn = rotation_from_quat(data.qpos[3:7].copy())
    spin = turn @ data.qvel[3:6]
    # MuJoCo's velocity belongs to half a step before its position; the body falls in between.
    velocity = data.qvel[:3] - 0.5 * _step(scene) * scene.gravity * np.array([0.0, 0.0, 1.0])
    return velocity + np.cross(spin, turn @ np.asarray(scene.offset, dtype=np.float64)), spin


def _disturb(scene: ThrowScene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Set the external forces, friction and surface height for the next step."""
    push = np.array([*scene.force, 0.0])
    if scene.gust:
        push[:2] += scene.gust * np.sin(np.array(_SHAKEN) * data.time + (0.4, 2.0))
    if scene.magnus:
        turn = rotation_from_quat(data.qpos[3:7].copy())
        push += scene.magnus * np.cross(turn @ data.qvel[3:6], data.qvel[:3])
    data.xfrc_applied[1, :3] = push
    if scene.patchy:
        model.geom_friction[:, 0] = scene.friction + scene.patchy * np.tanh(6.0 * data.qpos[0])
    if scene.bump:
        model.geom_pos[0, 2] = scene.height + scene.bump * np.sin(20.0 * data.qpos[0]) * np.sin(20.0 * data.qpos[1])


def _contact(scene: ThrowScene) -> list[float]:
    """Return MuJoCo's `solref` of the contact: a soft one, one with restitution, or a hard one without."""
    if scene.compliance:
        return [-1.0 / (scene.compliance * scene.mass), -scene.softened / scene.mass]
    if scene.restitution:
        ratio = damping_ratio(scene.restitution)
        return [1.0 / (_REBOUND * ratio), ratio]
    return [scene.slowness, 1.0]


def damping_ratio(restitution: float) -> float:
    """Return the damping ratio at which a spring and damper that push but never pull have a coefficient of restitution.

    Args:
        restitution: The coefficient, above zero and below one.

    Source: Schwager and Pöschel, Coefficient of restitution and linear-dashpot model revisited, Granular Matter 9, 2007.
    """

    def given_back(ratio: float) -> float:
        across = np.sqrt(abs(1.0 - ratio**2))
        angle = np.arctan2(across, ratio) if ratio < 1.0 else np.arctanh(across / ratio)
        return float(np.exp(-2.0 * ratio / max(across, 1e-12) * angle))

    return float(brentq(lambda ratio: given_back(ratio) - restitution, 1e-9, 100.0))


def _step(scene: ThrowScene) -> float:
    """Return the length of the engine's step, s."""
    return STEP / _FINER if scene.restitution else STEP


def _compile(scene: ThrowScene) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.option.timestep = _step(scene)
    spec.option.gravity = [0.0, 0.0, -scene.gravity]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.density = scene.density
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    contact = {
        "friction": [scene.friction, scene.spinning, scene.rolling],
        "condim": 6 if scene.rolling > 0 else 4 if scene.spinning > 0 else 3,
        "solref": _contact(scene),
    }
    turn = np.array([*scene.tilt, 0.0])
    plane = [10.0, 10.0, 1.0]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=plane, pos=[0.0, 0.0, scene.height], quat=quat_from_turn(turn), **contact
    )
    body = spec.worldbody.add_body(name="box")
    body.add_freejoint()
    edges = np.asarray(scene.edges, dtype=np.float64)
    ball = scene.shape == "ball"
    rigid = scene.mass * (1.0 - scene.slosh)
    body.mass = rigid
    moments = np.full(3, 0.1 * edges[0] ** 2) if ball else (np.sum(edges**2) - edges**2) / 12.0
    body.inertia = rigid * moments * scene.inertia
    body.ipos = list(scene.com)
    body.explicitinertial = True
    kind = mujoco.mjtGeom.mjGEOM_SPHERE if ball else mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(type=kind, size=[0.5 * edges[0], 0.0, 0.0] if ball else 0.5 * edges, **contact)
    if scene.slosh:
        inner = body.add_body(name="inner", pos=[0.0, 0.0, 0.0])
        inner.mass, inner.inertia, inner.explicitinertial = scene.mass * scene.slosh, [1e-6] * 3, True
        for axis in np.eye(3):
            stiff = scene.mass * scene.slosh * 30.0**2
            inner.add_joint(
                type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, stiffness=stiff, damping=0.1 * scene.mass * scene.slosh * 30.0
            )
    model = spec.compile()
    model.dof_damping[:3] = scene.linear * scene.mass
    model.dof_damping[3:6] = scene.angular * rigid * moments * scene.inertia
    return model
