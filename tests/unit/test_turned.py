"""Turned keyframes: a mark on a photo is where the turn takes it."""

import json

import numpy as np
import pytest
import trimesh

from gsbridge.capture.turned import turn_keyframes, turn_length
from gsbridge.configuration.align import AlignSettings
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import InputError
from gsbridge.images import image_size, read_image_u8, write_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.report.scores.turned import STAGES, StageSettings, write_turned_reconstruction

WIDTH, HEIGHT = 40, 24


@pytest.fixture
def capture(tmp_path):
    """Two dark photos, the first with one bright pixel, the second upright and smaller."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    write_image(tmp_path / "frames/b.png", image[:20, :10])
    image[5, 31] = 255
    write_image(tmp_path / "frames/a.png", image)
    frames = [{"name": "a.png"}, {"name": "b.png", "size": [10, 20]}]
    record = {"width": WIDTH, "height": HEIGHT, "frames": frames, "focal_prior_px": 50.0}
    (tmp_path / "keyframes.json").write_text(json.dumps(record))
    return tmp_path


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_marks_turn_with_their_photo(capture, degrees):
    out, record = capture / "turned/frames", capture / "turned/keyframes.json"
    turn_keyframes(capture / "frames", capture / "keyframes.json", degrees, out, record)
    turned, found = read_image_u8(out / "a.png"), json.loads(record.read_text())
    assert (found["width"], found["height"]) == turned.shape[1::-1] == ((HEIGHT, WIDTH) if degrees % 180 else (WIDTH, HEIGHT))
    assert found["focal_prior_px"] == 50.0
    assert tuple(found["frames"][1]["size"]) == image_size(out / "b.png")
    assert "size" not in found["frames"][0]
    # The middle of the pixel in column 31, row 5.
    length = turn_length({"metres": 0.1, "between": [["a.png", 31.5, 5.5], ["b.png", 0, 0]]}, degrees, capture / "frames")
    assert length["metres"] == 0.1
    name, u, v = length["between"][0]
    rows, columns = np.nonzero(turned[..., 0])
    assert (name, u, v) == ("a.png", columns[0] + 0.5, rows[0] + 0.5)
    assert length["between"][1][0] == "b.png"


def test_a_counter_clockwise_turn_takes_the_right_edge_to_the_top(capture):
    assert turn_length({"metres": 1, "between": [["a.png", WIDTH, 7]] * 2}, 90, capture / "frames")["between"][0] == [
        "a.png",
        7,
        0,
    ]


def test_lengths_without_pixels_stay(tmp_path):
    assert turn_length(None, 90, tmp_path) is None
    assert turn_length({"metres": 0.2, "object": "longest"}, 90, tmp_path) == {"metres": 0.2, "object": "longest"}


def test_photos_with_cameras_are_refused(capture):
    record = json.loads((capture / "keyframes.json").read_text()) | {"known_cameras": {"a.png": {}}}
    (capture / "keyframes.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="come with cameras"):
        turn_keyframes(capture / "frames", capture / "keyframes.json", 90, capture / "out", capture / "out.json")
    assert not (capture / "out").exists()


def test_a_stage_that_refuses_turned_photos_is_a_result(capture):
    """Two black photos have no features; what an earlier attempt left must not be read."""
    work = capture / "work"
    work.mkdir()
    (work / "sfm.json").write_text(json.dumps({"status": "pass", "registered": 2}))
    solid = trimesh.creation.box((0.08, 0.05, 0.1))
    usual = {stage: capture / f"{stage}.json" for stage in STAGES}
    for path in usual.values():
        path.write_text(json.dumps({"status": "pass", "reasons": [], "registered": 2, "scale_source": "unknown"}))
    for name in ("visual", "collision"):
        usual[name] = capture / f"{name}.ply"
        write_mesh(usual[name], Mesh(np.asarray(solid.vertices), np.asarray(solid.faces)))
    settings = StageSettings(SfmSettings(), AlignSettings(), MaskSettings(), MeshSettings(), None, None)
    record = json.loads((capture / "keyframes.json").read_text())
    frames = [{"name": name, "split": "train", "index": k, "time_s": None} for k, name in enumerate(("a.png", "b.png"))]
    more = {"frames": frames, "ordered": False, "known_cameras": {}, "source": {"kind": "images"}}
    (capture / "keyframes.json").write_text(json.dumps({**record, **more}))
    given = {"usual": usual, "frames": capture / "frames", "keyframes": capture / "keyframes.json", "settings": settings}
    for degrees, seed in ((180, 1), (0, 2)):
        out = capture / f"{degrees}.json"
        write_turned_reconstruction(out, **given, degrees=degrees, work=work, seed=1, threads=1)
        found = json.loads(out.read_text())
        assert "register" in found["refused"]
        assert (found["turned"], found["degrees"], found["seed"]) == (None, degrees, seed)
        assert found["usual"]["registered"] == 2
        assert not work.exists()
