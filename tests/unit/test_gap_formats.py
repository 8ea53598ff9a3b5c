"""Logs of other formats as records: each file is written here by the format's own package or by its documented layout."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.gap.formats.files import case_files, case_model, case_name, case_path, check_asked_cases, check_own_cases
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.records import Layout, Record, read_record
from gsbridge.gap.formats.store import load_records, save_records
from gsbridge.gap.joints.case import _per_column

JOINTS = ("shoulder", "elbow")
DEGREES = Layout(JOINTS, units={"position": "deg", "command": "deg"})
TIME = np.arange(150) / 50


def motion(phase: float = 0.0) -> np.ndarray:
    """Positions of both joints, rad. [T, 2]."""
    return np.stack([0.5 * np.sin(2 * TIME + phase), 0.3 * np.cos(3 * TIME + phase)], axis=1)


def write_lerobot(folder, version="v3.0", episodes=2, per_file=2, names=("shoulder.pos", "elbow.pos"), grouped=False):
    """A data set as LeRobot lays it out; episode k has the phase k."""
    (folder / "meta").mkdir(parents=True)
    vector = {"dtype": "float32", "shape": [2], "names": {"motors": list(names)} if grouped else list(names)}
    features = {
        "observation.state": vector,
        "action": vector,
        "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    }
    info = {"codebase_version": version, "fps": 50, "total_episodes": episodes, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    tables = []
    for episode in range(episodes):
        state = np.degrees(motion(episode)).astype(np.float32)
        action = np.degrees(motion(episode) + 0.01).astype(np.float32)
        columns = {"observation.state": list(state), "action": list(action), "timestamp": TIME.astype(np.float32)}
        tables.append(pd.DataFrame({**columns, "episode_index": episode, "frame_index": np.arange(len(TIME))}))
    for number, first in enumerate(range(0, episodes, per_file)):
        name = f"file-{number:03d}" if version.startswith("v3") else f"episode_{number:06d}"
        path = folder / f"data/chunk-000/{name}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pd.concat(tables[first : first + per_file]).to_parquet(path)
    return folder


@pytest.mark.parametrize(("version", "per_file", "grouped"), [("v3.0", 2, False), ("v2.1", 1, True)])
@pytest.mark.parametrize("episode", [0, 1])
def test_an_episode_of_a_lerobot_data_set(tmp_path, version, per_file, grouped, episode):
    folder = write_lerobot(tmp_path / "set", version, per_file=per_file, grouped=grouped)
    record = read_log(f"{folder}#{episode}", DEGREES)
    assert record.joints == JOINTS
    np.testing.assert_allclose(record.measured["position"], motion(episode), atol=1e-6)
    np.testing.assert_allclose(record.commands["command"], motion(episode) + 0.01, atol=1e-6)
    np.testing.assert_allclose(record.time, TIME, atol=1e-6)
    assert record.name == f"set#{episode}"
    assert record.digest != read_log(f"{folder}#{1 - episode}", DEGREES).digest


def test_elements_of_other_names_are_mapped_by_the_case(tmp_path):
    folder = write_lerobot(tmp_path / "set", names=("j1", "j2"))
    columns = {"position.shoulder": "observation.state.j1", "position.elbow": "observation.state.j2"}
    columns |= {"command.shoulder": "action.j1", "command.elbow": "action.j2"}
    record = read_log(f"{folder}#0", Layout(JOINTS, columns=columns, units=DEGREES.units))
    np.testing.assert_allclose(record.measured["position"], motion(), atol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "part", "said"),
    [
        (lambda folder: (folder / "meta/info.json").unlink(), "#0", "no LeRobot data set"),
        (lambda folder: None, "", "2 episodes"),
        (lambda folder: None, "#7", "no episode 7"),
        (lambda folder: None, "#first", "no number"),
        (lambda folder: (folder / "data/chunk-000/file-000.parquet").write_bytes(b"PAR1"), "#0", "cannot be read"),
    ],
)
def test_bad_data_sets_are_refused_in_one_sentence(tmp_path, spoil, part, said):
    folder = write_lerobot(tmp_path / "set")
    spoil(folder)
    with pytest.raises(InputError, match=said) as error:
        read_log(f"{folder}{part}", DEGREES)
    assert "\n" not in str(error.value)


def write_folder(folder, bag):
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    (folder / bag).write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: folder / "log.npz", r"a file of NumPy, which is not read\..*to_csv\('log\.csv'"),
        (lambda folder: folder / "log.pkl", r"a file of Python's tools.*to_csv\('log\.csv'"),
        (lambda folder: folder / "log.ulg", r"a log of PX4.*ulog2csv log\.ulg"),
        (lambda folder: folder / "log.mat", r"file of MATLAB, which is not read.*writetable"),
        (
            lambda folder: folder / "log.bag",
            r"ROS 1, which is.*rosbags-convert --src log\.bag --dst log --dst-storage mcap",
        ),
        (lambda folder: folder / "day" / "log.db3", r"SQLite, which is not read.*--src day --dst day_mcap --dst-storage mcap"),
        (lambda folder: write_folder(folder / "run", "run_0.db3"), r"SQLite.*--src run --dst run_mcap"),
        (lambda folder: write_folder(folder / "run", "run_0.mcap"), r"folder of a bag of ROS 2.*run_0\.mcap#TOPIC,COMMANDS"),
    ],
)
def test_logs_that_are_not_read_say_how_to_convert_them(tmp_path, make, said):
    with pytest.raises(InputError, match=said) as error:
        read_log(make(tmp_path), SI)
    assert "\n" not in str(error.value)


def test_units_of_a_data_set_must_be_stated(tmp_path):
    folder = write_lerobot(tmp_path / "set")
    with pytest.raises(InputError, match=r"no unit\. State it in the case, as 'units: \{command: \.\.\.\}'") as error:
        read_log(f"{folder}#0", Layout(JOINTS))
    assert error.value.source == f"{folder}#0"


def test_degrees_taken_for_radians_are_noticed(tmp_path):
    folder = write_lerobot(tmp_path / "set")
    with pytest.raises(InputError, match="degrees"):
        read_log(f"{folder}#0", Layout(JOINTS, units={"position": "deg", "command": "rad"}))


JOINT_STATE = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    + "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)


def states(k: int, offset: float = 0.0) -> dict:
    """A joint state, the joints in another order than the mechanism's."""
    q = motion()[k] + offset
    velocity = [-0.9 * np.sin(3 * TIME[k]), 1.0 * np.cos(2 * TIME[k])]
    seconds, nanos = divmod(round((100 + TIME[k]) * 1e9), 10**9)
    header = {"stamp": {"sec": seconds, "nanosec": nanos}, "frame_id": ""}
    return {"header": header, "name": ["elbow", "shoulder"], "position": [q[1], q[0]], "velocity": velocity, "effort": []}


def write_json_mcap(path, commands=True, latency=0.4):
    """Joint states and, half a period later, commands as JSON."""
    writer_module = pytest.importorskip("mcap.writer")
    with open(path, "wb") as stream:
        writer = writer_module.Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "jsonschema", b"{}")
        channels = {topic: writer.register_channel(topic, "json", schema) for topic in ("/joint_states", "/commands")}
        for k in range(len(TIME)):
            nanos = round((100 + TIME[k] + latency) * 1e9)
            writer.add_message(channels["/joint_states"], nanos, json.dumps(states(k)).encode(), nanos)
            if commands:
                content = {"data": [motion()[k, 0] + k, motion()[k, 1]]}
                writer.add_message(channels["/commands"], nanos + 10_000_000, json.dumps(content).encode(), nanos)
        writer.finish()
    return path


SI = Layout(JOINTS, units={"position": "rad", "velocity": "rad/s", "command": "rad"})


def test_joint_states_in_json_messages(tmp_path):
    record = read_log(f"{write_json_mcap(tmp_path / 'log.mcap')}#/joint_states", SI)
    np.testing.assert_allclose(record.measured["position"], motion(), atol=1e-12)
    np.testing.assert_allclose(record.measured["velocity"][:, 0], np.cos(2 * TIME), atol=1e-12)
    np.testing.assert_allclose(record.time, TIME, atol=1e-6)
    assert "effort" not in record.measured


def test_commands_are_those_sent_last(tmp_path):
    """At measurement k the command of k-1 is in force, since k's own came half a period later."""
    record = read_log(f"{write_json_mcap(tmp_path / 'log.mcap')}#/joint_states,/commands", SI)
    np.testing.assert_allclose(record.measured["position"], motion()[1:], atol=1e-12)
    np.testing.assert_allclose(record.commands["command"][:, 0] - motion()[:-1, 0], np.arange(len(TIME) - 1), atol=1e-9)


def write_ros_mcap(path, sent):
    """Joint states and commanded ones, written by the ROS package itself; `sent` gives the command of each sample."""
    writer_module = pytest.importorskip("mcap_ros2.writer")
    with open(path, "wb") as stream:
        writer = writer_module.Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for k in range(len(TIME)):
            nanos = round((200 + TIME[k]) * 1e9)
            writer.write_message("/joint_states", schema, states(k), nanos, nanos, k)
            writer.write_message("/joint_commands", schema, sent(k), nanos, nanos, k)
        writer.finish()
    return f"{path}#/joint_states,/joint_commands"


def test_ros_messages_carry_their_units(tmp_path):
    """No unit is stated anywhere."""
    log = write_ros_mcap(tmp_path / "log.mcap", lambda k: states(k, 0.01))
    record = read_log(log, Layout(JOINTS))
    np.testing.assert_allclose(record.measured["position"], motion(), atol=1e-12)
    np.testing.assert_allclose(record.commands["command"], motion() + 0.01, atol=1e-12)
    # For a sliding joint, ROS gives metres.
    slid = read_log(log, Layout(JOINTS, sliding=("elbow",)))
    np.testing.assert_array_equal(slid.measured["position"], record.measured["position"])


def test_commanded_torques_of_ros_are_commands_where_torques_drive(tmp_path):
    """One kind of message holds positions, speeds and efforts; a mechanism in mode `torque` is driven by the last alone."""
    log = write_ros_mcap(tmp_path / "log.mcap", lambda k: states(k, 0.01) | {"effort": [3.0 + k, 4.0 - k]})
    order = list(states(0)["name"])
    driven = read_log(log, Layout(JOINTS, torque_mode=True))
    wanted = np.stack([3.0 + np.arange(len(TIME)), 4.0 - np.arange(len(TIME))], axis=1)
    np.testing.assert_array_equal(driven.commands["command"], wanted[:, [order.index(joint) for joint in JOINTS]])
    assert set(driven.commands) == {"command"}
    fed = read_log(log, Layout(JOINTS))
    np.testing.assert_allclose(fed.commands["command"], motion() + 0.01, atol=1e-12)
    np.testing.assert_array_equal(fed.commands["feedforward"], driven.commands["command"])


def test_flat_messages_are_rows(tmp_path):
    writer_module = pytest.importorskip("mcap.writer")
    with open(tmp_path / "log.mcap", "wb") as stream:
        writer = writer_module.Writer(stream)
        writer.start()
        channel = writer.register_channel("/log", "json", 0)
        for k in range(len(TIME)):
            row = {"position.shoulder [rad]": motion()[k, 0], "position.elbow [deg]": np.degrees(motion()[k, 1]), "note": "x"}
            nanos = round(TIME[k] * 1e9)
            writer.add_message(channel, nanos, json.dumps(row).encode(), nanos)
        writer.finish()
    record = read_log(tmp_path / "log.mcap", Layout(JOINTS))
    np.testing.assert_allclose(record.measured["position"], motion(), atol=1e-9)
    np.testing.assert_allclose(record.time, TIME, atol=1e-9)


@pytest.mark.parametrize(
    ("part", "layout", "said"),
    [
        ("#/nothing", SI, "no topic '/nothing'"),
        ("#/joint_states", Layout(("wrist",), units=SI.units), "no joint 'wrist'"),
        ("#/joint_states,/commands", Layout(("elbow",), units=SI.units), "2 numbers for 1 joints"),
        ("#/joint_states", Layout(JOINTS), "has no unit"),
    ],
)
def test_bad_topics_are_refused_in_one_sentence(tmp_path, part, layout, said):
    path = write_json_mcap(tmp_path / "log.mcap")
    with pytest.raises(InputError, match=said):
        read_log(f"{path}{part}", layout)


def test_a_cut_mcap_file_is_refused(tmp_path):
    path = write_json_mcap(tmp_path / "log.mcap")
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InputError, match="no whole MCAP file"):
        read_log(path, SI)


def test_without_the_package_one_sentence_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "log.mcap").write_bytes(b"")
    for name in [name for name in sys.modules if name.split(".")[0] == "mcap"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    with pytest.raises(InputError, match=r"pip install .gsbridge\[mcap\]"):
        read_log(tmp_path / "log.mcap", SI)


def test_csv_and_parquet_say_the_same(tmp_path):
    columns = {
        "time [ms]": TIME * 1e3,
        "position.shoulder [rad]": motion()[:, 0],
        "position.elbow [mrad]": motion()[:, 1] * 1e3,
    }
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    pd.DataFrame(columns).to_parquet(tmp_path / "log.parquet")
    a, b = (read_log(tmp_path / name, Layout(JOINTS)) for name in ("log.csv", "log.parquet"))
    np.testing.assert_array_equal(a.measured["position"], b.measured["position"])
    np.testing.assert_allclose(a.measured["position"], motion(), atol=1e-12)
    with pytest.raises(InputError, match="have parts"):
        read_log(f"{tmp_path / 'log.csv'}#1", Layout(JOINTS))


@settings(max_examples=20, deadline=None)
@given(st.integers(3, 12), st.integers(1, 3), st.booleans(), st.text("abcäß_", max_size=8))
def test_stored_records_come_back_as_they_were(tmp_path_factory, rows, count, torque, name):
    rng = np.random.default_rng(rows)
    joints = tuple(f"j{k}" for k in range(count))
    commands, measured = ({kind: rng.normal(size=(rows, count))} for kind in ("command", "position"))
    sigma = {"position": np.full(count, 1e-3)}
    record = Record(name, np.arange(rows) / 7, joints, commands, measured, sigma, {}, "abc", torque)
    path = tmp_path_factory.mktemp("store") / "records.npz"
    save_records(path, {"fit": record, "select": record.with_measured({})})
    found = load_records(path)
    assert list(found) == ["fit", "select"]
    for field in ("name", "joints", "digest", "torque_commands"):
        assert getattr(found["fit"], field) == getattr(record, field)
    np.testing.assert_array_equal(found["fit"].time, record.time)
    for field in ("commands", "measured", "sigma", "quantum"):
        ours, theirs = getattr(record, field), getattr(found["fit"], field)
        assert list(ours) == list(theirs)
        for kind, values in ours.items():
            np.testing.assert_array_equal(values, theirs[kind])
    assert found["select"].measured == {}
    assert found["fit"].content_digest() == record.content_digest()


def test_a_damaged_store_is_refused(tmp_path):
    (tmp_path / "records.npz").write_bytes(b"PK\x03\x04 no")
    with pytest.raises(InputError, match="cannot be read"):
        load_records(tmp_path / "records.npz")


def test_files_of_a_case_are_found_before_it_is_read(tmp_path):
    write_lerobot(tmp_path / "set")
    (tmp_path / "model.yaml").write_text("urdf: arm.urdf\n")
    (tmp_path / "arm.urdf").write_text("<robot/>")
    (tmp_path / "a.csv").write_text("")
    case = tmp_path / "case.yaml"
    case.write_text("model: model.yaml\nrecords: {fit: a.csv, select: set#1, verify: lost.csv}\n")
    names = {path.relative_to(tmp_path).as_posix() for path in case_files(case)}
    assert names == {"model.yaml", "a.csv", "arm.urdf", "set/meta/info.json", "set/data/chunk-000/file-000.parquet"}
    assert case_model(case) == tmp_path / "model.yaml"
    for text in ("records: [", "", "model: 3\nrecords: 4\n"):
        case.write_text(text)
        assert case_files(case) == []
        assert case_model(case) == case


@pytest.mark.parametrize(
    ("path", "name"), [("logs/My Axis-2.yaml", "my_axis_2"), ("arm_7/case.yaml", "arm_7"), ("axis.yml", "axis")]
)
def test_a_case_is_called_by_its_file(path, name):
    assert case_name(path) == name


def test_a_case_without_a_word_is_refused():
    with pytest.raises(InputError, match="gives no name"):
        case_name("7.yaml")


def test_a_case_is_looked_for_in_its_places(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "b/case.yaml").write_text("")
    assert case_path("x", "case.yaml", [tmp_path / "a", tmp_path / "b"]) == tmp_path / "b/case.yaml"
    with pytest.raises(InputError, match="neither"):
        case_path("x", "lost.yaml", [tmp_path / "a", tmp_path / "b"])
    with pytest.raises(InputError, match=r"/b is a folder, the case's file is wanted"):
        case_path("x", "b", [tmp_path / "a", tmp_path])


def test_a_case_that_is_not_configured_is_named():
    check_asked_cases(["results/gap/axis/report.html", "results/gap-benchmark/report.html", "-n"], ["axis"])
    with pytest.raises(InputError, match="Did you mean 'axis'"):
        check_asked_cases(["results/gap/axsi/report.html"], ["axis"])
    with pytest.raises(InputError, match="'arm' is no case"):
        check_asked_cases(["results/rerun/gap/arm.rrd"], [])


def test_the_same_table_is_read_directly_and_through_a_log(tmp_path):
    pd.DataFrame({"time [s]": TIME, "position.shoulder [rad]": motion()[:, 0], "position.elbow [rad]": motion()[:, 1]}).to_csv(
        tmp_path / "log.csv", index=False
    )
    assert read_log(tmp_path / "log.csv", Layout(JOINTS)).digest == read_record(tmp_path / "log.csv", Layout(JOINTS)).digest


def test_names_of_the_workflows_own_cases_are_taken():
    check_own_cases(["axis"], ["loop_changed"])
    with pytest.raises(InputError, match="loop_changed"):
        check_own_cases(["loop_changed", "axis"], ["loop_changed"])


@pytest.mark.parametrize(
    "noise",
    [0.0, -1e-3, [1e-3], [1e-3, "small"], "small", True, float("inf"), float("nan"), 1e300, 10**400, [1e-3, None], {}, 1e-300],
)
def test_noise_that_makes_no_sense_is_refused(noise):
    with pytest.raises(InputError, match=r"noise.position"):
        _per_column("noise.position", noise, 2, 1e-12, "case.yaml")
    assert _per_column("noise.position", [1e-3, 2e-3], 2, 1e-12, "case.yaml").tolist() == [1e-3, 2e-3]
    # YAML 1.1 takes a number without a point before its exponent for text; docs/gap.md writes one.
    assert _per_column("tolerance.position", "5e-4", 2, 0.0, "case.yaml").tolist() == [5e-4, 5e-4]
    assert _per_column("tolerance.position", 0, 2, 0.0, "case.yaml").tolist() == [0.0, 0.0]
