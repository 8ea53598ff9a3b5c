"""Bodies in free flight and on a surface, against closed forms and integrators of their own."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.contact.body import is_body, parse_body, read_body
from gsbridge.gap.contact.setup import BOUNDS, BodySetup, body_setup
from gsbridge.gap.contact.starts import Starts
from gsbridge.gap.contact.world import Numerics, simulate
from gsbridge.geometry import rotation_from_quat

BOX = {"box": [0.1, 0.1, 0.1], "mass": 0.4, "controller": {"mode": "body"}, "contact": {"friction": 0.3}}
SPHERE = (
    '<robot name="ball"><link name="ball"><inertial><mass value="0.2"/>'
    '<inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><sphere radius="0.05"/></geometry></collision></link></robot>'
)
FLOAT = '<joint name="free" type="floating"><parent link="base"/><child link="rod"/></joint>'
TIMES = np.arange(0, 0.6, 0.01)


def body_of(**changes):
    return parse_body({**BOX, **changes}, Path())


def start(position=(0, 0, 0.05), velocity=(0, 0, 0), spin=(0, 0, 0), quat=(1, 0, 0, 0)):
    rows = [np.array([item], dtype=float) for item in (position, quat, velocity, spin)]
    return Starts(*rows, logged=True)


def fly(body, starts, effects=(), times=TIMES):
    return simulate(body, body_setup(body, effects), starts, [times])[0]


@pytest.fixture
def ball(tmp_path):
    (tmp_path / "ball.urdf").write_text(SPHERE)
    (tmp_path / "model.yaml").write_text(
        "urdf: ball.urdf\ncontroller: {mode: body}\ncontact: {friction: 0.5, restitution: 0.6}\n"
    )
    return read_body(tmp_path / "model.yaml")


def test_flight_is_a_parabola():
    flight = fly(body_of(physics_rate=2000), start((0, 0, 5), (1.0, -2.0, 0.5), (1, 2, 3)))
    wanted = np.array([0, 0, 5]) + TIMES[:, None] * [1.0, -2.0, 0.5] - 0.5 * 9.81 * TIMES[:, None] ** 2 * [0, 0, 1]
    # Half a step of falling per second: the engine moves with the speed at the end of its steps.
    assert np.abs(flight.position - wanted).max() < 0.6 * 9.81 / 2000
    assert not flight.touched.any()


def test_tumbling_follows_eulers_equations_about_a_shifted_centre():
    body = body_of(box=[0.06, 0.1, 0.2], centre_of_mass=[0.01, -0.02, 0.03], physics_rate=4000)
    spin, speed, turn = np.array([3.0, 9.0, 1.0]), np.array([0.4, 0.1, 0.0]), Rotation.from_euler("xyz", [0.3, -0.5, 0.8])
    x, y, z, w = turn.as_quat()
    flight = fly(body, start((0, 0, 5), speed, spin, (w, x, y, z)))
    own = np.diag(body.inertia)

    def rates(_, state):
        # Attitude as xyzw, angular velocity in the body's own axes.
        vector, scalar, inside = state[:3], state[3], state[4:]
        turning = 0.5 * np.array([*(scalar * inside + np.cross(vector, inside)), -vector @ inside])
        return np.concatenate([turning, np.cross(own * inside, inside) / own])

    solved = solve_ivp(rates, (0, TIMES[-1]), [*turn.as_quat(), *turn.inv().apply(spin)], t_eval=TIMES, rtol=1e-7, atol=1e-8)
    attitude = Rotation.from_quat(solved.y[:4].T)
    error = (attitude.inv() * Rotation.from_matrix(rotation_from_quat(flight.quat))).magnitude()
    assert error.max() < 0.01
    com = body.com
    begin = np.array([0, 0, 5]) + turn.apply(com)
    path = begin + TIMES[:, None] * (speed + np.cross(spin, turn.apply(com))) - 0.5 * 9.81 * TIMES[:, None] ** 2 * [0, 0, 1]
    assert np.abs(flight.position - (path - attitude.apply(com))).max() < 2e-3


@pytest.mark.parametrize("mass", [0.1, 2.0])
def test_sliding_stops_where_friction_says_whatever_the_mass(mass):
    flight = fly(body_of(mass=mass), start((0, 0, 0.05), (1.0, 0, 0)))
    assert flight.position[-1, 0] == pytest.approx(1.0 / (2 * 0.3 * 9.81), rel=0.02)


def test_a_tilted_surface_accelerates_by_what_friction_leaves():
    tilt = 0.4
    body = body_of(surface={"tilt": [0.0, tilt]}, contact={"friction": 0.2})
    turn = Rotation.from_euler("y", tilt)
    x, y, z, w = turn.as_quat()
    flight = fly(body, start(turn.apply([0, 0, 0.05]), quat=(w, x, y, z)))
    down = turn.apply([1, 0, 0])
    wanted = 0.5 * 9.81 * (np.sin(tilt) - 0.2 * np.cos(tilt)) * TIMES[-1] ** 2
    assert flight.position[-1] @ down - turn.apply([0, 0, 0.05]) @ down == pytest.approx(wanted, rel=0.03)


def test_a_ball_rebounds_with_its_share_of_the_speed(ball):
    times = np.arange(0, 0.8, 0.005)
    # What pushes bodies out of each other would add to the rebound.
    flight = simulate(ball, body_setup(ball), start((0, 0, 0.25)), [times], Numerics(erp=0.01))[0]
    hit = np.sqrt(2 * 0.2 / 9.81)
    rebound = flight.position[(times > hit + 0.02) & (times < hit + 0.4), 2].max() - 0.05
    assert rebound == pytest.approx(0.6**2 * 0.2, rel=0.06)
    assert times[np.argmax(flight.touched)] == pytest.approx(hit, abs=0.01)


def test_rolling_and_spinning_friction_brake_a_ball(ball):
    rolling = start((0, 0, 0.05), (0.5, 0, 0), (0, 10.0, 0))
    spinning = start((0, 0, 0.05), spin=(0, 0, 8.0))
    assert fly(ball, rolling).position[-1, 0] == pytest.approx(0.5 * TIMES[-1], rel=0.03)
    braked = fly(ball, rolling, [Applied("rolling_friction", "", {"arm": 0.004})])
    assert braked.position[-1, 0] < 0.9 * 0.5 * TIMES[-1]
    turned = [fly(ball, spinning, [Applied("spinning_friction", "", {"arm": arm})]).quat for arm in (0.0, 0.004)]
    speeds = [abs((quat[-1] - quat[-2]) @ (quat[-1] - quat[-2])) for quat in turned]
    assert speeds[1] < 0.5 * speeds[0]


@pytest.mark.parametrize("rate", [500, 2000])
def test_losses_in_the_air_are_a_rate_of_speed_and_of_spin(rate):
    """v' = -d v - g, to a twentieth of a millimetre at the usual step, too."""
    loss, speed = 2.0, np.array([2.0, 0.0, 1.0])
    body = body_of(physics_rate=rate, damping={"linear": 0.5})
    flight = fly(body, start((0, 0, 5), speed), (Applied("linear_damping", "", {"coefficient": loss}),))
    whole = loss + 0.5
    gone = (1.0 - np.exp(-whole * TIMES)) / whole
    fallen = 9.81 / whole * (TIMES - gone)
    wanted = [0, 0, 5] + gone[:, None] * speed - fallen[:, None] * [0, 0, 1]
    np.testing.assert_allclose(flight.position, wanted, atol=1e-4)
    flight = fly(
        body_of(physics_rate=rate), start((0, 0, 5), spin=(0, 0, 3.0)), (Applied("angular_damping", "", {"coefficient": loss}),)
    )
    turned = 2.0 * np.arctan2(flight.quat[:, 3], flight.quat[:, 0])
    np.testing.assert_allclose(turned, 3.0 * (1.0 - np.exp(-loss * TIMES)) / loss, atol=2e-4)


LOST = (
    (),
    (Applied("linear_damping", "", {"coefficient": 4.0}), Applied("angular_damping", "", {"coefficient": 8.0})),
    (Applied("steady_force", "", {"x": 0.5, "y": -0.3}), Applied("object_com", "", {"x": 0.01, "y": 0.0, "z": -0.01})),
)


@pytest.mark.parametrize("others", LOST)
@pytest.mark.parametrize("lag", [0.02, -0.02])
def test_speeds_that_are_logged_late_are_those_of_an_earlier_moment(lag, others):
    """A body with unlike moments and a tracked point beside its centre; speeds are logged by 20 ms too late or too early."""
    body = body_of(box=[0.06, 0.1, 0.2], physics_rate=2000)
    off = (Applied("tracking_offset", "", {"x": 0.02, "y": 0.01, "z": 0.03}), *others)
    times = np.arange(60) / 500
    whole = fly(body, start((0, 0, 5), (0.5, -0.2, 0.3), (3.0, 6.0, 2.0)), off, times)
    here, there = 20, 20 - round(500 * lag)
    speed = 250 * (whole.position[there + 1] - whole.position[there - 1])
    turn = Rotation.from_matrix(rotation_from_quat(whole.quat))
    spin = 250 * (turn[there + 1] * turn[there - 1].inv()).as_rotvec()
    late = Starts(whole.position[[here]], whole.quat[[here]], speed[None], spin[None], logged=True)
    seen = fly(body, late, (*off, Applied("tracking_lag", "", {"time": lag})), times[: 60 - here])
    np.testing.assert_allclose(seen.position, whole.position[here:], atol=1e-3)
    assert np.abs((seen.quat * whole.quat[here:]).sum(axis=1)).min() > np.cos(0.5 * 8e-3)


@pytest.mark.parametrize(("compliance", "damping"), [(1e-4, 5.0), (1e-4, 20.0), (2e-4, 10.0)])
@pytest.mark.parametrize("factor", [0.7, 1.0, 2.0])
def test_a_soft_contact_is_a_spring_and_a_damper(ball, compliance, damping, factor):
    """Dropped with a speed along the surface, against an own integration with Coulomb's friction.

    One wants finer steps, and of another the damper is more than what the integration damps.
    """
    mass, radius, friction, step = 0.2, 0.05, 0.5, 1e-5
    x, z, along, up, turning, wanted = 0.0, 0.2, 1.2, 0.0, 0.0, []
    for number in range(round(TIMES[-1] / step) + 1):
        if number % round(0.01 / step) == 0:
            wanted.append((x, z))
        depth = radius - z
        push = max(depth / compliance - damping * up, 0.0) if depth > 0 else 0.0
        slip = along - turning * radius
        rub = np.clip(-slip / step / (1 / mass + radius**2 / 2e-4), -friction * push, friction * push)
        up += step * (push / mass - 9.81)
        along, turning = along + step * rub / mass, turning - step * rub * radius / 2e-4
        x, z = x + step * along, z + step * up
    still = Applied("restitution", "", {"restitution": -0.6})
    soft = (Applied("contact_softness", "", {"compliance": compliance, "damping": damping}), still)
    states = start((0, 0, 0.2), (1.2, 0, 0))
    flight = simulate(ball, body_setup(ball, soft), states, [TIMES], Numerics(factor))[0]
    error = np.abs(flight.position[:, [0, 2]] - wanted)
    assert error.max() < 5e-3


def test_engines_differ_in_how_they_step_through_soft_contacts(ball):
    soft = (Applied("contact_softness", "", {"compliance": 1e-4, "damping": 5.0}),)
    states, setup = start((0, 0, 0.2), (1.2, 0, 0)), body_setup(ball, soft)
    short, long = (simulate(ball, setup, states, [TIMES], Numerics(factor))[0].position for factor in (0.7, 2.0))
    assert np.abs(short - long).max() > 1e-4


def test_a_set_gives_what_its_throws_give_alone():
    rng = np.random.default_rng(0)
    quat = rng.normal(size=(4, 4))
    states = Starts(
        np.array([0, 0, 0.12]) + rng.uniform(-0.02, 0.02, (4, 3)), quat / np.linalg.norm(quat, axis=1, keepdims=True),
        rng.normal(0, 0.5, (4, 3)), rng.normal(0, 3, (4, 3)), True,
    )  # fmt: skip
    body = body_of()
    together = simulate(body, body_setup(body), states, [TIMES] * 4)
    for k in range(4):
        part = Starts(*(getattr(states, key)[k : k + 1] for key in ("position", "quat", "velocity", "spin")), True)
        assert np.array_equal(fly(body, part).position, together[k].position)


def test_a_log_with_a_wrong_scale_is_the_true_one_multiplied():
    body, share = body_of(), 0.1
    true = fly(body, start((0.1, 0, 0.12), (0.5, 0.2, 0), (1, 2, 3)))
    logged = start((0.11, 0, 0.132), (0.55, 0.22, 0), (1, 2, 3))
    seen = fly(body, logged, [Applied("tracking_scale", "", {"share": share})])
    assert np.allclose(seen.position, 1.1 * true.position, atol=1e-6)


def test_a_slow_clock_looks_like_weak_gravity():
    body = body_of()
    clock = fly(body, start((0, 0, 5), (0.5, 0, 1.0)), [Applied("tracking_rate", "", {"share": 0.05})])
    weak = fly(body, start((0, 0, 5), (0.5, 0, 1.0)), [Applied("gravity_scale", "", {"share": 1 / 1.05**2 - 1})])
    assert np.abs(clock.position - weak.position).max() < 1e-3


@pytest.mark.parametrize("name", BODY_EFFECTS)
def test_every_parameter_of_every_body_effect_moves_the_output(name):
    body = body_of(damping={"linear": 0.1, "angular": 0.1}, contact={"friction": 0.3, "stiffness": 2e3, "damping": 2.0})
    throw = start((0, 0, 0.1), (0.8, 0.3, 0), (2, 5, 1), (0.9, 0.3, 0.2, 0.1))
    effect = BODY_EFFECTS[name]
    values = effect.directions()[0]
    plain = fly(body, throw, [Applied(name, "", values)]).position
    for parameter in effect.parameters:
        step = 0.5 * (parameter.typical or 1.0)
        moved = fly(body, throw, [Applied(name, "", {**values, parameter.name: values[parameter.name] + step})]).position
        assert np.abs(moved - plain).max() > 1e-6, parameter.name


def test_effects_change_the_figures_that_they_name():
    body = body_of()
    setup = body_setup(body, [Applied("contact_friction", "", {"friction": -0.1}), Applied("object_mass", "", {"share": 0.5})])
    assert setup.figures["friction"] == pytest.approx(0.2)
    assert setup.figures["mass"] == pytest.approx(0.6)
    assert body_setup(body, [Applied("contact_friction", "", {"friction": -1.0})]).figures["friction"] == 0.0
    assert set(BodySetup.nominal(body).figures) == set(BOUNDS)
    for wrong in (Applied("viscous", "", {"coefficient": 1.0}), Applied("restitution", "", {}), Applied("magic", "", {})):
        with pytest.raises(InputError):
            body_setup(body, [wrong])


def parse_urdf(text):
    """Mass, centre of mass and inertia in the link's axes as MuJoCo reads a URDF."""
    spec = mujoco.MjSpec.from_string(text.replace('<robot name="rod">', '<robot name="rod"><link name="base"/>' + FLOAT, 1))
    model = spec.compile()
    body = model.nbody - 1
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    return model.body_mass[body], model.body_ipos[body], turn @ np.diag(model.body_inertia[body]) @ turn.T


def test_mass_properties_survive_the_way_through_a_urdf(tmp_path):
    (tmp_path / "rod.urdf").write_text(
        '<robot name="rod"><link name="rod"><inertial><origin xyz="0.01 0.02 -0.03" rpy="0.2 -0.4 1.1"/><mass value="0.7"/>'
        '<inertia ixx="2e-3" iyy="3e-3" izz="4e-3" ixy="2e-4" ixz="-1e-4" iyz="3e-4"/></inertial>'
        '<collision><geometry><cylinder radius="0.02" length="0.3"/></geometry></collision></link></robot>'
    )
    model = {"urdf": "rod.urdf", "controller": {"mode": "body"}, "contact": {"friction": 0.3}}
    body = parse_body(model, tmp_path)
    written = parse_urdf(body.urdf(body.mass, body.com, 1.0, 1.0).replace('name="body"', 'name="rod"'))
    given_before = parse_urdf((tmp_path / "rod.urdf").read_text())
    for one, other in zip(written, given_before, strict=True):
        assert np.allclose(one, other, atol=1e-9)
    moments = np.linalg.eigvalsh(body.inertia)
    assert moments == pytest.approx(
        np.linalg.eigvalsh([[2e-3, 2e-4, -1e-4], [2e-4, 3e-3, 3e-4], [-1e-4, 3e-4, 4e-3]]), rel=1e-9
    )
    scaled = parse_body({**model, "mass": 1.4}, tmp_path)
    assert np.allclose(scaled.inertia, 2 * body.inertia)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"contact": {}}, "friction is missing"),
        ({"contact": {"friction": -1}}, "'contact.friction' is -1"),
        ({"contact": {"friction": "high"}}, "'contact.friction' is 'high', no number"),
        ({"contact": {"friction": 0.5, "restitution": 1.5}}, "Give 0 to 1"),
        ({"physics_rate": 0}, "'physics_rate' is 0"),
        ({"effects": ["restitution"]}, "names with parameters"),
        ({"contact": {"friction": 0.5, "stiffness": 1e4}}, "go together"),
        ({"urdf": "a.urdf"}, "either"),
        ({"mass": 0.0}, "no body"),
        ({"box": [0.1, 0.1]}, "3 numbers"),
        ({"box": [100, 100, 100]}, "looks like millimetres"),
        ({"colour": "red"}, "unknown"),
        ({"controller": {"mode": "pd"}}, "controller.mode"),
        ({"surface": {"tilt": 0.1}}, "2 numbers"),
    ],
)
def test_a_wrong_model_is_refused(change, said):
    with pytest.raises(InputError, match=said):
        body_of(**change)


def test_a_urdf_that_is_no_rigid_body_is_refused(tmp_path):
    model = {"urdf": "two.urdf", "controller": {"mode": "body"}, "contact": {"friction": 0.3}}
    with pytest.raises(InputError, match=r"it does not exist.* Check 'urdf' in own\.yaml$"):
        parse_body(model, tmp_path, "own.yaml")
    (tmp_path / "two.urdf").write_text('<robot name="a"><link name="a"/><link name="b"/></robot>')
    with pytest.raises(InputError, match="2 links"):
        parse_body(model, tmp_path)
    (tmp_path / "two.urdf").write_text('<robot name="a"><link name="a"/></robot>')
    with pytest.raises(InputError, match="lacks"):
        parse_body(model, tmp_path)
    (tmp_path / "two.urdf").write_text(SPHERE.replace('value="0.2"', 'value="heavy"'))
    with pytest.raises(InputError, match="damaged mass properties"):
        parse_body(model, tmp_path)


def test_a_model_of_a_body_is_told_from_one_of_a_mechanism(tmp_path):
    (tmp_path / "a.yaml").write_text("controller: {mode: body}\n")
    (tmp_path / "b.yaml").write_text("controller: {mode: pd}\n")
    assert is_body(tmp_path / "a.yaml")
    assert not is_body(tmp_path / "b.yaml")
    assert not is_body(tmp_path / "none.yaml")
