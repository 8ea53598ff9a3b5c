"""Figures of closed loops from their rows."""

import pytest

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.figures.loop import COLUMNS
from gsbridge.report.scores.measured_policies import write_loop_figures
from gsbridge.report.tables.rows import write_rows

CELL = {"task": "grasp", "object": "bear", "background": "foam_pad", "training_steps": 5000}
LOOPS = [
    {"table": "picture_loop", "reference": "mirror", "world": "tint", "before": "plain", "after": "sees"},
    {"table": "picture_loop", "reference": "mirror", "world": "moved", "before": "default", "after": ""},
    {"table": "loop", "reference": "mirror", "world": "late", "before": "default", "after": "amended"},
]


def row(variant, world, successes, trials=64):
    rate = successes / trials
    part = {"variant": variant, "world": world, "trials": trials, "successes": successes, "success_rate": rate}
    return {**CELL, **part, "ci95_low": 0.0, "ci95_high": 1.0}


@pytest.fixture
def tables(tmp_path):
    pictures = [row("plain", "mirror", 64), row("plain", "tint", 8), row("sees", "tint", 56), row("sees", "sim", 60)]
    pictures += [row("default", "mirror", 62), row("default", "moved", 63)]
    write_rows(tmp_path / "picture_loop.csv", COLUMNS, pictures)
    write_rows(tmp_path / "loop.csv", COLUMNS, [row("default", "mirror", 64), row("default", "late", 32)])
    return {name: tmp_path / f"{name}.csv" for name in ("picture_loop", "loop")}


def test_each_world_is_told_before_since_and_after(tables, tmp_path):
    write_loop_figures(tmp_path / "out.json", tables, LOOPS, "desktop")
    content = read_json(tmp_path / "out.json")
    values = {name: figure["value"] for name, figure in content["figures"].items()}
    assert values == {
        "loop_tint_before": 100.0,
        "loop_tint_changed": 12.5,
        "loop_tint_after": 87.5,
        "loop_moved_before": pytest.approx(96.875),
        "loop_moved_changed": pytest.approx(98.4375),
        "loop_late_before": 100.0,
        "loop_late_changed": 50.0,
    }
    assert content["figures"]["loop_tint_after"]["n"] == 64
    # Wilson, 56 of 64: tabulated 0.772 to 0.935.
    assert content["figures"]["loop_tint_after"]["interval"] == pytest.approx([77.2, 93.5], abs=0.1)
    assert content["figures"]["loop_late_changed"]["where"] == "results/rows/loop.csv"


def test_damaged_rows_are_refused(tables, tmp_path):
    text = tables["loop"].read_text().replace(",32,", ",many,")
    tables["loop"].write_text(text)
    with pytest.raises(InputError, match="rows of the loop are damaged"):
        write_loop_figures(tmp_path / "out.json", tables, LOOPS, "desktop")
    assert not (tmp_path / "out.json").exists()
