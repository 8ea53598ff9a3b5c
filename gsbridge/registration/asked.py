"""A board capture that a run is asked to use, looked at before any job starts.

The stage reads the same files when its turn comes. What is wrong with them is told here, in one line for whatever it is, while
whoever asked still sits before the screen.
"""

from __future__ import annotations

from pathlib import Path

from gsbridge.reading import refusing
from gsbridge.registration.capture import BoardCapture, read_board_capture

_REMEDY = "docs/registration.md describes the files"


def check_board_capture(folder: str | Path) -> BoardCapture:
    """Read a board capture, and refuse whatever is wrong with it.

    Args:
        folder: The photos, `arm.csv` or `arm.json`, and `camera.json`.

    Raises:
        InputError: A file cannot be read, or a number in it cannot be.
    """
    place = Path(folder)
    with refusing(place, "the board capture cannot be read", _REMEDY):
        return read_board_capture(place)
