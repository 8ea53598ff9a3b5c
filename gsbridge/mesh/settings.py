"""Settings of the mesh stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeshSettings:
    """How meshes are made. Lengths are shares of the object's size, so that scenes of unknown scale work alike.

    Args:
        backend: Depth of objects: `sweep` (CPU), `pycolmap` (needs CUDA), `openmvs` (needs its binaries), `auto` (the best
            that is there).
        faces: Faces of an object's visual mesh, at most.
        collision_faces: Faces of the collision mesh, at most.
        background_faces: Faces of a background's visual mesh, at most.
        hull_vote: Share of the views that must agree on a point of the hull.
        hull_voxels: Samples of the hull along the object's longest side.
        image_width: Photos wider than this are shrunk for the depth, px.
        sources: Views that each depth map is compared with.
        window: Radius of the compared patch, px; every second pixel of it is used.
        stride: Every n-th pixel of a photo gets a depth.
        min_score: Least mean correlation of a depth that counts, -1..1.
        min_agree: Other depth maps that must agree with a depth.
        poisson_depth: Octree depth of the surface fit.
        solid_voxels: Samples along the longest side of the grid on which the surface is closed.
        table_size: Width and depth of a background's mesh, at most; None is as large as the views see, m.
        min_views: Views that must see a part of the table.
        relief: Largest height of a background's relief above the table, as a share of the working distance; 0 gives a plane.
    """

    backend: str = "auto"
    faces: int = 8000
    collision_faces: int = 4000
    background_faces: int = 16000
    hull_vote: float = 0.95
    hull_voxels: int = 144
    image_width: int = 960
    sources: int = 4
    window: int = 4
    stride: int = 2
    min_score: float = 0.5
    min_agree: int = 2
    poisson_depth: int = 7
    solid_voxels: int = 128
    table_size: tuple[float, float] | None = None
    min_views: int = 4
    relief: float = 0.12
