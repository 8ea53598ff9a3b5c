"""Settings of the masks."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gsbridge.configuration.base import OrNull, Settings, Share, Whole


class MaskSettings(Settings):
    """Segmentation of objects in photos. Lengths are shares of the working distance, so that scenes of unknown scale work
    alike."""

    backend: Literal["grabcut", "sam2"] = "grabcut"
    """Method of segmentation: `grabcut`, which needs no weights, or `sam2`."""
    sam2_weights: OrNull[str] = None
    """Folder with a `Sam2VideoModel` saved by transformers, for the `sam2` backend only; relative to the directory snakemake
    runs in."""
    crop_px: Whole = Field(default=360, ge=32, le=4096)
    """Longest side of the image part on which GrabCut runs, px."""
    iterations: Whole = Field(default=3, ge=1, le=50)
    """GrabCut iterations of each pass."""
    passes: Whole = Field(default=3, ge=1, le=10)
    """Passes after the first. Each segments again within a band round the hull of the masks of the pass before."""
    hull_vote: Share = 0.84
    """Share of the views that must agree on a point of the first hull."""
    strict_vote: Share = 0.94
    """Share of the views that must agree on a point of the hulls of later passes."""
    subtractions: Whole = Field(default=2, ge=0, le=10)
    """Times the masks are compared with the bare table that the other photos show."""
    hull_voxels: Whole = Field(default=96, ge=16, le=512)
    """Samples along the longest side of the hull's grid."""
    height_share: Share = 0.008
    """Least height of an object point above the table."""
    min_points: Whole = Field(default=8, ge=1, le=10_000)
    """Fewest object points for a prompt."""
    min_consistency: Share = 0.85
    """Mean IoU of masks and reprojected hull below which the result is degraded."""
