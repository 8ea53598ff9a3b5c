"""Films of trials, read back."""

import numpy as np
import pytest
from PIL import Image
from trial_files import write_trials

from gsbridge.errors import InputError
from gsbridge.report.figures import trial_films as module
from gsbridge.report.figures.paired_trials import read_starts
from gsbridge.report.figures.trial_films import (
    BORDER,
    GAP,
    HEAD,
    LOST,
    RUNNING,
    SIDE,
    WON,
    chosen_starts,
    film_frames,
    write_trial_film,
)
from gsbridge.report.tables.result_paths import CellPaths

CELL = CellPaths("grasp", "mug", "table")
FAILED = {("fixed", 8): "not_grasped", ("unseen", 24): "dropped"}


def both(folder, **more):
    return [write_trials(folder, "sim", states=6), write_trials(folder, "mirror", states=9, **more)]


def test_the_film_runs_in_real_time_and_stays_on_its_last_picture(tmp_path):
    write_trial_film(CELL, both(tmp_path, failed=FAILED), tmp_path / "film.webp")
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.format, film.is_animated, film.info["loop"]) == ("WEBP", True, 0)
        # Nine states, every second shown, the last among them.
        assert film.n_frames == 5
        durations = []
        for number in range(film.n_frames):
            film.seek(number)
            film.load()
            durations.append(film.info["duration"])
        assert durations == [100] * 4 + [2000]
    assert (tmp_path / "film.webp").stat().st_size < 2_000_000


def test_frames_tell_the_outcome_when_a_trial_ends(tmp_path):
    starts = chosen_starts(read_starts(both(tmp_path, failed=FAILED)))
    frames = film_frames(starts, "title", "subtitle")
    sim = (HEAD + BORDER + SIDE // 2, GAP + 1)
    mirror = (sim[0], sim[1] + SIDE + 2 * BORDER)
    found = [[tuple(frame[place]) for frame in frames] for place in (sim, mirror)]
    # In sim the trial is done after five steps, in the mirror, where it fails, after eight.
    assert found[0] == [RUNNING] * 3 + [WON] * 2
    assert found[1] == [RUNNING] * 4 + [LOST]


def test_the_pictures_are_those_of_the_state(tmp_path):
    starts = chosen_starts(read_starts(both(tmp_path)))
    frames = film_frames(starts, "title", "subtitle")
    row, column = HEAD + BORDER + SIDE // 2, GAP + BORDER + SIDE // 2
    sim = starts[0].trials["sim"].path.pictures()[:, 0, 0, 0].astype(int)
    shown = [int(frame[row, column, 0]) for frame in frames]
    np.testing.assert_allclose(shown, sim[[0, 2, 4, 5, 5]], atol=2)


def test_failures_come_first_then_a_success_of_each_quadrant(tmp_path):
    chosen = chosen_starts(read_starts(both(tmp_path, failed=FAILED)))
    assert [start.succeeded() for start in chosen] == [False] * 2 + [True] * 4
    assert [start.quadrant for start in chosen[2:]] == [1, 2, 3, 4]
    everywhere = {(pose_set, index): "dropped" for pose_set in ("fixed", "unseen") for index in (0, 8, 16, 24)}
    lost = chosen_starts(read_starts(both(tmp_path / "lost", failed=everywhere)))
    assert len(lost) == module.MOST_FAILURES
    assert sorted(start.quadrant for start in lost) == [1, 2, 3, 4]


def test_one_world_alone_is_filmed_too(tmp_path):
    write_trial_film(CELL, [write_trials(tmp_path, "sim")], tmp_path / "film.webp")
    with Image.open(tmp_path / "film.webp") as film:
        assert film.n_frames == 4


def test_a_film_that_cannot_be_small_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST_BYTES", 100)
    with pytest.raises(InputError, match="the film has"):
        write_trial_film(CELL, both(tmp_path), tmp_path / "film.webp")
    assert not (tmp_path / "film.webp").exists()


def test_failures_come_first_only_where_there_are_any(tmp_path):
    for folder, failed, words in (("some", FAILED, "Failures first."), ("none", {}, "One start of each quadrant.")):
        (tmp_path / folder).mkdir()
        starts = read_starts(both(tmp_path / folder, failed=failed))
        assert module._rates(starts, CELL).endswith(words)
