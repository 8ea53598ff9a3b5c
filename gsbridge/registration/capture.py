"""A board capture: photos of the board by the wrist camera, and the arm's pose for each photo.

The capture is a folder with the photos, `arm.csv` or `arm.json`, and, where the intrinsics are known, `camera.json`.
`docs/registration.md` describes the files.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera, given_camera
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, write_json
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.given import read_given_json
from gsbridge.reading import MOST_FILES, refusing, regular_file
from gsbridge.robot.assembly import check_reach, check_rigid

ARM_CSV, ARM_JSON, CAMERA_JSON = "arm.csv", "arm.json", "camera.json"

_LARGEST = MOST_FILES * 2**10
"""Largest allowed size of a file of the capture, bytes: one kilobyte per photo, times the most photos a folder may hold."""

_POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")

_TABLE_REMEDY = (
    f"Write, with commas between them, image and q1, q2, ... (rad, or q1_deg, ...), or image and {', '.join(_POSE_COLUMNS)}"
)
_LIST_REMEDY = 'Write {"poses": [{"image": ..., "joints": [rad, ...]}, ...]}, or "base_from_flange" instead of "joints"'
_CAMERA_REMEDY = (
    "Give width, height, fx, fy, cx, cy in pixels and distortion: [k1, k2, p1, p2], or delete the file to have them estimated"
)
_LIKE_DISTORTION = re.compile(r"^dist(?!ance)|coef|^[kp][1-6]$", re.IGNORECASE)
"""Keys under which other tools write the numbers of a lens's distortion, such as RealSense's `coeffs`."""


@dataclass(frozen=True)
class BoardCapture:
    """Photos of the board and the arm's poses; exactly one of `joints` and `base_from_flange` is given.

    Args:
        folder: Where the photos lie.
        images: File names. N of them.
        joints: Measured joint angles, rad. [N, J].
        base_from_flange: Poses of the flange, m, for arms that report poses instead of joint angles. [N, 4, 4].
        camera: Intrinsics of the photos; None where they are to be estimated from the board.
        arm_file: Name of the file that the arm's poses were read from, in the same folder.
    """

    folder: Path
    images: tuple[str, ...]
    joints: Array | None
    base_from_flange: Array | None
    camera: Camera | None
    arm_file: str


def read_board_capture(folder: str | Path) -> BoardCapture:
    """Read a board capture.

    Args:
        folder: The capture's folder, as the module's docstring describes it.

    Raises:
        InputError: A file is missing or damaged, a photo is named twice, or a value is no finite number.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(place, "there is no such folder", "Correct the path of the board capture")
    table, listed = place / ARM_CSV, place / ARM_JSON
    for file in (table, listed, place / CAMERA_JSON):
        if file.exists():
            regular_file(file, "file of the board capture", "docs/registration.md describes the files", _LARGEST)
    if table.is_file():
        source, (images, joints, poses) = table, _read_table(table)
    elif listed.is_file():
        source, (images, joints, poses) = listed, _read_list(listed)
    else:
        raise InputError(place, f"neither {ARM_CSV} nor {ARM_JSON} is there", "Write where the arm stood for each photo")
    if not images:
        raise InputError(source, "it names no photo", "Write one line per photo")
    if len(set(images)) < len(images):
        twice = next(name for name in images if images.count(name) > 1)
        raise InputError(source, f"the photo {twice} is named twice", "Give each photo one pose of the arm")
    for name in images:
        if not (place / name).is_file():
            raise InputError(place / name, "the photo is missing", f"Take its line out of {source.name}, or put it there")
    for values in (joints, poses):
        if values is not None and not np.isfinite(values).all():
            bad = images[int(np.argmin(np.isfinite(values.reshape(len(images), -1)).all(1)))]
            raise InputError(source, f"the pose of {bad} is not finite", "Give finite numbers, or take the line out")
    if poses is not None:
        check_reach(poses, source)
    return BoardCapture(place, tuple(images), joints, poses, _read_camera(place / CAMERA_JSON), source.name)


def write_arm_table(path: str | Path, images: Sequence[str], joints: Array) -> None:
    """Write `arm.csv` with joint angles.

    Args:
        path: The file.
        images: File names. N of them.
        joints: rad. [N, J].
    """
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["image", *(f"q{index + 1}" for index in range(np.shape(joints)[1]))])
        for name, row in zip(images, joints, strict=True):
            writer.writerow([name, *(f"{value:.9g}" for value in row)])


def write_camera(path: str | Path, camera: Camera) -> None:
    """Write `camera.json`."""
    write_json(path, {"camera": camera.to_json()})


def _without_empty_end(cells: list[str]) -> list[str]:
    """Return the cells of a line without the empty ones at its end."""
    filled = [place for place, cell in enumerate(cells) if cell]
    return cells[: filled[-1] + 1] if filled else []


def _read_table(path: Path) -> tuple[list[str], Array | None, Array | None]:
    """Read `arm.csv`: photos, then either joints, rad [N, J], or flange poses, m [N, 4, 4]; the other one is None."""
    with (
        refusing(path, "it is no table with commas between the cells", _TABLE_REMEDY),
        path.open(newline="", encoding="utf-8-sig") as file,
    ):
        reader = csv.reader(file, skipinitialspace=True, strict=True)
        lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if any(map(str.strip, cells))]
    # Spreadsheets add empty columns after the last one.
    columns = _without_empty_end(lines[0][1]) if lines else []
    joints = [name for name in columns if re.fullmatch(r"q[0-9]+(_deg)?", name)]
    joints.sort(key=lambda name: int(name.removesuffix("_deg")[1:]))
    posed = all(name in columns for name in _POSE_COLUMNS)
    wanted = [f"q{index + 1}" for index in range(len(joints))]
    needed = [name for name in columns if name in ("image", *_POSE_COLUMNS) or name in joints]
    named = "image" in columns and len(set(needed)) == len(needed)
    if not named or bool(joints) == posed or [name.removesuffix("_deg") for name in joints] != wanted:
        raise InputError(path, f"its columns are {', '.join(columns)[:200] or 'missing'}", _TABLE_REMEDY)
    images, values = [], []
    for number, row_cells in lines[1:]:
        cells = _without_empty_end(row_cells)
        cells += [""] * (len(columns) - len(cells))
        if len(cells) != len(columns):
            problem = f"line {number} has {len(cells)} cells, the columns are {len(columns)}"
            raise InputError(path, problem, "Correct the line: commas between the cells, points in the numbers")
        row = dict(zip(columns, cells, strict=True))
        try:
            values.append([float(row[name]) for name in (joints or _POSE_COLUMNS)])
        except ValueError as error:
            raise InputError(path, f"line {number} holds no number where one is due", "Correct the line") from error
        if posed and not abs(np.linalg.norm(values[-1][3:]) - 1.0) <= 1e-2:
            raise InputError(
                path,
                f"the quaternion of line {number} is not of unit length",
                "Give qw, qx, qy, qz of the flange in the base frame",
            )
        images.append(row["image"])
    found = np.array(values, dtype=np.float64).reshape(len(images), len(joints or _POSE_COLUMNS))
    if joints:
        factors = [np.pi / 180 if name.endswith("_deg") else 1.0 for name in joints]
        return images, found * factors, None
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    poses[:, :3, :3] = rotation_from_quat(found[:, 3:])
    poses[:, :3, 3] = found[:, :3]
    return images, None, poses


def _read_list(path: Path) -> tuple[list[str], Array | None, Array | None]:
    """Read `arm.json`, a list of poses; the result is that of `_read_table`."""
    content = read_given_json(path, _LIST_REMEDY)
    with refusing(path, "a pose is damaged", _LIST_REMEDY):
        poses = list(content["poses"])
        images = [str(item["image"]) for item in poses]
        if poses and all("joints" in item for item in poses):
            joints = np.array([item["joints"] for item in poses], dtype=np.float64)
            if joints.ndim != 2 or not joints.size:
                raise InputError(
                    path, f"the joints of a photo are no list of angles: {poses[0]['joints']!r}"[:200], _LIST_REMEDY
                )
            return images, joints, None
        matrices = [check_rigid(item["base_from_flange"], f"{path}: {item['image']}") for item in poses]
    return images, None, np.array(matrices).reshape(-1, 4, 4)


def _read_camera(path: Path) -> Camera | None:
    """Read the intrinsics, which may stand alone or under the key `camera`, as in a calibration record; None without a file."""
    if not path.is_file():
        return None
    content = read_given_json(path, _CAMERA_REMEDY)
    content = content.get("camera", content)
    stated = content if isinstance(content, dict) and "distortion" not in content else {}
    unread = [key for key, value in stated.items() if isinstance(value, float | int | list) and _LIKE_DISTORTION.search(key)]
    if unread:
        problem = f"'{unread[0]}' looks like the lens's distortion, which is read under the key 'distortion' alone"
        raise InputError(path, problem, 'Write "distortion": [k1, k2, p1, p2], zeros for rectified photos')
    return given_camera(content, path, _CAMERA_REMEDY)
