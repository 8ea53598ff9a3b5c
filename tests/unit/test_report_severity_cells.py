"""The page on the policies of the tables at severity: what stands in it, against counts by hand."""

import numpy as np
import pytest
from policy_files import trial_rows, write_trials
from scipy.stats import binomtest
from severity_files import SIM, both_sets, lab, row, write

from gsbridge.errors import InputError
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.severity_cells import write_cells_page
from gsbridge.report.tables.severity_rows import resting, write_severity_rows

CUBE, BEAR = ("grasp", "small_cube", "foam_pad"), ("grasp", "bear", "foam_pad")
CAKE = ("pick_and_place", "cake", "plate")


def page_of(tmp_path, rows):
    write_cells_page(write(tmp_path / "rows.csv", rows), tmp_path / "page.md")
    return (tmp_path / "page.md").read_text()


def line_of(page, start):
    """Cells of the last line of a page that starts so."""
    return [
        cell.strip() for cell in [line for line in page.splitlines() if line.startswith(f"| {start} |")][-1].split("|")[2:-1]
    ]


def share(good, tried):
    interval = binomtest(good, tried).proportion_ci(method="wilson")
    return f"{100 * good / tried:.0f} % ({100 * interval.low:.0f} to {100 * interval.high:.0f}; {good}/{tried})"


def test_every_cell_stands_beside_simulation(tmp_path):
    rows = both_sets(CUBE, "gs", 64) + both_sets(CUBE, "gs", 60, world=lab(2)) + both_sets(CUBE, "gs", 48, world=lab(3))
    rows += both_sets(BEAR, "gs", 62) + both_sets(BEAR, "gs", 52, world=lab(2)) + both_sets(BEAR, "gs", 40, world=lab(3))
    rows += both_sets(CUBE, "mesh", 64) + both_sets(CUBE, "mesh", 20, world=lab(2))
    # One cell has no trial in simulation.
    rows += both_sets(CAKE, "gs", 50, world=lab(2))
    rows += [row(CUBE, "gs", 9, trials=16, pose_set="outside", world=world) for world in (SIM, lab(2))]
    page = page_of(tmp_path, rows)
    inside, outside = page.split("### Start poses outside the training square")
    assert line_of(inside, "Grasp: small cube on foam pad") == [share(64, 64), share(60, 64), share(48, 64)]
    assert line_of(inside, "Grasp: small cube on foam pad, mesh (RL-sim)") == [share(64, 64), share(20, 64), ""]
    assert line_of(inside, "Pick and place: cake on plate") == ["", share(50, 64), ""]
    assert line_of(outside, "Grasp: small cube on foam pad") == [share(9, 16), share(9, 16), ""]
    # Means over the cells, each counting the same, and points to simulation.
    count, sim, second, third, *changes = line_of(inside, "grasp, splats")
    assert (count, sim[:4], second[:4], third[:4]) == ("2", "98 %", "88 %", "69 %")
    assert "112/128" in second
    assert [change.split(" ")[0] for change in changes] == ["−11", "−30"]
    rates = np.array([52, 60, 62, 64]) / 64
    sigma = np.sqrt(np.sum(rates * (1 - rates) / 64)) / 2
    low, high = (float(text.replace("−", "-")) for text in changes[0].split("(")[1].rstrip(")").split(" to "))
    np.testing.assert_allclose((low, high), 100 * (-14 / 128 + np.array([-1.96, 1.96]) * sigma), atol=1.2)
    assert line_of(inside, "pick and place, splats")[-2:] == ["", ""]
    assert "lab_2 (severity 2), lab_3 (severity 3)" in page


def test_worlds_of_one_severity_are_one_column(tmp_path):
    rows = both_sets(CUBE, "gs", 60, world=lab(2)) + both_sets(CUBE, "gs", 50, world=("shed", 2, 2))
    page = page_of(tmp_path, rows)
    assert line_of(page, "Grasp: small cube on foam pad") == ["", share(110, 128)]
    assert "| policy | simulation | severity 2 |" in page


def test_what_it_rests_on_is_told(tmp_path):
    one = [{name: str(value) for name, value in found.items()} for found in both_sets(CUBE, "gs", 60, world=lab(2))]
    assert resting(one).startswith("Rests on 1 cell, 1 training of each policy, and 64 starts of each training inside")
    assert "say nothing of other trainings" in resting(one)
    more = [*one, *({**found, "training": training} for found in one for training in ("2", "3"))]
    assert "3 trainings of each policy" in resting(more)
    assert "say nothing of other trainings" not in resting(more)


def test_rows_of_trials_tell_simulation_from_the_rest(tmp_path):
    cell = CellPaths(*CUBE)
    files = [
        write_trials(tmp_path, cell, world, trial_rows({"fixed": 20, "unseen": 30}, forgiven=2)) for world in ("sim", "lab_3")
    ]
    write_severity_rows(tmp_path / "rows.csv", files, {"lab_3": (3, 3), "lab_4": (4, 4)})
    found = [(one["world"], one["look"], one["successes"]) for one in read_rows(tmp_path / "rows.csv")]
    # Excess contact is a failure in simulation only.
    assert found == [("sim", "", "20"), ("sim", "", "30"), ("lab_3", "3", "22"), ("lab_3", "3", "32")]
    write_cells_page(tmp_path / "rows.csv", tmp_path / "page.md")
    assert line_of((tmp_path / "page.md").read_text(), "Grasp: small cube on foam pad") == [share(50, 64), share(54, 64)]


def test_without_worse_days_there_is_no_page(tmp_path):
    with pytest.raises(InputError, match=r"of some severity"):
        page_of(tmp_path, both_sets(CUBE, "gs", 60))
    with pytest.raises(InputError, match="no trials"):
        page_of(tmp_path, [])
    assert not (tmp_path / "page.md").exists()
