"""Learning curves on their way to rerun and TensorBoard."""

import sys

import pytest
from recording_file import read_recording

from gsbridge.errors import InputError
from gsbridge.files import write_stage
from gsbridge.policy.curve import COLUMNS, write_curve
from gsbridge.report.recordings.tensorboard import write_events
from gsbridge.report.recordings.training import GROUPS, read_curve, record_training

ROWS = [{name: 100.0 * k + n for n, name in enumerate(COLUMNS)} | {"alpha": None} for k in range(3)]


@pytest.fixture
def curve(tmp_path):
    write_curve(tmp_path / "training.csv", ROWS)
    return tmp_path / "training.csv"


def test_a_curve_comes_back_as_it_was_written(curve):
    assert read_curve(curve) == ROWS


def test_every_column_of_the_curve_is_plotted_once():
    plotted = [column for columns in GROUPS.values() for column in columns]
    assert sorted(plotted) == sorted(set(COLUMNS) - {"step", "episode", "update", "length"})


def test_recording_holds_every_known_figure_at_its_step(curve, tmp_path):
    record = tmp_path / "training.json"
    write_stage(record, reasons=["it is young"], seed=1, algo="bc", success=0.5)
    record_training(curve, record, "cube", tmp_path / "training.rrd")
    found = read_recording(tmp_path / "training.rrd")
    assert found["/success/success"]["rows"] == 3
    assert "step" in found["/success/success"]["timelines"]
    values = found["/success/success"]["components"]["Scalars:scalars"]
    assert sorted(value.as_py()[0] for value in values) == [row["success"] for row in ROWS]
    assert "/schedule/alpha" not in found
    assert "it is young" in str(found["/summary"]["components"])


@pytest.mark.parametrize(
    "text", ["", "a,b\n1,2\n", ",".join(COLUMNS) + "\n", ",".join(COLUMNS) + "\nx" + "," * (len(COLUMNS) - 1)]
)
def test_damaged_curves_are_named(tmp_path, text):
    path = tmp_path / "training.csv"
    path.write_text(text)
    with pytest.raises(InputError, match="learning curve"):
        read_curve(path)


def test_tensorboard_that_is_not_there_is_named(curve, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(InputError, match=r"gsbridge\[tensorboard\]"):
        write_events(curve, tmp_path / "events")
    assert not (tmp_path / "events").exists()
