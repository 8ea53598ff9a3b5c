"""The true objects as rigid bodies: mesh, mass, contact pieces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from gsbridge.asset.body import body_from_table as true_body_from_table
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.objects import make_object
from gsbridge.reality.mirror.path import OBJECT_SPOT_M
from gsbridge.reality.mirror.studio import SCENES, placed
from gsbridge.reality.world.pieces import convex_pieces
from gsbridge.robot.links import convex_hull

DENSITIES = {
    "small_cube": 600.0,  # wood
    "cake": 350.0,  # sponge cake
    "banana": 950.0,  # fruit
    "bear": 120.0,  # plush
    "mug": 2300.0,  # stoneware
    "bowl": 2300.0,
    "pot": 1900.0,  # terracotta
    "statue": 2600.0,  # marble
    "toy": 950.0,  # plastic
    "white_box": 150.0,  # an empty box of cardboard
}
"""Densities of the true objects before the hidden factor, kg/m3: bulk density, for vessels the density of their walls."""

_CONTACT_DETAIL, _MASS_DETAIL = 4.0, 2.0
"""Vertex spacing of the meshes for contact and mass, as a multiple of the spacing in films; vertices lie on the surface, so few
suffice."""

_NEIGHBOURS, _REACH = 6, 6e-4
"""Number of the film mesh's vertices that are averaged for a vertex's colour, and width of their weights, m: the spacing of
vertices in films."""


def body_mesh(name: str, seed: int, detail: float) -> tuple[Mesh, Array]:
    """Return a true object in its body frame, which follows the rule for assets: turned as in its film, footprint centre at 0.

    Args:
        name: One of the mirror's objects.
        seed: Seed of the world's textures and shapes.
        detail: Spacing of the mesh as a multiple of 0.6 to 0.7 mm; see `make_object`.

    Returns:
        The mesh, m, with linear colours, and the vertex normals. [V, 3].

    Raises:
        InputError: The name is unknown.
    """
    mesh, normals = make_object(name, seed, detail)
    mesh, normals = placed(mesh, normals, (0.0, 0.0), SCENES[name][2])
    shift = true_body_from_table(mesh)[:3, 3]
    return Mesh(mesh.vertices + np.array([shift[0], shift[1], 0.0]), mesh.faces, mesh.colours), normals


@cache
def shown_mesh(name: str, seed: int, detail: float) -> tuple[Mesh, Array]:
    """Return a true object as `body_mesh` does, in the colours that it has in its film.

    Colours are painted at the vertices of a mesh, so a mesh of another detail would have another pattern, such as other
    sprinkles on the cake. Colours are therefore taken from the film's mesh and averaged around each vertex.

    Args:
        name: One of the mirror's objects.
        seed: Seed of the world's textures and shapes.
        detail: Spacing of the mesh as a multiple of 0.6 to 0.7 mm; see `make_object`.

    Returns:
        The mesh, m, with linear colours, and the vertex normals. [V, 3].

    Raises:
        InputError: The name is unknown.
    """
    mesh, normals = body_mesh(name, seed, detail)
    return repainted(mesh, body_mesh(name, seed, 1.0)[0]), normals


def repainted(mesh: Mesh, filmed: Mesh) -> Mesh:
    """Return a mesh with the film mesh's colours, averaged around each vertex. Both meshes have the same frame."""
    distances, nearest = cKDTree(filmed.vertices).query(mesh.vertices, _NEIGHBOURS)
    weights = np.exp(-((distances / _REACH) ** 2)) + 1e-12
    weights /= weights.sum(1, keepdims=True)
    assert filmed.colours is not None  # all that is made for the mirror is coloured
    colours = np.einsum("vk,vkc->vc", weights, filmed.colours[nearest])
    return Mesh(mesh.vertices, mesh.faces, colours.astype(np.float32))


def true_from_body(name: str, seed: int, body_from_table: Array) -> Array:
    """Return the pose of a reconstruction's body frame in the true object's body frame.

    Both frames have the axes of the film's table and their origin in the middle of a footprint. The reconstructed footprint
    differs from the true one; the tips of a banana, for example, are hard to see. This transform is needed to put the true
    object where a simulated one stands.

    Args:
        name: One of the mirror's objects.
        seed: Seed of the world's textures and shapes.
        body_from_table: Body frame of the reconstruction, from its film's table frame (`asset.json`), m. [4, 4].

    Returns:
        `true_from_body`, m. [4, 4].

    Raises:
        InputError: The name is unknown.
    """
    mesh, normals = make_object(name, seed, _MASS_DETAIL)
    mesh, _ = placed(mesh, normals, OBJECT_SPOT_M, SCENES[name][2])
    return np.asarray(true_body_from_table(mesh) @ np.linalg.inv(body_from_table))


@dataclass(frozen=True)
class TrueBody:
    """A true object in its body frame: footprint centre at the origin, standing on z = 0; m, kg.

    Args:
        name: Name of the body.
        mass: Mass, kg.
        centre: Centre of mass, m. [3].
        inertia: Inertia about the centre of mass, kg m2. [3, 3].
        hull: Vertices of the convex hull, m. [H, 3].
        pieces: Vertices of the convex pieces, m. [N, 3] each.
    """

    name: str
    mass: float
    centre: Array
    inertia: Array
    hull: Array
    pieces: list[Array]


def true_body(
    name: str, seed: int, mass_factor: float, folder: str | Path, aside: tuple[float, float] = (0.0, 0.0)
) -> TrueBody:
    """Build a true object of even density, whose centre of mass may be shifted to one side.

    Args:
        name: One of the mirror's objects.
        seed: Seed of the world's textures and shapes.
        mass_factor: Hidden factor on the object's mass.
        folder: Folder in which convex pieces are cached.
        aside: Shift of the centre of mass along x and y, as a share of the object's width. [2].

    Raises:
        InputError: The name is unknown.
    """
    mesh, _ = body_mesh(name, seed, _MASS_DETAIL)
    coarse, _ = body_mesh(name, seed, _CONTACT_DETAIL)
    even = body_of(name, mesh, DENSITIES[name] * mass_factor, convex_pieces(Mesh(coarse.vertices, coarse.faces), folder))
    # The inertia about the centre of mass is kept: a heavy side changes it by only a few percent.
    return replace(even, centre=even.centre + np.append(np.asarray(aside) * np.ptp(even.hull[:, :2], axis=0), 0.0))


def body_of(name: str, mesh: Mesh, density: float, pieces: list[Array]) -> TrueBody:
    """Build a body of even density.

    Args:
        name: Name of the body.
        mesh: Closed mesh in the body's own frame, m.
        density: Density, kg/m3.
        pieces: Vertices of the convex pieces that represent the body in contact, m. [N, 3] each.
    """
    solid = mesh.trimesh()
    solid.density = density
    return TrueBody(
        name,
        float(solid.mass),
        np.array(solid.center_mass),
        np.array(solid.moment_inertia),
        convex_hull(mesh.vertices).vertices,
        pieces,
    )
