"""A mesh seen from four sides and from above, shaded by its own shape."""

from __future__ import annotations

import numpy as np

from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import mesh_depth

SIDES = {"front": (-90.0, 20.0), "right": (0.0, 20.0), "back": (90.0, 20.0), "left": (180.0, 20.0), "above": (-90.0, 75.0)}
"""Azimuth and height of the eye, degrees; the front looks along +y of the table frame."""

_FIELD_DEG = 22.0
_PAPER, _DARK, _LIGHT = (246, 248, 250), (40, 66, 84), (214, 228, 236)


def draw_sides(mesh: Mesh, size: int) -> Array:
    """Draw all sides beside one another, at one scale.

    Args:
        mesh: Table frame, m.
        size: Width and height of each picture, px.

    Returns:
        [size, 5 size, 3] uint8 RGB.
    """
    middle = 0.5 * (mesh.vertices.min(0) + mesh.vertices.max(0))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    focal = 0.5 * size / np.tan(np.radians(0.5 * _FIELD_DEG))
    camera = Camera(size, size, focal, focal, 0.5 * size, 0.5 * size)
    distance = 1.06 * radius / np.sin(np.radians(0.5 * _FIELD_DEG))
    return np.concatenate([_shaded(mesh, camera, _pose(middle, distance, *side)) for side in SIDES.values()], axis=1)


def _pose(middle: Array, distance: float, azimuth_deg: float, height_deg: float) -> Array:
    """`cam_from_table` of an eye at some distance that looks at the middle."""
    azimuth, height = np.radians(azimuth_deg), np.radians(height_deg)
    towards = np.array([np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)])
    return look_at(middle + distance * towards, middle)


def _shaded(mesh: Mesh, camera: Camera, pose: Array) -> Array:
    """Draw the mesh, lit from the eye's upper left, on light paper. [H, W, 3] uint8."""
    depth = mesh_depth(mesh.vertices, mesh.faces, camera, pose).astype(np.float64)
    inside = np.isfinite(depth)
    points = camera.pixel_rays() * np.where(inside, depth, 0.0)[..., None]
    # Normals come from the depth picture, not from the faces, so that open or inside-out surfaces look as they are seen.
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normal = np.cross(down, across)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    light = np.array([-0.45, -0.6, -0.66])
    shade = np.clip(normal @ (light / np.linalg.norm(light)), 0.0, 1.0)[..., None]
    colour = np.array(_DARK) * (1 - shade) + np.array(_LIGHT) * shade
    return np.where(inside[..., None], colour, np.array(_PAPER)).round().astype(np.uint8)
