"""Model of a free body on a surface: shape, mass properties, contact, and the effects added to it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied, read_effects
from gsbridge.errors import InputError
from gsbridge.gap.formats.description_file import read_description_root
from gsbridge.gap.formats.yaml_file import read_yaml, stated_number
from gsbridge.geometry import Array
from gsbridge.meshes import LARGEST_MESH, read_mesh
from gsbridge.reading import load_yaml, refusing, regular_file
from gsbridge.robot.urdf import description_of, read_origin

_LARGEST = 10.0
"""Longest accepted edge of a thrown body, m; if one is longer, lengths must be in another unit."""

MOST = 1e9
"""Largest accepted value in a model, in SI units; larger ones are mistakes, and their squares would soon overflow."""

_STEEPEST = 1.5
"""Largest accepted tilt of a surface, rad."""

_FASTEST = 1e5
"""Largest accepted number of steps per second: with more, one throw takes minutes."""

MODE = "body"
"""Value of `controller.mode` for a body that nothing drives."""

CONTACT = ("friction", "restitution", "rolling_friction", "spinning_friction")
"""Keys of a model's contact, apart from its softness."""

_KEYS = (
    "urdf", "box", "mass", "centre_of_mass", "inertia", "controller", "surface", "contact", "damping", "gravity",
    "physics_rate", "effects", "evidence",
)  # fmt: skip
_LENGTHS = {
    "box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}, "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}  # fmt: skip
"""Shapes of a URDF: the attributes that give their size, and the number of values in each."""

_READ = (".obj", ".ply", ".stl")
"""File types of meshes whose size is checked here; only PyBullet reads other types."""

_SECTIONS = {
    "controller": ("mode",),
    "surface": ("height", "tilt"),
    "contact": (*CONTACT, "stiffness", "damping"),
    "damping": ("linear", "angular"),
}


@dataclass(frozen=True)
class FreeBody:
    """A body and the surface that it falls on.

    Args:
        source: File of the model, for messages.
        shapes: The body's `collision` elements, as in a URDF, with absolute paths of meshes.
        mass: Mass, kg.
        com: Centre of mass in the body frame, m. [3].
        inertia: Inertia about the centre of mass, along the axes of the body frame, kg m2. [3, 3].
        figures: Nominal contact, surface, losses and gravity, by the names in `gsbridge.gap.contact.setup.BOUNDS`.
        physics_rate: Steps of the engine per second.
        effects: Effects that the model already contains.
    """

    source: Path
    shapes: tuple[str, ...]
    mass: float
    com: Array
    inertia: Array
    figures: Mapping[str, float]
    physics_rate: float
    effects: tuple[Applied, ...] = ()

    def digest(self) -> str:
        """Return the SHA-256 of everything that a simulation depends on, except the contents of meshes."""
        parts = [self.shapes, self.mass, self.com.tolist(), self.inertia.tolist(), dict(self.figures), self.physics_rate]
        text = json.dumps([*parts, [effect.record() for effect in self.effects]], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def meshes(self) -> tuple[Path, ...]:
        """Mesh files that the shapes name."""
        elements = (ElementTree.fromstring(shape) for shape in self.shapes)
        return tuple(Path(mesh.attrib["filename"]) for element in elements for mesh in element.iter("mesh"))

    def urdf(self, mass: float, com: Array, inertia_factor: float, size: float) -> str:
        """Return a URDF of the body with these mass properties and all lengths of its shape multiplied by `size`.

        The inertia is given along its principal axes, since URDF readers differ in how they treat off-diagonal elements.

        Args:
            mass: Mass, kg.
            com: Centre of mass, body frame, m. [3].
            inertia_factor: Factor on the model's inertia, in addition to the one from the changed mass.
            size: Factor on all lengths of the shape.
        """
        moments, axes = np.linalg.eigh(self.inertia * inertia_factor * mass / self.mass)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        turn = _roll_pitch_yaw(axes)
        shapes = "".join(_scaled(text, size) for text in self.shapes)
        return (
            f'<robot name="body"><link name="body"><inertial><origin xyz="{_text(com)}" rpy="{_text(turn)}"/>'
            f'<mass value="{mass!r}"/><inertia ixx="{float(moments[0])!r}" iyy="{float(moments[1])!r}" '
            f'izz="{float(moments[2])!r}" ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link></robot>'
        )


def _roll_pitch_yaw(turn: Array) -> Array:
    """Return the roll, pitch and yaw of a rotation, rad; yaw is 0 if pitch is a right angle (gimbal lock). [3, 3] -> [3]."""
    level = np.hypot(turn[0, 0], turn[1, 0])
    pitch = np.arctan2(-turn[2, 0], level)
    if level < 1e-9:
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def _scaled(shape: str, size: float) -> str:
    """Return a `collision` element with all its lengths multiplied by `size`."""
    element = ElementTree.fromstring(shape)
    for item in element.iter():
        for key in ("xyz", "size", "radius", "length", "scale"):
            if key in item.attrib:
                item.set(key, _text(size * np.array([float(value) for value in item.attrib[key].split()])))
    return ElementTree.tostring(element, encoding="unicode")


def is_body(path: str | Path) -> bool:
    """Whether a model file describes a free body."""
    try:
        content = load_yaml(path, "model", "See docs/gap_objects.md")
    except InputError:
        return False
    controller = content.get("controller") if isinstance(content, Mapping) else None
    return isinstance(controller, Mapping) and controller.get("mode") == MODE


def read_body(path: str | Path) -> FreeBody:
    """Read the model of a free body: YAML with `urdf` or `box`, `contact` and so on; see docs/gap_objects.md.

    Raises:
        InputError: The file or the URDF cannot be read, or a key is unknown, missing or out of bounds.
    """
    path = Path(path)
    with refusing(path, "the model cannot be used", "Correct it after docs/gap_objects.md"):
        return parse_body(read_yaml(path, "model", "docs/gap_objects.md"), path.parent, path)


def parse_body(content: Any, folder: Path, source: str | Path = "model") -> FreeBody:
    """Make a free body from the content of its file.

    Args:
        content: Content of the file.
        folder: Folder that the path of its URDF is relative to.
        source: File, for messages.

    Raises:
        InputError: For the reasons listed at `read_body`.
    """
    source = Path(source)
    _check(content, _KEYS, source, "")
    sections = {name: {} if content.get(name) is None else content[name] for name in _SECTIONS}
    for name, section in sections.items():
        _check(section, _SECTIONS[name], source, f"{name}.")
    if sections["controller"].get("mode") != MODE:
        raise InputError(source, f"controller.mode is no '{MODE}'", f"State 'controller: {{mode: {MODE}}}' for a thrown body")
    if ("urdf" in content) == ("box" in content):
        raise InputError(source, "the model needs either 'urdf' or 'box'", "Give a URDF of one link, or three edges in metres")
    contact = sections["contact"]
    if "friction" not in contact:
        raise InputError(source, "contact.friction is missing", "State what your simulator uses, e.g. 0.5")
    if ("stiffness" in contact) != ("damping" in contact):
        raise InputError(source, "contact.stiffness and contact.damping go together", "State both, or none for a hard contact")
    if "box" in content:
        shapes, mass, com, inertia = _box(content, source)
    else:
        shapes, mass, com, inertia = _link(folder / str(content["urdf"]), source)
        scale = number(content.get("mass", mass), source, "mass") / mass
        mass, inertia = mass * scale, inertia * scale
    com = _row(content.get("centre_of_mass"), com, source, "centre_of_mass")
    if "inertia" in content:
        inertia = np.diag(_row(content["inertia"], np.zeros(3), source, "inertia", 0.0, MOST))
    moments = np.linalg.eigvalsh(inertia)
    if mass <= 0 or moments[0] <= 0 or moments[2] > moments[:2].sum() * (1 + 1e-6):
        raise InputError(source, f"no body has the mass {mass:g} kg and the inertia {moments.tolist()} kg m2", "Correct them")
    tilt = _row(sections["surface"].get("tilt"), np.zeros(2), source, "surface.tilt", -_STEEPEST, _STEEPEST)

    def positive(section: Mapping[str, Any], prefix: str, key: str, default: float = 0.0, high: float = MOST) -> float:
        return number(section.get(key, default), source, prefix + key, 0.0, high)

    damping = sections["damping"]
    figures = {name: positive(contact, "contact.", name, high=1.0 if name == "restitution" else MOST) for name in CONTACT}
    figures |= {
        "compliance": 1.0 / number(contact["stiffness"], source, "contact.stiffness", 1.0) if "stiffness" in contact else 0.0,
        "contact_damping": positive(contact, "contact.", "damping"),
        "height": number(sections["surface"].get("height", 0.0), source, "surface.height", -_LARGEST, _LARGEST),
        "tilt_x": float(tilt[0]),
        "tilt_y": float(tilt[1]),
        "linear_damping": positive(damping, "damping.", "linear"),
        "angular_damping": positive(damping, "damping.", "angular"),
        "gravity": positive(content, "", "gravity", 9.81),
    }
    effects = read_effects([] if content.get("effects") is None else content["effects"], source, BODY_EFFECTS)
    rate = number(content.get("physics_rate", 500.0), source, "physics_rate", 50.0, _FASTEST)
    return FreeBody(source, shapes, mass, com, inertia, figures, rate, effects)


def number(value: Any, source: str | Path, key: str, low: float = -MOST, high: float = MOST) -> float:
    """Return a number from a file after checking it.

    Args:
        value: Value as read from the file.
        source: File, for messages.
        key: Name of the value in the file, for messages.
        low, high: Smallest and largest value that is allowed.

    Raises:
        InputError: The value is not a number, or out of bounds.
    """
    return stated_number(value, low, high, key, "", source)


def _check(content: Any, known: tuple[str, ...], source: Path, prefix: str) -> None:
    """Refuse a section that is not a mapping, or has an unknown key."""
    if not isinstance(content, Mapping):
        raise InputError(source, f"'{prefix.rstrip('.') or 'the model'}' is no section", "Correct it after docs/gap_objects.md")
    for key in content:
        if key not in known:
            raise InputError(source, f"the key '{prefix}{key}' is unknown", f"Use only: {', '.join(known)}")


def _row(values: Any, default: Array, source: Path, key: str, low: float = -_LARGEST, high: float = _LARGEST) -> Array:
    """Return the numbers of a key, each within bounds; `default` if the key is missing."""
    if values is None:
        return default
    if not isinstance(values, list) or len(values) != len(default):
        raise InputError(source, f"'{key}' needs {len(default)} numbers", f"E.g. [{', '.join(['0'] * len(default))}]")
    return np.array([number(value, source, key, low, high) for value in values])


def _box(content: Mapping[str, Any], source: Path) -> tuple[tuple[str, ...], float, Array, Array]:
    """Return shapes, mass (kg), centre of mass (m) and inertia (kg m2) of a solid box."""
    edges = _row(content["box"], np.zeros(3), source, "box", -MOST, MOST)
    if "mass" not in content or (edges <= 0).any():
        raise InputError(source, "a box needs 'mass' (kg) and three edges above zero (m)", "State them")
    if edges.max() > _LARGEST:
        raise InputError(source, f"an edge of the box is {edges.max():g} m long: it looks like millimetres", "Give metres")
    mass = number(content["mass"], source, "mass")
    inertia = np.diag(mass / 12.0 * (np.sum(edges**2) - edges**2))
    return (f'<collision><geometry><box size="{_text(edges)}"/></geometry></collision>',), mass, np.zeros(3), inertia


def _link(path: Path, source: Path) -> tuple[tuple[str, ...], float, Array, Array]:
    """Read shapes, mass (kg), centre of mass (m) and inertia (kg m2) from a URDF with one link.

    Args:
        path: File of the URDF.
        source: File of the model that names it, for messages.

    Raises:
        InputError: The URDF cannot be read, or has several links, no shape or no mass.
    """
    description = description_of(read_description_root(path, "urdf", source), path)
    if len(description.links) != 1:
        raise InputError(
            path, f"the URDF has {len(description.links)} links", "A thrown body is one rigid link; merge fixed parts into it"
        )
    shapes = []
    for element in description.root.iterfind("link/collision"):
        _check_shape(element, path)
        shapes.append(ElementTree.tostring(element, encoding="unicode"))
    inertial = description.inertials.get(description.base)
    if inertial is None or not shapes:
        raise InputError(path, "the link lacks 'inertial' or 'collision'", "Add mass, inertia and a shape")
    turn = Rotation.from_euler("xyz", inertial.origin.rpy).as_matrix()
    return tuple(shapes), inertial.mass, np.array(inertial.origin.xyz), turn @ inertial.tensor @ turn.T


def _check_shape(collision: ElementTree.Element, path: Path) -> None:
    """Check a `collision` element of a URDF, and make the path of its mesh absolute.

    Raises:
        InputError: The element has not exactly one known shape, has an invalid length, or a mesh that cannot be read.
    """
    solids = [element for element in collision.findall("geometry/*") if element.tag in _LENGTHS]
    if len(solids) != 1:
        raise InputError(path, "a collision element has no shape, or several", f"Give one of {', '.join(_LENGTHS)}")
    (solid,) = solids
    with refusing(path, "a collision element has a damaged origin", "Correct it, or export the URDF again"):
        if np.abs(read_origin(collision, "collision").xyz).max() > _LARGEST:
            raise ValueError(f"it lies more than {_LARGEST:g} m away")
    if solid.tag == "mesh":
        scale = solid.get("scale", "1").split()
        solid.set("scale", " ".join(scale * 3 if len(scale) == 1 else scale))
    for key, count in _LENGTHS[solid.tag].items():
        try:
            lengths = [float(word) for word in solid.get(key, "").split()]
        except ValueError:
            lengths = []
        # The scale of a mesh may convert any unit, and may be negative (mirrored).
        sizes, most = (np.abs(lengths), MOST) if key == "scale" else (np.array(lengths), _LARGEST)
        if len(lengths) != count or not ((sizes > 0.0) & (sizes <= most)).all():
            what = f'the {solid.tag} of a collision element has {key}="{solid.get(key, "")[:80]}"'
            raise InputError(path, what, f"Give {count} of at most {most:g}, none of them zero")
    if solid.tag == "mesh":
        name = solid.get("filename", "")
        mesh = path.parent / name.removeprefix("file://").removeprefix("package://")
        remedy = f"Check the mesh that {path.name} names"
        regular_file(mesh, "mesh of the body", remedy, LARGEST_MESH)
        if mesh.suffix.lower() in _READ:
            edges = np.ptp(read_mesh(mesh, remedy).vertices, axis=0) * np.abs(lengths)
            if edges.max() > _LARGEST:
                raise InputError(
                    mesh, f"the body is {edges.max():g} m large: it looks like millimetres", f"{remedy}, and its scale"
                )
        solid.set("filename", str(mesh.resolve()))
