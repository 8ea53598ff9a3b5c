"""Simulation of throws in PyBullet: all bodies of a set share one world and touch the surface, but not each other.

No setting is left to the engine's defaults. The engine's frame is that of the surface, so the surface's height and tilt move
the throws and gravity instead of the plane. A set of throws gives bit for bit the same results as its throws one by one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient
from scipy.spatial.transform import Rotation

from gsbridge.asset.bullet import body_from_inertial
from gsbridge.errors import InputError
from gsbridge.gap.contact.body import FreeBody
from gsbridge.gap.contact.setup import BodySetup
from gsbridge.gap.contact.starts import Starts
from gsbridge.geometry import Array, quat_from_rotation, rotation_from_quat

_SOLVER_ITERATIONS = 50

_LOSSES = ("linear_damping", "angular_damping")
"""Figures of the losses in the air: the loss of speed and that of spin."""

_FINER, _FINEST = 4, 10
"""Smallest and largest number of steps per step of the model if the contact is soft; in longer steps a ball rolls too fast."""

_SLOW_IMPACT = 0.05
"""Impact speed below which there is no rebound, m/s."""


@dataclass(frozen=True)
class Numerics:
    """Numerical choices of the engine that no model states; they are varied to learn how much they matter.

    Args:
        step_factor: Factor on the engine's step.
        erp: Share of a penetration that one step corrects. It also adds up to this share of the impact's speed to a rebound.
        cone: Whether friction is bounded by a circle instead of a square.
    """

    step_factor: float = 1.0
    erp: float = 0.1
    cone: bool = True


@dataclass(frozen=True)
class Flight:
    """A simulated throw at its samples, in the log's frame.

    Args:
        position: Position of the tracked point, m. [T, 3].
        quat: Attitude, wxyz. [T, 4].
        touched: Whether the body has touched the surface by then. [T] bool.
    """

    position: Array
    quat: Array
    touched: Array = field(repr=False)


def simulate(
    body: FreeBody, setup: BodySetup, starts: Starts, times: Sequence[Array], numerics: Numerics | None = None
) -> list[Flight]:
    """Simulate throws.

    Args:
        body: Shape and mass properties.
        setup: Figures of the simulation.
        starts: Initial states in the log's frame.
        times: Times of each throw's samples by the log's clock, s, from 0. Each [T].
        numerics: The engine's numerical choices; None for the defaults.

    Raises:
        InputError: PyBullet cannot load the body.
    """
    numerics = numerics or Numerics()
    step = numerics.step_factor * _fine_enough(1.0 / body.physics_rate, setup.figures)
    frame = _SurfaceFrame(setup.figures)
    clocks = [np.asarray(time, dtype=np.float64) / setup.figures["rate"] for time in times]
    client = BulletClient(pybullet.DIRECT)
    try:
        plane, numbers = _build(client, body, setup, len(times), numerics, step)
        client.setGravity(*frame.pull().tolist())
        kept = [float(np.exp(-step * setup.figures[name])) for name in _LOSSES]
        inertial, moments = body_from_inertial(client, numbers[0]), np.array(client.getDynamicsInfo(numbers[0], -1)[2])
        for number, pose, velocity, spin in zip(numbers, *frame.enter(starts, inertial, moments), strict=True):
            quat = np.roll(quat_from_rotation(pose[:3, :3]), -1)
            client.resetBasePositionAndOrientation(number, pose[:3, 3].tolist(), quat.tolist())
            # The engine moves positions with the speed at a step's end. Start half a step back, so that this is mid-step speed.
            begin = kept[0] ** 0.5 * velocity - 0.5 * step * frame.pull()
            client.resetBaseVelocity(number, begin.tolist(), (kept[1] ** 0.5 * spin).tolist())
        rows, touches = _run(client, plane, numbers, clocks, step, kept, frame.pull())
    finally:
        client.disconnect()
    return [
        Flight(*frame.leave(row[:, :3], row[:, 3:], inertial), clock >= touch)
        for row, clock, touch in zip(rows, clocks, touches, strict=True)
    ]


def _fine_enough(step: float, figures: Mapping[str, float]) -> float:
    """Return the engine's step, s: short enough, within limits, for a soft contact.

    The engine damps a contact by its stiffness times the step. Even at twice the returned step that should not exceed the
    damper.
    """
    soft = 0.5 * figures["compliance"] * figures["contact_damping"]
    return float(np.clip(soft, step / _FINEST, step / _FINER)) if figures["compliance"] > 0 else step


class _SurfaceFrame:
    """Conversion between the log and the engine, whose plane is the surface and whose lengths and times have no scale error."""

    def __init__(self, figures: Mapping[str, float]) -> None:
        self.figures = figures
        # Rotation from the engine's frame to the log's.
        self.turn = Rotation.from_euler("xyz", [figures["tilt_x"], figures["tilt_y"], 0.0]).as_matrix()
        self.lift = np.array([0.0, 0.0, figures["height"]])
        self.offset = np.array([figures[f"offset_{axis}"] for axis in "xyz"])

    def pull(self) -> Array:
        """Return the acceleration by gravity and the steady force, engine's frame, m/s2. [3]."""
        f = self.figures
        return self.turn.T @ np.array([f["force_x"] / f["mass"], f["force_y"] / f["mass"], -f["gravity"]])

    def enter(self, starts: Starts, inertial: Array, moments: Array) -> tuple[Array, Array, Array]:
        """Convert logged initial states to the engine's.

        Args:
            starts: Initial states as they were logged.
            inertial: Pose of the inertial frame in the body frame. [4, 4].
            moments: Principal moments of inertia, kg m2. [3].

        Returns:
            Poses of the inertial frame [N, 4, 4], velocities of the centre of mass, m/s, [N, 3] and angular velocities, rad/s,
            [N, 3], in the engine's frame.
        """
        f = self.figures
        attitude = rotation_from_quat(starts.quat)
        arm = attitude @ (inertial[:3, 3] - self.offset)
        spin, velocity = starts.spin * f["rate"], starts.velocity * (f["rate"] / f["scale"])
        # Speeds with a lag belong to an earlier moment; propagate them through free flight to the first sample.
        lag = f["lag"] / f["rate"]
        back = Rotation.from_rotvec(-lag * spin).as_matrix()
        velocity = velocity + np.cross(spin, np.einsum("nij,nj->ni", back, arm))
        if lag:
            slowing, slower = (f[name] for name in _LOSSES)
            pulled = -np.expm1(-slowing * lag) / slowing if slowing else lag
            velocity = np.exp(-slowing * lag) * velocity + pulled * self.turn @ self.pull()
            spin = np.exp(-slower * lag) * _spun_on(spin, back, attitude @ inertial[:3, :3], moments)
        poses = np.tile(np.eye(4), (len(attitude), 1, 1))
        poses[:, :3, :3] = self.turn.T @ attitude @ inertial[:3, :3]
        poses[:, :3, 3] = (starts.position / f["scale"] + arm - self.lift) @ self.turn
        return poses, velocity @ self.turn, spin @ self.turn

    def leave(self, position: Array, xyzw: Array, inertial: Array) -> tuple[Array, Array]:
        """Convert poses of the inertial frame in the engine to the log's frame.

        Args:
            position: Positions of the inertial frame, engine's frame, m. [T, 3].
            xyzw: Its attitudes, as quaternions xyzw. [T, 4].
            inertial: Pose of the inertial frame in the body frame. [4, 4].

        Returns:
            Positions of the tracked point, m, and attitudes of the body, wxyz, in the log's frame. [T, 3], [T, 4].
        """
        attitude = self.turn @ rotation_from_quat(np.roll(xyzw, 1, axis=1)) @ inertial[:3, :3].T
        place = position @ self.turn.T + self.lift - attitude @ (inertial[:3, 3] - self.offset)
        return self.figures["scale"] * place, quat_from_rotation(attitude)


def _spun_on(spin: Array, back: Array, attitude: Array, moments: Array) -> Array:
    """Propagate angular velocities to a later moment of free flight, in which angular momentum is constant. [N, 3].

    Args:
        spin: Angular velocities at the earlier moment, rad/s. [N, 3].
        back: Rotations from the later moment's attitudes to the earlier one's. [N, 3, 3].
        attitude: Attitudes of the principal axes at the later moment. [N, 3, 3].
        moments: Principal moments of inertia, kg m2. [3].
    """
    before = back @ attitude
    momentum = np.einsum("nij,j,nkj,nk->ni", before, moments, before, spin)
    return np.einsum("nij,j,nkj,nk->ni", attitude, 1.0 / moments, attitude, momentum)


def _build(
    client: BulletClient, body: FreeBody, setup: BodySetup, count: int, numerics: Numerics, step: float
) -> tuple[int, list[int]]:
    """Add the surface and `count` copies of the body to the engine, with every setting stated; return their numbers."""
    f = setup.figures
    client.setPhysicsEngineParameter(
        fixedTimeStep=step,
        numSubSteps=0,
        numSolverIterations=_SOLVER_ITERATIONS,
        deterministicOverlappingPairs=1,
        restitutionVelocityThreshold=_SLOW_IMPACT,
        erp=numerics.erp,
        contactERP=numerics.erp,
        enableConeFriction=int(numerics.cone),
    )
    plane = client.createMultiBody(0.0, client.createCollisionShape(client.GEOM_PLANE))
    # Bullet multiplies the friction and restitution of the two bodies in contact, so those of the thrown body are 1.
    client.changeDynamics(
        plane,
        -1,
        lateralFriction=f["friction"],
        restitution=f["restitution"],
        rollingFriction=f["rolling_friction"],
        spinningFriction=f["spinning_friction"],
    )
    client.setCollisionFilterGroupMask(plane, -1, 1, 2)
    soft = {}
    if f["compliance"] > 0:
        # Bullet evaluates the spring at a step's end, which damps by stiffness times step; subtract that from the damper.
        own = max(f["contact_damping"] - step / f["compliance"], 0.0)
        soft = {"contactStiffness": 1.0 / f["compliance"], "contactDamping": own}
    numbers = []
    with tempfile.TemporaryDirectory(prefix="gsbridge-gap-") as folder:
        path = Path(folder) / "body.urdf"
        com = np.array([f[f"com_{axis}"] for axis in "xyz"])
        path.write_text(body.urdf(f["mass"], com, f["inertia"], f["size"]), encoding="utf-8")
        for _ in range(count):
            try:
                number = client.loadURDF(str(path), flags=client.URDF_USE_INERTIA_FROM_FILE)
            except pybullet.error as error:
                raise InputError(body.source, f"PyBullet cannot load the body ({error})", "Check it with a viewer") from error
            client.setCollisionFilterGroupMask(number, -1, 2, 1)
            client.changeDynamics(
                number,
                -1,
                lateralFriction=1.0,
                restitution=1.0,
                rollingFriction=0.0,
                spinningFriction=0.0,
                # Bullet's own damping grows with the speed.
                linearDamping=0.0,
                angularDamping=0.0,
                # By default Bullet brakes a body before it touches, by an amount that depends on how the steps fall.
                contactProcessingThreshold=0.0,
                maxJointVelocity=1e4,
                activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
                **soft,
            )
            numbers.append(number)
    return plane, numbers


def _run(
    client: BulletClient,
    plane: int,
    numbers: Sequence[int],
    clocks: Sequence[Array],
    step: float,
    kept: Sequence[float],
    pull: Array,
) -> tuple[list[Array], Array]:
    """Run the engine; return poses of the inertial frames at the samples, and times of first touch.

    Args:
        client: The engine.
        plane: Number of the surface.
        numbers: Numbers of the N bodies.
        clocks: Times of each body's samples, s. Each [T].
        step: Step of the engine, s.
        kept: Shares of speed and of spin that remain after one step in the air.
        pull: Acceleration by gravity and the steady force, engine's frame, m/s2. [3].

    Returns:
        Positions, m, and quaternions xyzw of each body, each [T, 7], and times of first touch, s, inf for none. [N].
    """
    wanted: dict[int, list[int]] = {}
    for place, clock in enumerate(clocks):
        before = np.floor(clock / step).astype(int)
        for number in np.unique(np.concatenate([before, before + 1])).tolist():
            wanted.setdefault(number, []).append(place)
    seen: list[tuple[list[int], list[list[float]]]] = [([], []) for _ in clocks]
    touch = np.full(len(clocks), np.inf)
    place_of = {number: place for place, number in enumerate(numbers)}
    look, advance = client.getBasePositionAndOrientation, client.stepSimulation
    moving, push = client.getBaseVelocity, client.resetBaseVelocity
    # The next step adds the pull of a whole step without losses; subtract in advance what half a step's losses take of it.
    lost = ((1.0 - kept[0] ** 0.5) * step * pull).tolist()
    for number in range(max(wanted) + 1):
        for place in wanted.get(number, ()):
            at, to = look(numbers[place])
            seen[place][0].append(number)
            seen[place][1].append([*at, *to])
        if not np.isfinite(touch).all():
            for contact in client.getContactPoints(plane):
                place = place_of[contact[2]]
                if contact[9] > 0.0 and not np.isfinite(touch[place]):
                    # The engine reports contacts of the step that has just ended.
                    touch[place] = (number - 1) * step
        advance()
        if min(kept) < 1.0:
            for item in numbers:
                velocity, spin = moving(item)
                slowed = [kept[0] * value - less for value, less in zip(velocity, lost, strict=True)]
                push(item, slowed, [kept[1] * value for value in spin])
    return [
        _between(np.array(known) * step, np.array(poses), clock) for (known, poses), clock in zip(seen, clocks, strict=True)
    ], touch


def _between(known: Array, poses: Array, clock: Array) -> Array:
    """Interpolate poses linearly between steps. [K], [K, 7], [T] -> [T, 7]."""
    # A quaternion and its negative are the same attitude; make the signs of neighbours agree before interpolating.
    flips = np.where((poses[1:, 3:] * poses[:-1, 3:]).sum(axis=1) < 0, -1.0, 1.0)
    poses[1:, 3:] *= np.cumprod(flips)[:, None]
    out = np.stack([np.interp(clock, known, column) for column in poses.T], axis=1)
    out[:, 3:] /= np.linalg.norm(out[:, 3:], axis=1, keepdims=True)
    return out
