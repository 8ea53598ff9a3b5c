"""Robot and body descriptions (URDF, MJCF) that a user's model names."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from gsbridge.reading import LARGEST_TEXT, refusing, regular_file


def read_description_root(path: str | Path, key: str, named_in: str | Path) -> ElementTree.Element:
    """Read the root element of a URDF or MJCF.

    Error messages address the user who wrote the model. For robots that gsbridge builds itself there is
    `gsbridge.robot.urdf.read_description`.

    Args:
        path: The file.
        key: Key in the model's file that names it, for messages.
        named_in: File of the model, for messages.

    Raises:
        InputError: There is no such file, it is a folder, a device or a pipe, or it is not XML.
    """
    file = regular_file(path, "description", f"Check '{key}' in {named_in}", LARGEST_TEXT)
    with refusing(path, "this is no valid XML", "Correct it, or export it again"):
        return ElementTree.parse(file).getroot()
