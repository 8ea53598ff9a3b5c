"""Every reader of files that others made, with broken and hostile files: one clear line or a result, no traceback and no hang.

`GSBRIDGE_FUZZ=10000` tries that many files over all readers; by default there are few enough for every run of the tests.
"""

import contextlib
import json
import os
import re
import resource
import shutil
import signal
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pycolmap
import pytest
import yaml

from gsbridge.capture.sources import Source, list_photos, read_colmap, read_nerfstudio
from gsbridge.errors import GsbridgeError
from gsbridge.files import read_json
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.records import Layout
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.images import read_image_u8, read_mask
from gsbridge.reading import load_yaml
from gsbridge.sim.model import read_model
from gsbridge.splats.ply import read_ply

CASES = int(os.environ.get("GSBRIDGE_FUZZ", "240"))
DATA = Path(__file__).parent / "data"
SECONDS = 5
GIGABYTE = 2**30
JOINTS = ("shoulder", "elbow")
NONSENSE = (
    "nan",
    "-inf",
    "1e308",
    "-1",
    "0",
    "99999999999999999999",
    '""',
    "[]",
    "{}",
    "null",
    "abc",
    "[1, [2, {}]]",
    "&x [*x]",
)
TAGS = ("!!python/object/apply:os.system ['touch owned']", "!!binary aaaa", "!!set {a, b}", "!!timestamp 2001-99-99")


@dataclass(frozen=True)
class Reader:
    """A reader and what it reads.

    Args:
        write: Writes a sound input into a folder; returns the file that is to be broken.
        read: Reads it.
        text: Whether numbers and words in it may be exchanged, not only bytes.
    """

    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    text: bool = False


def _photo(folder: Path, name: str) -> Path:
    picture = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    cv2.imwrite(str(folder / name), cv2.GaussianBlur(picture, (9, 9), 2))
    return folder / name


def _transforms(folder: Path) -> Path:
    frames = []
    for i in range(3):
        _photo(folder, f"{i}.png")
        frames.append({"file_path": f"{i}.png", "transform_matrix": np.eye(4).tolist()})
    content = {"w": 64, "h": 48, "fl_x": 50.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0, "k1": 0.0, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder / "transforms.json"


def _colmap(part: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        options = pycolmap.SyntheticDatasetOptions()
        options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 4, 20
        model = pycolmap.synthesize_dataset(options)
        (folder / "images").mkdir()
        for image in model.images.values():
            (folder / "images" / image.name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "images" / image.name).write_bytes(b"")
        model.write(folder)
        return folder / f"{part}.bin"

    return write


def _log(folder: Path, suffix: str) -> Path:
    time = np.arange(0, 3, 0.02)
    table = {"time [s]": time}
    for number, joint in enumerate(JOINTS):
        table |= {f"position.{joint} [rad]": np.sin(time + number), f"command.{joint} [rad]": np.sin(time + number)}
    path = folder / f"log{suffix}"
    frame = pd.DataFrame(table)
    frame.to_parquet(path) if suffix == ".parquet" else frame.to_csv(path, index=False)
    return path


def _mcap(folder: Path) -> Path:
    from mcap.writer import Writer

    path = folder / "log.mcap"
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/joint_states", "json", writer.register_schema("JointState", "jsonschema", b"{}"))
        for k in range(150):
            content = {"name": list(JOINTS), "position": [np.sin(0.02 * k), np.cos(0.02 * k)]}
            writer.add_message(channel, 20_000_000 * k, json.dumps(content).encode(), 20_000_000 * k)
        writer.finish()
    return path


URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="1.0"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="10" velocity="3"/></joint></robot>"""


def _mechanism(folder: Path) -> Path:
    (folder / "arm.urdf").write_text(URDF)
    content = {
        "urdf": "arm.urdf",
        "joints": ["shoulder"],
        "controller": {"mode": "pd", "stiffness": [50.0], "damping": [2.0]},
        "effects": [],
    }
    (folder / "model.yaml").write_text(yaml.safe_dump(content))
    return folder / "model.yaml"


def _case(folder: Path) -> Path:
    _mechanism(folder)
    time = np.arange(0, 3, 0.01)
    table = {"time [s]": time, "position.shoulder [rad]": np.sin(time), "command.shoulder [rad]": np.sin(time)}
    for role in ("fit", "select", "verify"):
        pd.DataFrame(table).to_csv(folder / f"{role}.csv", index=False)
    content = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ("fit", "select", "verify")}}
    (folder / "case.yaml").write_text(yaml.safe_dump(content))
    return folder / "case.yaml"


def _nominal(folder: Path) -> Path:
    source = Path(__file__).parents[2] / "models" / "nominal.yaml"
    (folder / "nominal.yaml").write_text(source.read_text())
    return folder / "nominal.yaml"


def _ply(folder: Path) -> Path:
    from gsbridge.splats.cloud import Cloud
    from gsbridge.splats.ply import write_ply

    rng = np.random.default_rng(0)
    names = {"means": (20, 3), "quats": (20, 4), "scales": (20, 3), "opacities": (20,), "colours": (20, 3)}
    values = {name: (0.1 + 0.8 * rng.random(shape)).astype(np.float32) for name, shape in names.items()}
    write_ply(folder / "splats.ply", Cloud(**values))
    return folder / "splats.ply"


LAYOUT = Layout(JOINTS, units={"position": "rad", "command": "rad"})
READERS = {
    "jpeg": Reader(lambda folder: _photo(folder, "0.jpg"), read_image_u8),
    "png": Reader(lambda folder: _photo(folder, "0.png"), read_image_u8),
    "heif": Reader(lambda folder: Path(shutil.copy(DATA / "turned.heic", folder)), read_image_u8),
    "mask": Reader(lambda folder: _photo(folder, "0.png"), read_mask),
    "transforms": Reader(_transforms, read_nerfstudio, text=True),
    "colmap cameras": Reader(_colmap("cameras"), lambda path: read_colmap(path.parent, None)),
    "colmap images": Reader(_colmap("images"), lambda path: read_colmap(path.parent, None)),
    "colmap points": Reader(_colmap("points3D"), lambda path: read_colmap(path.parent, None)),
    "csv": Reader(lambda folder: _log(folder, ".csv"), lambda path: read_log(path, LAYOUT), text=True),
    "parquet": Reader(lambda folder: _log(folder, ".parquet"), lambda path: read_log(path, LAYOUT)),
    "mcap": Reader(_mcap, lambda path: read_log(f"{path}#/joint_states", LAYOUT)),
    "mechanism": Reader(_mechanism, read_mechanism_model, text=True),
    "case": Reader(_case, lambda path: (case_files(path), read_joint_case(path)), text=True),
    "nominal model": Reader(_nominal, read_model, text=True),
    "ply": Reader(_ply, read_ply),
    "json": Reader(_transforms, read_json, text=True),
}


def broken(data: bytes, rng: np.random.Generator, text: bool) -> bytes:
    """The data with one to three things wrong."""
    for _ in range(int(rng.integers(1, 4))):
        place = int(rng.integers(0, max(len(data), 1)))
        span = int(rng.integers(1, 40))
        kind = int(rng.integers(0, 8 if text else 5))
        if kind == 0:
            data = data[:place]
        elif kind == 1:
            data = data[:place] + bytes(rng.integers(0, 256, span, np.uint8)) + data[place:]
        elif kind == 2:
            data = data[:place] + data[place + span :]
        elif kind == 3:
            data = data[:place] + bytes(rng.integers(0, 256, span, np.uint8)) + data[place + span :]
        elif kind == 4:
            data = data[:place] + data[place : place + span] * int(rng.integers(2, 30)) + data[place:]
        else:
            words = list(re.finditer(rb"-?\d[\d.e+-]*|\b[a-z_]{2,}\b", data))
            if words:
                word = words[int(rng.integers(len(words)))]
                other = str(rng.choice([*NONSENSE, *TAGS])).encode()
                data = data[: word.start()] + other + data[word.end() :]
    return data


class Hang(BaseException):
    """Reading took too long; nothing may catch it."""


def read_within(reader: Reader, path: Path) -> None:
    """Read, and let only our own errors pass.

    Raises:
        Hang: It took longer than it may.
    """

    def late(*_: object) -> None:
        raise Hang

    assert threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    said = ""
    try:
        reader.read(path)
    except GsbridgeError as error:
        said = str(error)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert "\n" not in said.strip(), said
    assert len(said) < 1500, said


@pytest.mark.parametrize("name", READERS)
def test_broken_files_end_in_one_line(name, tmp_path, monkeypatch):
    reader = READERS[name]
    path = reader.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    sound = path.read_bytes()
    reader.read(path)  # it is sound before it is broken
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(max(CASES // len(READERS), 4)):
        rng = np.random.default_rng([number, *name.encode()])
        path.write_bytes(broken(sound, rng, reader.text))
        problem = ""
        try:
            read_within(reader, path)
        except BaseException as error:
            # Without its chain: a deep one breaks the report itself.
            where = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"case {number} of {name}: {type(error).__name__}: {error} in {where.filename}:{where.lineno}"
        assert not problem, problem
    assert not (tmp_path / "owned").exists()
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) * 1024 < GIGABYTE


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "bomb": BOMB,
    "loop": "&a [*a]",
    "deep": "[" * 5000 + "]" * 5000,
    "python": "!!python/object/apply:os.system ['touch owned']",
    "records are a list": "model: model.yaml\nrecords: [fit.csv]",
    "model is a number": "model: 3\nrecords: {fit: fit.csv}",
    "noise is a list": "model: model.yaml\nrecords: {fit: fit.csv}\nnoise: [1]",
    "a device": "model: model.yaml\nrecords: {fit: /dev/zero}",
    "the whole disk": "model: model.yaml\nrecords: {fit: /usr}",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_cases_end_in_one_line(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = _case(tmp_path)
    path.write_text(HOSTILE[name])

    def read(path: Path) -> None:
        with contextlib.suppress(GsbridgeError):
            case_files(path)
        with pytest.raises(GsbridgeError):
            read_joint_case(path)

    read_within(Reader(_case, read), path)
    assert not (tmp_path / "owned").exists()


def test_aliases_that_a_person_writes_are_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("a: &a {x: 1}\nb: *a\nc: [*a, *a]\n")
    assert load_yaml(path, "file", "-") == {"a": {"x": 1}, "b": {"x": 1}, "c": [{"x": 1}, {"x": 1}]}


def test_half_a_photo_is_refused_and_a_whole_one_with_a_thumbnail_is_read(tmp_path):
    path = _photo(tmp_path, "0.jpg")
    whole = path.read_bytes()
    thumbnail = b"\xff\xe1" + (len(whole) + 2).to_bytes(2, "big") + whole
    path.write_bytes(whole[:2] + thumbnail + whole[2:])
    assert read_image_u8(path).shape == (48, 64, 3)
    path.write_bytes((whole[:2] + thumbnail + whole[2:])[: -len(whole) // 3])
    with pytest.raises(GsbridgeError, match="cut off"):
        read_image_u8(path)


def test_a_picture_of_absurd_size_is_refused_before_it_is_decoded(tmp_path):
    path = _photo(tmp_path, "0.png")
    data = bytearray(path.read_bytes())
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    path.write_bytes(bytes(data))
    with pytest.raises(GsbridgeError):
        read_image_u8(path)


def test_a_phone_s_heif_is_read_and_turned_as_it_was_held():
    """64 x 48 px as stored, to be turned a quarter clockwise; red grows to the right and green downwards before the turn."""
    picture = read_image_u8(DATA / "turned.heic").astype(int)
    assert picture.shape == (64, 48, 3)
    assert picture[60, 24, 0] - picture[4, 24, 0] > 180
    assert picture[32, 4, 1] - picture[32, 44, 1] > 150


def test_a_folder_of_photos_may_hold_heif(tmp_path):
    (tmp_path / "a.HEIC").write_bytes(b"")
    assert [photo.path.name for photo in list_photos(tmp_path)] == ["a.HEIC"]
    assert Source("images", tmp_path).kind == "images"
