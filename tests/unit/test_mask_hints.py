"""A person's hints about pixels: in the prompt, in the masks, and on the sheet from which pixels are read."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import BROWSER, check
from table_scene import RADIUS, ball_scene

from gsbridge.cameras import write_views
from gsbridge.cli import main
from gsbridge.errors import InputError
from gsbridge.images import read_mask
from gsbridge.masks import MaskSettings, segment_object
from gsbridge.masks.hints import Hints, hinted, read_hints
from gsbridge.masks.prompt import find_object
from gsbridge.photogrammetry.sparse import SparsePoints, read_points
from gsbridge.report.pages.photo_pictures import ruled, ruler_step


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return ball_scene(tmp_path_factory.mktemp("ball"))


def pixel(view, point):
    return view.camera.project(view.cam_from_table[:3, :3] @ point + view.cam_from_table[:3, 3])


def test_hints_must_fit_a_registered_photo(scene):
    views = list(scene.views)
    assert len(read_hints([], views)) == len(views)
    with pytest.raises(InputError, match="no registered photo"):
        read_hints([("none.png", 3.0, 3.0, "keep")], views)
    with pytest.raises(InputError, match="outside"):
        read_hints([(views[0].name, 3.0, 1e5, "keep")], views)
    hints = read_hints([(views[1].name, 3.0, 4.0, "keep"), (views[1].name, 5.0, 6.0, "drop")], views)
    np.testing.assert_array_equal(hints[1].keep, [[3.0, 4.0]])
    np.testing.assert_array_equal(hints[1].drop, [[5.0, 6.0]])
    assert len(hints[0].keep) == len(hints[0].drop) == 0


def test_measured_points_near_a_hint_change_sides(scene):
    views, sparse = list(scene.views), read_points(scene.points_npz)
    prompt = find_object(scene.views, sparse, 0.008, 8)
    # A thing beside the ball that every view measured.
    thing = np.array([0.1, 0.02, 0.004]) + np.random.default_rng(0).normal(0, 1e-4, (6, 3))
    first = len(sparse.points)
    view_index = np.repeat(np.arange(len(views)), 6)
    more = SparsePoints(
        np.concatenate([sparse.points, thing]),
        np.concatenate([sparse.view_index, view_index]),
        np.concatenate([sparse.point_index, np.tile(first + np.arange(6), len(views))]),
    )
    none = Hints(np.zeros((0, 2)), np.zeros((0, 2)))
    kept = [Hints(pixel(views[0], thing[0])[None], np.zeros((0, 2))), *[none] * (len(views) - 1)]
    wider = hinted(prompt, more, views, kept)
    held = {row.tobytes() for row in wider.points}
    assert all(point.tobytes() in held for point in thing)
    assert (wider.low[:2] < thing.min(0)[:2]).all()
    assert (wider.high > thing.max(0)).all()
    assert not set(wider.table) & set(range(first, first + 6))
    dropped = [Hints(np.zeros((0, 2)), pixel(views[0], thing[0])[None]), *[none] * (len(views) - 1)]
    again = hinted(wider, more, views, dropped)
    assert not {row.tobytes() for row in again.points} & {row.tobytes() for row in thing}
    assert set(range(first, first + 6)) <= set(again.table)


def test_masks_obey_and_the_sheet_shows_it(scene, tmp_path, capsys):
    views = list(scene.views)
    base = tmp_path / "results/scenes/ball"
    aside = pixel(views[3], np.array([0.0, -1.6 * RADIUS, 0.0]))
    middle = pixel(views[5], np.array([0.0, 0.0, RADIUS]))
    points = [(views[3].name, *map(float, aside), "keep"), (views[5].name, *map(float, middle), "drop")]
    settings = MaskSettings(crop_px=160, hull_voxels=48, iterations=2, passes=1)
    segment_object(scene.views, scene.points_npz, base / "masks/images", base / "masks/masks.json", settings, points=points)
    for index, (u, v), inside in ((3, aside, True), (5, middle, False)):
        mask = read_mask(base / "masks/images" / views[index].name)
        assert (mask[int(v), int(u)] > 0.5) == inside
    (base / "sfm").mkdir()
    (base / "sfm/images").symlink_to(scene.views.path(views[0]).parent)
    (base / "align").mkdir()
    write_views(base / "align/views.json", views)
    config = tmp_path / "config.yaml"
    own = yaml.safe_load((Path(__file__).parents[2] / "config.yaml").read_text())
    own["scenes"]["ball"] = {"kind": "object", "source": {"images": "a"}, "masks": {"points": [list(p) for p in points]}}
    config.write_text(yaml.safe_dump(own))
    given = ["--results", str(tmp_path / "results"), "--config", str(config)]
    assert main(["masks", "ball", "--photo", views[3].name, *given]) == 0
    assert "mask_sheet.html" in capsys.readouterr().out
    text = (base / "mask_sheet.html").read_text()
    assert text.count("<img ") == 1
    assert views[3].name in text
    assert "http" not in re.sub(r"data:[^\"]+", "", text)
    assert main(["masks", "ball", "--photo", "none.png", *given]) == 1
    for name, said in (
        ("bal", "Did you mean 'ball'?"),
        ("foam_pad", "a background"),
        ("mug", "results/scenes/mug/align/align.json"),
    ):
        capsys.readouterr()
        assert main(["masks", name, *given]) == 1
        assert said in capsys.readouterr().err
    assert main(["masks", "ball", "--config", str(tmp_path / "none.yaml")]) == 1
    assert "Go to the project's folder" in capsys.readouterr().err
    if BROWSER is not None:
        assert check(text, tmp_path)["pictures"] == 1


@pytest.mark.parametrize("content", [b"scenes: [\n", b"\x83\xff\x00", b"words\n", b"", b"scenes: &a [*a]\n"])
def test_a_broken_configuration_is_named_in_one_line(content, tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    file.write_bytes(content)
    for path in (file, tmp_path):
        assert main(["masks", "ball", "--config", str(path)]) == 1
        said = capsys.readouterr().err
        assert said.startswith(f"gsbridge: {path}: ")
        assert said.count("\n") == 1


def test_rulers_stand_at_round_pixels():
    assert [ruler_step(longest) for longest in (14, 130, 640, 4000)] == [1, 10, 50, 500]
    picture = np.zeros((120, 160, 3), np.uint8)
    out = ruled(picture, 0.25, [(400.0, 200.0, "drop")])
    step = ruler_step(640)
    assert out[60, round(3 * step * 0.25)].min() > 80
    assert out[50, 100, 0] > out[50, 100, 1]
