"""Settings of the meshes."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gsbridge.configuration.base import Number, OrNull, Positive, Settings, Share, Whole


class MeshSettings(Settings):
    """How meshes are made. Lengths are shares of the object's size, so that scenes of unknown scale work alike."""

    backend: Literal["auto", "sweep", "pycolmap", "openmvs"] = "auto"
    """Method that measures the depth of objects: `sweep` (CPU), `pycolmap` (needs CUDA), `openmvs` (needs its binaries), or
    `auto`, the best that this machine has."""
    faces: Whole = Field(default=8000, ge=100, le=10_000_000)
    """Largest number of faces of an object's visual mesh."""
    collision_faces: Whole = Field(default=4000, ge=100, le=1_000_000)
    """Largest number of faces of a collision mesh."""
    background_faces: Whole = Field(default=16_000, ge=100, le=10_000_000)
    """Largest number of faces of a background's visual mesh."""
    hull_vote: Share = 0.95
    """Share of the views that must agree on a point of the hull."""
    hull_voxels: Whole = Field(default=144, ge=16, le=1024)
    """Samples of the hull along the object's longest side."""
    image_width: Whole = Field(default=960, ge=64, le=10_000)
    """Photos wider than this are shrunk for the depth, px."""
    sources: Whole = Field(default=4, ge=1, le=20)
    """Views that each depth map is compared with."""
    window: Whole = Field(default=4, ge=1, le=20)
    """Radius of the compared patch, px; every second pixel of it is used."""
    stride: Whole = Field(default=2, ge=1, le=16)
    """Every n-th pixel of a photo gets a depth."""
    min_score: Number = Field(default=0.5, ge=-1, le=1)
    """Least mean correlation of a depth that counts, -1..1."""
    min_agree: Whole = Field(default=2, ge=1, le=20)
    """Number of other depth maps that must agree with a depth."""
    poisson_depth: Whole = Field(default=7, ge=3, le=12)
    """Octree depth of the surface fit."""
    solid_voxels: Whole = Field(default=128, ge=16, le=1024)
    """Samples along the longest side of the grid on which the surface is closed."""
    table_size: OrNull[tuple[Positive, Positive]] = None
    """Largest width and depth of a background's mesh, m; null takes all that the views see."""
    min_views: Whole = Field(default=4, ge=1, le=1000)
    """Views that must see a part of the table."""
    relief: Share = 0.12
    """Largest height of a background's relief above the table, as a share of the working distance; 0 gives a plane."""
