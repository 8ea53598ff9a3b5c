"""Cases about throws through the stages of the workflow: what each leaves, the page, the recording, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from recording_file import read_recording
from scipy.spatial.transform import Rotation

from gsbridge import digests
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.body_truth import ThrowScene, throw_box
from gsbridge.gap.contact import bank
from gsbridge.gap.contact.bank import grid_bank
from gsbridge.gap.contact.body import parse_body, read_body
from gsbridge.gap.contact.case import read_throw_case
from gsbridge.gap.contact.checks import check_clock, check_fall, check_speeds
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.residual_map import CHANNELS, GROUPS, cells, map_distances
from gsbridge.gap.contact.store import load_throws, save_throws
from gsbridge.gap.contact.throws import Throw, Throws, write_throws
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.workflow import (
    load_backend,
    read_backend,
    write_case_records,
    write_comparison,
    write_findings,
    write_replays,
    write_screening,
)
from gsbridge.report.gap.page import CaseFiles, write_gap_report
from gsbridge.report.gap.rows import gap_row
from gsbridge.report.recordings.gap import record_gap
from gsbridge.report.recordings.gap_throws import solid

ROLES = ("fit", "select", "verify")
MODEL = {"box": [0.1, 0.1, 0.1], "mass": 0.4, "controller": {"mode": "body"}, "contact": {"friction": 0.5}}
HORIZON = 0.4
COUNT = 9


def write_case(folder, friction=0.2, **changes):
    """Throws of another engine with less friction than the model's."""
    for seed, role in enumerate(ROLES):
        write_throws(folder / f"{role}.csv", throw_box(ThrowScene(friction=friction, duration=HORIZON), COUNT, seed))
    (folder / "model.yaml").write_text(yaml.safe_dump(MODEL))
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ROLES}, "horizon": HORIZON}
    (folder / "case.yaml").write_text(yaml.safe_dump({**case, "effects": ["contact_friction", "table_height"], **changes}))
    return folder / "case.yaml"


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    """All files of a case that went through the stages."""
    folder = tmp_path_factory.mktemp("thrown")
    case, out, model = write_case(folder), folder / "out", folder / "model.yaml"
    names = ("records", "comparison", "screen", "findings", "replays")
    paths = {name: out / f"{name}.json" for name in names} | {"data": out / "records.npz", "series": out / "replays.npz"}
    paths |= {"model": model, "amended": out / "model.yaml", "case": case}
    first = (model, paths["data"], paths["records"])
    write_case_records(case, paths["data"], paths["records"])
    write_comparison(*first, paths["comparison"])
    write_screening(*first, folder / "bank", paths["screen"])
    write_findings(*first, folder / "bank", paths["findings"], paths["amended"], 0)
    write_replays(*first, paths["findings"], paths["series"], paths["replays"])
    return paths


def test_the_stages_name_friction_and_leave_what_the_page_needs(stages):
    about, comparison, findings = (read_json(stages[name]) for name in ("records", "comparison", "findings"))
    assert about["mode"] == "body"
    assert about["records"]["fit"]["throws"] == COUNT
    assert findings["verdict"] == "named", findings["sentence"]
    assert findings["records"]["fit"] == about["records"]["fit"]["digest"]
    assert comparison["unit"] == findings["verify"]["unit"] == "mm"
    assert [item.name for item in read_body(stages["amended"]).effects] == ["contact_friction"]
    rows = read_json(stages["replays"])["records"]["verify"]
    assert rows["before"] == pytest.approx(findings["verify"]["before"])
    assert rows["after"] == pytest.approx(findings["verify"]["after"])
    with np.load(stages["series"]) as series:
        number = series["verify/throw"]
        assert len(np.unique(number)) == COUNT
        before = [series["verify/before"][number == k].mean() for k in range(COUNT)]
        assert 1e3 * np.mean(before) == pytest.approx(rows["before"], rel=1e-5)
        apart = np.linalg.norm(series["verify/explained_position"] - series["verify/position"], axis=1)
        np.testing.assert_allclose(apart, series["verify/after"], atol=1e-6)
    assert gap_row("toss", findings)["amended"] == "contact_friction"


def test_the_screening_fills_the_bank_that_the_diagnosis_reads(stages):
    screening, findings = read_json(stages["screen"]), read_json(stages["findings"])
    assert screening["simulations"] == findings["simulations"]["bank"]
    assert screening["candidates"] == ["contact_friction", "table_height"]
    assert findings["simulations"]["case"] < 100


def test_the_page_speaks_of_throws(stages, tmp_path):
    files = CaseFiles(*(stages[name] for name in ("records", "comparison", "screen", "findings", "series", "replays")))
    write_gap_report("cube", files, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    findings = read_json(stages["findings"])
    row = findings["effects"][0]["parameters"]["friction"]
    assert findings["sentence"].startswith("Contact friction: 0.")
    assert "instead of 0.5; the mean distance falls" in findings["sentence"]
    for said in (
        f"{findings['verify']['before']:.3g} mm",
        f"{100 * findings['verify']['removed']:.0f} %",
        f"<b>0.5 → {row['becomes']:.3g}</b>",
        f"verify, {COUNT} throws",
        "noise and chaos",
        "results/gap/cube/model.yaml",
    ):
        assert said in text, said
    for wrong in ("times the noise", "joint", "record verify", "9 would do"):
        assert wrong not in text, wrong
    assert text.count("<img") == 3


def test_the_recording_moves_every_way_beside_what_was_measured(stages, tmp_path):
    record_gap(stages["model"], stages["findings"], stages["series"], stages["replays"], "cube", tmp_path / "out.rrd")
    found = read_recording(tmp_path / "out.rrd")
    with np.load(stages["series"]) as series:
        samples = len(series["verify/time"])
    for entity in ("measured/body", "nominal/body", "nominal/measured", "explained/body", "explained/measured"):
        assert found[f"/{entity}"]["timelines"] == {"time"}
        assert found[f"/{entity}"]["rows"] == samples + 1
    assert found["/plots/distance/after"]["rows"] == samples + 1
    assert found["/nominal/path"]["rows"] == COUNT


def test_kinds_of_cases_are_told_apart_by_their_model(stages):
    assert read_backend(stages["case"]).about()["mode"] == "body"
    loaded = load_backend(stages["model"], stages["data"], stages["records"])
    assert loaded.about() == {**read_backend(stages["case"]).about(), "model": str(stages["model"])}


def test_throws_survive_the_store(tmp_path):
    throws = throw_box(ThrowScene(duration=0.2), 3, 0)
    bare = Throws(tuple(replace(item, velocity=None, spin=None) for item in throws.items), "abc", "bare")
    save_throws(tmp_path / "throws.npz", {"fit": throws, "select": bare})
    back = load_throws(tmp_path / "throws.npz")
    assert (back["select"].digest, back["select"].name) == ("abc", "bare")
    for role, given in (("fit", throws), ("select", bare)):
        for one, other in zip(given.items, back[role].items, strict=True):
            assert one.name == other.name
            for key in ("time", "position", "quat", "velocity", "spin"):
                np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    (tmp_path / "throws.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match="cannot be read"):
        load_throws(tmp_path / "throws.npz")


def test_a_bank_is_made_once_and_again_where_it_is_damaged(tmp_path, monkeypatch):
    body, throws = parse_body(MODEL, "."), throw_box(ThrowScene(duration=0.2), 8, 0)

    def matches():
        replay = ThrowReplay(body, throws, 0.2)
        return grid_bank(replay, ("restitution",), tmp_path), replay

    first, made = matches()
    (file,) = tmp_path.iterdir()
    stamp = file.stat().st_mtime_ns
    again, read = matches()
    assert again == first
    assert made.runs == read.runs == 0
    assert first.runs == 4  # the model as it is, and three sizes: less than no restitution is none
    assert file.stat().st_mtime_ns == stamp
    file.write_bytes(b"no archive")
    assert matches()[0] == first
    changed = grid_bank(ThrowReplay(parse_body({**MODEL, "mass": 0.5}, "."), throws, 0.2), ("restitution",), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    assert changed.runs == first.runs
    # Another code of effects or simulation makes another bank; its digest follows imports.
    monkeypatch.setattr(bank, "_edition", lambda: "edited")
    assert matches()[0] == first
    assert len(list(tmp_path.iterdir())) == 3
    reached = digests.import_closure([bank.__name__])
    assert {"gsbridge.effects.bodies.restitution", "gsbridge.gap.contact.world", "gsbridge.gap.contact.starts"} <= reached


def test_a_difference_in_height_behind_the_impact_is_found_there():
    body, throws = parse_body(MODEL, "."), throw_box(ThrowScene(friction=0.5, duration=HORIZON), 16, 1)
    replay = ThrowReplay(body, throws, HORIZON)
    plain = replay.flights()
    rng = np.random.default_rng(0)
    quiet = [[rng.normal(0, 1e-3, f.position.shape) for f in plain] for _ in range(4)]
    null = np.stack([cells(replay, row) for row in quiet])
    measured = []
    for flight, time in zip(plain, replay.times, strict=True):
        late = flight.touched & (time > time[np.argmax(flight.touched)] + 0.061)
        measured.append(flight.position + rng.normal(0, 1e-3, flight.position.shape) + late[:, None] * [0, 0, 0.05])
    replay.measured = measured
    found = map_distances(replay, plain, null)
    columns = [name for names in GROUPS.values() for name in names]
    place = columns.index("after")
    assert found.values[CHANNELS.index("height"), place] == pytest.approx(50, rel=0.05)
    assert found.values[CHANNELS.index("height"), columns.index("flight")] == pytest.approx(1, rel=0.2)
    assert found.marked[CHANNELS.index("height"), place]
    assert not found.marked[0].any()
    assert not found.marked[:, columns.index("flight")].any()


def test_axes_of_a_throw_are_those_of_its_start():
    """A difference along the start's direction shows there and nowhere else, whatever that direction is."""
    body, throws = parse_body(MODEL, "."), throw_box(ThrowScene(duration=0.2), 8, 2)
    replay = ThrowReplay(body, throws, 0.2)
    ahead = replay.starts.velocity * [1, 1, 0]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    found = cells(replay, [0.02 * np.tile(row, (len(time), 1)) for row, time in zip(ahead, replay.times, strict=True)])
    np.testing.assert_allclose(found[:, 0][np.isfinite(found[:, 0])], 0.02, rtol=1e-9)
    np.testing.assert_allclose(np.nan_to_num(found[:, 1:]), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        ('<box size="0.1 0.2 0.3"/>', 0.006),
        ('<sphere radius="0.1"/>', 4 / 3 * np.pi * 1e-3),
        ('<cylinder radius="0.1" length="0.2"/>', np.pi * 2e-3),
        ('<capsule radius="0.1" length="0.2"/>', np.pi * 2e-3 + 4 / 3 * np.pi * 1e-3),
    ],
)
def test_bodies_are_drawn_as_their_urdf_has_them(tmp_path, shape, volume):
    (tmp_path / "body.urdf").write_text(
        '<robot name="b"><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        f'</inertial><collision><origin xyz="0.5 0 0" rpy="0.3 0 1"/><geometry>{shape}</geometry></collision></link></robot>'
    )
    body = parse_body({"urdf": "body.urdf", "controller": {"mode": "body"}, "contact": {"friction": 0.3}}, tmp_path)
    vertices, triangles = solid(body)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    assert volumes.sum() == pytest.approx(volume, rel=0.03)
    assert (((a + b + c) / 4) * volumes[:, None]).sum(axis=0) / volumes.sum() == pytest.approx([0.5, 0, 0], abs=2e-3)


def ballistic(spins):
    """Throws in free flight that turn with the given angular velocities, log's axes, without noise to speak of."""
    rng = np.random.default_rng(0)
    time = np.arange(20) / 100
    items = []
    for spin in spins:
        velocity, begin = rng.normal(0, 1, 3), Rotation.random(random_state=rng)
        position = [0, 0, 2.0] + time[:, None] * velocity - 0.5 * 9.81 * time[:, None] ** 2 * [0, 0, 1]
        turn = Rotation.from_rotvec(time[:, None] * spin) * begin
        quat = np.roll(turn.as_quat(), 1, axis=1)
        items.append(Throw("0", time, position + rng.normal(0, 1e-5, position.shape), quat, velocity, np.array(spin)))
    return Throws(tuple(items))


def changed(throws, **changes):
    return Throws(tuple(replace(throw, **{key: change(throw) for key, change in changes.items()}) for throw in throws.items))


def in_body_axes(throw):
    return Rotation.from_quat(np.roll(throw.quat[0], -1)).inv().apply(throw.spin)


@pytest.mark.parametrize(
    ("check", "changes", "said"),
    [
        (check_fall, {"position": lambda t: 1e3 * t.position}, "millimetres"),
        (check_fall, {"position": lambda t: 1e2 * t.position}, "centimetres"),
        (check_fall, {"position": lambda t: t.position[:, [0, 2, 1]]}, "along -y"),
        (check_fall, {"position": lambda t: -t.position}, r"along \+z"),
        (check_clock, {"time": lambda t: 1e3 * t.time}, "milliseconds"),
        (check_clock, {"time": lambda t: 1e9 * t.time}, "nanoseconds"),
        (check_clock, {"time": lambda t: 7 * t.time}, "50 Hz"),
        (check_speeds, {"velocity": lambda t: 1e3 * t.velocity}, "1e[+]03 times what the poses move by: it looks like millim"),
        (check_speeds, {"spin": lambda t: np.degrees(t.spin)}, "degrees per second"),
        (check_speeds, {"spin": lambda t: 9 * t.spin}, "9 times what the poses move by. State"),
        (check_speeds, {"spin": in_body_axes}, "body's own axes"),
        (check_speeds, {"velocity": lambda t: -t.velocity}, "'velocity' points elsewhere than the poses move"),
        (check_speeds, {"velocity": lambda t: t.velocity[[0, 2, 1]]}, "'velocity' points elsewhere"),
    ],
)
def test_throws_that_contradict_themselves_are_refused(check, changes, said):
    throws = ballistic(np.random.default_rng(1).normal(0, 4, (20, 3)))
    gravity = (9.81,) if check is check_fall else ()
    check(throws, *gravity, "log")
    with pytest.raises(InputError, match=said) as error:
        check(changed(throws, **changes), *gravity, "log")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("factor", [0.4, 1.6, 2.9])
def test_speeds_of_another_size_point_nowhere_else(factor):
    throws = ballistic(np.random.default_rng(1).normal(0, 4, (20, 3)))
    check_speeds(changed(throws, velocity=lambda t: factor * t.velocity), "log")


def test_throws_that_hardly_move_are_not_called_contradictory():
    """A body that lies still has no speeds to compare, and does not fall."""
    rng = np.random.default_rng(0)
    time = np.arange(20) / 100
    items = [
        Throw(str(k), time, rng.normal(0, 1e-4, (20, 3)), np.tile([1.0, 0, 0, 0], (20, 1)), rng.normal(0, 0.01, 3), np.zeros(3))
        for k in range(9)
    ]
    check_fall(Throws(tuple(items)), 9.81, "log")
    check_speeds(Throws(tuple(items)), "log")


def test_throws_of_two_roles_are_told(tmp_path):
    case = write_case(tmp_path)
    assert read_throw_case(case).reasons == ()
    (tmp_path / "verify.csv").write_bytes((tmp_path / "fit.csv").read_bytes())
    (reason,) = read_throw_case(case).reasons
    assert reason.startswith(f"{COUNT} throws of 'fit' are in 'verify', too")


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"velocity.x": "vx"}, "no record has the column 'vx', which the case names for 'velocity.x'. They have: throw, time"),
        ({"nonsense": "time"}, "'nonsense' under 'columns' is no name of ours for a column. Ours are time, throw"),
        ({"position.x": "position.y"}, "'position.x' and 'position.y' are both read from 'position.y'"),
        ({"position.x": 3}, "columns.position.x is 3, which is no text"),
    ],
)
def test_columns_of_throws_that_name_nothing_are_refused(tmp_path, columns, said):
    case = write_case(tmp_path, columns=columns if "position.x" not in columns else {**columns, "position.y": "position.y"})
    with pytest.raises(InputError) as error:
        read_throw_case(case)
    assert said in str(error.value)


def test_bad_throws_leave_nothing(tmp_path):
    case = write_case(tmp_path)
    throws = throw_box(ThrowScene(duration=HORIZON), COUNT, 5)
    write_throws(tmp_path / "select.csv", changed(throws, position=lambda t: 1e3 * t.position))
    with pytest.raises(InputError, match=r"select.csv: .*millimetres"):
        write_case_records(case, tmp_path / "out/records.npz", tmp_path / "out/records.json")
    assert not (tmp_path / "out").exists()


def test_the_workflow_watches_every_file_of_a_case(tmp_path):
    (tmp_path / "set").mkdir()
    for name in ("set/1.csv", "set/notes.txt", "hull.obj", "fit.csv"):
        (tmp_path / name).write_text("")
    (tmp_path / "body.urdf").write_text(
        '<robot name="b"><link name="b"><collision><geometry><mesh filename="hull.obj"/></geometry></collision></link></robot>'
    )
    (tmp_path / "model.yaml").write_text("urdf: body.urdf\ncontroller: {mode: body}\n")
    (tmp_path / "case.yaml").write_text("model: model.yaml\nrecords: {fit: fit.csv, select: set}\n")
    found = {path.name for path in case_files(tmp_path / "case.yaml")}
    assert found == {"model.yaml", "fit.csv", "1.csv", "body.urdf", "hull.obj"}
