"""The table of the closed loop."""

import csv

import pytest

from gsbridge.files import write_json
from gsbridge.report.figures.loop import LoopFiles, write_loop

HEADER = ("pose_set", "index", "quadrant", "success", "success_tolerant", "failure")


def trials(path, good: int, count: int = 8):
    """Trials of which the first few succeed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for k in range(count):
            word = "true" if k < good else "false"
            writer.writerow(("fixed", k, 1, word, word, "" if k < good else "time_out"))
        # A start outside the training square counts in no row.
        writer.writerow(("outside", 0, 1, "false", "false", "time_out"))
    return path


@pytest.fixture
def files(tmp_path):
    plan = [{"variant": "default", "world": "mirror"}, {"variant": "default", "world": "late"}]
    plan += [{"variant": "amended", "world": "late"}]
    tables = [trials(tmp_path / f"{k}.csv", good) for k, good in enumerate((8, 1, 6))]
    trainings = [tmp_path / variant / "seed1" / "training.json" for variant in ("default", "amended")]
    for path, steps in zip(trainings, (5000, 7000), strict=True):
        write_json(path, {"steps": steps, "cpu_seconds": {"act": 60.0, "update": 120.0}})
    logged = tmp_path / "trials.json"
    write_json(logged, {"trials": [{"success": False, "seconds": 5.0}, {"success": True, "seconds": 2.5}]})
    calibration = {
        "before": {"verify": 400.0},
        "after": {"verify": 14.0},
        "delay": 0.058,
        "simulations": 1400,
        "seconds": 120.0,
    }
    write_json(tmp_path / "calibration.json", calibration)
    found = {"sentence": "Said.", "simulations": {"bank": 1000, "case": 50}, "seconds": 60.0}
    for name, verdict in (("a", "none_of_the_known"), ("b", "named")):
        write_json(tmp_path / f"{name}.json", {**found, "verdict": verdict})
    write_json(tmp_path / "amendment.json", {"reasons": ["friction is not simulated"]})
    return LoopFiles(
        {"task": "grasp", "object": "cake", "background": "foam_pad", "seed": 1},
        plan,
        tables,
        trainings,
        [logged, logged],
        tmp_path / "calibration.json",
        [tmp_path / "a.json", tmp_path / "b.json"],
        tmp_path / "amendment.json",
    )


def test_rows_and_page_tell_before_after_and_the_price(files, tmp_path):
    out = [tmp_path / name for name in ("loop.csv", "dynamic.md", "loop.png")]
    write_loop(files, *out)
    rows = list(csv.DictReader(out[0].open()))
    assert [int(row["successes"]) for row in rows] == [8, 1, 6]
    assert [int(row["training_steps"]) for row in rows] == [5000, 5000, 7000]
    # Wilson, 1 of 8: tabulated 0.0224 to 0.4709.
    assert float(rows[1]["ci95_low"]) == pytest.approx(0.0224, abs=1e-3)
    assert float(rows[1]["ci95_high"]) == pytest.approx(0.4709, abs=1e-3)
    text = out[1].read_text()
    for words in (
        "**named**",
        "**none of the known**",
        "from 400 to 14 times",
        "58.0 ms",
        "4 records of 15 s together, 2 of them of failed",
        "1400 simulations of the arm to calibrate, 2000 for the banks",
        "4 minutes",
        "7000 steps: 3 minutes",
        "Left out: friction is not simulated",
    ):
        assert words in text, words
    assert out[2].stat().st_size > 1000
