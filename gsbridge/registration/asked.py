"""Check of the board capture that a run is asked to use, made before any job starts.

The stage reads the same files later. This early check reports any fault in them as one line while the user who started the run
is still at the screen.
"""

from __future__ import annotations

from pathlib import Path

from gsbridge.reading import refusing
from gsbridge.registration.capture import BoardCapture, read_board_capture

_REMEDY = "docs/registration.md describes the files"


def check_board_capture(folder: str | Path) -> BoardCapture:
    """Read a board capture and report any fault in it as an `InputError`.

    Args:
        folder: The photos, `arm.csv` or `arm.json`, and `camera.json`.

    Raises:
        InputError: A file cannot be read, or holds a value that is not possible.
    """
    place = Path(folder)
    with refusing(place, "the board capture cannot be read", _REMEDY):
        return read_board_capture(place)
