"""Conversion of COLMAP's cameras, poses, models and log output.

cv2 is imported before pycolmap, because the other order was seen to abort the process.
"""

from __future__ import annotations

import contextlib
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import cv2  # noqa: F401  (must be loaded before pycolmap)
import numpy as np
import pycolmap

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array

_REMEDY = "Export the model again from COLMAP (cameras, images and points3D, all .bin or all .txt)"
_PARTS = ("cameras", "images", "points3D")


def camera_from_colmap(camera: pycolmap.Camera | None, source: str | Path) -> Camera:
    """Turn a COLMAP camera into a `Camera`.

    Args:
        camera: A pinhole camera, with up to OPENCV's distortion.
        source: File that it comes from, for the error message.

    Raises:
        InputError: There is no camera, or its model has more distortion terms than k1, k2, p1, p2, or is a fisheye.
    """
    if camera is None:
        raise InputError(source, "an image of the COLMAP model has no camera", "Export the model again")
    name = camera.model.name
    p = [float(value) for value in camera.params]
    if name == "SIMPLE_PINHOLE":
        values = (p[0], p[0], p[1], p[2], (0.0, 0.0, 0.0, 0.0))
    elif name == "PINHOLE":
        values = (p[0], p[1], p[2], p[3], (0.0, 0.0, 0.0, 0.0))
    elif name == "SIMPLE_RADIAL":
        values = (p[0], p[0], p[1], p[2], (p[3], 0.0, 0.0, 0.0))
    elif name == "RADIAL":
        values = (p[0], p[0], p[1], p[2], (p[3], p[4], 0.0, 0.0))
    elif name == "OPENCV":
        values = (p[0], p[1], p[2], p[3], (p[4], p[5], p[6], p[7]))
    else:
        raise InputError(source, f"the camera model {name} is not supported", "Use PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV")
    return Camera(int(camera.width), int(camera.height), *values)


def colmap_params(camera: Camera) -> list[float]:
    """Parameters of a camera in COLMAP's order: PINHOLE without distortion, OPENCV with it."""
    pinhole = [camera.fx, camera.fy, camera.cx, camera.cy]
    return pinhole if camera.is_pinhole else [*pinhole, *camera.distortion]


def exif_focal_px(path: str | Path) -> float | None:
    """Focal length from a photo's EXIF data, px at its full size; None if they give none."""
    try:
        camera = pycolmap.infer_camera_from_image(path)
    except (RuntimeError, ValueError):
        return None
    return float(camera.mean_focal_length()) if camera.has_prior_focal_length else None


def pose_matrix(image: pycolmap.Image) -> Array:
    """`cam_from_world` of a registered image. [4, 4]."""
    out = np.eye(4)
    out[:3] = image.cam_from_world().matrix()
    return out


def read_model(folder: str | Path) -> pycolmap.Reconstruction:
    """Read a COLMAP model, binary or text.

    Raises:
        InputError: Files are missing or damaged, or no image has a pose.
    """
    path = Path(folder)
    if not os.path.isdir(path):
        raise InputError(str(path)[:200], "the COLMAP model folder does not exist", _REMEDY)
    suffix = next((s for s in (".bin", ".txt") if (path / f"cameras{s}").is_file()), None)
    missing = [f"{part}{suffix or '.bin'}" for part in _PARTS if not (path / f"{part}{suffix or '.bin'}").is_file()]
    if missing:
        raise InputError(path, f"the COLMAP model lacks {', '.join(missing)}", _REMEDY)
    if suffix == ".bin":
        _check_binary(path)
    try:
        model = pycolmap.Reconstruction(path)
    except (RuntimeError, ValueError, OverflowError, MemoryError, IndexError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(path, f"the COLMAP model is damaged ({reason})", _REMEDY) from error
    if model.num_reg_images() == 0:
        raise InputError(path, "the COLMAP model holds no image with a pose", _REMEDY)
    return model


def _check_binary(path: Path) -> None:
    """Refuse truncated binary files by walking their records.

    COLMAP's reader does not notice the end of a file: it continues with the last value read, requests huge amounts of memory,
    or ends the process.
    """
    walkers = {"cameras": _walk_cameras, "images": _walk_images, "points3D": _walk_points}
    for part, walk in walkers.items():
        file = path / f"{part}.bin"
        data = file.read_bytes()
        try:
            count = struct.unpack_from("<Q", data, 0)[0]
            # Every record in the three files has more than 20 bytes, so a larger count means damage instead of a big model.
            if count * 20 > len(data) or walk(data, count) != len(data):
                raise ValueError("its length does not match its content")
        except (struct.error, ValueError, IndexError, KeyError, OverflowError) as error:
            raise InputError(file, f"the COLMAP model file is damaged or cut off ({error})", _REMEDY) from error


def _walk_cameras(data: bytes, count: int) -> int:
    sizes = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8, 6: 12, 7: 5, 8: 4, 9: 5, 10: 12}
    position = 8
    for _ in range(count):
        _, model, width, height = struct.unpack_from("<iiQQ", data, position)
        if model not in sizes or not 0 < width < 1 << 20 or not 0 < height < 1 << 20:
            raise ValueError(f"camera model {model} of {width} x {height} pixels")
        position += 24 + 8 * sizes[model]
    return position


def _walk_images(data: bytes, count: int) -> int:
    position = 8
    for _ in range(count):
        end = data.index(b"\0", position + 64)
        points = struct.unpack_from("<Q", data, end + 1)[0]
        position = end + 9 + 24 * points
    return position


def _walk_points(data: bytes, count: int) -> int:
    position = 8
    for _ in range(count):
        track = struct.unpack_from("<Q", data, position + 43)[0]
        position += 51 + 8 * track
    return position


@contextlib.contextmanager
def quiet(log: str | Path) -> Iterator[None]:
    """Append to a file what C++ libraries write to stderr; Python's own logging is not affected.

    COLMAP writes many lines per run through glog and, from some threads, to the raw descriptor; only a redirected descriptor
    catches all of them. In the meantime Python's stderr handlers write to a duplicate of the old descriptor.
    """
    import logging
    import sys

    Path(log).parent.mkdir(parents=True, exist_ok=True)
    sys.stderr.flush()
    saved = os.dup(2)
    handlers = [
        handler
        for handler in logging.getLogger().handlers
        if isinstance(handler, logging.StreamHandler) and handler.stream in (sys.stderr, sys.__stderr__)
    ]
    streams = [handler.stream for handler in handlers]
    with open(log, "ab") as sink, os.fdopen(os.dup(saved), "w", encoding="utf-8", errors="replace") as terminal:
        os.dup2(sink.fileno(), 2)
        for handler in handlers:
            handler.setStream(terminal)
        try:
            yield
        finally:
            for handler, stream in zip(handlers, streams, strict=True):
                handler.setStream(stream)
            os.dup2(saved, 2)
            os.close(saved)
