"""What a model's mechanism is described by: a URDF, or an MJCF of MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.formats.description_file import read_description_root
from gsbridge.geometry import Array
from gsbridge.robot.mjcf import description_of_mjcf, is_mjcf
from gsbridge.robot.urdf import Description, description_of


@dataclass(frozen=True)
class Stated:
    """What MJCF says besides, and URDF cannot.

    Args:
        gravity: Acceleration in the base frame, m/s2; None where nothing is said. [3].
        armature: Inertia of rotor and gear by joint, kg m2 (of joints that slide kg).
    """

    gravity: Array | None
    armature: dict[str, float]


def read_mechanism_description(path: str | Path, key: str = "urdf", named_in: str | Path = "the model") -> Description:
    """Read a description of either kind.

    Args:
        path: The file.
        key: Key of the model that names it, for messages.
        named_in: File of the model, for messages.

    Raises:
        InputError: As `gsbridge.robot.urdf.read_description` and `gsbridge.robot.mjcf.description_of_mjcf`.
    """
    root = read_description_root(path, key, named_in)
    if any(isinstance(element.tag, str) and "wiki/xacro}" in element.tag for element in root.iter()) or any(
        "${" in value for element in root.iter() for value in element.attrib.values()
    ):
        plain = Path(path).name.removesuffix(".xacro").removesuffix(".urdf")
        raise InputError(path, "this is a xacro file", f"Expand it first: xacro {Path(path).name} > {plain}_expanded.urdf")
    return description_of(description_of_mjcf(path) if is_mjcf(root) else root, path)


def stated_besides(description: Description) -> Stated:
    """What a description says that URDF cannot."""
    root = description.root
    gravity = root.get("gravity")
    losses = {str(joint.get("name")): joint.find("dynamics") for joint in root.findall("joint")}
    armature = {name: float(element.get("armature", 0.0)) for name, element in losses.items() if element is not None}
    return Stated(None if gravity is None else np.array([float(value) for value in gravity.split()]), armature)


def description_bytes(path: Path) -> bytes:
    """All that a description says, for digests: of MJCF what MuJoCo makes of it, since it may include other files."""
    return ElementTree.tostring(description_of_mjcf(path)) if _is_mjcf(path) else path.read_bytes()


def _is_mjcf(path: str | Path) -> bool:
    """Whether a file is MJCF; what cannot be read is none."""
    try:
        return is_mjcf(ElementTree.parse(path).getroot())
    except (OSError, ElementTree.ParseError, LookupError, ValueError):
        return False
