"""The overview picture and clip, from real files of a small scene: sizes, duration, what is counted."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from robot_fixture import robot
from test_environment_build import files  # noqa: F401
from test_report_onlooker_films import shown_ms
from trial_files import write_trials

from gsbridge.cameras import Camera, View, look_at, write_views
from gsbridge.environment.robot_splats import robot_splats, write_robot_splats
from gsbridge.errors import InputError
from gsbridge.images import write_image
from gsbridge.report.figures import overview as module
from gsbridge.report.figures.overview import FilmedScene, write_overview
from gsbridge.report.tables.result_paths import CellPaths

FAILED = {("fixed", 8): "not_grasped", ("unseen", 24): "dropped"}


@pytest.fixture(scope="module")
def scene(files, tmp_path_factory):  # noqa: F811
    """Assets and the robot's splats."""
    folder = tmp_path_factory.mktemp("links")
    write_robot_splats(folder / "splats", robot_splats(robot(), 900, fit_steps=0, seed=1))
    return replace(files[0], robot_splats=folder / "splats")


def filmed(folder, count):
    """A film of so many grey pictures, in portrait."""
    (folder / "images").mkdir(parents=True)
    views = []
    for number in range(count):
        write_image(folder / "images" / f"{number:04d}.png", np.full((90, 60, 3), 0.4, np.float32))
        pose = look_at((0.4, 0.1 * number, 0.3), (0, 0, 0))
        views.append(View(f"{number:04d}.png", Camera(60, 90, 70, 70, 30, 45), pose, "train"))
    write_views(folder / "views.json", views)
    return FilmedScene(folder / "views.json", folder / "images", "a real camera")


def test_picture_and_clip_are_small_and_last_as_long_as_is_said(scene, tmp_path):
    trials = [write_trials(tmp_path, "sim", states=6), write_trials(tmp_path, "mirror", states=9, failed=FAILED)]
    films = {"item": filmed(tmp_path / "item", 3), "background": filmed(tmp_path / "background", 5)}
    out = {"picture": str(tmp_path / "all.jpg"), "clip": str(tmp_path / "all.webp")}
    write_overview(CellPaths("grasp", "box", "flat"), trials, scene, films, out)
    with Image.open(out["picture"]) as picture:
        assert picture.size == (module.GAP + 2 * (module.WIDTH + module.GAP), module.HEAD + 2 * (module.HEIGHT + module.FOOT))
    assert (tmp_path / "all.jpg").stat().st_size < module.MOST_PICTURE_BYTES
    assert (tmp_path / "all.webp").stat().st_size < module.MOST_BYTES
    # Film and orbit; of each of two starts four moments of nine states and its end; the counts.
    wanted = 2 * module.SHOWN_S + 2 * (4 * 0.1 + module.HOLD_S) + module.LAST_S
    assert shown_ms(out["clip"]) == pytest.approx(1000 * wanted, abs=20)


def test_counts_stand_where_their_share_is(tmp_path):
    trials = [write_trials(tmp_path, "sim"), write_trials(tmp_path, "mirror", failed=FAILED)]
    counted = module._counted(module.read_starts(trials)).astype(int)
    left, right = module.BAR
    for colour, share in zip(module.COLOURS, (1.0, 0.75), strict=True):
        # Dots, wider than the line of the interval; of two sets of start poses.
        seen = (np.abs(counted - colour).max(-1) < 6)[:, left - 6 :]
        rows = np.flatnonzero(np.apply_along_axis(lambda row: row.sum(), 1, seen))
        tall = [column for column in range(seen.shape[1]) if seen[:, column].sum() >= 2 * 9]
        assert len(rows)
        assert np.mean(tall) + left - 6 == pytest.approx(left + share * (right - left), abs=2)


def test_a_film_without_views_is_refused(tmp_path):
    empty = filmed(tmp_path, 0)
    with pytest.raises(InputError, match="holds no view"):
        empty.read()
