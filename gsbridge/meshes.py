"""Triangle meshes: reading, writing and the figures that stages check."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

if TYPE_CHECKING:
    # Functions import it where they use it: the import takes a second, which planning the workflow does not need to spend.
    import trimesh


LARGEST_MESH = 2**30
"""Largest size of a mesh's file, bytes: twenty million triangles."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, table frame, metres.

    Args:
        vertices: Positions of the vertices. [V, 3] float64.
        faces: Vertex indices, counter-clockwise seen from outside. [F, 3] int64.
        colours: Vertex colours, sRGB 0..1, or None. [V, 3] float32.
    """

    vertices: Array
    faces: Array
    colours: Array | None = None

    def corners(self) -> Array:
        """Triangle corners. [F, 3, 3]."""
        return self.vertices[self.faces]

    def normals(self) -> Array:
        """Unit face normals; zero for degenerate faces. [F, 3]."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        cross = np.cross(b - a, c - a)
        return cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-30)

    def areas(self) -> Array:
        """Face areas, m2. [F]."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    def volume(self) -> float:
        """Signed enclosed volume, m3 (divergence theorem); meaningful for a watertight mesh only."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    def is_watertight(self) -> bool:
        """True if every edge belongs to exactly two faces that run through it in opposite directions."""
        edges = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]])
        if len(edges) == 0:
            return False
        key = edges[:, 0] * (int(self.faces.max()) + 1) + edges[:, 1]
        reverse = edges[:, 1] * (int(self.faces.max()) + 1) + edges[:, 0]
        unique = np.unique(key)
        return len(unique) == len(key) and bool(np.array_equal(unique, np.unique(reverse)))

    def trimesh(self) -> trimesh.Trimesh:
        """This mesh as a `trimesh.Trimesh`; its vertices are neither merged nor reordered."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, process=False)


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a binary PLY, whole or not at all."""
    import trimesh

    out = mesh.trimesh()
    if mesh.colours is not None:
        rgb = np.rint(np.clip(mesh.colours, 0, 1) * 255).astype(np.uint8)
        out.visual = trimesh.visual.ColorVisuals(out, vertex_colors=np.c_[rgb, np.full(len(rgb), 255, np.uint8)])
    with atomic_file(path) as temporary:
        out.export(str(temporary), file_type="ply")


def read_mesh(path: str | Path, remedy: str = "Delete it and run the mesh stage again") -> Mesh:
    """Read a mesh (PLY, OBJ, STL).

    Args:
        path: The file.
        remedy: What the user can do about a damaged file.

    Raises:
        InputError: The file is missing, too large, damaged or holds no triangle.
    """
    import trimesh

    regular_file(path, "mesh", "Check the path, or run the mesh stage", LARGEST_MESH)
    with refusing(path, "the mesh cannot be read", remedy):
        loaded = trimesh.load(str(path), process=False, force="mesh")
        if not isinstance(loaded, trimesh.Trimesh):
            raise ValueError("it holds no triangles")
        vertices = np.asarray(loaded.vertices, dtype=np.float64)
        faces = np.asarray(loaded.faces, dtype=np.int64)
    if len(faces) == 0 or not np.isfinite(vertices).all():
        raise InputError(path, "the mesh holds no triangle or a vertex that is no number", remedy)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(path, f"a triangle of the mesh names a vertex beyond the {len(vertices)} that it holds", remedy)
    colours = None
    if isinstance(loaded.visual, trimesh.visual.ColorVisuals) and loaded.visual.kind == "vertex":
        colours = np.asarray(loaded.visual.vertex_colors)[:, :3].astype(np.float32) / 255.0
    return Mesh(vertices, faces, colours)
