"""Cameras and posed views.

OpenCV axes: x right, y down, z forward. A view matrix is `cam_from_table` (or `cam_from_world`). Pixel centres lie at +0.5,
so that the image spans 0..width and a 2x downscale halves `fx, fy, cx, cy` exactly (COLMAP's convention; OpenCV's pixel
centres at integers are converted where OpenCV is called).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Array

_FOCAL = (0.05, 100.0)
"""Smallest and largest focal length that is accepted, as multiples of the picture's longer side.

The lower limit is wider than any lens without fisheye, the upper one is a telescope's.
"""
_LARGEST_SIDE = 100_000
_LARGEST_DISTORTION = 100.0
_SKEW = 1e-2
"""Largest entry of `|R R^T - I|` for which a matrix R from a file passes as a rotation.

Files round to about five digits; scale and shear show in the first two.
"""


@dataclass(frozen=True)
class Camera:
    """Intrinsics: a pinhole, with OpenCV's radial-tangential distortion where `distortion` is not zero.

    Args:
        width, height: Image size, px.
        fx, fy, cx, cy: Focal lengths and principal point, px (pixel centres at +0.5).
        distortion: k1, k2, p1, p2 of the OPENCV model.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def intrinsics(self) -> Array:
        """3x3 matrix K. [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_pinhole(self) -> bool:
        """True without distortion."""
        return not any(self.distortion)

    @property
    def pinhole_numbers(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy."""
        return float(self.fx), float(self.fy), float(self.cx), float(self.cy)

    def undistorted(self) -> Camera:
        """This camera without its distortion."""
        return replace(self, distortion=(0.0, 0.0, 0.0, 0.0))

    def scaled(self, factor: float) -> Camera:
        """Camera of the image resized by `factor`; the size is rounded and the focal lengths follow it exactly."""
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        sx, sy = width / self.width, height / self.height
        return replace(self, width=width, height=height, fx=self.fx * sx, cx=self.cx * sx, fy=self.fy * sy, cy=self.cy * sy)

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Camera of a rectangular part of the image.

        Args:
            left, top: Corner of the part in the image, px.
            width, height: Size of the part, px.
        """
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def project(self, points_cam: Array) -> Array:
        """Pixels of points in camera coordinates. [..., 3] -> [..., 2]. Points behind the camera give NaN."""
        p = np.asarray(points_cam, dtype=np.float64)
        z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
        x, y = p[..., 0] / z, p[..., 1] / z
        if not self.is_pinhole:
            k1, k2, p1, p2 = self.distortion
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * k2)
            x, y = (
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            )
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def pixel_rays(self) -> Array:
        """Directions (z = 1, camera axes) through all pixel centres of a pinhole. [H, W, 3].

        Raises:
            ValueError: The camera has distortion; undistort the images first.
        """
        if not self.is_pinhole:
            raise ValueError("rays are defined for undistorted images only")
        u = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        v = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        x, y = np.meshgrid(u, v)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def to_json(self) -> dict[str, Any]:
        """Plain mapping for a JSON file."""
        return {
            "width": self.width,
            "height": self.height,
            "fx": self.fx,
            "fy": self.fy,
            "cx": self.cx,
            "cy": self.cy,
            "distortion": list(self.distortion),
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Camera:
        """Inverse of `to_json`."""
        k1, k2, p1, p2 = content.get("distortion", (0.0, 0.0, 0.0, 0.0))
        return cls(
            int(content["width"]),
            int(content["height"]),
            float(content["fx"]),
            float(content["fy"]),
            float(content["cx"]),
            float(content["cy"]),
            (float(k1), float(k2), float(p1), float(p2)),
        )


def camera_problem(camera: Camera) -> str | None:
    """What is wrong with a camera, in words; None if nothing is."""
    longer = max(camera.width, camera.height)
    if longer > _LARGEST_SIDE:
        return f"a picture with a side of more than {_LARGEST_SIDE} px"
    if min(camera.width, camera.height) <= 0:
        return f"a picture of {camera.width} x {camera.height} px"
    for name, value in (("fx", camera.fx), ("fy", camera.fy)):
        if not _FOCAL[0] * longer <= value <= _FOCAL[1] * longer:
            return f"a focal length {name} of {value:g} px in a picture of {camera.width} x {camera.height} px"
    for name, value, side in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if not -side <= value <= 2 * side:
            return f"a principal point at {name} = {value:g} px in a picture of {camera.width} x {camera.height} px"
    if not all(abs(value) <= _LARGEST_DISTORTION for value in camera.distortion):
        return f"a distortion of {', '.join(f'{value:g}' for value in camera.distortion)}"
    return None


def pose_problem(pose: Array) -> str | None:
    """What is wrong with a view matrix, in words; None if nothing is. Any shape is accepted, but only [4, 4] can be right."""
    if pose.shape != (4, 4):
        return "its pose is no 4x4 matrix"
    if not np.isfinite(pose).all():
        return "its pose holds a number that is none"
    rotation = pose[:3, :3]
    scale = float(np.linalg.norm(rotation) / np.sqrt(3))
    if not np.abs(rotation @ rotation.T - np.eye(3)).max() <= _SKEW:
        return f"its pose is no rotation and translation (its axes are {scale:.4g} long, or not at right angles)"
    if np.linalg.det(rotation) < 0.0:
        return "its pose mirrors the world"
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        return "the last row of its pose is not 0, 0, 0, 1"
    return None


def given_camera(content: Any, source: str | Path, remedy: str) -> Camera:
    """Build a camera from the content of a file, and refuse one that cannot exist.

    Args:
        content: What `Camera.to_json` gives, or anything else.
        source: File that the content was read from, for the message.
        remedy: What the user can do, for the message.

    Raises:
        InputError: An entry is missing, is not a number, or lies outside the accepted range.
    """
    try:
        camera = Camera.from_json(content)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise InputError(source, f"the camera is damaged or incomplete ({error})", remedy) from error
    problem = camera_problem(camera)
    if problem:
        raise InputError(source, f"there is no such camera: {problem}", remedy)
    return camera


def camera_centre(cam_from_world: Array) -> Array:
    """Position of the camera in the world. [..., 4, 4] -> [..., 3]."""
    pose = np.asarray(cam_from_world)
    return -np.einsum("...ji,...j->...i", pose[..., :3, :3], pose[..., :3, 3])


def look_at(eye: Array, target: Array, up: Array = (0.0, 0.0, 1.0)) -> Array:  # type: ignore[assignment]
    """`cam_from_world` of a camera at `eye` that looks at `target`, image up towards `up`. [3] each -> [4, 4].

    Args:
        eye: Centre of the camera, world frame, m. [3].
        target: Point that lies on the optical axis, world frame, m. [3].
        up: Direction that points up in the image, of any length, world frame. [3].

    Raises:
        ValueError: The line of sight is parallel to `up`.
    """
    eye = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    length = np.linalg.norm(right)
    if length < 1e-9:
        raise ValueError("the line of sight is parallel to the up direction")
    right /= length
    rotation = np.stack([right, np.cross(forward, right), forward])
    out = np.eye(4)
    out[:3, :3] = rotation
    out[:3, 3] = -rotation @ eye
    return out


HELD_OUT_EVERY = 8
HELD_OUT_PHASE = 4
"""Every 8th keyframe is held out, starting with the 5th, so that the first view of a path never is."""


def split_of(keyframe: int) -> str:
    """`held_out` or `train`, from the position of a frame among all keyframes, counted from 0 (registered or not)."""
    return "held_out" if keyframe % HELD_OUT_EVERY == HELD_OUT_PHASE else "train"


@dataclass(frozen=True)
class View:
    """One registered, undistorted photo.

    Args:
        name: File name of the image inside the image folder.
        camera: Pinhole intrinsics.
        cam_from_table: Pose, table frame in metres (or scene units where the scale is unknown). [4, 4].
        split: `train` or `held_out`.
    """

    name: str
    camera: Camera
    cam_from_table: Array = field(repr=False)
    split: str = "train"

    @property
    def centre(self) -> Array:
        """Camera position in the table frame. [3]."""
        return camera_centre(self.cam_from_table)


@dataclass(frozen=True)
class Views(Sequence[View]):
    """All registered views of a scene and the folder of their images."""

    images: Path
    views: tuple[View, ...]

    def __len__(self) -> int:
        return len(self.views)

    @overload
    def __getitem__(self, index: int) -> View: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[View, ...]: ...
    def __getitem__(self, index: int | slice) -> View | tuple[View, ...]:
        return self.views[index]

    def __iter__(self) -> Iterator[View]:
        return iter(self.views)

    def of(self, split: str) -> tuple[View, ...]:
        """Views of one split."""
        return tuple(view for view in self.views if view.split == split)

    def path(self, view: View) -> Path:
        """Image file of a view."""
        return self.images / view.name


def write_views(path: str | Path, views: Sequence[View]) -> None:
    """Write `views.json`: cameras and poses in the table frame. The image folder is not stored; readers are given it."""
    write_json(
        path,
        {
            "frame": "table: metres, z up, table top at z = 0; cam_from_table with OpenCV axes",
            "views": [
                {
                    "name": view.name,
                    "camera": view.camera.to_json(),
                    "cam_from_table": np.asarray(view.cam_from_table).tolist(),
                    "split": view.split,
                }
                for view in views
            ],
        },
    )


def read_views(path: str | Path, images: str | Path) -> Views:
    """Read `views.json` written by the align stage.

    Args:
        path: The `views.json`.
        images: Folder of the undistorted images.

    Raises:
        InputError: The file is damaged or an image is missing.
    """
    remedy = "Delete the file and run the align stage again"
    content = read_json(path)
    try:
        views = tuple(_view(item, path, remedy) for item in content["views"])
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise InputError(path, f"a view is damaged ({error})", remedy) from error
    names = [view.name for view in views]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(path, f"the view of {twice} is there twice", remedy)
    folder = Path(images)
    for view in views:
        if not (folder / view.name).is_file():
            raise InputError(folder / view.name, "the image of a registered view is missing", "Run the sfm stage again")
    return Views(folder, views)


def _view(item: Mapping[str, Any], path: str | Path, remedy: str) -> View:
    """Build one view from its entry in `views.json`, and refuse a camera or pose that cannot exist."""
    view = View(
        str(item["name"]),
        given_camera(item["camera"], path, remedy),
        np.array(item["cam_from_table"], dtype=np.float64),
        item["split"],
    )
    problem = pose_problem(view.cam_from_table)
    if problem or view.split not in ("train", "held_out"):
        raise InputError(path, f"the view of {view.name} is damaged: {problem or f'its split is {view.split!r}'}", remedy)
    return view
