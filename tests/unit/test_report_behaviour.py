"""Behaviour in two worlds: joined trials, rows and figure."""

import csv

import numpy as np
import pytest
from PIL import Image
from trial_files import POSES, write_trials

from gsbridge.errors import InputError
from gsbridge.report.figures.behaviour import COLUMNS, most_typical, write_behaviour
from gsbridge.report.figures.behaviour_drawing import picked, spread_starts
from gsbridge.report.figures.paired_trials import failures_first, read_starts, trials_by_cell
from gsbridge.report.tables.result_paths import CellPaths

CELL = CellPaths("grasp", "mug", "table")
MESH = CellPaths("grasp", "mug", "table", "mesh")
FAILED = {("fixed", 8): "not_grasped", ("unseen", 24): "dropped"}


def test_trials_are_joined_by_their_start(tmp_path):
    files = [write_trials(tmp_path, "mirror", states=9, failed=FAILED), write_trials(tmp_path, "sim", states=6)]
    starts = read_starts(files)
    assert [(start.pose_set, start.index) for start in starts] == POSES
    assert [start.quadrant for start in starts] == [1, 2, 3, 4] * 2
    for start in starts:
        assert list(start.trials) == ["sim", "mirror"]
        assert [len(trial.path) for trial in start.trials.values()] == [6, 9]
        assert start.trials["mirror"].path.index == start.index
        assert start.trials["mirror"].failure == FAILED.get((start.pose_set, start.index), "")
        assert start.trials["mirror"].seconds == pytest.approx(0.4)
    assert starts[1].pose == (0.08, 0.2, -0.5)


def test_excess_contact_is_a_failure_in_simulation_only(tmp_path):
    failed = {("fixed", 0): "excess_contact"}
    start = read_starts([write_trials(tmp_path, world, failed=failed) for world in ("sim", "mirror")])[0]
    assert not start.trials["sim"].success
    assert start.trials["sim"].outcome() == "excess contact"
    assert start.trials["mirror"].success
    assert start.trials["mirror"].outcome() == "success"


def test_failures_come_first_and_those_of_the_other_world_before_all(tmp_path):
    files = [
        write_trials(tmp_path, "sim", failed={("fixed", 16): "dropped"}),
        write_trials(tmp_path, "mirror", failed=FAILED),
    ]
    ordered = failures_first(read_starts(files))
    assert [start.label for start in ordered[:3]] == ["fixed 8", "unseen 24", "fixed 16"]
    assert [start.label for start in ordered[3:]] == ["fixed 0", "fixed 24", "unseen 0", "unseen 8", "unseen 16"]


def test_files_that_do_not_belong_together_are_refused(tmp_path):
    sim = write_trials(tmp_path, "sim")
    with pytest.raises(InputError, match="start poses are others"):
        read_starts([sim, write_trials(tmp_path, "mirror", poses=POSES[:-1])])
    other = write_trials(tmp_path / "other", "sim", states=7)
    sim.log.write_bytes(other.log.read_bytes())
    with pytest.raises(InputError, match="holds other trials"):
        read_starts([sim])
    sim = write_trials(tmp_path, "sim")
    sim.table.write_text(sim.table.read_text().replace("fixed,8", "fixed,eight"))
    with pytest.raises(InputError, match="damaged"):
        read_starts([sim])
    with pytest.raises(InputError, match="none to show"):
        read_starts([])


def test_rows_hold_the_known_distances_and_counts(tmp_path):
    sim = write_trials(tmp_path / "gs", "sim", failed={("fixed", 8): "dropped"})
    files = {
        CELL: [sim, write_trials(tmp_path / "gs", "mirror", shift=0.002, states=11, failed=FAILED)],
        MESH: [write_trials(tmp_path / "mesh", "sim"), write_trials(tmp_path / "mesh", "mirror", shift=0.02, states=9)],
    }
    write_behaviour(list(files.items()), tmp_path / "figure.png", tmp_path / "rows.csv")
    with (tmp_path / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [(row["renderer"], row["pose_set"]) for row in rows] == [
        (renderer, pose_set) for renderer in ("gs", "mesh") for pose_set in ("fixed", "unseen")
    ]
    for row in rows:
        # The paths lie side by side: 2 or 20 mm times 1 to 4, and times 5 to 8.
        known = (2 if row["renderer"] == "gs" else 20) * (np.arange(4) + (1 if row["pose_set"] == "fixed" else 5))
        assert float(row["distance_mm_median"]) == pytest.approx(np.median(known), abs=2e-3)
        assert float(row["distance_mm_p90"]) == pytest.approx(np.quantile(known, 0.9), abs=2e-3)
        assert (row["world"], row["trials"]) == ("mirror", "4")
    counts = [tuple(int(row[name]) for name in ("sim_successes", "world_successes", "same_outcome")) for row in rows]
    assert counts == [(3, 3, 4), (4, 3, 3), (4, 4, 4), (4, 4, 4)]
    with Image.open(tmp_path / "figure.png") as image:
        assert image.width > 1500
        assert len(set(image.convert("RGB").resize((200, 100)).get_flattened_data())) > 50


def test_one_world_or_no_policy_is_refused(tmp_path):
    with pytest.raises(InputError, match="not tried in two worlds"):
        write_behaviour([(CELL, [write_trials(tmp_path, "sim")])], tmp_path / "figure.png", tmp_path / "rows.csv")
    with pytest.raises(InputError, match="no policy"):
        write_behaviour([], tmp_path / "figure.png", tmp_path / "rows.csv")
    assert not (tmp_path / "figure.png").exists()


def test_the_shown_trial_is_neither_the_best_nor_the_worst():
    assert most_typical([np.array([5.0, 1.0, 9.0, 4.0, 100.0])]) == 0
    # Typical of both: the third is the median of the first policy and next to that of the other.
    assert most_typical([np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([30.0, 50.0, 20.0, 10.0, 40.0])]) in (0, 2, 3)
    assert most_typical([np.array([1.0, 2.0, 3.0]), np.array([7.0, 8.0, 9.0])]) == 1


def test_strips_and_drawn_paths_are_spread_evenly(tmp_path):
    starts = read_starts([write_trials(tmp_path, "sim", states=15)])
    pictures, times = picked(starts[0], "sim")
    assert len(pictures) == 8
    np.testing.assert_allclose(times, 0.1 * np.arange(8))
    drawn = spread_starts(starts)
    assert len(drawn) == 8
    assert [start.quadrant for start in drawn] == [1, 1, 2, 2, 3, 3, 4, 4]
    assert len(spread_starts(starts, 4)) == 4


def test_files_are_grouped_by_policy():
    cells = [vars(CELL), vars(CELL), vars(MESH)]
    found = trials_by_cell(cells, ["sim", "mirror", "sim"], [1, 1, 1], ["a", "b", "c"], ["d", "e", "f"])
    assert [cell for cell, _ in found] == [CELL, MESH]
    assert [(file.world, file.table, file.log) for file in found[0][1]] == [("sim", "a", "d"), ("mirror", "b", "e")]
