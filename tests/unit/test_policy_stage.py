"""The training stage: what a checkpoint is keyed by, how long a training took."""

import json
from dataclasses import replace

import pytest
from robot_fixture import robot
from sim_fixture import content, cube

from gsbridge.environment.build import StageFiles
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.policy.curve import PARTS
from gsbridge.policy.stage import command_delay, cpu_seconds_to, files_digest
from gsbridge.sim.model import parse_model
from gsbridge.sim.world import SimWorld


def files(folder):
    for name in ("item", "background"):
        (folder / name / "hulls").mkdir(parents=True)
        (folder / name / "asset.json").write_text(json.dumps({"status": "pass", "name": name}))
        (folder / name / "hulls" / "0.obj").write_text("v 0 0 0")
    (folder / "robot").mkdir()
    (folder / "robot" / "robot.urdf").write_text("<robot/>")
    (folder / "model.yaml").write_text("effects: []")
    parts = {name: folder / name / "asset.json" for name in ("item", "background")}
    return StageFiles(robot=folder / "robot", model=folder / "model.yaml", **parts)


@pytest.mark.parametrize("changed", ["item/hulls/0.obj", "background/asset.json", "robot/robot.urdf", "model.yaml"])
def test_everything_that_a_world_is_made_of_is_in_the_key(tmp_path, changed):
    made = files(tmp_path)
    before = files_digest(made)
    assert files_digest(made) == before
    (tmp_path / changed).write_text("something else")
    assert files_digest(made) != before


def test_typed_colours_are_in_the_key_and_missing_files_are_named(tmp_path):
    made = files(tmp_path)
    assert files_digest(replace(made, item_colour=(0.1, 0.2, 0.3))) != files_digest(made)
    with pytest.raises(InputError, match="gone"):
        files_digest(replace(made, registration=tmp_path / "gone.json"))


def test_time_until_it_is_good_enough_leaves_evaluations_out():
    rows = [
        {"success": success, **{f"cpu_{part}_s": float(k * 10**n) for n, part in enumerate(PARTS)}}
        for k, success in enumerate([0.2, 0.96, 0.9, 1.0], start=1)
    ]
    assert PARTS[-1] == "evaluate"
    assert cpu_seconds_to(rows, 0.95) == 2 * 111.0
    assert cpu_seconds_to(rows, 0.99) == 4 * 111.0
    assert cpu_seconds_to(rows[:1], 0.95) is None


@pytest.mark.parametrize("latency", [0.0, 0.1])
@pytest.mark.parametrize(("delay", "effects", "periods"), [(0.0, {}, 0.0), (0.05, {"lag": 0.1, "command_delay": 0.025}, 3.5)])
def test_the_teacher_reckons_with_every_delay_that_the_model_states_and_no_other(delay, effects, periods, latency):
    values = content()
    values["arm"]["delay"] = delay
    values["effects"] = [{"name": name, "parameters": {"time": time}} for name, time in effects.items()]
    settings = EnvironmentSettings(image_size=64)
    with SimWorld(robot(), cube(), parse_model(values), latency=latency) as sim:
        environment = PickEnvironment(sim, settings, BlankRenderer(64))
        assert command_delay(environment) == pytest.approx(periods)
