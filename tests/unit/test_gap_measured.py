"""Real logs, if GSBRIDGE_MEASURED names the folder of measured data."""

import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.contact.case import read_throw_case
from gsbridge.gap.contact.replay import ThrowReplay

ROOT = Path(__file__).resolve().parents[2]
FOLDER = os.environ.get("GSBRIDGE_MEASURED")
measured = pytest.mark.skipif(not FOLDER, reason="GSBRIDGE_MEASURED names no folder with cube_toss and dfki_pendulum")


def load():
    spec = importlib.util.spec_from_file_location("gap_measured", ROOT / "benchmarks" / "gap_measured.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_other_data_are_refused(tmp_path):
    benchmark = load()
    with pytest.raises(InputError, match="not there"):
        benchmark.check_data(tmp_path, "cube_toss")
    (tmp_path / "dfki_pendulum").mkdir()
    with pytest.raises(InputError, match="SHA-256"):
        benchmark.check_data(tmp_path, "dfki_pendulum")


def test_the_pendulum_has_the_inertia_and_weight_it_is_given():
    import mujoco

    model = mujoco.MjSpec.from_string(load().pendulum_urdf(0.6755, 0.5)).compile()
    data = mujoco.MjData(model)
    data.qpos[0] = 0.7
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias[0] == pytest.approx(0.6755 * 0.5 * 9.81 * np.sin(0.7), rel=1e-6)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia) if mujoco.__version__ >= "4" else mujoco.mj_fullM(model, inertia, data.qM)
    assert inertia[0, 0] == pytest.approx(0.6755 * 0.25, rel=1e-3)


@measured
def test_tosses_convert_to_a_case_that_friction_explains(tmp_path):
    benchmark = load()
    roles = {"fit": (0, 12), "select": (60, 70), "verify": (160, 170)}
    case = read_throw_case(benchmark.write_toss_case(Path(FOLDER), tmp_path, roles))
    replay = ThrowReplay(case.body, case.throws["fit"])
    before = replay.errors().mean()
    after = replay.errors([Applied("contact_friction", "", {"friction": 0.18 - 0.5})]).mean()
    assert before > 0.05
    assert after < 0.25 * before
    # The cube rests on a face, so its centre should lie 52.4 mm high; the data say 51.2 mm.
    assert np.median([throw.position[-1, 2] for throw in case.throws["fit"].items]) == pytest.approx(0.0512, abs=5e-4)


@measured
def test_the_pendulum_becomes_a_case(tmp_path):
    from gsbridge.gap.joints.case import read_joint_case as read_mechanism_case

    case = read_mechanism_case(load().write_pendulum_case(Path(FOLDER), tmp_path))
    assert case.system.joints == ("axis",)
    assert set(case.records) == {"fit", "select", "verify"}


@measured
def test_currents_without_a_clock_are_refused_in_words(tmp_path):
    found = load().diagnose_axis(Path(FOLDER), tmp_path)
    assert found["verdict"] == "refused"
    assert "time" in found["sentence"]
