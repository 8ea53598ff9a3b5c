"""Where photos come from: a video, a folder of photos, posed photos of other programs, or a film of the mirror."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.capture.known_views import KnownView, checked_view
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array
from gsbridge.given import read_given_json
from gsbridge.images import HEIF_SUFFIXES, image_size, read_image_u8
from gsbridge.reading import refusing, regular_file

logger = logging.getLogger("gsbridge")

KINDS = ("video", "images", "colmap", "nerfstudio", "film")
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", *HEIF_SUFFIXES)

_UNREAD_SUFFIXES = (".avif", ".jxl", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2")
"""Formats of phones and cameras that OpenCV does not read."""

_COUNTED_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi")
"""Containers that store their number of frames; for others OpenCV gives duration times frame rate, which may be far off."""
_DECODED_SHARE = 0.98

_ISO_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot", b"styp", b"sidx", b"uuid", b"udta", b"meta")
"""Kinds of the first box of an MP4 or QuickTime file; the kind follows the box's length."""
_CONTAINER_STARTS = (
    b"\x1a\x45\xdf\xa3",  # Matroska and WebM
    b"\x00\x00\x01",  # MPEG-1 and -2, and plain H.264 and H.265, whose start code may have one zero more
    b"\x00\x00\x00\x01",
    b"\x30\x26\xb2\x75",  # ASF, that is WMV
    b"FLV",
    b"OggS",
    b"\x06\x0e\x2b\x34",  # MXF
    b"GIF8",
    b"YUV4MPEG2",
    b"DKIF",
)
_TRANSPORT_PACKETS = ((0, 188), (4, 192))
"""Place of the first sync byte of an MPEG transport stream, and length of its packets; camcorders put a time stamp before each
packet."""

_NERFSTUDIO_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
_EXPORT_AGAIN = "Export it again with ns-process-data"


@dataclass(frozen=True)
class Source:
    """One capture as the user gives it.

    Args:
        kind: One of `KINDS`.
        path: Video file, photo folder, COLMAP model folder, `transforms.json`, or the mirror's film folder.
        images: Folder of the photos of a COLMAP model; None for `images` in the model's folder or up to two above it.
    """

    kind: str
    path: Path
    images: Path | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("source", f"the kind of source '{self.kind}' is unknown", f"Use one of {', '.join(KINDS)}")
        object.__setattr__(self, "path", Path(self.path))
        if self.images is not None:
            object.__setattr__(self, "images", Path(self.images))


@dataclass(frozen=True)
class Photo:
    """A photo on disk; `known` is set if its camera and pose came with it, `time_s` if it is a frame of a film."""

    path: Path
    time_s: float | None = None
    known: KnownView | None = None


class Video:
    """Frames of a video file, decoded in order and rotated upright as the phone was held.

    Args:
        path: The video.

    Raises:
        InputError: The file is missing, empty, or no video.
    """

    def __init__(self, path: Path) -> None:
        self.path = regular_file(path, "video", "Check the path in config.yaml")
        if self.path.stat().st_size == 0:
            raise InputError(self.path, "the video is empty (0 bytes)", "Copy it again from the phone")
        with refusing(self.path, "the video cannot be read", "Copy it again from the phone"), open(self.path, "rb") as file:
            begin = file.read(_TRANSPORT_PACKETS[-1][1] + 5)
        if not _is_container(begin):
            raise InputError(
                self.path,
                "this is not a video: it begins like none of MP4, MOV, Matroska, WebM, AVI, MPEG, WMV and others",
                "Copy it again from the phone, or convert it to H.264 MP4",
            )
        capture = cv2.VideoCapture(str(self.path))
        try:
            opened, _ = capture.read() if capture.isOpened() else (False, None)
            if not opened:
                raise InputError(
                    self.path,
                    "this is not a video that can be decoded, or its end is cut off",
                    "Copy it again from the phone, or convert it to H.264 MP4",
                )
            self.declared = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
            self.fps = float(capture.get(cv2.CAP_PROP_FPS)) or 30.0
        finally:
            capture.release()

    def __iter__(self) -> Iterator[tuple[float, Array]]:
        """Time, s, and uint8 BGR image [H, W, 3] of each frame."""
        capture = cv2.VideoCapture(str(self.path))
        try:
            index = 0
            while True:
                ok, frame = capture.read()
                if not ok:
                    return
                yield self._time(index, capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0), frame
                index += 1
        finally:
            capture.release()

    def _time(self, index: int, stated: float) -> float:
        """Time of a frame, s: its number divided by the frame rate, or the file's time stamp if the phone changed its rate.

        Differences of up to a millisecond are ignored, because containers round times; Matroska rounds to a millisecond.
        """
        even = index / self.fps
        return stated if np.isfinite(stated) and abs(stated - even) > 0.001 else even

    def check(self, decoded: int) -> None:
        """Refuse a video that lost many frames, because a decoder skips damaged parts without an error.

        If the container only estimates its number of frames, as WebM and Matroska do, an intact video may seem to lack some;
        then there is only a warning.

        Raises:
            InputError: Fewer frames were decoded than the file counts.
        """
        if decoded < min(self.declared - 2, _DECODED_SHARE * self.declared):
            if self.path.suffix.lower() not in _COUNTED_SUFFIXES:
                logger.warning(
                    "%s: %d frames decoded, about %d expected; if the video stops early, convert it to H.264 MP4",
                    self.path,
                    decoded,
                    self.declared,
                )
                return
            raise InputError(
                self.path,
                f"only {decoded} of {self.declared} declared frames could be decoded: the file is damaged",
                "Copy it again from the phone, or cut out the damaged part",
            )


def _is_container(begin: bytes) -> bool:
    """Whether a file begins as videos do; the decoder would also accept lists of other files, and open those.

    Args:
        begin: The file's first bytes; two packets of a transport stream are enough.
    """
    if begin.startswith(_CONTAINER_STARTS) or begin[4:8] in _ISO_BOXES:
        return True
    if begin.startswith(b"RIFF") and begin[8:12] == b"AVI ":
        return True
    return any(begin[place : place + length + 1 : length] == b"GG" for place, length in _TRANSPORT_PACKETS)


class PhotoSequence:
    """Frames of a film that lie as images in a folder, with the interface of `Video`."""

    def __init__(self, path: Path, photos: list[Photo]) -> None:
        self.path = path
        self.photos = photos
        self.declared = len(photos)

    def __iter__(self) -> Iterator[tuple[float, Array]]:
        for photo in self.photos:
            yield photo.time_s or 0.0, np.ascontiguousarray(read_image_u8(photo.path)[..., ::-1])

    def check(self, decoded: int) -> None:
        """Do nothing, because a missing image has already raised an error."""


def list_photos(folder: Path) -> list[Photo]:
    """Photos of a folder, in the order of their names; a warning names photos whose format is not read.

    Raises:
        InputError: The folder is missing or holds no photos.
    """
    if not os.path.isdir(folder):
        raise InputError(str(folder)[:200], "the photo folder does not exist", "Check the path in config.yaml")
    files = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    paths = [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES]
    unread = [path.name for path in files if path.suffix.lower() in _UNREAD_SUFFIXES]
    if unread:
        skipped = f"{len(unread)} photos are in a format that is not read: {', '.join(unread[:5])}"
        skipped += ", ..." if len(unread) > 5 else ""
        if not paths:
            raise InputError(folder, skipped, "Convert them to JPEG; phones can also export or take JPEG")
        logger.warning("%s: %s; they are left out, convert them to JPEG", folder, skipped)
    if not paths:
        raise InputError(folder, "the folder holds no photos", f"Put photos there ({', '.join(IMAGE_SUFFIXES)})")
    return [Photo(path) for path in paths]


def read_film(folder: Path) -> tuple[dict[str, Any], list[Photo]]:
    """Read `film.json` of the mirror and list its frames.

    Raises:
        InputError: The film is damaged or lacks frames.
    """
    record = folder / "film.json"
    content = read_json(record)
    with refusing(record, "the film's record is damaged", "Delete the film's folder and film it again"):
        photos = [Photo(folder / "frames" / frame["name"], float(frame["time_s"])) for frame in content["frames"]]
    missing = [photo.path.name[:80] for photo in photos if not os.path.isfile(photo.path)]
    if missing or not photos:
        what = (
            f"{len(missing)} of {len(photos)} frames are missing, the first is {missing[0]}" if missing else "it has no frames"
        )
        raise InputError(record, f"the film is incomplete: {what}", "Delete the film's folder and film it again")
    return content, photos


def read_colmap(model: Path, images: Path | None) -> list[Photo]:
    """Posed photos of an existing COLMAP model.

    Raises:
        InputError: The model is damaged, or photos are missing.
    """
    # pycolmap is loaded only here: videos and photo folders do not need it.
    from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix, read_model

    # The folder of a whole COLMAP project is accepted as well as that of its model.
    places = (model, model / "sparse" / "0", model / "sparse")
    model = next((p for p in places if any(os.path.isfile(p / f"cameras{end}") for end in (".bin", ".txt"))), model)
    reconstruction = read_model(model)
    if images is None:
        # COLMAP's own layout: project/images beside project/sparse/0.
        images = next((p / "images" for p in (model, model.parent, model.parent.parent) if (p / "images").is_dir()), None)
    if images is None or not os.path.isdir(images):
        raise InputError(
            str(images or model)[:200],
            "the photo folder of the COLMAP model does not exist",
            "Put the photos into a folder `images` beside the model, as COLMAP's projects have it",
        )
    photos = []
    with refusing(model, "the COLMAP model is damaged", "Export it again, or reconstruct it again"):
        for image_id in reconstruction.reg_image_ids():
            image = reconstruction.image(image_id)
            known = checked_view(KnownView(camera_from_colmap(image.camera, model), pose_matrix(image)), model, image.name)
            photos.append(Photo(images / image.name, known=known))
    return _existing(sorted(photos, key=lambda photo: photo.path.name), model)


def read_nerfstudio(path: Path) -> tuple[list[Photo], list[str]]:
    """Posed photos of a nerfstudio `transforms.json`, and the listed photos that do not exist.

    The file holds `world_from_cam` with OpenGL axes (y up, z backward); they become `cam_from_world` with OpenCV axes here.

    Raises:
        InputError: The file is damaged, or fewer than 3 of its photos exist.
    """
    content = read_given_json(path, f"Check the path in config.yaml. {_EXPORT_AGAIN}")
    photos, absent = [], []
    with refusing(path, "the transforms file is damaged", _EXPORT_AGAIN):
        for frame in content["frames"]:
            file = _photo_file(path.parent, str(frame["file_path"]))
            if file is None:
                absent.append(str(frame["file_path"])[:80])
                continue
            values = _own_values(content, frame)
            _refuse_lens(path, values)
            matrix = np.array(frame["transform_matrix"], dtype=np.float64)
            if matrix.shape not in ((4, 4), (3, 4)) or not np.isfinite(matrix).all():
                raise ValueError("a transform_matrix is no 4 x 4 matrix")
            if len(matrix) == 4 and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-6):
                raise ValueError("the last row of a transform_matrix is not 0 0 0 1")
            world_from_cam = np.eye(4)
            world_from_cam[: len(matrix)] = matrix
            world_from_cam[:3, 1:3] *= -1.0
            camera = _nerfstudio_camera(values, file)
            known = checked_view(KnownView(camera, np.linalg.inv(world_from_cam)), path, file.name)
            photos.append(Photo(file, known=known))
    if absent and len(photos) < 3:
        total = len(photos) + len(absent)
        raise InputError(
            path, f"{len(absent)} of {total} listed photos do not exist, for example {absent[0]}", "Check the paths"
        )
    if absent:
        logger.warning("%s: %d listed photos do not exist and are left out: %s", path, len(absent), ", ".join(absent[:5]))
    return _existing(sorted(photos, key=lambda photo: photo.path.name), path), absent


def _photo_file(folder: Path, name: str) -> Path | None:
    """File of a listed photo, also if the exporter left the suffix out; None if there is no such file."""
    file = folder / name
    choices = [file, *(file.with_name(file.name + suffix) for suffix in IMAGE_SUFFIXES)]
    return next((choice for choice in choices if os.path.isfile(choice)), None)


def _own_values(content: dict[str, Any], frame: dict[str, Any]) -> dict[str, Any]:
    """Values of a transforms file for one photo; the photo's own entries override those that hold for all photos."""
    values = {**content, **frame}
    for length, angle in (("fl_x", "camera_angle_x"), ("fl_y", "camera_angle_y")):
        if angle in frame and length not in frame:
            values.pop(length, None)
    return values


def _refuse_lens(path: Path, values: dict[str, Any]) -> None:
    """Refuse lenses that `Camera` does not describe.

    Args:
        path: The transforms file.
        values: Its values for one photo.

    Raises:
        InputError: The lens is of such a kind.
    """
    model = values.get("camera_model", "OPENCV")
    if model not in _NERFSTUDIO_MODELS:
        raise InputError(path, f"the camera model {str(model)[:40]} is not supported", "Use OPENCV or PINHOLE")
    if values.get("is_fisheye"):
        raise InputError(path, "a camera is a fisheye, which is not supported", "Use OPENCV or PINHOLE")
    if any(float(values.get(key, 0.0)) != 0.0 for key in ("k3", "k4")):
        raise InputError(path, "the camera has distortion terms k3 or k4", "Use the OPENCV model with k1, k2, p1, p2")


def _nerfstudio_camera(values: dict[str, Any], file: Path) -> Camera:
    """Camera of one frame; the photo's size replaces a missing size or centre, the angle of view a missing focal length."""
    width, height = (int(values["w"]), int(values["h"])) if {"w", "h"} <= values.keys() else image_size(file)
    fx = float(values["fl_x"]) if "fl_x" in values else 0.5 * width / np.tan(0.5 * float(values["camera_angle_x"]))
    if "fl_y" in values or "camera_angle_y" not in values:
        fy = float(values.get("fl_y", fx))
    else:
        fy = 0.5 * height / np.tan(0.5 * float(values["camera_angle_y"]))
    k1, k2, p1, p2 = (float(values.get(key, 0.0)) for key in ("k1", "k2", "p1", "p2"))
    cx, cy = float(values.get("cx", 0.5 * width)), float(values.get("cy", 0.5 * height))
    return Camera(width, height, float(fx), fy, cx, cy, (k1, k2, p1, p2))


def _existing(photos: list[Photo], source: Path) -> list[Photo]:
    """Return the photos if all of them exist on disk and their names differ; else raise an error."""
    if not photos:
        raise InputError(source, "no photo is listed", "Export it again with at least 3 photos")
    missing = [photo.path for photo in photos if not os.path.isfile(photo.path)]
    if missing:
        problem = f"{len(missing)} of {len(photos)} listed photos do not exist"
        raise InputError(str(missing[0])[:200], problem, "Check the photo folder")
    names = {photo.path.stem for photo in photos}
    if len(names) < len(photos):
        raise InputError(source, "two photos in different folders carry the same name", "Rename them")
    return photos
