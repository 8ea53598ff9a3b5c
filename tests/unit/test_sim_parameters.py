"""Every physical value of the model acts, on the channel it should and with the size that mechanics predicts."""

import numpy as np
import pytest
from sim_fixture import EDGE, ball, content, model, slab, world

from gsbridge.sim.engine import Item
from gsbridge.sim.world import SimWorld
from gsbridge.tasks.state import State

G, RADIUS = 9.81, EDGE / 2
MIDDLE = np.array([0.0, 0.265, 0.0])


def moved(sim: SimWorld, seconds: float) -> np.ndarray:
    """Position of the object after some time, relative to the start region's middle."""
    for _ in range(round(seconds / sim.model.period)):
        sim.step()
    return sim.state().object_position[0] - MIDDLE


def slide(friction: float, **changes) -> float:
    """Way of the cube pushed at 0.5 m/s until it stops."""
    with world(contact__table__friction=friction, **changes) as sim:
        sim.push([0.5, 0, 0], [0, 0, 0])
        return moved(sim, 0.6)[0]


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_table_friction_sets_the_stopping_distance(friction):
    assert slide(friction) == pytest.approx(0.5**2 / (2 * friction * G), rel=0.05)


def test_gravity_shortens_the_slide():
    assert slide(0.3, gravity=5.0) == pytest.approx(0.5**2 / (2 * 0.3 * 5.0), rel=0.05)


def test_mass_changes_the_weight_but_not_the_slide():
    with world(object__mass=2.0) as sim:
        assert sim.state().object_contact[0] == pytest.approx(2 * 600 * EDGE**3 * G, rel=0.01)
    assert slide(0.3, object__mass=2.0) == pytest.approx(slide(0.3), rel=0.02)


def drop(height: float, **changes) -> float:
    """How high the ball comes up again, looked at every 5 ms."""
    with world(ball(), timing__control_hz=200, **changes) as sim:
        pose = np.eye(4)
        pose[:3, 3] = 0.0, 0.265, height
        sim.place(pose)
        heights = np.array([moved(sim, 0.005)[2] for _ in range(60)])
    return float(heights[int(np.sqrt(2 * height / G) / 0.005) + 2 :].max())


def test_restitution_throws_the_ball_back():
    """A soft contact gives back less than the coefficient says, but the more, the larger it is, and nothing without it."""
    rebounds = [drop(0.05, contact__table__restitution=value) for value in (0.0, 0.4, 0.8)]
    assert rebounds[0] < 1e-3
    assert 1e-3 < rebounds[1] < 0.05 * 0.4**2
    assert 5e-3 < rebounds[2] < 0.05 * 0.8**2


def test_rolling_friction_brakes_the_ball():
    """Rolling without slip, a = -(5/7) g lever / radius."""
    for lever in (0.0, 0.001):
        with world(ball(), contact__table__rolling_friction=lever, contact__table__spinning_friction=0.0) as sim:
            sim.push([0.2, 0, 0], [0, 0.2 / RADIUS, 0])
            moved(sim, 0.5)
            speed = np.linalg.norm(sim.state().object_spin[0]) * RADIUS
        assert speed == pytest.approx(max(0.2 - 5 / 7 * G * lever / RADIUS * 0.5, 0.0), abs=0.02)


def test_spinning_friction_brakes_the_spin():
    """Torque = lever * weight, so the spin falls by lever * g / (0.4 r^2) per second."""
    for lever in (0.0, 0.0002):
        with world(ball(), contact__table__spinning_friction=lever) as sim:
            sim.push([0, 0, 0], [0, 0, 10.0])
            moved(sim, 0.5)
            assert sim.state().object_spin[0, 2] == pytest.approx(10.0 - lever * G / (0.4 * RADIUS**2) * 0.5, abs=0.2)


def on_plate(folder, key: str, value: float, speed: float, turn: float, seconds: float) -> State:
    """A ball on a slab, some time after it was given a speed along x and a spin about the vertical."""
    still = {"contact__plate__spinning_friction": 0.0, f"contact__plate__{key}": value}
    with world(ball(), plate=slab(folder), **still) as sim:
        sim.push([speed, 0, 0], [0, speed / RADIUS, turn])
        moved(sim, seconds)
        return sim.state()


def test_rolling_friction_of_the_plate_brakes_the_ball(tmp_path):
    free, braked = (on_plate(tmp_path, "rolling_friction", lever, 0.2, 0.0, 0.3) for lever in (0.0, 0.002))
    lost = np.linalg.norm(free.object_spin[0]) - np.linalg.norm(braked.object_spin[0])
    assert lost * RADIUS == pytest.approx(5 / 7 * G * 0.002 / RADIUS * 0.3, rel=0.15)


def test_spinning_friction_of_the_plate_brakes_the_spin(tmp_path):
    free, braked = (on_plate(tmp_path, "spinning_friction", lever, 0.0, 10.0, 0.3) for lever in (0.0, 0.0002))
    lost = free.object_spin[0, 2] - braked.object_spin[0, 2]
    assert lost == pytest.approx(0.0002 * G / (0.4 * RADIUS**2) * 0.3, rel=0.1)


def test_restitution_of_the_plate_throws_the_ball_back(tmp_path):
    plate = slab(tmp_path)
    rebounds = [drop(0.05, plate=plate, contact__plate__restitution=value) - 0.006 for value in (0.0, 0.8)]
    assert rebounds[0] < 2e-3
    assert rebounds[1] > 5e-3


def pinched(axis: int, **changes) -> float:
    """What is left of a spin of 20 rad/s after 50 ms, of a ball between two pads that close along y, without weight."""
    with squeeze(ball(), gravity=0.0, contact__table__friction=0.0, **changes) as sim:
        assert sim.state().pad_forces.min() > 1.0
        sim.push([0, 0, 0], 20.0 * np.eye(3)[axis])
        sim.step()
        return sim.state().object_spin[0, axis]


def test_spinning_friction_of_the_pads_holds_what_would_turn_between_them():
    assert pinched(1, contact__gripper__spinning_friction=0.0) == pytest.approx(20.0, rel=0.01)
    assert pinched(1, contact__gripper__spinning_friction=0.005) == pytest.approx(0.0, abs=0.1)


def test_rolling_friction_of_the_pads_brakes_what_would_roll_along_them():
    slippery = {"contact__gripper__friction": 0.001, "contact__gripper__spinning_friction": 0.0}
    free, braked = (pinched(0, contact__gripper__rolling_friction=lever, **slippery) for lever in (0.0, 0.002))
    assert free > 10.0
    assert braked < 0.5 * free


def test_restitution_of_the_pads_throws_back_what_hits_them():
    """A ball pushed against an open finger."""
    speeds = []
    for value in (0.0, 0.8):
        with world(ball(), contact__gripper__restitution=value) as sim:
            for height, steps in ((0.15, 6), (0.045, 10)):
                for _ in range(steps):
                    sim.command(np.array([*MIDDLE[:2], height]), 0.0, 0.14)
                    sim.step()
            sim.push([0, 1.0, 0], [0, 0, 0])
            sim.step()
            sim.step()
            speeds.append(np.linalg.norm(sim.state().object_velocity[0]))
    assert speeds[0] < 0.03
    assert speeds[1] > 2.0 * speeds[0]


def test_stiffness_of_contacts_sets_how_far_the_ball_sinks():
    weight = 600 * 4 / 3 * np.pi * RADIUS**3 * G
    for stiffness in (2e3, 1e4):
        with world(ball(), contact__stiffness=stiffness, contact__damping=20.0) as sim:
            # The engine adds a hundredth of a millimetre of slop.
            assert -moved(sim, 0.5)[2] == pytest.approx(weight / stiffness + 1e-5, rel=0.05)


def test_damping_of_contacts_takes_the_rebound_of_their_spring():
    springy, damped = (drop(0.03, contact__stiffness=2e3, contact__damping=value) for value in (0.5, 50.0))
    assert springy > damped + 0.005


@pytest.mark.parametrize(("key", "spin"), [("linear_damping", False), ("angular_damping", True)])
def test_damping_of_the_object_in_the_air(key, spin):
    """Against the closed form of v' = -d v. Engine defaults would take 0.04 per second; nominal takes nothing."""
    for damping in (0.0, 1.0):
        with world(gravity=0.0, **{f"object__{key}": damping}) as sim:
            pose = np.eye(4)
            pose[:3, 3] = 0.0, 0.265, 3.0
            sim.place(pose)
            sim.push([0 if spin else 1.0, 0, 0], [0, 0, 1.0 if spin else 0])
            moved(sim, 0.4)
            state = sim.state()
            speed = state.object_spin[0, 2] if spin else state.object_velocity[0, 0]
        assert speed == pytest.approx(np.exp(-damping * 0.4), rel=1e-6 if damping else 1e-9)


# The arm: one step of 48 mm sideways, then still.


def swing(**changes) -> tuple[np.ndarray, np.ndarray]:
    """Tool y and motor torque of the first joint, per physics step of 0.4 s after a step command."""
    with world(**changes) as sim:
        rows = []
        advance = sim.engine.advance

        def record() -> None:
            rows.append((sim.controller.torques[1, 0], *sim._measured[0, :2], *sim._measured[1, :1]))
            advance()

        sim.engine.advance = record
        sim.command(np.array([0.0, 0.313, 0.25]), 0.0, 0.14)
        for _ in range(round(0.4 / sim.model.period)):
            sim.step()
    rows = np.array(rows)
    return rows[:, 1], rows[:, 0]


def with_first(section: str, factor: float) -> list[float]:
    """A list of the model with the first joint's value changed."""
    values = list(content()["arm"][section])
    values[0] *= factor
    return values


@pytest.fixture(scope="module")
def nominal():
    return swing()


def largest(a: np.ndarray, b: np.ndarray) -> float:
    count = min(len(a), len(b))
    return float(np.abs(a[:count] - b[:count]).max())


@pytest.mark.parametrize(
    ("key", "factor"), [("stiffness", 0.2), ("damping", 0.2), ("armature", 5.0), ("viscous_friction", 20.0)]
)
def test_joint_gains_and_losses_act_on_position_and_effort(nominal, key, factor):
    angle, effort = swing(**{f"arm__{key}": with_first(key, factor)})
    assert largest(angle, nominal[0]) > 1e-4
    assert largest(effort, nominal[1]) > 1.0


def test_armature_and_friction_cost_the_torque_they_should(nominal):
    """Effort against inertia times acceleration plus friction times speed, with the joint's own values doubled."""
    more = {"arm__armature": with_first("armature", 3.0)}
    angle, effort = swing(**more)
    acceleration = np.gradient(np.gradient(angle, 1e-3), 1e-3)
    plain = np.gradient(np.gradient(nominal[0], 1e-3), 1e-3)
    # 1.0 kg m2 more: at the largest acceleration the motors must give as much more torque.
    k = int(np.argmax(plain[:60]))
    extra = effort[k : k + 10].mean() - nominal[1][k : k + 10].mean()
    inertia = 2.2 + 0.5
    expected = (inertia + 1.0) * acceleration[k : k + 10].mean() - inertia * plain[k : k + 10].mean()
    assert extra == pytest.approx(expected, rel=0.15)


def test_delay_shifts_the_motion(nominal):
    """By the number of steps it says."""
    angle, _ = swing(arm__delay=0.03)
    assert np.abs(angle[:29] - angle[0]).max() < 1e-6
    assert largest(angle[30:], nominal[0]) < 1e-5
    assert largest(angle, nominal[0]) > 1e-2


def test_gravity_compensation_carries_the_arm():
    """Without a tenth of it the second joint sags by the missing torque over its stiffness."""
    with world(arm__gravity_compensation=0.9) as sim, world() as full:
        for _ in range(6):
            sim.step()
            full.step()
        sag = sim.joints()[0][1] - full.joints()[0][1]
        missing = -0.1 * full.joints()[2][1]
        # The angle at which the weight is carried is that of the sagged arm, all but the same.
        assert sag == pytest.approx(missing / content()["arm"]["stiffness"][1], rel=0.02)
        assert full.joints()[0][1] == pytest.approx(full.kinematics.rest[1], abs=1e-6)


# The gripper.


def close(sim: SimWorld, steps: int) -> np.ndarray:
    """Opening while the gripper closes in the air."""
    out = []
    for _ in range(steps):
        sim.command(np.array([0.0, 0.265, 0.25]), 0.0, 0.0)
        sim.step()
        out.append(sim.state().aperture[0])
    return np.array(out)


@pytest.mark.parametrize("speed", [0.08, 0.2])
def test_gripper_speed(speed):
    with world(gripper__speed=speed) as sim:
        opening = close(sim, 8)
    assert (opening[2] - opening[6]) / 0.2 == pytest.approx(speed, rel=0.05)


def squeeze(item: Item | None = None, **changes) -> SimWorld:
    """A world with the cube, or another object, held on the table."""
    sim = world(item, **changes)
    for height, aperture, steps in ((0.15, 0.1, 6), (0.045, 0.1, 10), (0.045, 0.0, 14)):
        for _ in range(steps):
            sim.command(np.array([0.0, 0.265, height]), 0.0, aperture)
            sim.step()
    return sim


@pytest.mark.parametrize("force", [20, 80])
def test_gripper_force_is_what_the_pads_feel(force):
    with squeeze(gripper__force=force) as sim:
        assert sim.state().pad_forces[0] == pytest.approx([force, force], rel=0.1)


def test_gripper_stiffness_and_damping_act_on_the_opening():
    ways = []
    for changes in ({}, {"stiffness": 500.0}, {"damping": 0.0}):
        with world(**{f"gripper__{key}": value for key, value in changes.items()}) as sim:
            ways.append(close(sim, 4))
    assert np.abs(ways[1] - ways[0]).max() > 5e-4
    assert np.abs(ways[2] - ways[0]).max() > 5e-5


def test_gripper_friction_holds_or_drops():
    for friction, holds in ((0.9, True), (0.01, False)):
        with squeeze(contact__gripper__friction=friction) as sim:
            for height in np.linspace(0.045, 0.12, 8):
                sim.command(np.array([0.0, 0.265, height]), 0.0, 0.0)
                sim.step()
            assert bool(sim.state().object_clearance[0] > 0.05) is holds


def test_control_rate_sets_the_period_and_physics_rate_the_steps():
    fast = model(timing__control_hz=50, timing__physics_hz=2000)
    assert (fast.period, fast.substeps) == (0.02, 40)
    with world(timing__control_hz=50) as sim:
        pose = np.eye(4)
        pose[:3, 3] = 0.0, 0.265, 3.0
        sim.place(pose)
        for _ in range(5):
            sim.step()
        assert sim.state().object_velocity[0, 2] == pytest.approx(-G * 0.1, rel=1e-6)
    falls = []
    for rate in (500, 1000):
        with world(timing__physics_hz=rate) as sim:
            pose = np.eye(4)
            pose[:3, 3] = 0.0, 0.265, 3.0
            sim.place(pose)
            falls.append(moved(sim, 0.2)[2])
    # Semi-implicit Euler falls g t dt / 2 farther than the parabola.
    assert falls[1] - falls[0] == pytest.approx(G * 0.2 * 0.0005, rel=0.05)
