"""Joint logs, cases and models that are well-formed but odd: each is refused in one line, or read rightly.

A value that a reader accepts silently leads to a wrong diagnosis: infinite noise hides every gap, a command that never changes
makes one.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from gsbridge.errors import InputError
from gsbridge.gap.contact.throws import read_throws
from gsbridge.gap.formats import mcap as mcap_logs
from gsbridge.gap.formats.branches import unwrapped
from gsbridge.gap.formats.columns import MOST_VALUES
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.present import check_records
from gsbridge.gap.formats.records import Layout
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from tests.fuzz.samples import JOINTS, READERS, Reader, write_case
from tests.fuzz.test_readers import read_within

TIME = np.arange(400) / 100
LAYOUT = Layout(("axis",))
ROS = Layout(("axis",), units={"position": "rad", "command": "rad"})


def table(position: np.ndarray, command: np.ndarray | None = None) -> pd.DataFrame:
    """A log of one axis."""
    columns = {"time [s]": TIME, "position.axis [rad]": position}
    return pd.DataFrame(columns if command is None else {**columns, "command.axis [rad]": command})


def refused(path: Path, reader, said: str) -> None:
    """The reader refuses a file in one line that says this, soon."""

    def read(path: Path) -> None:
        with pytest.raises(InputError, match=said):
            reader(path)

    read_within(Reader(write_case, read), path)


def changed_case(folder: Path, **changes: object) -> Path:
    """A sound case with other content."""
    path = write_case(folder)
    content = yaml.safe_load(path.read_text()) | changes
    path.write_text(yaml.safe_dump(content))
    return path


def changed_model(folder: Path, **changes: object) -> Path:
    """A sound model with other content; what stands under `controller` is changed key by key."""
    path = READERS["mechanism"].write(folder)
    content = yaml.safe_load(path.read_text())
    controller = content["controller"] | changes.pop("controller", {})
    path.write_text(yaml.safe_dump({**content, **changes, "controller": controller}))
    return path


INF, NAN = float("inf"), float("nan")
SIZES = [INF, NAN, -1e-4, 1e300, True, "small", None, [1e-4] * 40, {"axis": 1e-4}]


@pytest.mark.parametrize("value", SIZES, ids=repr)
@pytest.mark.parametrize("key", ["noise", "tolerance"])
def test_sizes_that_would_hide_every_gap(tmp_path, key, value):
    refused(changed_case(tmp_path, **{key: {"position": value}}), read_joint_case, rf"{key}\.position")


def test_sizes_that_a_person_writes(tmp_path):
    path = changed_case(tmp_path, tolerance={"position": 0})
    path.write_text(path.read_text() + "noise: {position: 5e-4}\n")
    record = read_joint_case(path).records["fit"]
    assert set(record.sigma["position"]) == {5e-4}
    assert not record.tolerance["position"].any()


@pytest.mark.parametrize("value", [INF, NAN, 0, 0.0, True, "0.1 N m", 1e300, 1e-300, [None], {JOINTS[0]: INF}], ids=repr)
def test_gains_that_no_motor_has(tmp_path, value):
    refused(changed_case(tmp_path, torque_per_ampere=value), read_joint_case, "torque_per_ampere")


def test_numbers_that_grow_endless_with_their_unit(tmp_path):
    log = table(np.sin(TIME)).assign(**{"effort.axis [kN m]": 1.0})
    log = log.rename(columns={"effort.axis [kN m]": "effort.axis [N]"})
    log.loc[3, "effort.axis [N]"] = 1e306
    log.rename(columns={"effort.axis [N]": "effort.axis [kN]"}).to_csv(tmp_path / "log.csv", index=False)
    layout = Layout(("axis",), sliding=("axis",), columns={"position.axis": "position.axis"})
    text = (tmp_path / "log.csv").read_text().replace("position.axis [rad]", "position.axis [m]")
    (tmp_path / "log.csv").write_text(text)
    refused(tmp_path / "log.csv", lambda path: read_log(path, layout), "holds .* in data row 4, beyond measure")


MODELS = {
    "truth value": ({"controller": {"stiffness": True}}, "stiffness' is True, which is no number"),
    "text": ({"controller": {"stiffness": "060"}}, "stiffness' is '060', which is no number"),
    "nothing": ({"controller": {"stiffness": None}}, "controller.stiffness is missing"),
    "nothing in a list": ({"viscous": [None]}, "viscous' is None, which is no number"),
    "twice": ({"joints": [JOINTS[0], JOINTS[0]]}, f"names '{JOINTS[0]}' twice"),
    "millimetres": ({"gravity": [0, 0, -9810]}, r"'gravity' is \[0, 0, -9810\]"),
    "steps without end": ({"physics_rate": 1e12}, r"physics_rate' is 1e\+12"),
    "a loop without end": ({"controller": {"rate": 1e12}}, r"rate' is 1e\+12"),
    "friction without end": ({"coulomb": 1e300}, r"coulomb' is 1e\+300"),
}


@pytest.mark.parametrize("name", MODELS)
def test_numbers_of_a_model_that_are_none(tmp_path, name):
    changes, said = MODELS[name]
    refused(changed_model(tmp_path, **changes), read_mechanism_model, said)


@pytest.mark.parametrize("word", ["060", "1:30"])
def test_numbers_that_yaml_reads_as_others(tmp_path, word):
    path = changed_model(tmp_path)
    path.write_text(path.read_text() + f"physics_rate: {word}\n")
    refused(path, read_mechanism_model, f"YAML reads {word} as another number than it says")


# Logs in tables


@pytest.mark.parametrize("ending", [".PARQUET", ".Parquet", ".CSV"])
def test_endings_in_capitals(tmp_path, ending):
    path = tmp_path / f"log{ending}"
    log = table(0.5 * np.sin(TIME))
    log.to_csv(path, index=False) if ending == ".CSV" else log.to_parquet(path)
    assert len(read_log(path, LAYOUT).time) == len(TIME)


def test_parquet_with_a_column_twice(tmp_path):
    columns = [pa.array(TIME), pa.array(np.sin(TIME)), pa.array(np.cos(TIME))]
    names = ["time [s]", "position.axis [rad]", "position.axis [rad]"]
    pq.write_table(pa.Table.from_arrays(columns, names), tmp_path / "log.parquet")
    refused(tmp_path / "log.parquet", lambda path: read_log(path, LAYOUT), "the column 'position.axis' stands twice")


def test_parquet_of_few_bytes_and_many_rows(tmp_path):
    path, rows = tmp_path / "log.parquet", 2**20
    part = pa.table({name: np.zeros(rows) for name in ("time [s]", "position.axis [rad]")})
    with pq.ParquetWriter(path, part.schema, compression="zstd") as writer:
        for _ in range(MOST_VALUES // (2 * rows) + 1):
            writer.write_table(part)
    assert path.stat().st_size < 2**21
    refused(path, lambda path: read_log(path, LAYOUT), r"it holds \d+ rows of 2 columns; at most 250000000 values are read")


@pytest.mark.parametrize("ending", ["csv.gz", "csv.bz2", "csv.xz", "csv.zip", "csv"])
def test_logs_that_are_packed(tmp_path, ending):
    """Also by another name than their kind's."""
    path = tmp_path / f"log.{ending}"
    table(np.sin(TIME)).to_csv(path, index=False, compression="gzip" if ending == "csv" else "infer")
    refused(path, lambda path: read_log(path, LAYOUT), rf"it is compressed. Unpack log\.{ending} first")


@pytest.mark.parametrize("mark", [";", "\t"])
def test_decimal_commas_between_other_separators(tmp_path, mark):
    table(np.sin(TIME)).to_csv(tmp_path / "log.csv", sep=mark, decimal=",", index=False)
    refused(tmp_path / "log.csv", lambda path: read_log(path, LAYOUT), "its columns are separated by .* decimals with a point")


def test_throws_in_files_with_odd_names(tmp_path):
    for name in ("t².csv", "t1.CSV"):
        (tmp_path / name).write_text("a,b\n1,2\n")
    refused(tmp_path, read_throws, "the column 'time' is missing")


NO_NAMES = ["a\0b.csv", "n" * 5000, "n" * 5000 + ".mcap#/a", "a\0b.mcap", "a\0b#3"]


@pytest.mark.parametrize("name", NO_NAMES, ids=lambda name: ascii(name[-9:]))
@pytest.mark.parametrize("key", ["records", "model", "repeats"])
def test_names_that_no_file_can_have(tmp_path, key, name):
    path = changed_case(tmp_path, **{key: name if key == "model" else {"fit": name}})

    def read(path: Path) -> None:
        case_files(path)
        read_joint_case(path)

    refused(path, read, "cannot be read|does not exist|No such file|too long")


@pytest.mark.parametrize("key", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", ["a\0b.urdf", "n" * 5000], ids=["zero byte", "long"])
def test_names_of_descriptions_that_no_file_can_have(tmp_path, key, name):
    path = write_case(tmp_path)
    model = tmp_path / yaml.safe_load(path.read_text())["model"]
    content = {k: v for k, v in yaml.safe_load(model.read_text()).items() if k != "urdf"}
    model.write_text(yaml.safe_dump({key: name, **content}))

    def read(path: Path) -> None:
        case_files(path)
        read_joint_case(path)

    refused(path, read, ".")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"records": {"fitt": "fit.csv"}}, "'fitt' under 'records' is no role of a record. Did you mean 'fit'"),
        ({"records": {"fit": "lost.csv"}}, "the record 'fit' is missing: there is no .*lost.csv"),
        ({"records": {"fit": "lost#3"}}, "the record 'fit' is missing"),
        ({"records": {"fit": "n" * 5000}}, "the record 'fit' is missing"),
        ({"repeats": {"fit": ["lost.csv"]}}, "the record 'fit' is missing: .* under `repeats:`"),
    ],
)
def test_a_case_is_looked_at_before_it_is_planned(tmp_path, changes, said):
    path = changed_case(tmp_path)
    check_records(path, tmp_path / "results")
    refused(changed_case(tmp_path, **changes), lambda path: check_records(path, tmp_path / "results"), said)
    check_records(changed_case(tmp_path, records={"fit": "results/later.csv"}), tmp_path / "results")


# Angles that wrap around after a turn


def wrap(angles: np.ndarray) -> np.ndarray:
    return (angles + np.pi) % (2 * np.pi) - np.pi


TURNING = 2.4 + 1.5 * np.sin(2 * TIME)


@pytest.mark.parametrize(
    ("position", "command"),
    [
        (wrap(TURNING), TURNING),
        (TURNING, wrap(TURNING)),
        (wrap(TURNING), wrap(TURNING + 0.05)),
        (wrap(TURNING + 2.0), wrap(TURNING + 1.95)),
        (TURNING - 2 * np.pi, TURNING),
        ((TURNING - 3.0) % (2 * np.pi), TURNING - 3.0),
        (wrap(5 * TIME), 5 * TIME),
        (wrap(TURNING), None),
        (wrap(TURNING), wrap(TURNING[np.arange(len(TIME)) // 5 * 5])),
    ],
)
def test_encoders_that_begin_anew_after_a_turn(tmp_path, position, command):
    table(position, command).to_csv(tmp_path / "log.csv", index=False)
    record = read_log(tmp_path / "log.csv", LAYOUT)
    found = record.measured["position"][:, 0]
    assert np.abs(np.diff(found)).max() < 0.2
    np.testing.assert_allclose(np.cos(found), np.cos(position), atol=1e-9)
    if command is not None:
        assert np.abs(record.commands["command"][:, 0] - found).max() < 0.15


def test_long_ways_that_a_joint_really_goes_are_left_alone(tmp_path):
    """A command that steps through most of a turn, and a joint that follows it; and one that slides."""
    command = np.where(TIME < 2.0, -2.9, 2.9)
    position = np.clip(-2.9 + 8.0 * (TIME - 2.0), -2.9, 2.9)
    table(position, command).to_csv(tmp_path / "log.csv", index=False)
    record = read_log(tmp_path / "log.csv", LAYOUT)
    np.testing.assert_array_equal(record.commands["command"][:, 0], command)
    np.testing.assert_allclose(record.measured["position"][:, 0], position, atol=1e-12)
    text = (tmp_path / "log.csv").read_text().replace("[rad]", "[m]")
    (tmp_path / "log.csv").write_text(text)
    record = read_log(tmp_path / "log.csv", Layout(("axis",), sliding=("axis",)))
    np.testing.assert_array_equal(record.commands["command"][:, 0], command)


@pytest.mark.parametrize("far", [2.5, 3.1])
@pytest.mark.parametrize("speed", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("period", [4.0, 20.0])
def test_a_command_that_a_slow_joint_cannot_follow_is_left_alone(tmp_path, far, speed, period):
    """Steps and square waves of nearly a turn, a joint that limps behind or is stuck, and a log without positions."""
    command = np.where((TIME - 1.0) % period < 0.5 * period, far, -far)
    position = np.full(len(TIME), -far)
    for k in range(1, len(TIME)):
        most = speed * (TIME[k] - TIME[k - 1])
        position[k] = position[k - 1] + np.clip(command[k] - position[k - 1], -most, most)
    table(position, command).to_csv(tmp_path / "log.csv", index=False)
    record = read_log(tmp_path / "log.csv", LAYOUT)
    np.testing.assert_array_equal(record.commands["command"][:, 0], command)
    np.testing.assert_allclose(record.measured["position"][:, 0], position, atol=1e-12)
    np.testing.assert_array_equal(unwrapped(TIME, None, command)[1], command)


def test_a_dead_joint_is_not_moved_to_its_command(tmp_path):
    table(np.full(len(TIME), -3.0), np.full(len(TIME), 3.0) + 1e-3 * np.sin(TIME)).to_csv(tmp_path / "log.csv", index=False)
    assert np.all(read_log(tmp_path / "log.csv", LAYOUT).measured["position"] == -3.0)


# Logs in MCAP


def write_mcap(
    path: Path,
    stamps: dict[str, np.ndarray],
    *,
    joints: tuple[str, ...] = ("axis",),
    other: bytes = b"",
    chunked: bool = True,
) -> Path:
    """States and commands with stamps in their headers, and a topic that nobody asks for."""
    writer_module = pytest.importorskip("mcap.writer")
    with open(path, "wb") as stream:
        writer = writer_module.Writer(stream, use_chunking=chunked)
        writer.start()
        channels = {topic: writer.register_channel(topic, "json", 0) for topic in (*stamps, "/camera")}
        for topic, times in stamps.items():
            for k, time in enumerate(times):
                seconds, nanos = divmod(round((100 + time) * 1e9), 10**9)
                content = {"header": {"stamp": {"sec": seconds, "nanosec": nanos}}}
                values = [float(0.5 * np.sin(3 * time))] * len(joints)
                content |= {"data": values} if topic == "/commands" else {"name": joints, "position": values}
                logged = round((100 + k / 100) * 1e9)
                writer.add_message(channels[topic], logged, json.dumps(content).encode(), logged)
        if other:
            writer.add_message(channels["/camera"], 10**11, other, 10**11)
        writer.finish()
    return path


def test_commands_whose_stamps_run_backwards(tmp_path):
    stamps = {"/states": TIME, "/commands": TIME.copy()}
    stamps["/commands"][[100, 101]] = stamps["/commands"][[101, 100]]
    path = write_mcap(tmp_path / "log.mcap", stamps)
    said = "the clock runs backwards by 0.01 s at message 102 of '/commands'"
    refused(path, lambda path: read_log(f"{path}#/states,/commands", ROS), said)


@pytest.mark.parametrize(
    ("sent", "covers"), [(TIME[:250], "0 to 2.74 s"), (TIME[120:], "1.2 to 3.99 s"), (TIME, ""), (TIME[::100], "")]
)
def test_commands_that_do_not_cover_the_measurements(tmp_path, sent, covers):
    """Those that are sent where something changes hold until the next."""
    path = write_mcap(tmp_path / "log.mcap", {"/states": TIME, "/commands": sent})
    record = read_log(f"{path}#/states,/commands", ROS)
    assert covers in record.cut
    assert bool(record.cut) == bool(covers)
    assert record.duration == pytest.approx(3.99 if not covers else 2.74 if covers.startswith("0") else 2.79)


@pytest.mark.parametrize("chunked", [True, False])
def test_topics_that_nobody_asked_for_are_not_decoded(tmp_path, monkeypatch, chunked):
    path = write_mcap(tmp_path / "LOG.MCAP", {"/states": TIME}, other=b"no JSON", chunked=chunked)
    assert len(read_log(f"{path}#/states", ROS).time) == len(TIME)
    monkeypatch.setattr(mcap_logs, "MOST_MESSAGES", 300)
    refused(path, lambda path: read_log(f"{path}#/states", ROS), "more than the 300 messages")
    monkeypatch.setattr(mcap_logs, "MOST_MESSAGES", 400)
    monkeypatch.setattr(mcap_logs, "LARGEST_TOPICS", 1000)
    refused(path, lambda path: read_log(f"{path}#/states", ROS), "more than")


def test_a_log_that_is_cut_marks_its_case(tmp_path):
    write_mcap(tmp_path / "log.mcap", {"/states": TIME, "/commands": TIME[:250]}, joints=JOINTS[:1])
    records = {"fit": "log.mcap#/states,/commands", "select": "fit.csv", "verify": "fit.csv"}
    case = read_joint_case(changed_case(tmp_path, records=records, units={"position": "rad", "command": "rad"}))
    assert "of the record 'fit' '/commands' covers 0 to 2.74 s alone: only these were taken" in case.reasons
