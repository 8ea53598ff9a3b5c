"""A cup with a handle, put together from convex pieces whose measures are known."""

from pathlib import Path

import numpy as np

from gsbridge.asset.body import MassProperties, mass_properties
from gsbridge.asset.hulls import hull_mesh
from gsbridge.asset.urdf import write_body_urdf, write_obj
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.sim.engine import Item

RADIUS, WALL, HEIGHT, FLOOR = 0.039, 0.004, 0.090, 0.006
SECTORS = 20
DENSITY = 2300.0


def pieces(radius: float = RADIUS, wall: float = WALL, height: float = HEIGHT, handle: bool = True) -> list[Array]:
    """Vertices of the floor, of the wall's sectors and of a handle to the right, body frame, m. [N, 3] each."""
    angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    out = [np.concatenate([np.c_[radius * ring, np.full(SECTORS, z)] for z in (0.0, FLOOR)])]
    for here, there in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        corners = [r * side for r in (radius - wall, radius) for side in (here, there)]
        out.append(np.array([[*corner, z] for corner in corners for z in (FLOOR, height)]))
    if handle:
        near, far = radius - 0.002, radius + 0.018
        for low, high in (
            ((near, 0.018), (far + 0.007, 0.030)),
            ((far, 0.030), (far + 0.007, 0.078)),
            ((near, 0.066), (far, 0.078)),
        ):
            out.append(np.array([[x, y, z] for x in (low[0], high[0]) for y in (-0.005, 0.005) for z in (low[1], high[1])]))
    return out


def surface(parts: list[Array]) -> Mesh:
    """The pieces' surfaces, seen from above that of their union."""
    meshes = [hull_mesh(part) for part in parts]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), faces)


def properties(parts: list[Array]) -> MassProperties:
    """Mass properties of all pieces together; where they overlap counts twice, which is little."""
    each = [mass_properties(hull_mesh(part), DENSITY) for part in parts]
    mass = sum(part.mass for part in each)
    centre = sum(part.mass * part.centre for part in each) / mass
    inertia = np.zeros((3, 3))
    for part in each:
        away = part.centre - centre
        inertia += part.inertia + part.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return MassProperties(sum(part.volume for part in each), mass, centre, inertia)


def cup(folder: Path, width: float) -> Item:
    """The cup as a body for the simulation.

    Args:
        folder: Where its files go.
        width: How far fingers must open to take it, m.
    """
    parts = pieces()
    names = [f"piece_{index:02d}.obj" for index in range(len(parts))]
    for name, part in zip(names, parts, strict=True):
        write_obj(folder / name, hull_mesh(part))
    write_body_urdf(folder / "cup.urdf", "cup", properties(parts), visual=names[0], collisions=names)
    return Item(folder / "cup.urdf", np.concatenate(parts), width)
