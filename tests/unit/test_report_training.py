"""What trainings took and reached, from learning curves that are made up here."""

import pytest
from policy_files import write_policy

from gsbridge.errors import InputError
from gsbridge.policy import curve
from gsbridge.report.figures import learning_curves
from gsbridge.report.tables import training as training_table
from gsbridge.report.tables.paper import PAPER_GRASPS
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.training import write_training_rows

CELL = PAPER_GRASPS[0]


def test_training_rows_count_every_part_until_the_first_good_evaluation(tmp_path):
    policy, csv = write_policy(tmp_path, CELL, [0.5, 0.9375, 0.96875, 0.9], seed=4, seconds=30.0)
    row = training_table.training_row(policy, csv)
    # Four parts of half a minute between two evaluations; the third one is the first with 95 %.
    assert (row["cpu_min"], row["cpu_min_to_95"], row["steps_to_95"]) == (8.0, 6.0, 3000)
    assert (row["seed"], row["steps"], row["replay_mb"], row["status"]) == (4, 4000, 150.0, "pass")
    assert (row["best_success"], row["retest_success"], row["controller_success"]) == (0.96875, 0.96875, 0.9375)
    never, csv = write_policy(tmp_path, CELL, [0.5, 0.9], seed=5)
    assert training_table.training_row(never, csv)["cpu_min_to_95"] is None
    csv.write_text(csv.read_text().replace("0.5", "half"))
    with pytest.raises(InputError, match="learning curve is damaged"):
        training_table.training_row(never, csv)


def test_columns_read_of_a_learning_curve_are_written_by_the_training():
    assert training_table.PARTS == curve.PARTS
    assert {*training_table.CURVE_COLUMNS, *learning_curves.CURVE_COLUMNS} <= set(curve.COLUMNS)


def test_printed_training_shows_minutes_and_dashes(tmp_path):
    good = write_policy(tmp_path, CELL, [0.5, 0.96875, 1.0])
    poor = write_policy(tmp_path, CELL, [0.5], seed=2)
    write_training_rows(*zip(good, poor, strict=True), tmp_path / "training.csv")
    table = training_table.training_table(read_rows(tmp_path / "training.csv"))
    # Four parts in columns of their own: what they went into adds up to the minutes before them.
    assert table.columns[7:12] == ("CPU min", "of it simulate", "act", "learn", "evaluate")
    assert all(float(row[7]) == pytest.approx(sum(map(float, row[8:12])), abs=0.25) for row in table.rows)
    assert "simulating" in table.notes[1]
    assert table.rows[0][7:14] == ("12.0", "3.0", "3.0", "3.0", "3.0", "8.0", "150")
    assert (table.rows[1][7], table.rows[1][12]) == ("4.0", "–")
    assert training_table.training_table([]) is None
