"""Effects on the handled object in the simulation: each does what its name says, against the law it states."""

import numpy as np
import pytest
from robot_fixture import robot
from sim_fixture import ball, content, cube

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.sim.item_setup import ItemSetup
from gsbridge.sim.model import parse_model
from gsbridge.sim.world import SimWorld

AWAY = (0.2, 0.15)
"""Where nothing is in the object's way."""


def fly(name=None, values=None, *, others=(), item=None, height=0.0, velocity=(0, 0, 0), spin=(0, 0, 0), steps=10):
    """Heights and places of an object that is let go with some speed, its speeds, and the world's engine figures."""
    effects = [*others, *([{"name": name, "parameters": values}] if name else [])]
    with SimWorld(robot(), item or cube(), parse_model({**content(), "effects": effects})) as sim:
        pose = np.eye(4)
        pose[:3, 3] = (*AWAY, height)
        sim.place(pose)
        sim.engine.forget()
        sim.push(np.array(velocity, float), np.array(spin, float))
        rows = []
        for _ in range(steps):
            sim.step()
            rows.append(np.concatenate([sim.engine.item_motion()[:3], sim._velocity, sim._spin, sim._object[:3, 3]]))
        mass, _, inertia, *_ = sim.engine.client.getDynamicsInfo(sim.engine.item, -1)
        return np.array(rows), mass, np.array(inertia), sim.engine.body_from_inertial


def travelled(*args, **kwargs) -> float:
    return float(np.linalg.norm(fly(*args, **kwargs)[0][-1, :2] - AWAY))


def test_friction_shortens_the_way():
    slide = {"velocity": (0.5, 0, 0), "steps": 12}
    # v2 / (2 mu g), from the cube's own 0.6.
    for change in (0.3, -0.3):
        way = travelled("contact_friction", {"friction": change}, **slide)
        assert way == pytest.approx(0.5**2 / (2 * (0.6 + change) * 9.81), rel=0.15)


def test_restitution_lets_it_rebound():
    fall = {"height": 0.1, "steps": 10}
    plain, bouncing = fly(**fall)[0], fly("restitution", {"restitution": 0.6}, **fall)[0]
    assert bouncing[:, 5].max() > 0.3
    assert plain[:, 5].max() < 0.1


def test_rolling_and_spinning_friction_slow_down():
    assert travelled("rolling_friction", {"arm": 0.005}, item=ball(), velocity=(0.3, 0, 0), spin=(0, 0.3 / 0.029, 0)) < (
        0.9 * travelled(item=ball(), velocity=(0.3, 0, 0), spin=(0, 0.3 / 0.029, 0))
    )
    turn = {"item": ball(), "spin": (0, 0, 10.0), "steps": 6}
    assert fly("spinning_friction", {"arm": 0.002}, **turn)[0][-1, 8] < 0.9 * fly(**turn)[0][-1, 8]


def test_gravity_pulls_more():
    rows = fly("gravity_scale", {"share": 0.5}, height=0.5, steps=4)[0]
    assert rows[-1, 5] == pytest.approx(-1.5 * 9.81 * 0.2, rel=1e-3)


def test_mass_and_inertia_are_scaled():
    _, mass, inertia, _ = fly(steps=1)
    _, heavy, turned, _ = fly("object_mass", {"share": 0.5}, steps=1)
    assert heavy == pytest.approx(1.5 * mass)
    assert turned == pytest.approx(1.5 * inertia)
    _, same, turned, _ = fly("inertia_scale", {"share": 0.5}, steps=1)
    assert same == pytest.approx(mass)
    assert turned == pytest.approx(1.5 * inertia)
    # A steady force moves half the mass twice as far.
    wind = [{"name": "steady_force", "parameters": {"x": 0.1, "y": 0.0}}]
    light = fly("object_mass", {"share": -0.5}, others=wind, height=0.5, steps=4)[0]
    assert light[-1, 0] - AWAY[0] == pytest.approx(0.5 * 0.1 / (0.5 * mass) * 0.2**2, rel=0.02)


def test_centre_of_mass_moves():
    plain, moved = fly(steps=1)[3], fly("object_com", {"x": 0.01, "y": 0.0, "z": -0.005}, steps=1)[3]
    np.testing.assert_allclose(moved[:3, 3] - plain[:3, 3], [0.01, 0.0, -0.005], atol=1e-9)
    # Dropped on an edge of its footprint it turns towards the heavy side.
    spin = fly("object_com", {"x": 0.035, "y": 0.0, "z": 0.0}, height=0.02, steps=8)[0][:, 7]
    assert spin.max() > 0.2 > np.abs(fly(height=0.02, steps=8)[0][:, 7]).max()


def test_losses_in_the_air_follow_their_law():
    """v' = -d v falls exponentially."""
    start, drag, time = 2.0, 1.5, 0.2
    left = start * np.exp(-drag * time)
    rows = fly("angular_damping", {"coefficient": drag}, height=0.6, spin=(0, 0, start), steps=4)[0]
    assert rows[-1, 8] == pytest.approx(left, rel=0.01)
    weightless = [{"name": "gravity_scale", "parameters": {"share": -0.9}}]
    rows = fly("linear_damping", {"coefficient": drag}, others=weightless, height=0.6, velocity=(start, 0, 0), steps=4)[0]
    assert rows[-1, 3] == pytest.approx(left, rel=0.02)


def test_a_steady_force_pushes():
    rows, mass, *_ = fly("steady_force", {"x": 0.05, "y": -0.1}, height=0.6, steps=4)
    np.testing.assert_allclose(rows[-1, 3:5], np.array([0.05, -0.1]) / mass * 0.2, rtol=0.01)


def test_the_table_stands_higher_and_askew():
    assert fly("table_height", {"height": 0.01})[0][-1, 11] == pytest.approx(0.01, abs=5e-4)
    rows = fly("table_tilt", {"about_x": 0.0, "about_y": 0.03}, height=0.02)[0]
    # Turned about y, the side of positive x is lower.
    assert rows[-1, 11] == pytest.approx(-0.03 * AWAY[0], abs=1.5e-3)


def test_a_soft_table_gives_way():
    rows, mass, *_ = fly("contact_softness", {"compliance": 0.004, "damping": 10.0}, steps=20)
    # Four corners share the weight.
    assert fly(steps=20)[0][-1, 11] - rows[-1, 11] == pytest.approx(0.004 * mass * 9.81 / 4, rel=0.2)


TESTED = {
    "angular_damping", "contact_friction", "contact_softness", "gravity_scale", "inertia_scale", "linear_damping", "object_com",
    "object_mass", "restitution", "rolling_friction", "spinning_friction", "steady_force", "table_height", "table_tilt",
}  # fmt: skip


def test_every_effect_on_an_object_is_played_or_says_why_not():
    assert {name for name, effect in BODY_EFFECTS.items() if effect.amendable} == TESTED


def test_without_effects_the_object_is_that_of_the_model():
    model = parse_model(content())
    setup = ItemSetup(model)
    assert setup.table(model) == model.contact.table
    assert (setup.figures["mass"], setup.figures["gravity"]) == (model.object.mass, model.gravity)
    assert not setup.pushes
    assert setup.description(cube().urdf) is None
    np.testing.assert_array_equal(setup.table_pose(), np.eye(4))
