"""Records: units, and every kind of log that must be refused with a sentence that says why."""

import numpy as np
import pandas as pd
import pytest

from gsbridge.errors import InputError
from gsbridge.gap.formats.quantum import quantum_of, shared_steps
from gsbridge.gap.formats.records import Layout, check_degrees, doubtful_degrees, read_record

LAYOUT = Layout(("axis",))


def table(rows: int = 300) -> dict[str, np.ndarray]:
    time = np.arange(rows) * 0.01
    return {
        "time [s]": time,
        "command.axis [rad]": np.sin(2 * time),
        "position.axis [rad]": np.sin(2 * time - 0.01),
        "velocity.axis [rad/s]": 2 * np.cos(2 * time - 0.01),
        "effort.axis [N m]": 0.3 * np.sin(2 * time),
    }


def written(tmp_path, columns, name="log.csv"):
    path = tmp_path / name
    frame = pd.DataFrame(columns)
    frame.to_parquet(path) if path.suffix == ".parquet" else frame.to_csv(path, index=False)
    return path


def renamed(columns, old, new, factor=1.0):
    return {new if key == old else key: values * factor if key == old else values for key, values in columns.items()}


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_formats_agree(tmp_path, name):
    columns = table()
    record = read_record(written(tmp_path, columns, name), LAYOUT)
    assert record.joints == ("axis",)
    assert record.duration == pytest.approx(2.99)
    np.testing.assert_allclose(record.measured["effort"][:, 0], columns["effort.axis [N m]"], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "factor"),
    [
        ("position.axis [rad]", "position.axis [deg]", 180 / np.pi),
        ("velocity.axis [rad/s]", "velocity.axis [rpm]", 30 / np.pi),
        ("time [s]", "time [ms]", 1e3),
        ("effort.axis [N m]", "effort.axis [mNm]", 1e3),
    ],
)
def test_stated_units_become_si(tmp_path, old, new, factor):
    plain = read_record(written(tmp_path, table()), LAYOUT)
    other = read_record(written(tmp_path, renamed(table(), old, new, factor), "other.csv"), LAYOUT)
    np.testing.assert_allclose(other.time, plain.time, atol=1e-9)
    for kind in plain.measured:
        np.testing.assert_allclose(other.measured[kind], plain.measured[kind], atol=1e-9)


def test_columns_of_other_names_are_found_with_units_beside(tmp_path):
    columns = renamed(renamed(table(), "position.axis [rad]", "enc_1"), "time [s]", "stamp [s]")
    layout = Layout(("axis",), columns={"time": "stamp", "position.axis": "enc_1"}, units={"position": "rad"})
    record = read_record(written(tmp_path, columns), layout)
    np.testing.assert_allclose(record.measured["position"][:, 0], columns["enc_1"], atol=1e-12)


def refused(tmp_path, columns, layout=LAYOUT):
    path = written(tmp_path, columns)
    with pytest.raises(InputError) as error:
        read_record(path, layout)
    assert error.value.source == str(path)
    return str(error.value)


def test_missing_column_is_named(tmp_path):
    columns = table()
    del columns["position.axis [rad]"]
    assert "'position.axis' is missing" in refused(tmp_path, columns)


def test_missing_unit_is_refused(tmp_path):
    assert "has no unit" in refused(tmp_path, renamed(table(), "position.axis [rad]", "position.axis"))


@pytest.mark.parametrize(("mark", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_separators_are_named(tmp_path, mark, name):
    path = written(tmp_path, table())
    path.write_text(path.read_text().replace(",", mark))
    with pytest.raises(InputError, match=f"separated by {name}"):
        read_record(path, LAYOUT)


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_a_table_without_a_header_line_is_told_so(tmp_path, mark):
    """Its numbers were listed as the names of its columns."""
    path = written(tmp_path, table())
    path.write_text("\n".join(path.read_text().replace(",", mark).splitlines()[1:]))
    with pytest.raises(InputError, match=r"it has no header line: its first line holds numbers\. Write the columns' names"):
        read_record(path, LAYOUT)


@pytest.mark.parametrize("again", ["position.axis [rad]", "position.axis [deg]"])
def test_a_column_that_stands_twice_is_refused(tmp_path, again):
    """One of the two would be lost, and nobody would know which."""
    path = written(tmp_path, table())
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{header},{again}", *(f"{row},0.5" for row in rows)]))
    with pytest.raises(InputError, match=r"the column 'position\.axis' stands twice"):
        read_record(path, LAYOUT)


@pytest.mark.parametrize(("mark", "name"), [("|", "bars"), (" ", "blanks")])
def test_separators_that_headers_may_hold_are_named_too(tmp_path, mark, name):
    path = written(tmp_path, {key.split(" ")[0]: values for key, values in table().items()})
    path.write_text(path.read_text().replace(",", mark))
    with pytest.raises(InputError, match=f"separated by {name}"):
        read_record(path, LAYOUT)


def first_value(text, value):
    """A log whose first value in the first row is another."""
    header, row, rest = text.split("\n", 2)
    return "\n".join([header, value + row[row.index(",") :], rest])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: "# logged by an arm\n" + text, "begins with a comment: # logged by an arm. Remove the lines above"),
        (lambda text: "# " + text, "begins with a comment: # time .*Write the header without a mark"),
        (
            lambda text: "logged by an arm\n" + text,
            r"first line names 1, its rows have 5 values\. The first line has to be the header: remove",
        ),
        (lambda text: text.replace("\n0.01,", "\n0.01,7,", 1), r"line 3 has 6 values, those above it 5\. Mend that line"),
        (
            lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1),
            "names 5, its rows have 6 values.*no comma behind the last",
        ),
        (lambda text: "\n".join(row.replace(".", ",") if "[" not in row else row for row in text.split("\n")), "with a point"),
        (lambda text: text.split("\n")[0] + "\n", "a header and no rows"),
        (lambda text: first_value(text, "2026-03-04T10:00:00"), "'2026-03-04T10:00:00'.*seconds since the first sample"),
        (lambda text: first_value(text, '"0,01"'), "but '0,01'.*decimals with a point"),
        (lambda text: first_value(text, "s"), "but 's'.*remove the row of units"),
    ],
)
def test_files_that_are_no_plain_csv_say_what_to_do(tmp_path, spoil, said):
    path = written(tmp_path, table())
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError, match=said) as error:
        read_record(path, LAYOUT)
    assert error.value.source == str(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_text_that_is_not_utf8_is_refused(tmp_path, encoding):
    path = written(tmp_path, renamed(table(), "position.axis [rad]", "position.axis [°]"))
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
    with pytest.raises(InputError, match="not in UTF-8"):
        read_record(path, LAYOUT)


def test_a_header_and_a_case_that_disagree_are_refused(tmp_path):
    said = refused(tmp_path, table(), Layout(("axis",), units={"position": "deg"}))
    assert "states [rad] for the column 'position.axis', the case [deg]" in said
    # One unit, written in two ways.
    read_record(written(tmp_path, table()), Layout(("axis",), units={"effort": "Nm"}))


@pytest.mark.parametrize("factor", [1e3, 1e-4])
def test_times_in_another_unit_are_noticed(tmp_path, factor):
    said = refused(tmp_path, table() | {"time [s]": table()["time [s]"] * factor})
    assert "the times look like another unit" in said


def test_wrong_dimension_is_refused(tmp_path):
    assert "no angular speed" in refused(tmp_path, renamed(table(), "velocity.axis [rad/s]", "velocity.axis [rad]"))


@pytest.mark.parametrize("old", ["position.axis [rad]", "velocity.axis [rad/s]"])
def test_degrees_for_radians_are_noticed(tmp_path, old):
    message = refused(tmp_path, renamed(table(), old, old, 180 / np.pi))
    assert "looks like" in message


def test_radians_are_not_taken_for_degrees(tmp_path):
    columns = table()
    for name in ("position.axis [rad]", "velocity.axis [rad/s]"):
        columns[name] = columns[name] * 1.4
    assert read_record(written(tmp_path, columns), LAYOUT).duration > 2


def test_positions_far_beyond_the_limits_look_like_degrees(tmp_path):
    columns = {key: values for key, values in table().items() if "velocity" not in key and "command" not in key}
    record = read_record(written(tmp_path, renamed(columns, "position.axis [rad]", "position.axis [rad]", 57.3)), LAYOUT)
    with pytest.raises(InputError, match="looks like degrees"):
        check_degrees(record, "log.csv", np.array([[-2.0, 2.0]]))


def test_clock_that_runs_backwards_is_refused(tmp_path):
    columns = table()
    columns["time [s]"][100] = columns["time [s]"][98]
    assert "backwards" in refused(tmp_path, columns)


def test_a_clock_that_was_set_anew_is_not_to_be_sorted(tmp_path):
    """Sorted, two stretches would lie in one another."""
    columns = table()
    columns["time [s]"] = np.where(np.arange(300) < 150, columns["time [s]"], columns["time [s]"] - 0.5)
    assert "cut the log there" in refused(tmp_path, columns)
    columns = table()
    columns["time [s]"][[100, 101]] = columns["time [s]"][[101, 100]]
    assert "Sort the log" in refused(tmp_path, columns)


def test_a_joint_without_limits_that_turns_far_is_asked_about(tmp_path):
    columns = {name: values if name == "time [s]" else 57.3 * values for name, values in table().items()}
    record = read_record(written(tmp_path, columns), LAYOUT)
    for limits in (None, np.array([[-np.inf, np.inf]]), np.zeros((1, 2))):
        (said,) = doubtful_degrees(record, limits)
        assert "axis" in said
        assert "state [deg]" in said
    assert doubtful_degrees(record, np.array([[-60.0, 60.0]])) == []
    assert doubtful_degrees(read_record(written(tmp_path, table()), LAYOUT)) == []


def test_not_a_number_is_refused_with_its_row(tmp_path):
    columns = table()
    columns["effort.axis [N m]"][41] = np.nan
    assert "data row 42" in refused(tmp_path, columns)


def test_short_record_is_refused(tmp_path):
    assert "lasts 1.49 s" in refused(tmp_path, table(150))


def test_amperes_need_a_gain(tmp_path):
    columns = renamed(table(), "effort.axis [N m]", "effort.axis [A]", 10.0)
    assert "amperes" in refused(tmp_path, columns)
    record = read_record(written(tmp_path, columns), Layout(("axis",), torque_per_ampere={"axis": 0.1}))
    np.testing.assert_allclose(record.measured["effort"][:, 0], table()["effort.axis [N m]"], atol=1e-9)


def test_currents_in_milliamperes_and_gains_of_torques(tmp_path):
    layout = Layout(("axis",), torque_per_ampere={"axis": 0.5})
    columns = renamed(table(), "effort.axis [N m]", "effort.axis [mA]", 2e3)
    record = read_record(written(tmp_path, columns), layout)
    np.testing.assert_allclose(record.measured["effort"][:, 0], table()["effort.axis [N m]"], atol=1e-12)
    assert "in [N m], and 'torque_per_ampere' is stated" in refused(tmp_path, table(), layout)


def test_joints_that_the_model_holds_are_looked_at(tmp_path):
    columns = table() | {"position.wrist [deg]": np.full(300, 90.0), "position.hand": np.ones(300)}
    layout = Layout(("axis",), held={"wrist": False, "hand": False, "thumb": True})
    assert read_record(written(tmp_path, columns), layout).held == {"wrist": pytest.approx(np.pi / 2)}


def test_channel_of_one_joint_only_is_refused(tmp_path):
    columns = table() | {"position.elbow [rad]": table()["position.axis [rad]"]}
    assert ".elbow'" in refused(tmp_path, columns, Layout(("axis", "elbow")))


def test_a_short_record_shows_the_step_of_a_fine_encoder():
    step, rng = 2 * np.pi / 65536, np.random.default_rng(0)
    moved = np.sin(np.linspace(0.0, 6.0, 300))[:, None]
    assert quantum_of(np.round(moved / step) * step) == pytest.approx(step)
    assert quantum_of(moved + 1e-4 * rng.normal(size=moved.shape)) == 0.0


def test_a_log_that_was_brought_to_other_times_shows_the_step_of_its_encoder():
    """Between two samples of the encoder lie values that are none of its levels, and all are written with six digits."""
    step, clock = 2 * np.pi / 4096, np.arange(0.0, 6.0, 0.011)
    counted = np.round(0.4 * np.sin(clock) ** 3 / step) * step
    resampled = np.round(np.interp(np.arange(0.0, 5.9, 0.005), clock, counted), 6)[:, None]
    assert quantum_of(resampled) == pytest.approx(step, rel=1e-3)
    # From rest to rest, without an encoder: the postures lie a tenth apart, which is no step.
    rests = np.repeat(np.array([0.0, 0.3, 0.1, 0.5, 0.2, 0.4]), 50)
    moving = np.convolve(rests, np.hanning(21) / np.hanning(21).sum(), mode="valid")[:, None]
    assert quantum_of(moving) == 0.0


@pytest.mark.parametrize("bits", [12, 14, 16])
def test_the_step_of_a_fine_encoder_is_found_among_six_digits(bits):
    step = 2 * np.pi / 2**bits
    moved = np.round(0.5 * np.sin(np.linspace(0.0, 6.0, 900)) / step) * step
    assert quantum_of(np.round(moved, 6)[:, None]) == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize("step", [0.0, 2 * np.pi / 4096])
def test_postures_a_round_angle_apart_are_no_steps(step):
    """From posture to posture, three degrees apart, each for a second; with an encoder its own step is the one that counts."""
    postures = np.deg2rad(3.0) * np.repeat(np.arange(60.0), 50)
    moving = np.convolve(postures, np.hanning(17) / np.hanning(17).sum(), mode="valid")
    seen = np.round(moving / step) * step if step else np.round(moving, 6)
    assert quantum_of(seen[:, None])[0] == pytest.approx(step, rel=1e-3) if step else quantum_of(seen[:, None])[0] < 2e-6


def test_a_log_that_hardly_moves_counts_as_the_others_do_and_no_other_log_does():
    step, time = 2 * np.pi / 4096, np.arange(0.0, 6.0, 0.01)
    moves = np.round(0.3 * np.sin(time) / step) * step
    rests = np.where(time < 3.0, 7 * step, 9 * step)
    fine = np.round(0.3 * np.sin(time) + 2e-4 * np.random.default_rng(0).normal(size=time.shape), 6)
    coarse = np.round(0.3 * np.sin(time), 2)
    logs = [{"position": column[:, None]} for column in (moves, rests, fine, coarse)]
    alone = [{"position": quantum_of(log["position"])} for log in logs]
    assert alone[1]["position"] == 0.0
    found = [float(steps["position"][0]) for steps in shared_steps(logs, alone)]
    assert found[:2] == [pytest.approx(step), pytest.approx(step)]
    # What one log was written with says nothing of the others.
    assert found[2] < 2e-6
    assert found[3] == pytest.approx(0.01)


def test_quantum_is_the_smallest_step():
    values = np.round(np.sin(np.arange(1000) / 30.0) / 3e-3) * 3e-3
    assert quantum_of(values[:, None])[0] == pytest.approx(3e-3)
    assert quantum_of(np.random.default_rng(0).normal(size=(1000, 1)))[0] == 0.0
