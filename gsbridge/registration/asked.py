"""A board capture that a run is asked to use, looked at before any job starts.

The stage reads the same files when its turn comes. What is wrong with them is told here, in one line for whatever it is, while
whoever asked still sits before the screen.
"""

from __future__ import annotations

import math
from dataclasses import astuple
from pathlib import Path

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.reading import MOST_FILES, refusing, regular_file
from gsbridge.registration.capture import ARM_CSV, ARM_JSON, CAMERA_JSON, BoardCapture, read_board_capture

_REMEDY = "docs/registration.md describes the files"
_LARGEST = MOST_FILES * 2**10
"""Largest size of a list of poses, bytes: a kilobyte for each of as many photos as a folder of data may hold."""


def check_board_capture(folder: str | Path) -> BoardCapture:
    """Read a board capture, and refuse whatever is wrong with it.

    Args:
        folder: The photos, `arm.csv` or `arm.json`, and `camera.json`.

    Raises:
        InputError: A file cannot be read, or a number in it cannot be.
    """
    place = Path(folder)
    for name in (ARM_CSV, ARM_JSON, CAMERA_JSON):
        if (place / name).exists():
            regular_file(place / name, "file of the board capture", _REMEDY, _LARGEST)
    with refusing(place, "the board capture cannot be read", _REMEDY):
        found = read_board_capture(place)
    if found.camera is not None:
        _check_camera(found.camera, place / CAMERA_JSON)
    return found


def _check_camera(camera: Camera, source: Path) -> None:
    """Refuse intrinsics that no camera has.

    Raises:
        InputError: A number is not finite, or a size or focal length not positive.
    """
    *numbers, distortion = astuple(camera)
    sizes = {"width": camera.width, "height": camera.height, "fx": camera.fx, "fy": camera.fy}
    wrong = [f"{name} is {value:.6g}" for name, value in sizes.items() if not value > 0]
    if not all(map(_finite, [*numbers, *distortion])):
        wrong.append("a number is not finite")
    if wrong:
        raise InputError(source, f"no camera is like this: {', '.join(wrong)}", _REMEDY)


def _finite(value: float) -> bool:
    """Whether a number is one that can be computed with: JSON's whole numbers may have any length."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False
