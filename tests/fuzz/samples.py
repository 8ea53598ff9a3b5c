"""Sound inputs of every reader, small enough to be written and broken thousands of times."""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pycolmap
import yaml
from safetensors.numpy import save as save_tensors

from gsbridge.capture.sources import Video, read_colmap, read_nerfstudio
from gsbridge.configuration.whole import read_configuration
from gsbridge.files import read_json, write_json
from gsbridge.gap.contact.throws import read_throws
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.records import Layout
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.description import read_mechanism_description
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.images import read_image_u8, read_mask
from gsbridge.meshes import read_mesh
from gsbridge.policy.export import load_policy
from gsbridge.policy.format import FORMAT, PROPRIO_NAMES, SPEC, WEIGHTS
from gsbridge.policy.networks import Actor
from gsbridge.reading import load_yaml
from gsbridge.registration.asked import check_board_capture
from gsbridge.registration.result import read_registration
from gsbridge.robot.urdf import read_description
from gsbridge.sim.model import read_model
from gsbridge.splats.ply import read_ply

DATA = Path(__file__).parent / "data"
ROOT = Path(__file__).parents[2]
JOINTS = ("shoulder", "elbow")


@dataclass(frozen=True)
class Reader:
    """A reader and what it reads.

    Args:
        write: Writes a sound input into a folder; returns the file that is to be broken.
        read: Reads it.
        text: Whether numbers and words in it may be exchanged, not only bytes.
        numbers: Whether each number in it counts, so that none may be NaN or endless.
    """

    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    text: bool = False
    numbers: bool = False

    @staticmethod
    def is_label(text: str, place: int) -> bool:
        """Whether a number stands in a comment, is a version or a name, or a limit, which may be endless."""
        line = text[text.rfind("\n", 0, place) + 1 : place]
        return any(word in line for word in ("#", "version", '"name": "', "<limit"))


def write_photo(folder: Path, name: str) -> Path:
    picture = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    cv2.imwrite(str(folder / name), cv2.GaussianBlur(picture, (9, 9), 2))
    return folder / name


def _transforms(folder: Path) -> Path:
    frames = []
    for i in range(3):
        write_photo(folder, f"{i}.png")
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


def _lerobot(folder: Path) -> Path:
    """A data set of one episode; returns its description."""
    time = np.arange(150) / 50
    positions = np.stack([np.sin(time), np.cos(time)], axis=1).astype(np.float32)
    vector = {"dtype": "float32", "shape": [2], "names": {"motors": [f"{joint}.pos" for joint in JOINTS]}}
    features = {"observation.state": vector, "action": vector, "timestamp": {"dtype": "float32", "shape": [1], "names": None}}
    info = {"codebase_version": "v3.0", "fps": 50, "total_episodes": 1, "features": features}
    columns = {"observation.state": list(positions), "action": list(positions), "timestamp": time.astype(np.float32)}
    (folder / "set/meta").mkdir(parents=True)
    (folder / "set/data/chunk-000").mkdir(parents=True)
    pd.DataFrame({**columns, "episode_index": 0}).to_parquet(folder / "set/data/chunk-000/file-000.parquet")
    (folder / "set/meta/info.json").write_text(json.dumps(info))
    return folder / "set/meta/info.json"


def _lerobot_rows(folder: Path) -> Path:
    return _lerobot(folder).parents[1] / "data/chunk-000/file-000.parquet"


def _read_lerobot(path: Path) -> object:
    top = next(parent for parent in path.parents if parent.name == "set")
    return read_log(f"{top}#0", LAYOUT)


def _board(file: str) -> Callable[[Path], Path]:
    """A board capture with a camera whose arm is told by joints, by poses of its flange, or by a list in JSON."""

    def write(folder: Path) -> Path:
        names = [write_photo(folder, f"{number}.png").name for number in range(3)]
        camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 32.0, "cy": 24.0, "distortion": [0.1, 0.0, 0.0, 0.0]}
        (folder / "camera.json").write_text(json.dumps({"camera": camera}))
        if file == "arm.json":
            poses = [{"image": name, "base_from_flange": np.eye(4).tolist()} for name in names]
            (folder / file).write_text(json.dumps({"poses": poses}))
        elif file == "flange.csv":
            rows = [f"{name},0.3,0.1,0.5,1.0,0.0,0.0,0.0" for name in names]
            (folder / "arm.csv").write_text("\n".join(["image,x,y,z,qw,qx,qy,qz", *rows]))
        else:
            (folder / "arm.csv").write_text("\n".join(["image,q1,q2", *(f"{name},0.1,0.2" for name in names)]))
        return folder / file.replace("flange", "arm")

    return write


def _read_board(path: Path) -> object:
    return check_board_capture(path.parent)


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


def write_case(folder: Path) -> Path:
    _mechanism(folder)
    time = np.arange(0, 3, 0.01)
    table = {"time [s]": time, "position.shoulder [rad]": np.sin(time), "command.shoulder [rad]": np.sin(time)}
    for role in ("fit", "select", "verify"):
        pd.DataFrame(table).to_csv(folder / f"{role}.csv", index=False)
    content = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ("fit", "select", "verify")}}
    (folder / "case.yaml").write_text(yaml.safe_dump(content))
    return folder / "case.yaml"


def _nominal(folder: Path) -> Path:
    source = ROOT / "models" / "nominal.yaml"
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


def _urdf(folder: Path) -> Path:
    (folder / "arm.urdf").write_text(URDF)
    return folder / "arm.urdf"


MJCF = """<mujoco><worldbody><body name="upper"><joint name="shoulder" type="hinge" axis="0 1 0" range="-90 90"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>"""


def _mjcf(folder: Path) -> Path:
    (folder / "arm.xml").write_text(MJCF)
    return folder / "arm.xml"


def _video(folder: Path) -> Path:
    writer = cv2.VideoWriter(str(folder / "film.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, (64, 48))
    for k in range(4):
        writer.write(np.full((48, 64, 3), 60 * k, np.uint8))
    writer.release()
    return folder / "film.mp4"


def _policy(folder: Path) -> None:
    rng = np.random.default_rng(0)
    state = Actor(with_position=False).state_dict()
    content = save_tensors({name: rng.standard_normal(tuple(value.shape)).astype("f4") for name, value in state.items()})
    (folder / WEIGHTS).write_bytes(content)
    entries = {"names": list(PROPRIO_NAMES)}
    spec = {"observation": {"image": {"size_px": 64}, "proprio": entries}, "action": {"names": ["a"] * 5}}
    write_json(folder / SPEC, {"format": FORMAT, **spec, "sha256": hashlib.sha256(content).hexdigest()})


def _policy_spec(folder: Path) -> Path:
    _policy(folder)
    return folder / SPEC


def _weights(folder: Path) -> Path:
    _policy(folder)
    return folder / WEIGHTS


def _read_forged_weights(path: Path) -> object:
    """The weights with a digest that fits them, whatever they are."""
    spec = json.loads((path.parent / SPEC).read_text())
    write_json(path.parent / SPEC, {**spec, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()})
    return load_policy(path.parent)


def _registration(folder: Path) -> Path:
    write_json(
        folder / "registration.json",
        dict.fromkeys(("base_from_table", "flange_from_camera"), np.eye(4).tolist()) | {"reasons": []},
    )
    return folder / "registration.json"


def _throws(folder: Path) -> Path:
    time = np.arange(0, 0.5, 0.01)
    table = {"throw": np.zeros(50, int), "time [s]": time, "position.x [m]": time, "position.y [m]": 0 * time}
    table |= {"position.z [m]": 1 - 4.9 * time**2, "orientation.w": 1 + 0 * time}
    table |= {f"orientation.{axis}": 0 * time for axis in "xyz"}
    pd.DataFrame(table).to_csv(folder / "throws.csv", index=False)
    return folder / "throws.csv"


def _photo_views(folder: Path) -> Path:
    camera = {"width": 16, "height": 12, "fx": 20.0, "fy": 20.0, "cx": 8.0, "cy": 6.0}
    rows = []
    for number in range(12):
        for shot in range(3):
            cv2.imwrite(str(folder / f"{number}_{shot}.png"), np.full((12, 16, 3), 90 + shot, np.uint8))
        role = ("fit", "select", "verify")[number % 3]
        rows.append({"name": str(number), "role": role, "cam_from_world": np.eye(4).tolist()})
    (folder / "views.json").write_text(json.dumps({"camera": camera, "views": rows}))
    np.savez_compressed(folder / "depths.npz", depths=np.ones((12, 12, 16), np.float32))
    return folder / "views.json"


def _depths(folder: Path) -> Path:
    _photo_views(folder)
    return folder / "depths.npz"


def _read_photo_views(path: Path) -> object:
    return read_pairs(path.parent, path.parent, path.parent)


def _mesh(folder: Path) -> Path:
    corners = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    sides = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "mesh.ply").write_text(head + corners + sides)
    return folder / "mesh.ply"


def _configuration(folder: Path) -> Path:
    return Path(shutil.copy(ROOT / "config.yaml", folder))


LAYOUT = Layout(JOINTS, units={"position": "rad", "command": "rad"})
READERS = {
    "jpeg": Reader(lambda folder: write_photo(folder, "0.jpg"), read_image_u8),
    "png": Reader(lambda folder: write_photo(folder, "0.png"), read_image_u8),
    "heif": Reader(lambda folder: Path(shutil.copy(DATA / "turned.heic", folder)), read_image_u8),
    "mask": Reader(lambda folder: write_photo(folder, "0.png"), read_mask),
    "transforms": Reader(_transforms, read_nerfstudio, text=True, numbers=True),
    "colmap cameras": Reader(_colmap("cameras"), lambda path: read_colmap(path.parent, None)),
    "colmap images": Reader(_colmap("images"), lambda path: read_colmap(path.parent, None)),
    "colmap points": Reader(_colmap("points3D"), lambda path: read_colmap(path.parent, None)),
    "csv": Reader(lambda folder: _log(folder, ".csv"), lambda path: read_log(path, LAYOUT), text=True),
    "parquet": Reader(lambda folder: _log(folder, ".parquet"), lambda path: read_log(path, LAYOUT)),
    "mcap": Reader(_mcap, lambda path: read_log(f"{path}#/joint_states", LAYOUT)),
    "lerobot": Reader(_lerobot, _read_lerobot, text=True),
    "lerobot rows": Reader(_lerobot_rows, _read_lerobot),
    "board": Reader(_board("arm.csv"), _read_board, text=True, numbers=True),
    "board flange": Reader(_board("flange.csv"), _read_board, text=True, numbers=True),
    "board list": Reader(_board("arm.json"), _read_board, text=True, numbers=True),
    "board camera": Reader(_board("camera.json"), _read_board, text=True, numbers=True),
    "mechanism": Reader(_mechanism, read_mechanism_model, text=True, numbers=True),
    "case": Reader(write_case, lambda path: (case_files(path), read_joint_case(path)), text=True),
    "nominal model": Reader(_nominal, read_model, text=True, numbers=True),
    "ply": Reader(_ply, read_ply),
    "urdf": Reader(_urdf, read_description, text=True, numbers=True),
    "mjcf": Reader(_mjcf, read_mechanism_description, text=True, numbers=True),
    "video": Reader(_video, lambda path: list(Video(path))),
    "policy": Reader(_policy_spec, lambda path: load_policy(path.parent), text=True),
    "weights": Reader(_weights, _read_forged_weights),
    "registration": Reader(_registration, read_registration, text=True, numbers=True),
    "throws": Reader(_throws, read_throws, text=True),
    "photo views": Reader(_photo_views, _read_photo_views, text=True, numbers=True),
    "depths": Reader(_depths, _read_photo_views),
    "mesh": Reader(_mesh, read_mesh, text=True),
    "configuration": Reader(
        _configuration, lambda path: read_configuration(load_yaml(path, "configuration", "-")), text=True, numbers=True
    ),
    "json": Reader(_transforms, read_json, text=True),
}
