"""The body of an object: its frame, and its mass properties from its volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh


@dataclass(frozen=True)
class MassProperties:
    """Mass properties of a rigid body of uniform density.

    Args:
        volume: Volume, m3.
        mass: Mass, kg.
        centre: Centre of mass, body frame, m. [3].
        inertia: Inertia about the centre of mass, body axes, kg m2. [3, 3].
    """

    volume: float
    mass: float
    centre: Array
    inertia: Array


def mass_properties(mesh: Mesh, density: float) -> MassProperties:
    """Exact mass, centre of mass and inertia of a closed mesh of uniform density.

    Args:
        mesh: Watertight, faces counter-clockwise seen from outside, m.
        density: kg/m3.

    Raises:
        ValueError: The mesh encloses no volume, or is not watertight.

    Source: every face spans a tetrahedron with one fixed point, whose moments are polynomials of its corners (Mirtich, "Fast
    and accurate computation of polyhedral mass properties", 1996, by tetrahedra instead of projections).
    """
    if not mesh.is_watertight():
        raise ValueError("mass properties need a watertight mesh")
    # With the middle of the mesh as the fixed point the tetrahedra are small, and little precision is lost to cancellation.
    origin = 0.5 * (mesh.vertices.min(0) + mesh.vertices.max(0))
    a, b, c = np.moveaxis(mesh.corners() - origin, 1, 0)
    determinant = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = float(determinant.sum() / 6.0)
    if not volume > 0:
        raise ValueError("the mesh encloses no volume; its faces may be turned inside out")
    total = a + b + c
    centre = (determinant @ total) / (24.0 * volume)
    corners = np.stack([a, b, c, total])
    second = np.einsum("f,kfi,kfj->ij", determinant, corners, corners) / 120.0 - volume * np.outer(centre, centre)
    inertia = density * (np.trace(second) * np.eye(3) - second)
    return MassProperties(volume, density * volume, centre + origin, 0.5 * (inertia + inertia.T))


def body_from_table(mesh: Mesh) -> Array:
    """Transform to the body frame: centre of the footprint's bounds at the origin, z = 0 on the table, axes of the table frame.

    Args:
        mesh: Object, table frame, m.

    Returns:
        [4, 4].
    """
    low, high = mesh.vertices[:, :2].min(0), mesh.vertices[:, :2].max(0)
    out = np.eye(4)
    out[:2, 3] = -0.5 * (low + high)
    return out


def narrowest_width(vertices: Array) -> float:
    """Smallest distance, m, between two upright parallel planes that enclose all points: the opening that a gripper needs.

    Args:
        vertices: Vertices of the object, m. [N, 3].

    Source: the narrowest strip has an edge of the convex polygon on one side (Houle and Toussaint, 1988).
    """
    polygon = vertices[ConvexHull(vertices[:, :2]).vertices, :2]
    edges = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    return float(np.ptp(polygon @ normals.T, axis=0).min())
