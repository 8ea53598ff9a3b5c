"""Only whole runs from nothing are timed."""

import subprocess
import sys
from pathlib import Path

import pytest

from gsbridge.files import read_json, write_json

PROGRAM = Path(__file__).parents[2] / "benchmarks" / "wall_time.py"


@pytest.fixture
def call(tmp_path):
    def run(*command: str) -> int:
        times = ["--output", "times.json", "--absent", "results"]
        return subprocess.run(
            [sys.executable, str(PROGRAM), "make_toy", *times, "--", *command], cwd=tmp_path, check=False
        ).returncode

    return run


def test_time_is_kept_beside_others(call, tmp_path):
    write_json(tmp_path / "times.json", {"make_tables": {"wall_s": 5.0, "cores": 2}})
    assert call("sleep", "0.3") == 0
    times = read_json(tmp_path / "times.json")
    assert times["make_tables"] == {"wall_s": 5.0, "cores": 2}
    assert times["make_toy"]["wall_s"] >= 0.3
    assert times["make_toy"]["cores"] >= 1


def test_failed_and_half_done_runs_are_not_timed(call, tmp_path):
    assert call("false") == 1
    (tmp_path / "results").mkdir()
    assert call("true") != 0
    assert not (tmp_path / "times.json").exists()
