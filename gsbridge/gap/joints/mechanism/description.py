"""Reading of the description of a mechanism: a URDF, or an MJCF of MuJoCo."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.formats.description_file import read_description_root
from gsbridge.geometry import Array
from gsbridge.meshes import LARGEST_MESH
from gsbridge.reading import refusing, regular_file
from gsbridge.robot.mjcf import description_of_mjcf, is_mjcf
from gsbridge.robot.mjcf_files import mjcf_named
from gsbridge.robot.urdf import Description, description_of

MOST_ELEMENTS = 100_000
"""Largest number of elements of an MJCF, where an element that is repeated counts each time."""

MOST_CELLS = 100_000_000
"""Largest number of values of a height field, and of pixels of a texture: some hundred megabytes."""


@dataclass(frozen=True)
class Stated:
    """Figures that an MJCF can state and a URDF cannot.

    Args:
        gravity: Acceleration in the base frame, m/s2; None where the file does not state it. [3].
        armature: Inertia of rotor and gear by joint, kg m2 (kg for joints that slide).
    """

    gravity: Array | None
    armature: dict[str, float]


def read_mechanism_description(path: str | Path, key: str = "urdf", named_in: str | Path = "the model") -> Description:
    """Read a description of either kind.

    Args:
        path: The file.
        key: Key of the model that names the file, for messages.
        named_in: File of the model, for messages.

    Raises:
        InputError: As `gsbridge.robot.urdf.read_description` and `gsbridge.robot.mjcf.description_of_mjcf`.
    """
    root = read_description_root(path, key, named_in)
    if is_mjcf(root):
        _refuse_giants(root, path)
        _check_named(path, key, named_in)
        with refusing(path, "MuJoCo cannot read it", "Correct the MJCF"):
            root = description_of_mjcf(path)
    return description_of(root, path)


def _check_named(path: str | Path, key: str, named_in: str | Path) -> None:
    """Check the files that an MJCF, or a file that it includes, names, before MuJoCo opens them.

    Args:
        path: The MJCF.
        key: Key of the model that names the MJCF, for messages.
        named_in: File of the model, for messages.

    Raises:
        InputError: A file is a device or a pipe, or is too large, or an included file is no XML.
    """
    for other in mjcf_named(path):
        if other.suffix == ".xml":
            _refuse_giants(read_description_root(other, key, named_in), other)
        elif not other.is_dir():
            regular_file(other, "file that the MJCF names", "Correct the MJCF", LARGEST_MESH)


def _refuse_giants(root: ElementTree.Element, source: str | Path) -> None:
    """Refuse an MJCF whose few words stand for more than any mechanism has: MuJoCo would work on it without end.

    Args:
        root: Root element of the description or of an included file.
        source: File, for the message.

    Raises:
        InputError: Repetitions stand for more than `MOST_ELEMENTS` elements, or a grid or a picture has more than
            `MOST_CELLS` values.
    """
    elements, waiting = 0, [(root, 1)]
    while waiting:
        element, times = waiting.pop()
        elements += times
        times *= _product(element.get("count", ""))
        waiting += [(child, times) for child in element]
        cells = max(_product(f"{element.get(a, '')} {element.get(b, '')}") for a, b in (("nrow", "ncol"), ("width", "height")))
        if max(elements, times) > MOST_ELEMENTS or cells > MOST_CELLS:
            raise InputError(source, f"its <{element.tag}> stands for more than a mechanism has", "Leave it out of the MJCF")


def _product(numbers: str) -> int:
    """Multiply the whole numbers in a text; other words count as one, since MuJoCo reports them itself."""
    return math.prod(max(int(word), 1) for word in numbers.split() if re.fullmatch(r"\d{1,18}", word))


def stated_besides(description: Description) -> Stated:
    """Read the figures of a description that URDF cannot state."""
    root = description.root
    gravity = root.get("gravity")
    losses = {str(joint.get("name")): joint.find("dynamics") for joint in root.findall("joint")}
    armature = {name: float(element.get("armature", 0.0)) for name, element in losses.items() if element is not None}
    return Stated(None if gravity is None else np.array([float(value) for value in gravity.split()]), armature)


def description_bytes(path: Path) -> bytes:
    """Return all that a description says, for digests; an MJCF is converted by MuJoCo, since it may include other files."""
    return ElementTree.tostring(description_of_mjcf(path)) if _is_mjcf(path) else path.read_bytes()


def _is_mjcf(path: str | Path) -> bool:
    """Tell whether a file is MJCF; a file that cannot be read is not."""
    try:
        return is_mjcf(ElementTree.parse(path).getroot())
    except (OSError, ElementTree.ParseError, LookupError, ValueError):
        return False
