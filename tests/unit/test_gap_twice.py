"""Effects of a model that act on a joint twice, and candidates beside an effect that a model has."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.errors import InputError
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import parse_mechanism_model
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

INERTIA = 0.5
URDF = f"""<robot name="wheels"><link name="base"/>
<link name="a"><inertial><mass value="1"/><inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}"/></inertial></link>
<joint name="one" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<link name="b"><inertial><mass value="1"/><inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}"/></inertial></link>
<joint name="two" type="continuous"><parent link="base"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""


def effect(name, joint="one", **parameters):
    return {"name": name, "parameters": parameters} | ({"joint": joint} if joint else {})


def model(folder, *effects):
    """Two balanced wheels that turn freely, in steps of 50 us."""
    (folder / "wheels.urdf").write_text(URDF)
    content = {"urdf": "wheels.urdf", "controller": {"mode": "free"}, "physics_rate": 20000, "effects": list(effects)}
    return parse_mechanism_model(content, folder)


def test_two_springs_pull_like_both_together(tmp_path):
    """SciPy integrates the sum of their torques; the other wheel has one spring alone."""
    springs = ((2.0, 0.5), (6.0, -0.4))
    system = model(
        tmp_path,
        *(effect("spring", stiffness=stiffness, rest=rest) for stiffness, rest in springs),
        effect("spring", "two", stiffness=2.0, rest=0.5),
    )
    mechanism, time = Mechanism(system), np.arange(300) / 100
    record = Record("swing", time, system.joints, {}, {})
    state = (np.array([0.3, -0.2]), np.array([1.0, 0.0]))
    found = mechanism.run(record, apply_effects(mechanism, ()), [(0, len(time))], [state])["position"]
    for k, pulls in enumerate((springs, springs[:1])):

        def law(_, x, pulls=pulls):
            return x[1], -sum(stiffness * (x[0] - rest) for stiffness, rest in pulls) / INERTIA

        told = solve_ivp(law, (0.0, 3.0), (state[0][k], state[1][k]), t_eval=time, rtol=1e-9, atol=1e-9).y[0]
        np.testing.assert_allclose(found[:, k], told, atol=5e-4)


RIPPLE = effect("ripple", sine=1.0, cosine=0.0, waves=6.0)
STRIBECK = effect("stribeck", torque=1.0, speed=0.05)


@pytest.mark.parametrize("one", [RIPPLE, STRIBECK, effect("table", "", stiffness=1e3, height=0.1)])
def test_a_second_shape_of_a_law_is_refused(tmp_path, one):
    with pytest.raises(InputError, match=rf"lists '{one['name']}'.* 2 times, which do not add up.* Keep one of these entries"):
        model(tmp_path, one, one)
    model(tmp_path, one, *([one | {"joint": "two"}] if "joint" in one else []))


def test_every_effect_whose_shape_a_second_one_would_replace_stands_alone():
    for known in JOINT_EFFECTS.values():
        shaped = any(not (parameter.amplitude or parameter.weighted_by) for parameter in known.parameters)
        assert known.alone == shaped


def test_the_shape_of_a_law_in_the_model_is_no_candidate(tmp_path):
    system, time = model(tmp_path, RIPPLE, STRIBECK | {"joint": "two"}), np.arange(300) / 100
    position = np.random.default_rng(0).normal(0.0, 1e-4, (300, 2))
    view = JointResiduals.of(Mechanism(system), Record("rest", time, system.joints, {}, {"position": position}))
    found = [str(candidate) for candidate in candidates(view, ("ripple", "stribeck", "spring"))]
    assert found == ["ripple:two", "spring:one", "spring:two", "stribeck:one"]
