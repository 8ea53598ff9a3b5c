"""The compiled replay against other engines: MuJoCo's bias forces and inertia, PyBullet's motion, an analytic axis."""

from pathlib import Path

import mujoco
import numpy as np
import pybullet_data
import pytest
import scipy.linalg
from bullet_replay import run_in_bullet

from gsbridge.effects.joints.base_tilt import BaseTilt
from gsbridge.gap.benchmark.mechanisms import axis_plant, controller
from gsbridge.gap.benchmark.trajectories import course
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism import dynamics
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism

ARM = {
    "urdf": "model.urdf",
    "controller": controller([600, 600, 400, 400, 100, 60, 20], [40, 40, 25, 25, 4, 2, 0.3]),
    "viscous": [2.0, 2.0, 1.0, 1.0, 0.2, 0.1, 0.02],
}
FOLDER = Path(pybullet_data.getDataPath()) / "kuka_iiwa"
HOME = np.array([0.0, 0.4, 0.0, -1.2, 0.0, 0.8, 0.0])


def arm(**changes):
    return parse_mechanism_model(ARM | changes, FOLDER)


def moved(system, centre, reach, duration=2.0):
    wanted = course("multisine", centre, np.full(len(centre), reach), duration, np.random.default_rng(3))
    time = np.arange(round(duration * 100)) / 100
    return Record("a", time, system.joints, {"command": np.array([wanted(t) for t in time])}, {}), wanted


def test_inertia_and_bias_equal_mujoco(tmp_path):
    mechanism = Mechanism(arm())
    mechanism.skeleton.write(tmp_path / "arm.urdf", mechanism.skeleton.inertials)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.urdf"))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    chain, bodies = mechanism.chain, mechanism.chain.bodies(mechanism.skeleton.inertials)
    turn, origin, axis = np.empty((7, 3, 3)), np.empty((7, 3)), np.empty((7, 3))
    matrix, hold, full, held = np.empty((7, 7)), np.empty(7), np.empty((7, 7)), np.empty(7)
    screws, loads, work = np.empty((7, 6)), np.empty((7, dynamics.LOADS)), np.empty((7, 18))
    gravity, parents, slides = np.array([0, 0, -9.81]), chain.parents, chain.slides
    for _ in range(5):
        data.qpos[:], data.qvel[:] = rng.normal(size=7), rng.normal(size=7)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        dynamics.place(parents, chain.fixed, chain.axes, slides, data.qpos.copy(), turn, origin, axis)
        dynamics.spread(slides, bodies, turn, origin, axis, screws, loads)
        dynamics.bias(parents, screws, loads, gravity, data.qvel.copy(), work, hold)
        dynamics.inertia(parents, screws, loads, matrix)
        np.testing.assert_allclose(matrix, full, atol=1e-9)
        np.testing.assert_allclose(hold, data.qfrc_bias, atol=1e-9)
        dynamics.weights(parents, slides, bodies, gravity, turn, origin, axis, work, held)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(held, data.qfrc_bias, atol=1e-9)


def test_factor_solves_as_scipy_does():
    rng = np.random.default_rng(1)
    for count in (1, 2, 7):
        root = rng.normal(size=(count, count))
        matrix, factor, values = root @ root.T + np.eye(count), np.empty((count, count)), rng.normal(size=count)
        wanted = scipy.linalg.solve(matrix, values)
        dynamics.factorise(matrix, factor)
        dynamics.solve(factor, values)
        np.testing.assert_allclose(values, wanted, rtol=1e-10)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_motion_equals_pybullet(friction):
    # The engine takes viscous friction at the begin of a step, the kernel at its end; the light wrist feels it most.
    system = arm(scheme="euler", physics_rate=1000)
    record, _ = moved(system, HOME, 0.3, 1.0)
    mechanism, setup = Mechanism(system), Mechanism(system).setup()
    setup.law["coulomb"][:4] = friction
    spans, states = [(0, len(record.time))], [(HOME, np.zeros(7))]
    ours = mechanism.run(record, setup, spans, states)
    theirs = run_in_bullet(mechanism, record, setup, spans, states)
    assert np.abs(ours["position"] - theirs["position"]).max(axis=0)[:6].max() < 2e-4
    assert np.abs(ours["effort"] - theirs["effort"]).max() < 0.05
    assert np.ptp(ours["position"], axis=0).min() > 0.02


def test_axis_follows_its_equation(tmp_path):
    system, plant = axis_plant(tmp_path)
    record, wanted = moved(system, np.array([0.3]), 0.8)
    truth = plant.truth(wanted, record.duration, record.time, {"coulomb": 0.1, "viscous": 0.05})
    mechanism = Mechanism(system)
    setup = mechanism.setup()
    setup.law["coulomb"][0], setup.law["viscous"][0] = 0.1, 0.05
    start = np.array([wanted(0.0)[0]])
    ours = mechanism.run(record, setup, [(0, len(record.time))], [(start, np.zeros(1))])
    # Commands of the record are joined by lines, the truth's follow the course: a tenth of a millirad at 100 Hz.
    assert np.abs(ours["position"] - truth["position"]).max() < 5e-4
    plain = mechanism.run(record, mechanism.setup(), [(0, len(record.time))], [(start, np.zeros(1))])
    assert np.abs(plain["position"] - truth["position"]).max() > 2e-3


def test_replays_repeat_to_the_last_bit(tmp_path):
    system, _ = axis_plant(tmp_path)
    record, wanted = moved(system, np.array([0.3]), 0.8)
    runs = [
        Mechanism(system).run(record, Mechanism(system).setup(), [(0, len(record.time))], [(wanted(0.0), np.zeros(1))])
        for _ in range(2)
    ]
    for kind in runs[0]:
        np.testing.assert_array_equal(runs[0][kind], runs[1][kind])


def test_joints_of_a_longer_chain_that_are_held_merge(tmp_path):
    whole = Mechanism(arm())
    held = Mechanism(arm(joints=["lbr_iiwa_joint_1", "lbr_iiwa_joint_2"], controller=controller(600, 40), viscous=1.0))
    masses = held.chain.bodies(held.skeleton.inertials)[:, 0]
    assert masses.sum() == pytest.approx(whole.chain.bodies(whole.skeleton.inertials)[:, 0].sum())


@pytest.mark.parametrize("down", [[0, 0, -1], [1, 0, 0], [0, -1, 0], [0, 0, 1], [0.6, 0.0, -0.8]])
def test_a_base_tilts_about_two_axes_across_gravity(down):
    """On a wall, too, where one of x and y is gravity's own axis: each parameter turns gravity by its full angle."""
    strength, angle = 9.81 * np.array(down, float), 0.05
    turned = []
    for name in ("about_x", "about_y"):
        setup = Mechanism(arm(gravity=strength.tolist())).setup()
        np.testing.assert_allclose(setup.gravity, strength)
        BaseTilt().apply(setup, -1, {"about_x": 0.0, "about_y": 0.0, name: angle})
        assert np.linalg.norm(setup.gravity) == pytest.approx(9.81)
        assert np.arccos(setup.gravity @ strength / 9.81**2) == pytest.approx(angle, abs=1e-6)
        turned.append(np.cross(strength, setup.gravity))
    assert turned[0] @ turned[1] == pytest.approx(0.0, abs=1e-9)
    if down == [0, 0, -1]:
        # The base turns about its own x: gravity turns the other way.
        np.testing.assert_allclose(setup_gravity(0.0, angle), [9.81 * np.sin(angle), 0, -9.81 * np.cos(angle)], atol=1e-12)
        np.testing.assert_allclose(setup_gravity(angle, 0.0), [0, -9.81 * np.sin(angle), -9.81 * np.cos(angle)], atol=1e-12)


def test_the_end_of_an_arm_is_where_it_ends_whatever_the_records_order():
    """Payload and surface belong to the outermost link; descriptions and logs may well list joints from the tip."""
    names = [f"lbr_iiwa_joint_{k}" for k in range(1, 8)]
    for order in (names, names[::-1], [names[k] for k in (3, 6, 0, 5, 1, 4, 2)]):
        mechanism = Mechanism(parse_mechanism_model(
            {"urdf": "model.urdf", "joints": order, "controller": {"mode": "torque"}}, FOLDER
        ))  # fmt: skip
        setup = mechanism.setup()
        assert setup.last == "lbr_iiwa_link_7"
        assert mechanism.system.joints[mechanism.chain.order[mechanism.tip]] == names[-1]
        before = setup.inertials[setup.last].mass
        setup.add_payload(0.5, np.array([0.0, 0.0, 0.1]))
        assert setup.inertials["lbr_iiwa_link_7"].mass == pytest.approx(before + 0.5)


def setup_gravity(about_x, about_y):
    """Gravity in the base of an arm that stands on a tilted floor."""
    setup = Mechanism(arm()).setup()
    BaseTilt().apply(setup, -1, {"about_x": about_x, "about_y": about_y})
    return setup.gravity
