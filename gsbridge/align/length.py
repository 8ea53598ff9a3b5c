"""Scale from a length that the user knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array, Similarity

_FORM = (
    "Write `{metres: 0.21, between: [[image, u, v], [image, u, v]]}` for two points on the table, in pixels of the keyframes, "
    "or `{metres: 0.2, object: longest}` for the object's longest side"
)


@dataclass(frozen=True)
class KnownLength:
    """A length in the scene that the user knows.

    Args:
        metres: The length, m.
        between: Two points *on the table*: keyframe name and pixel (u, v) each; None for the object's longest side.
    """

    metres: float
    between: tuple[tuple[str, float, float], tuple[str, float, float]] | None

    @classmethod
    def parse(cls, content: Mapping[str, Any]) -> KnownLength:
        """Read the setting `known_length`.

        Raises:
            InputError: It has another form.
        """
        try:
            metres = float(content["metres"])
            if not 1e-4 < metres < 100.0:
                raise InputError("known_length", f"{metres:g} m is no plausible length", _FORM)
            if "between" in content:
                (a, ua, va), (b, ub, vb) = content["between"]
                return cls(metres, ((str(a), float(ua), float(va)), (str(b), float(ub), float(vb))))
            if content.get("object") != "longest":
                raise KeyError("between")
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("known_length", f"the setting cannot be read ({error})", _FORM) from error
        return cls(metres, None)


def scale_from_length(
    length: KnownLength,
    table_from_sfm: Similarity,
    views: Mapping[str, tuple[Camera, Array]],
    distorted: Camera,
    side: float,
    others: Mapping[str, Camera] = MappingProxyType({}),
) -> float:
    """Scale of the reconstruction from a known length, m per sfm unit.

    Args:
        length: The known length.
        table_from_sfm: Table frame before scaling (scale 1).
        views: Pinhole and `cam_from_sfm` [4, 4] by image name.
        distorted: Camera of the keyframes as taken, in whose pixels the points are given.
        side: Longest side of the object, sfm units.
        others: Cameras of keyframes of another size, by name.

    Raises:
        InputError: A named image is not registered, or the points do not lie in it or on the table.
    """
    if length.between is None:
        return length.metres / side
    ends = []
    for name, u, v in length.between:
        if name not in views:
            raise InputError("known_length", f"the keyframe {name} is not registered", "Name another keyframe of this scene")
        camera = others.get(name, distorted)
        if not (0 <= u <= camera.width and 0 <= v <= camera.height):
            raise InputError(
                "known_length",
                f"({u:g}, {v:g}) lies outside {name}, which has {camera.width} x {camera.height} pixels",
                "Read the pixels off the keyframe in `capture/frames`, not off the original photo",
            )
        ends.append(table_point(np.array([u, v]), camera, table_from_sfm.move_pose(views[name][1])))
    distance = float(np.linalg.norm(ends[1] - ends[0]))
    if not np.isfinite(distance) or distance <= 0:
        raise InputError("known_length", "the two pixels do not show two points of the table", _FORM)
    return length.metres / distance


def reading_error(
    length: KnownLength,
    table_from_sfm: Similarity,
    views: Mapping[str, tuple[Camera, Array]],
    distorted: Camera,
    others: Mapping[str, Camera] = MappingProxyType({}),
) -> float:
    """Relative standard error of the scale from two points if each pixel coordinate has a standard error of one pixel.

    Args:
        length: Two points on the table.
        table_from_sfm: Table frame before scaling (scale 1).
        views: Pinhole and `cam_from_sfm` [4, 4] by image name.
        distorted, others: See `scale_from_length`.

    Raises:
        InputError: See `scale_from_length`.
    """
    assert length.between is not None
    (a, ua, va), (b, ub, vb) = length.between
    found = scale_from_length(length, table_from_sfm, views, distorted, 1.0, others)
    square = 0.0
    for moved in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)):
        # Each coordinate moves by half a pixel either way; both values are shifted inwards if the border is near.
        scales = []
        for side in (-0.5, 0.5):
            values = [value + side * step for value, step in zip((ua, va, ub, vb), moved, strict=True)]
            for k, name in enumerate((a, a, b, b)):
                camera = others.get(name, distorted)
                values[k] = min(max(values[k], 0.0), float((camera.width, camera.height)[k % 2]))
            near = KnownLength(length.metres, ((a, values[0], values[1]), (b, values[2], values[3])))
            scales.append(scale_from_length(near, table_from_sfm, views, distorted, 1.0, others))
        square += ((scales[1] - scales[0]) / found) ** 2
    return float(np.sqrt(square))


def table_point(pixel: Array, camera: Camera, cam_from_table: Array) -> Array:
    """Point at which the ray through a pixel meets the plane z = 0 of the table.

    Args:
        pixel: Position in the photo as taken, px. [2].
        camera: Camera of the photo, with its distortion.
        cam_from_table: Pose of the camera. [4, 4].

    Returns:
        The point in the table frame, in the units of `cam_from_table`; NaN where the ray does not meet the plane. [3].
    """
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-9)
    xy = cv2.undistortPoints(
        np.asarray(pixel, dtype=np.float64).reshape(1, 1, 2), camera.intrinsics, np.array(camera.distortion), criteria=criteria
    )
    rotation, translation = cam_from_table[:3, :3], cam_from_table[:3, 3]
    direction = rotation.T @ np.array([*xy.ravel(), 1.0])
    centre = -rotation.T @ translation
    reach = -centre[2] / direction[2] if direction[2] != 0 else -1.0
    return centre + reach * direction if reach > 0 else np.full(3, np.nan)
