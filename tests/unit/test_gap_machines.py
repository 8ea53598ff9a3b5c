"""Further machines and thrown bodies of the benchmark: each hidden effect acts as its name says."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.benchmark import body_cases, machines
from gsbridge.gap.benchmark.body_truth import RunawayError, ThrowScene, damping_ratio, throw_box
from gsbridge.gap.benchmark.body_visibility import BodyVisibility
from gsbridge.gap.benchmark.generate import NotShownError, _joined
from gsbridge.gap.benchmark.hidden_parts import Rubs, true_parameters
from gsbridge.gap.benchmark.trajectories import course
from gsbridge.gap.contact.body import parse_body
from gsbridge.gap.contact.case import read_throw_case
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals


def test_all_effects_can_be_hidden_and_unknown_families_are_disjoint():
    assert set(machines.EFFECTS) | set(machines.NEVER_HIDDEN) == set(JOINT_EFFECTS)
    assert not set(machines.EFFECTS) & set(machines.NEVER_HIDDEN)
    assert set(body_cases.KNOWN) == set(BODY_EFFECTS)
    for families in (machines.UNKNOWN_OF, body_cases.UNKNOWN_OF):
        assert not set(families["development"]) & set(families["scored"])
    assert sum(len(names) for names in machines.UNKNOWN_OF.values()) >= 8


def test_seeds_in_a_row_go_through_all_machines():
    drawn = [machines.drawn_logging(1000 + k) for k in range(24)]
    assert {item.machine for item in drawn} == set(machines.MACHINES)
    assert all(item.rate * item.duration <= 20000 for item in drawn)
    assert {len(item.channels) for item in drawn} == {2, 3}


@pytest.mark.parametrize(
    "name",
    ["torque_delay", "torque_lag", "coulomb_asym", "eccentricity", "load_friction", "rate_limit", "ripple", "warming"],
)
def test_what_mujoco_hides_is_what_the_catalogue_calls_so(tmp_path, name):
    """The same effect in both engines: the catalogue's law explains nearly all of what the other formulation shows."""
    system, plant = machines.machine_plant("axis", tmp_path)
    time = np.arange(150) / 100
    wanted = _joined(course("multisine", plant.centre, plant.reach, 1.5, np.random.default_rng(0)), 100.0)
    size = {"warming": 0.3, "coulomb_asym": 0.5, "eccentricity": 0.02}.get(name, 3 * plant.sizes[f"{name}:turn"][0])
    joint_name = f"{name}:turn"
    moved = plant.truth(wanted, 1.5, time, {joint_name: size})
    sent = np.array([wanted(t) for t in time])
    seen = {kind: moved[kind] for kind in plant.noise}
    record = Record("fit", time, plant.joints, {"command": sent}, seen, sigma=dict(plant.noise))
    view = JointResiduals.of(Mechanism(system), record)
    values = true_parameters(name, size, 0) or {JOINT_EFFECTS[name].parameters[0].name: size}
    before = np.sqrt((view.residual() ** 2).mean())
    after = np.sqrt((view.residual((Applied(name, "turn", values),)) ** 2).mean())
    assert before > 0.3
    assert after < 0.15 * before


@pytest.mark.parametrize(
    "hidden",
    [
        {"warming": -0.1},
        {"warming": 0.1, "coulomb": 0.3, "viscous": 0.1},
        {"warming": -0.1, "coulomb_asym": 0.3, "load_friction": 0.1},
    ],
)
def test_all_friction_changes_while_running_known_or_hidden(tmp_path, hidden):
    """The law of the catalogue, in an engine of its own, leaves nothing over; with steady friction much would be left."""
    system, plant = machines.machine_plant("pendulum", tmp_path)
    time = np.arange(400) / 100
    wanted = _joined(course("multisine", plant.centre, plant.reach, 4.0, np.random.default_rng(0)), 100.0)
    moved = plant.truth(wanted, 4.0, time, {f"{name}:swing": size for name, size in hidden.items()})
    seen = {kind: moved[kind] for kind in plant.noise}
    record = Record("fit", time, plant.joints, {"command": np.array([wanted(t) for t in time])}, seen, sigma=dict(plant.noise))
    view = JointResiduals.of(Mechanism(system), record)
    effects = [
        Applied(name, "swing", true_parameters(name, size, 0) or {JOINT_EFFECTS[name].parameters[0].name: size})
        for name, size in hidden.items()
    ]
    steady = np.sqrt((view.residual(tuple(effects[1:])) ** 2).mean())
    after = np.sqrt((view.residual(tuple(effects)) ** 2).mean())
    assert steady > 0.3
    assert after < 0.15 * steady


def test_friction_that_warms_away_leaves_none(tmp_path):
    system, _ = machines.machine_plant("pendulum", tmp_path)
    (known,), place = system.coulomb, np.zeros(1)
    rubs = Rubs(system, {"warming:swing": -0.1, "coulomb:swing": 0.2})
    left = [known + 0.2 + rubs(place, place, time, place)[0] for time in (0.0, 4.0, 12.0)]
    assert left == pytest.approx([known + 0.2, 0.6 * (known + 0.2), 0.0])


@pytest.mark.parametrize(
    ("machine", "joint", "name", "size"),
    [
        ("slide", "carriage", "compliance", 2e-5),
        ("pendulum", "swing", "compliance", 0.02),
        ("pendulum", "swing", "backlash", 5e-3),
        ("arm3", "lift", "compliance", 1e-3),
        ("arm3", "lift", "backlash", 5e-3),
    ],
)
def test_what_plays_or_yields_behind_a_gear_that_rubs_does_so_in_both_engines(tmp_path, machine, joint, name, size):
    """MuJoCo has a second joint behind the motor, on which all friction acts: so it must in the replay."""
    system, plant = machines.machine_plant(machine, tmp_path)
    time = np.arange(400) / 100
    wanted = _joined(course("multisine", plant.centre, plant.reach, 4.0, np.random.default_rng(0)), 100.0)
    moved = plant.truth(wanted, 4.0, time, {f"{name}:{joint}": size})
    seen = {kind: moved[kind] for kind in plant.noise}
    record = Record("fit", time, plant.joints, {"command": np.array([wanted(t) for t in time])}, seen, sigma=dict(plant.noise))
    view = JointResiduals.of(Mechanism(system), record)
    parameter = JOINT_EFFECTS[name].parameters[0].name
    before = np.sqrt((view.residual() ** 2).mean())
    after = np.sqrt((view.residual((Applied(name, joint, {parameter: size}),)) ** 2).mean())
    assert before > 0.3
    assert after < 0.15 * before


def test_a_drawn_body_can_be_read_and_flies_by_what_is_hidden(tmp_path):
    case = body_cases.draw_body_case(("gravity_scale",), 20.0, 3, count=8)
    body_cases.write_body_case(tmp_path, case)
    read = read_throw_case(tmp_path / "case.yaml")
    assert {role: len(throws) for role, throws in read.throws.items()} == dict.fromkeys(("fit", "select", "verify"), 8)
    assert case.parameters["gravity_scale"]["share"] == case.hidden["gravity_scale"]
    json.dumps({"settings": case.settings, "parameters": case.parameters})


def test_a_clock_that_leaves_all_samples_as_they_are_shows_like_any_other_effect():
    """No pose moves where a clock is slow: what shows is that a replay falls at another time."""
    case = body_cases.draw_body_case(("tracking_rate",), 5.0, 1, count=1)
    assert 5.0 / 1.4 < case.units < 5.0 * 1.4
    assert abs(case.hidden["tracking_rate"]) < body_cases.KNOWN["tracking_rate"].high


def test_no_friction_is_less_than_none():
    scene, parameters = body_cases.KNOWN["contact_friction"].hide(ThrowScene("box", friction=0.3), -0.5, np.ones(3))
    assert (scene.friction, parameters) == (0.0, {"friction": -0.3})
    scene, parameters = body_cases.KNOWN["table_height"].hide(ThrowScene("box"), -0.01, np.ones(3))
    assert (scene.height, parameters) == (-0.01, {"height": -0.01})


def test_what_shows_at_no_size_is_not_hidden(monkeypatch):
    """A mass shows nowhere where every force grows with it and contacts are hard."""
    monkeypatch.setattr(body_cases, "_drawn_scene", lambda shape, names, rng: ThrowScene("ball", slowness=0.002, duration=0.4))
    with pytest.raises(NotShownError) as caught:
        body_cases.draw_body_case(("object_mass",), 5.0, 2, count=1)
    assert caught.value.name == "object_mass"


def test_throws_that_run_away_are_not_drawn(monkeypatch, tmp_path):
    """Air that pushes a body on instead of slowing it down: MuJoCo would put it back to where it began, and go on."""
    monkeypatch.chdir(tmp_path)
    calm, wild = ThrowScene("ball", duration=0.4), ThrowScene("ball", linear=-400.0, duration=0.4)
    with pytest.raises(RunawayError, match="throw 0 runs away"):
        throw_box(wild, 2, 1)
    seen = BodyVisibility(body_cases._model(calm), {body_cases.URDF: body_cases._ball(0.1, calm.mass)}, calm, 2, 3)
    assert seen.units(wild) == np.inf
    assert not list(tmp_path.glob("MUJOCO*"))
    assert seen.units(calm) == 0.0
    monkeypatch.setattr(body_cases, "_drawn_scene", lambda shape, names, rng: calm)
    monkeypatch.setattr(body_cases, "throw_box", lambda *rest: throw_box(wild, 1, 1))
    with pytest.raises(NotShownError, match="runs away"):
        body_cases.draw_body_case(("gravity_scale",), 20.0, 3, count=1)


def test_a_contact_that_is_soft_is_not_given_a_restitution_as_well():
    """MuJoCo's contact is either of them, so that a truth of both would list a restitution that it does not have."""
    with pytest.raises(NotShownError, match="either of contact_softness and restitution"):
        body_cases.draw_body_case(("contact_softness", "restitution"), 5.0, 2, count=1)


@pytest.mark.parametrize("names", [("gravity_scale", "tracking_rate"), ("object_mass", "steady_force")])
def test_two_that_are_one_equation_are_not_hidden_together(names):
    with pytest.raises(NotShownError, match="one equation") as caught:
        body_cases.draw_body_case(names, 5.0, 2, count=1)
    assert caught.value.name == names[1]


def test_another_effect_takes_the_place_of_one_that_does_not_show(monkeypatch):
    asked = []

    def draw(names, units, seed):
        asked.append((names, seed))
        if "object_mass" in names:
            raise NotShownError("object_mass", "it does not show")
        return names

    monkeypatch.setattr(body_cases, "draw_body_case", draw)
    pool = ("object_mass", "restitution", "table_tilt", "tracking_lag")
    names = body_cases.draw_shown_case(("object_mass", "restitution"), 5.0, 9, pool)
    assert names[0] == "restitution"
    assert names[1] in ("table_tilt", "tracking_lag")
    assert len({seed for tried, seed in asked if "object_mass" in tried}) == len(asked) - 1 == 4
    first, asked = asked.copy(), []
    assert body_cases.draw_shown_case(("object_mass", "restitution"), 5.0, 9, pool) == names
    assert asked == first
    with pytest.raises(InputError, match="nothing could be hidden"):
        body_cases.draw_shown_case(("object_mass",), 5.0, 9, ("object_mass",))


def test_throws_of_mujoco_fall_by_gravity_before_they_touch():
    scene = ThrowScene(edges=(0.1, 0.1, 0.1), gravity=9.0, duration=0.1, noise=(0.0, 0.0), lag=0.0, rate=200.0)
    for throw in throw_box(scene, 3, 0).items:
        fall = throw.position[0] + throw.velocity * throw.time[:, None] - 4.5 * throw.time[:, None] ** 2 * [0, 0, 1]
        early = throw.time < 0.05
        assert np.allclose(throw.position[early], fall[early], atol=2e-5)


def test_a_lag_is_listed_in_seconds_of_the_logs_clock(tmp_path):
    """The replay of the diagnosis, in an engine of its own, flies as the truth does with the parameters that are listed."""
    scene, listed = ThrowScene(edges=(0.08,) * 3, mass=0.3, friction=0.4, rate=120.0, duration=0.15, noise=(0.0, 0.0)), {}
    body = parse_body(body_cases._model(scene), tmp_path)
    for name, size in (("tracking_lag", 0.016), ("tracking_rate", 0.12)):
        scene, listed[name] = body_cases.KNOWN[name].hide(scene, size, np.ones(3))
    listed |= body_cases._beside_others(scene, list(listed))
    replay = ThrowReplay(body, throw_box(scene, 8, 1), 0.15)
    gaps = replay.gaps([Applied(name, "", values) for name, values in listed.items()])
    assert gaps.max() < 5e-5
    true = replay.gaps([Applied("tracking_lag", "", {"time": 0.016}), Applied("tracking_rate", "", {"share": 0.12})])
    assert true.min() > 5e-4


def test_equations_that_are_the_same_are_twins():
    assert body_cases.body_twins(("gravity_scale",)) == [["tracking_rate"]]
    assert body_cases.body_twins(("restitution",)) == []


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.7, 0.95])
def test_a_damper_gives_back_what_was_asked_for(restitution):
    """Against the equation of motion of a spring and a damper that let go when they would pull."""
    ratio = damping_ratio(restitution)

    def released(_, state):
        return state[0] + 2.0 * ratio * state[1] if state[1] > 0.0 or state[0] > 0.0 else -1.0

    released.terminal = True
    solved = solve_ivp(
        lambda _, s: [s[1], -s[0] - 2.0 * ratio * s[1]], (0.0, 50.0), [0.0, -1.0], events=released, rtol=1e-10, atol=1e-12
    )
    assert solved.y[1, -1] == pytest.approx(restitution, abs=2e-3)


@pytest.mark.parametrize("restitution", [0.1, 0.4, 0.8])
def test_every_ball_of_the_truth_rebounds_with_its_restitution(restitution):
    """At whatever moment of a step it touches."""
    scene = ThrowScene("ball", (0.06,) * 3, restitution=restitution, rate=2000.0, duration=0.3, noise=(0.0, 0.0))
    for throw in throw_box(scene, 12, 5).items:
        speed = np.gradient(throw.position[:, 2], throw.time)
        fastest = int(np.argmin(speed))
        back = speed[fastest : fastest + 40].max()
        assert back / -speed[fastest] == pytest.approx(restitution, abs=0.03)
