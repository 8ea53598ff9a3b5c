"""What the controller of a replay makes of its commands, against controllers and equations that are written out here."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism, command_grid

INERTIA, STIFFNESS, DAMPING = 0.05, 60.0, 3.0

URDF = f"""<robot name="table">
  <link name="base"/>
  <link name="disc"><inertial><mass value="1"/>
    <inertia ixx="0.03" iyy="0.03" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="axis" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint>
</robot>
"""
"""A disc that turns about the vertical, so that its weight does not matter."""

TIME = np.arange(300) / 100
OMEGA, SWING = 4.0, 0.5


def turning(time):
    """Angle, rad, and speed, rad/s, of a command that starts from rest. [T] -> [T], [T]."""
    return SWING * (1.0 - np.cos(OMEGA * time)), SWING * OMEGA * np.sin(OMEGA * time)


def disc(folder, controller, **model):
    """The disc under a controller; by default one of position and speed errors."""
    (folder / "disc.urdf").write_text(URDF)
    plain = {"mode": "pd", "stiffness": STIFFNESS, "damping": DAMPING}
    return parse_mechanism_model({"urdf": "disc.urdf", "controller": plain | controller, **model}, folder)


def replayed(system, commands, effects=None, start=(0.0, 0.0)):
    """Positions of the disc in a replay of commands, rad. [T]."""
    mechanism = Mechanism(system)
    setup = mechanism.setup()
    record = Record("disc", TIME, ("axis",), {kind: values[:, None] for kind, values in commands.items()}, {})
    if effects is not None:
        effects(setup)
    states = [(np.array(start[:1]), np.array(start[1:]))]
    return mechanism.run(record, setup, [(0, len(TIME))], states)["position"][:, 0]


def sampled(wanted, speed, rate):
    """Angles of the disc under a controller that holds its torque for each period, by the parabola that it then runs. [T]."""
    period, angle, pace, out = 1.0 / rate, 0.0, 0.0, []
    for target, reference in zip(wanted, speed, strict=True):
        out.append(angle)
        turned = (STIFFNESS * (target - angle) + DAMPING * (reference - pace)) / INERTIA
        angle, pace = angle + period * pace + 0.5 * period**2 * turned, pace + period * turned
    return np.array(out)


@pytest.mark.parametrize("physics", [100, 1000, 4000])
def test_a_controller_derives_a_held_command_at_its_own_rate(tmp_path, physics):
    """Between two physics steps the command jumps; what a controller at 100 Hz differentiates is a smooth course."""
    angle, speed = turning(TIME)
    controller = {"rate": 100, "between": "hold", "velocity_reference": "derivative"}
    moved = replayed(disc(tmp_path, controller, physics_rate=physics), {"command": angle})
    assert np.abs(moved - sampled(angle, speed, 100.0)).max() < 2e-3
    assert np.abs(moved - sampled(angle, 0.0 * speed, 100.0)).max() > 0.05


@pytest.mark.parametrize("between", ["hold", "line"])
@pytest.mark.parametrize("rate", [1000, 500, 250, 100, 50])
def test_the_derived_speeds_of_a_controller_add_up_to_the_path_of_its_command(tmp_path, rate, between):
    system = disc(tmp_path, {"rate": rate, "between": between, "velocity_reference": "derivative"})
    angle, _ = turning(TIME)
    record = Record("disc", TIME, ("axis",), {"command": angle[:, None]}, {})
    target, speed, _ = command_grid(record, system, Mechanism(system).setup(), 2951)
    path = np.cumsum(speed[:: round(1000 / rate), 0]) / rate
    # A path lags or leads by half a control period, and by the time for which a command is held.
    most = SWING * OMEGA * (1.0 / rate + 0.01)
    assert np.abs(path - target[:: round(1000 / rate), 0]).max() < most


TORQUE = 0.8


@pytest.mark.parametrize("fastest", [50.0, 2.5, 0.7])
def test_a_limit_of_speed_leaves_torques_alone_and_cuts_speeds_off(tmp_path, fastest):
    """A ramp of 2 rad/s with a torque that swings, by the equation of the disc; two of the limits are never reached."""
    pace, wave = 2.0, 12.0
    commands = {
        "command": pace * TIME,
        "command_velocity": np.full(len(TIME), pace),
        "feedforward": TORQUE * np.sin(wave * TIME),
    }

    def turned(time, state, most):
        torque = STIFFNESS * (most * time - state[0]) + DAMPING * (most - state[1]) + TORQUE * np.sin(wave * time)
        return [state[1], torque / INERTIA]

    system = disc(tmp_path, {"between": "line", "rate": 4000}, physics_rate=4000)
    moved = replayed(system, commands, lambda setup: setup.limit_commands(0, 1.0 / fastest))
    true = solve_ivp(turned, TIME[[0, -1]], [0.0, 0.0], t_eval=TIME, args=(min(pace, fastest),), rtol=1e-9, atol=1e-12).y[0]
    assert np.abs(moved - true).max() < 5e-4
    assert np.ptp(true - min(pace, fastest) * TIME) > 0.01


@pytest.mark.parametrize("rotor", [0.0, 0.4])
@pytest.mark.parametrize("more", [0.0, 0.03])
def test_a_servo_has_its_bandwidth_whatever_rotors_the_model_states(tmp_path, rotor, more):
    """After a step, a servo with the natural frequency w and critical damping runs as 1 - (1 + w t) exp(-w t).

    A rotor's inertia that only the mechanism has makes it slower, by the equation of the disc.
    """
    bandwidth, step = 5.0, 0.3
    system = disc(tmp_path, {"mode": "position", "bandwidth": bandwidth, "rate": 4000}, armature=rotor, physics_rate=4000)
    commands = {"command": np.full(len(TIME), step)}
    moved = replayed(system, commands, lambda setup: setup.law["armature"].__setitem__(0, rotor + more))
    share, pace = (INERTIA + rotor) / (INERTIA + rotor + more), 2 * np.pi * bandwidth

    def turned(_, state):
        return [state[1], share * (pace**2 * (step - state[0]) - 2 * pace * state[1])]

    true = solve_ivp(turned, TIME[[0, -1]], [0.0, 0.0], t_eval=TIME, rtol=1e-9, atol=1e-12).y[0]
    assert np.abs(moved - true).max() < 2e-3
    if not more:
        np.testing.assert_allclose(true, step * (1.0 - (1.0 + pace * TIME) * np.exp(-pace * TIME)), atol=1e-8)


@pytest.mark.parametrize("mode", ["torque", "pd", "position"])
def test_a_torque_that_is_fed_forward_acts_in_every_driven_mode(tmp_path, mode):
    """Beside the torque of the mode, by the equation of the disc."""
    wave, pace = 5.0, 2 * np.pi * 2.0
    sent = 0.1 if mode == "torque" else 0.4

    def turned(time, state):
        error, speed = sent - state[0], state[1]
        laws = {
            "torque": sent,
            "pd": STIFFNESS * error - DAMPING * speed,
            "position": INERTIA * (pace**2 * error - 2 * pace * speed),
        }
        return [speed, (laws[mode] + TORQUE * np.sin(wave * time)) / INERTIA]

    controller = {"mode": mode, "bandwidth": 2.0, "between": "line", "rate": 4000}
    commands = {"command": np.full(len(TIME), sent), "feedforward": TORQUE * np.sin(wave * TIME)}
    moved = replayed(disc(tmp_path, controller, physics_rate=4000), commands)
    true = solve_ivp(turned, TIME[[0, -1]], [0.0, 0.0], t_eval=TIME, rtol=1e-9, atol=1e-12).y[0]
    assert np.abs(moved - true).max() < 2e-3 * np.abs(true).max()


@pytest.mark.parametrize("pace", [500.0, 1500.0])
def test_a_joint_may_turn_on_and_on(tmp_path, pace):
    """Nothing brakes a disc: it follows a steady command exactly, and turns on by itself without a motor."""
    controller = {"between": "line", "velocity_reference": "derivative"}
    driven = replayed(disc(tmp_path, controller), {"command": pace * TIME}, start=(0.0, pace))
    free = replayed(disc(tmp_path, {"mode": "free"}), {}, start=(0.0, pace))
    np.testing.assert_allclose(driven, pace * TIME, atol=1e-3)
    np.testing.assert_allclose(free, pace * TIME, atol=1e-6)


@pytest.mark.parametrize("pace", [0.1, 500.0])
def test_a_loop_that_its_period_makes_unstable_runs_away(tmp_path, pace):
    """Damping times period beyond twice the inertia turns a speed round and makes it larger in each period."""
    controller = {"between": "line", "damping": 2.5 * INERTIA / 1e-3, "velocity_reference": "derivative"}
    moved = replayed(disc(tmp_path, controller), {"command": pace * TIME})
    assert np.isnan(moved[-1])
