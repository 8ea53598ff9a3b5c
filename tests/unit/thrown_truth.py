"""Throws of a box in MuJoCo, whose contacts are another formulation than those of the engine that diagnoses them.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gsbridge.gap.contact.starts import quat_from_turn
from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.geometry import Array, quat_multiply

STEP = 5e-4
"""Of MuJoCo, s."""


@dataclass(frozen=True)
class Scene:
    """A box, a surface, and how the box is thrown and logged.

    Args:
        edges: Of the box, m.
        mass: kg.
        friction: Of the pair, sliding.
        spinning: Lever arm of spinning friction, m; none at zero.
        gravity: m/s2.
        density: Of the air, kg/m3, for MuJoCo's drag.
        tilt: Of the surface about y, rad.
        com_x: Shift of the centre of mass along the body's x axis, m.
        slowness: Time constant of the contact, s.
        rate: Samples per second.
        duration: Of a throw, s.
        noise: Of positions, m, and of attitudes, rad.
    """

    edges: Sequence[float] = (0.1, 0.1, 0.1)
    mass: float = 0.4
    friction: float = 0.2
    spinning: float = 0.0
    gravity: float = 9.81
    density: float = 0.0
    tilt: float = 0.0
    com_x: float = 0.0
    slowness: float = 0.004
    rate: float = 150.0
    duration: float = 0.75
    noise: tuple[float, float] = (1e-4, 5e-4)


def throw_box(scene: Scene, count: int, seed: int) -> Throws:
    """Throw a box `count` times: low, at 0.5-1.5 m/s, with spins of some rad/s."""
    rng = np.random.default_rng(seed)
    model = _compile(scene)
    data = mujoco.MjData(model)
    items = []
    for number in range(count):
        mujoco.mj_resetData(model, data)
        turn = rng.normal(size=4)
        data.qpos[:3] = 0.0, 0.0, rng.uniform(1.0, 2.0) * float(np.linalg.norm(scene.edges))
        data.qpos[3:7] = turn / np.linalg.norm(turn)
        along, speed = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.5, 1.5)
        data.qvel[:3] = speed * np.cos(along), speed * np.sin(along), rng.uniform(-0.3, 0.3)
        data.qvel[3:6] = rng.normal(0.0, 2.5, 3)
        mujoco.mj_forward(model, data)
        items.append(_logged(scene, model, data, rng, str(number)))
    return Throws(tuple(items))


def _logged(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator, name: str) -> Throw:
    """One throw as a tracker sees it."""
    time = np.arange(int(scene.duration * scene.rate) + 1) / scene.rate
    steps = np.round(time / STEP).astype(int)
    rows: list[Array] = []
    for step in range(int(steps[-1]) + 1):
        if step == steps[len(rows)]:
            rows.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    poses = np.array(rows)
    position = poses[:, :3] + rng.normal(0.0, scene.noise[0], (len(time), 3))
    quat = quat_multiply(quat_from_turn(rng.normal(0.0, scene.noise[1], (len(time), 3))), poses[:, 3:])
    return Throw(name, steps * STEP, position, quat)


def _compile(scene: Scene) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    spec.option.gravity = [0.0, 0.0, -scene.gravity]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.density = scene.density
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    contact = {
        "friction": [scene.friction, scene.spinning, 0.0],
        "condim": 4 if scene.spinning > 0 else 3,
        "solref": [scene.slowness, 1.0],
    }
    half = 0.5 * scene.tilt
    quat = [np.cos(half), 0.0, np.sin(half), 0.0]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10.0, 10.0, 1.0], quat=quat, **contact)
    body = spec.worldbody.add_body(name="box")
    body.add_freejoint()
    edges = np.asarray(scene.edges, dtype=np.float64)
    body.mass = scene.mass
    body.inertia = scene.mass / 12.0 * (np.sum(edges**2) - edges**2)
    body.ipos = [scene.com_x, 0.0, 0.0]
    body.explicitinertial = True
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=0.5 * edges, **contact)
    return spec.compile()
