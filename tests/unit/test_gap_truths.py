"""The benchmark's truths share no code with the diagnosis, and play what they list as an equation or another engine does."""

import ast
from pathlib import Path

import numpy as np
import pybullet
import pytest
from axis_logs import axis_course
from pybullet_utils.bullet_client import BulletClient
from scipy.signal import lfilter

import gsbridge.gap.benchmark
from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.axis_truth import AXIS, run_axis
from gsbridge.gap.benchmark.bullet_truth import BulletTruth
from gsbridge.gap.benchmark.generate import NotShownError
from gsbridge.gap.benchmark.hidden_parts import PLACE, Commands
from gsbridge.gap.benchmark.mechanisms import axis_plant, mechanism_site
from gsbridge.gap.benchmark.mujoco_truth import MujocoTruth
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.mechanism.setup import smoothed

TRUTHS = ("axis_truth", "axis_motion", "mujoco_truth", "bullet_truth", "arm_loop", "trajectories", "noises")


@pytest.mark.parametrize("name", TRUTHS)
def test_truths_import_nothing_of_the_diagnosis(name):
    path = Path(gsbridge.gap.benchmark.__file__).parent / f"{name}.py"
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            found.add(str(node.module))
        elif isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
    known = {
        "gsbridge.gap.joints.mechanism.mechanism_model",
        "gsbridge.gap.joints.mechanism.inertials",
        "gsbridge.geometry",
        "gsbridge.kernels",
    }
    ours = {item for item in found if item.startswith("gsbridge")}
    assert all(item in known or item.startswith("gsbridge.gap.benchmark.") for item in ours), ours


@pytest.mark.parametrize(
    ("hidden", "effect"),
    [
        ({}, None),
        ({"viscous": 0.2}, Applied("viscous", "axis", {"coefficient": 0.2})),
        ({"coulomb": 0.05}, Applied("coulomb", "axis", {"torque": 0.05})),
        ({"link_mass": 0.1}, Applied("link_mass", "axis", {"change": 0.1})),
        ({"command_delay": 0.004}, Applied("command_delay", "", {"time": 0.004})),
        ({"spring": 0.5}, Applied("spring", "axis", {"stiffness": 0.5, "rest": 0.4})),
    ],
)
def test_engines_agree_with_the_replay_on_what_an_effect_does(tmp_path, hidden, effect):
    # Three formulations and the replay, against the benchmark's noise of 2e-4 rad and 0.02 N m. Joints that dry friction holds
    # creep in some of them.
    system, _ = axis_plant(tmp_path)
    wanted, times = axis_course()
    mechanism = Mechanism(system)
    record = Record("a", times, system.joints, {"command": np.array([wanted(t) for t in times])}, {})
    start = [(wanted(0.0), np.zeros(1))]
    ours = mechanism.run(record, apply_effects(mechanism, [effect] if effect else []), [(0, len(times))], start)
    for truth in (run_axis, MujocoTruth(system), BulletTruth(system)):
        theirs = truth(wanted, 1.0, times, hidden)
        assert np.abs(theirs["position"] - ours["position"]).max() < (4e-4 if "coulomb" in hidden else 1.5e-4)
        assert np.abs(theirs["effort"] - ours["effort"]).max() < (0.06 if "coulomb" in hidden else 0.03)


def test_a_lag_is_the_filters_exact_answer(tmp_path):
    # Reference: the differential equation of the filter, T y' = u - y, stepped a thousand times finer.
    wanted, times = axis_course()
    slow, fine = 2.5e-3, np.arange(0.0, 1.0, 1e-6)
    knots = np.arange(102) * 1e-2
    lines = np.interp(fine, knots, [float(wanted(t)[0]) for t in knots])
    share = 5e-7 / slow
    exact = lines[0] + lfilter([share / (1 + share)] * 2, [1.0, -(1 - share) / (1 + share)], lines - lines[0])
    grid = fine[::1000]
    ours = smoothed(np.interp(grid, fine, lines)[:, None], slow, 1e-3)[:, 0]
    assert np.abs(ours - exact[::1000]).max() < 1e-6
    # The same for the filters in the truths of arms and of the axis, judged by the motion that they cause.
    system, _ = axis_plant(tmp_path)
    moved = [truth(wanted, 1.0, times, {"lag": slow})["position"] for truth in (run_axis, MujocoTruth(system))]
    plain = [truth(wanted, 1.0, times, {})["position"] for truth in (run_axis, MujocoTruth(system))]
    changes = [a - b for a, b in zip(moved, plain, strict=True)]
    assert np.abs(changes[0] - changes[1]).max() < 0.01 * np.abs(changes[0]).max()


def test_what_delays_filters_and_limits_commands_adds_up(tmp_path):
    """Two of them hidden together once left one out, though the truth listed both."""
    wanted, times = axis_course()
    late, limit = {"command_delay": 0.03}, {"rate_limit": 2.0}
    system, _ = axis_plant(tmp_path)
    for truth in (run_axis, MujocoTruth(system)):
        both = truth(wanted, 1.0, times, {"lag": 0.01, **late})["position"]
        other = truth(lambda time: wanted(max(time - 0.03, 0.0)), 1.0, times, {"lag": 0.01})["position"]
        np.testing.assert_allclose(both, other, atol=1e-4)
        assert np.abs(both - truth(wanted, 1.0, times, {"lag": 0.01})["position"]).max() > 5e-3
    # A ramp of 1 rad/s behind a filter, through a limit of 0.5 rad/s; the filter itself trails by its time constant.
    ramp, hidden = np.arange(200) * 1e-3, {"lag": 0.01, **limit}
    made = Commands(system, hidden, np.zeros(1), 1e-3)
    sent = np.array([made(np.array([value]))[0] for value in ramp])
    filtered = ramp - 0.01 * (1.0 - np.exp(-ramp / 0.01))
    # Below half of its final speed the filter is slower than the limit.
    free = ramp < 0.01 * np.log(2.0)
    np.testing.assert_allclose(sent[free], filtered[free], atol=1e-9)
    np.testing.assert_allclose(np.diff(sent)[20:], 0.5e-3, atol=1e-12)


def test_dry_friction_holds_in_the_engines_without_creeping(tmp_path):
    # 0.05 N m pull at a joint that 0.2 N m hold: it must not move at all, and by default MuJoCo lets it creep.
    system, _ = axis_plant(tmp_path)
    times = np.arange(100) / 100
    for truth in (MujocoTruth(system), BulletTruth(system)):
        held = truth(lambda time: np.array([0.3]), 1.0, times, {"coulomb": 0.2, "effort_offset": 0.05})
        assert np.abs(held["position"] - 0.3).max() < 1e-5


@pytest.mark.parametrize("engine", [BulletTruth, MujocoTruth])
def test_a_payload_is_as_heavy_on_a_link_that_is_heavier_than_described(engine, tmp_path):
    """A held axis: the weights of the link, 0.2 m from the axis and half as heavy again, and of 1 kg at its place on it."""
    system, _ = axis_plant(tmp_path)
    held = engine(system)(lambda time: np.array([-0.5]), 2.0, np.array([1.9]), {"payload": 1.0, "link_mass:axis": 0.5})
    q, (x, _, z) = held["position"][0, 0], PLACE
    levers = 1.5 * AXIS["moment"] * np.cos(q) + x * np.cos(q) - z * np.sin(q)
    assert held["effort"][0, 0] == pytest.approx(AXIS["gravity"] * levers, rel=1e-3)


@pytest.mark.parametrize("joint", [":axis", ""])
def test_play_and_a_spring_are_not_hidden_behind_one_motor(tmp_path, joint):
    """MuJoCo's joint between motor and link is either of them, so that a truth of both would be a truth of one."""
    system, _ = axis_plant(tmp_path)
    wanted, times = axis_course()
    with pytest.raises(NotShownError, match="the joint axis has either backlash or compliance") as caught:
        MujocoTruth(system)(wanted, 1.0, times, {f"backlash{joint}": 0.01, f"compliance{joint}": 0.001})
    assert caught.value.name == f"compliance{joint}"


@pytest.mark.parametrize("engine", [BulletTruth, MujocoTruth])
def test_a_push_is_the_engines_own_and_passes(engine, tmp_path):
    """A slow push down: the controller's torques grow by the Jacobian's transpose times the force, where the arm then is."""
    site = mechanism_site("t1", tmp_path)
    truth, times = engine(site.system), np.arange(300) / 100
    still = np.array(site.plant.centre)
    push = {"touch_at": 0.2, "touch_for": 2.2, "touch_x": 0.0, "touch_y": 0.0, "touch_z": -10.0}
    plain, pushed = (truth(lambda _: still, 3.0, times, hidden) for hidden in ({}, push))
    change = pushed["effort"] - plain["effort"]
    assert np.abs(change[:18]).max() < 1e-9
    middle = slice(125, 136)
    asked, where = (pushed[kind][middle].mean(axis=0) for kind in ("effort", "position"))
    np.testing.assert_allclose(asked, held_torques(site.system, where, -10.0), atol=0.15)
    assert np.abs(change[middle]).max() > 3.0
    assert np.abs(change[-1]).max() < 0.02 * np.abs(change[middle]).max()


def held_torques(system, q, force):
    """Torques that hold an arm against its weight and a force along z on its last link, by PyBullet and finite differences."""
    client = BulletClient(pybullet.DIRECT)
    client.setGravity(*system.gravity.tolist())
    body = client.loadURDF(str(system.urdf), useFixedBase=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
    numbers = {client.getJointInfo(body, k)[1].decode(): k for k in range(client.getNumJoints(body))}
    columns = [numbers[name] for name in system.joints]

    def height(at):
        for number, value in zip(columns, at, strict=True):
            client.resetJointState(body, number, float(value))
        return client.getLinkState(body, columns[-1], computeForwardKinematics=1)[0][2]

    slopes = [(height(q + step) - height(q - step)) / 2e-4 for step in 1e-4 * np.eye(len(q))]
    zero = [0.0] * len(q)
    weight = np.array(client.calculateInverseDynamics(body, q.tolist(), zero, zero))
    client.disconnect()
    return weight - force * np.array(slopes)
