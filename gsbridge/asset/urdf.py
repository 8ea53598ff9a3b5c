"""Writing bodies as URDF, with their meshes as OBJ, to the same bytes every time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from gsbridge.asset.body import MassProperties
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh


def write_obj(path: str | Path, mesh: Mesh) -> None:
    """Write a Wavefront OBJ in metres, to a tenth of a micrometre, whole or not at all. Colours are left out."""
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in mesh.vertices + 0.0]  # + 0.0: no negative zeros
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    with atomic_file(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")


def _numbers(values: Array) -> str:
    return quoteattr(" ".join(f"{value:.9g}" for value in np.asarray(values) + 0.0))


def _geometry(kind: str, mesh: str, concave: bool = False) -> list[str]:
    return [
        f"    <{kind}{' concave=' + quoteattr('yes') if concave else ''}>",
        "      <geometry>",
        f"        <mesh filename={quoteattr(mesh)}/>",
        "      </geometry>",
        f"    </{kind}>",
    ]


def write_body_urdf(
    path: str | Path, name: str, properties: MassProperties | None, *, visual: str, collisions: Sequence[str]
) -> None:
    """Write a URDF of one link, `body`, whose frame is the body frame.

    Args:
        path: The URDF.
        name: Name of the robot element.
        properties: Mass, centre of mass and inertia; None makes a static body, whose collision meshes are taken as concave.
        visual: Mesh that is shown, relative to the URDF.
        collisions: Meshes that touch, relative to the URDF; convex unless the body is static.
    """
    static = properties is None
    mass = 0.0 if properties is None else properties.mass
    centre = np.zeros(3) if properties is None else properties.centre
    inertia = np.zeros((3, 3)) if properties is None else properties.inertia
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    tensor = " ".join(f"{key}={_numbers(inertia[index][None])}" for key, index in entries.items())
    lines = [
        '<?xml version="1.0"?>',
        f"<robot name={quoteattr(name)}>",
        # Bullet makes a triangle mesh of an OBJ only if the link is marked as concave, too.
        f'  <link name="body"{" concave=" + quoteattr("yes") if static else ""}>',
        "    <inertial>",
        f'      <origin xyz={_numbers(centre)} rpy="0 0 0"/>',
        f"      <mass value={_numbers(np.array([mass]))}/>",
        f"      <inertia {tensor}/>",
        "    </inertial>",
        *_geometry("visual", visual),
    ]
    for collision in collisions:
        lines += _geometry("collision", collision, concave=static)
    lines += ["  </link>", "</robot>"]
    with atomic_file(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
