"""Films from beside the table: which trials they show, and what their frames and corners are."""

import numpy as np
from PIL import Image
from trial_files import write_trials

from gsbridge.report.figures import onlooker_films as module
from gsbridge.report.figures.onlooker_films import told_starts, write_onlooker_film
from gsbridge.report.figures.paired_trials import read_starts
from gsbridge.report.figures.trial_films import LOST, WON
from gsbridge.report.tables.result_paths import CellPaths

FAILED = {("fixed", 8): "not_grasped", ("unseen", 24): "dropped"}


class GreenView:
    """An onlooker that sees nothing but green, once per picture of the film."""

    def pictures(self, path, every):
        count = len([*range(0, len(path) - 1, every), len(path) - 1])
        return [np.full((module.HEIGHT, module.WIDTH, 3), (0, 200, 0), np.uint8)] * count


def both(folder, **more):
    return [write_trials(folder, "sim", states=6), write_trials(folder, "mirror", states=9, **more)]


def shown_ms(path):
    """How long a film lasts."""
    with Image.open(path) as film:
        times = []
        for number in range(film.n_frames):
            film.seek(number)
            film.load()
            times.append(film.info["duration"])
    return sum(times)


def test_a_success_and_a_failure_are_told_where_there_are_both(tmp_path):
    assert [start.succeeded() for start in told_starts(read_starts(both(tmp_path / "a", failed=FAILED)))] == [True, False]
    assert [start.succeeded() for start in told_starts(read_starts(both(tmp_path / "b")))] == [True, True]


def test_the_film_shows_the_arm_the_outcome_and_what_the_policy_saw(tmp_path, monkeypatch):
    monkeypatch.setattr(module.OnlookerView, "build", lambda *_: GreenView())
    write_onlooker_film(CellPaths("grasp", "mug", "table"), both(tmp_path, failed=FAILED), None, tmp_path / "film.webp")
    assert (tmp_path / "film.webp").stat().st_size < module.MOST_BYTES
    # Nine states, every second one shown: four pictures of 0.1 s, then the last state for two seconds. Equal pictures in a row
    # are one frame of the file, so their number is no measure, but the time that they stay is.
    assert shown_ms(tmp_path / "film.webp") == 4 * 100 + 2000
    with Image.open(tmp_path / "film.webp") as film:
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB")).astype(int)
    lower = module.HEAD + module.HEIGHT + 2 * module.BORDER + module.TEXT + module.GAP
    middle, left = module.HEIGHT // 2, module.GAP + module.WIDTH + 2 * module.BORDER + module.GAP
    # The first line succeeds; the mirror fails in the second.
    assert np.abs(last[module.HEAD + middle, module.GAP + 1] - WON).max() < 40
    assert np.abs(last[lower + middle, left + 1] - LOST).max() < 40
    assert np.abs(last[lower + middle, left + 100] - (0, 200, 0)).max() < 40
    corner = last[lower + module.BORDER + 20, left + module.BORDER + 40]
    assert np.abs(corner - (0, 200, 0)).max() > 40
