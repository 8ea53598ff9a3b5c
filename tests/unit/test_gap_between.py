"""Commands that run differently between two samples than the model says."""

from dataclasses import replace

import numpy as np
import pytest

from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.benchmark.trajectories import KINDS, course
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.between import other_way
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

RATE, SECONDS = 50.0, 6.0


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_plant(tmp_path_factory.mktemp("axis"))


def records(plant, noise, hidden, held=False):
    """Positions of an axis whose commands ran smoothly, or were held for the time between two samples."""
    rng, times, out = np.random.default_rng(0), np.arange(round(SECONDS * RATE)) / RATE, {}
    for role, kind in KINDS.items():
        smooth = course(kind, plant.centre, plant.reach, SECONDS, rng)
        wanted = (lambda time, smooth=smooth: smooth(np.floor(time * RATE + 1e-6) / RATE)) if held else smooth
        moved = plant.truth(wanted, SECONDS, times, hidden)["position"]
        sent = np.array([wanted(time) for time in times])
        measured = {"position": moved + rng.normal(0.0, noise, moved.shape)}
        out[role] = Record(role, times, plant.joints, {"command": sent}, measured)
    return out


def saying(system, between):
    return replace(system, controller=replace(system.controller, between=between))


@pytest.mark.parametrize(("said", "true"), [("hold", "line"), ("line", "hold")])
def test_the_other_way_is_told_where_it_leaves_less(axis, said, true):
    system, plant = axis
    logs = records(plant, 2e-4, {}, held=true == "hold")
    found = {}
    for word in (said, true):
        mechanism = Mechanism(saying(system, word))
        found[word] = other_way([JointResiduals.of(mechanism, logs[role]) for role in ("fit", "select")])
    assert found[said].better
    assert f"'between: {true}'" in found[said].sentence
    assert not found[true].better


def test_nothing_is_asked_where_commands_are_logged_as_often_as_they_are_used(axis):
    system, plant = axis
    slow = replace(system, controller=replace(system.controller, rate=RATE, between="line"))
    assert other_way([JointResiduals.of(Mechanism(slow), record) for record in records(plant, 2e-4, {}).values()]) is None


def test_a_clock_is_not_blamed_for_commands_that_the_model_holds(axis, tmp_path):
    system, plant = axis
    # This noise hides the steps of held commands, but not their delay.
    logs = records(plant, 4e-3, {})
    diagnosis = diagnose_joints(saying(system, "hold"), logs, tmp_path, names=("clock_offset",))
    found = JointAccount().findings_of(diagnosis, logs, seed=0)
    assert found["verdict"] == "none_of_the_known"
    assert "'between: line'" in found["warnings"][0]
    # A clock that is late in spite of this is named.
    late = records(plant, 4e-3, {"clock_offset": 0.04})
    assert diagnose_joints(saying(system, "hold"), late, tmp_path, names=("clock_offset",)).finding.verdict == "named"


def test_a_delay_of_half_a_sample_is_named_where_the_stairs_of_held_commands_do_not_show(axis, tmp_path):
    system, plant = axis
    logs = records(plant, 2e-4, {"command_delay": 0.5 / RATE})
    diagnosis = diagnose_joints(saying(system, "line"), logs, tmp_path, names=("command_delay", "coulomb"))
    found = JointAccount().findings_of(diagnosis, logs, seed=0)
    assert found["verdict"] == "named"
    assert found["effects"][0]["parameters"]["time"]["value"] == pytest.approx(0.5 / RATE, rel=0.02)
    assert not any("'between: " in warning for warning in found.get("warnings", ()))
