"""Descriptions of robots and bodies that a model of the user's own names."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from gsbridge.reading import LARGEST_TEXT, refusing, regular_file


def read_description_root(path: str | Path, key: str, named_in: str | Path) -> ElementTree.Element:
    """Read the root element of a URDF or MJCF.

    Advice goes to whoever wrote the model: `gsbridge.robot.urdf.read_description` is for robots that are built here.

    Args:
        path: The file.
        key: Key of the model that names it.
        named_in: File of the model.

    Raises:
        InputError: There is no such file, it is a folder, a device or a pipe, or it is no XML.
    """
    file = regular_file(path, "description", f"Check '{key}' in {named_in}", LARGEST_TEXT)
    with refusing(path, "this is no valid XML", "Correct it, or export it again"):
        return ElementTree.parse(file).getroot()
