"""Small simulated worlds for the tests."""

from functools import cache
from pathlib import Path

import numpy as np
import yaml
from robot_fixture import _FOLDER, robot

from gsbridge.asset.body import mass_properties
from gsbridge.asset.hulls import hull_mesh
from gsbridge.asset.urdf import write_body_urdf, write_obj
from gsbridge.sim.engine import Item
from gsbridge.sim.model import Model, parse_model
from gsbridge.sim.world import SimWorld

NOMINAL = Path(__file__).resolve().parents[2] / "models" / "nominal.yaml"
EDGE = 0.058


def content() -> dict:
    """Content of the nominal model file, a fresh copy."""
    return yaml.safe_load(NOMINAL.read_text(encoding="utf-8"))


def model(**changes) -> Model:
    """The nominal model with some values changed; double underscores separate sections."""
    values = content()
    for path, value in changes.items():
        *sections, key = path.split("__")
        place = values
        for section in sections:
            place = place[section]
        assert key in place, path
        place[key] = value
    return parse_model(values, "test")


def _write(name: str, shape: str, centre: float, mass: float, inertia: float) -> Path:
    path = Path(_FOLDER.name) / f"{name}.urdf"
    path.write_text(
        f"""<robot name="{name}"><link name="body"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>
        <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><origin xyz="0 0 {centre}"/><geometry>{shape}</geometry></collision></link></robot>"""
    )
    return path


@cache
def cube() -> Item:
    """A cube of 58 mm and 117 g, standing on its footprint."""
    mass, half = 600.0 * EDGE**3, EDGE / 2
    points = np.array([(x, y, z) for x in (-half, half) for y in (-half, half) for z in (0, EDGE)])
    return Item(_write("cube", f'<box size="{EDGE} {EDGE} {EDGE}"/>', half, mass, mass * EDGE**2 / 6), points, EDGE)


@cache
def ball() -> Item:
    """A ball of the same size."""
    radius = EDGE / 2
    mass = 600.0 * 4 / 3 * np.pi * radius**3
    return Item(_write("ball", f'<sphere radius="{radius}"/>', radius, mass, 0.4 * mass * radius**2), cube().points, EDGE)


def hull(folder: Path) -> Item:
    """The cube as a hull, as assets are, with a tilted lid and two sides that are not quite parallel."""
    points = cube().points * np.where(cube().points[:, :1] > 0, 1.0, [[1.0, 0.98, 0.97]])
    write_obj(folder / "hull.obj", hull_mesh(points))
    path = folder / "hull.urdf"
    write_body_urdf(path, "hull", mass_properties(hull_mesh(points), 600.0), visual="hull.obj", collisions=["hull.obj"])
    return Item(path, points, EDGE)


def slab(folder: Path) -> Path:
    """A static body of triangles, 6 mm high, over the whole start region."""
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (0.065, 0.465) for z in (-0.01, 0.006)]
    faces = [(1, 2, 4), (1, 4, 3), (5, 8, 6), (5, 7, 8), (1, 6, 2), (1, 5, 6), (3, 4, 8), (3, 8, 7), (2, 6, 8), (2, 8, 4)]
    (folder / "slab.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c}\n" for a, b, c in faces)
    )
    (folder / "slab.urdf").write_text(
        '<robot name="slab"><link name="body" concave="yes"><inertial><mass value="0"/>'
        '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision concave="yes"><geometry><mesh filename="slab.obj"/></geometry></collision></link></robot>'
    )
    return folder / "slab.urdf"


def world(item: Item | None = None, *, plate: Path | None = None, **changes) -> SimWorld:
    """A world with the nominal model, changed as asked."""
    return SimWorld(robot(), item or cube(), model(**changes), plate=plate)
