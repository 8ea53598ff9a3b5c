"""The stage that finds the light: without a film of an object, and what it refuses."""

import numpy as np
import pytest
from robot_fixture import robot

from gsbridge.environment.light import FilmedShadow, LightFile, calibrate_light
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.scene.light import directions


def test_without_an_object_on_the_table_there_is_no_light_and_the_record_says_so(tmp_path):
    calibrate_light(tmp_path / "light.json", robot=robot().folder, shown=FilmedShadow.of({"robot": "robot"}))
    record = read_json(tmp_path / "light.json")
    assert record["status"] == "degraded"
    assert "no shadows" in record["reasons"][0]
    found = LightFile.read(tmp_path / "light.json")
    assert found.light is None
    assert found.shadows("object", None) is None
    visible = robot().visuals()
    assert set(found.robot) == set(visible)
    for name, spheres in found.robot.items():
        corners = np.concatenate([mesh.vertices for mesh, _ in visible[name]])
        low, high = corners.min(0), corners.max(0)
        assert len(spheres)
        assert ((spheres[:, :3] > low) & (spheres[:, :3] < high)).all()
        # A sphere may reach past a surface by half the distance of the places that were tried.
        assert (spheres[:, 3] < 0.5 * (high - low).max() + 0.01).all()


@pytest.mark.parametrize(
    "content",
    [
        {"light": None},
        {"light": None, "robot": {"hand": [[1.0, 2.0]]}},
        {"light": {"floor": 0.1, "shares": [0.9]}, "robot": {}},
        {"light": {"shares": [1.0] * len(directions())}, "robot": {}},
    ],
)
def test_a_damaged_record_is_refused(tmp_path, content):
    write_json(tmp_path / "light.json", content)
    with pytest.raises(InputError, match=r"light\.json"):
        LightFile.read(tmp_path / "light.json")
