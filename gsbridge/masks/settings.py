"""Settings of the masks stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MaskSettings:
    """How objects are cut out. Lengths are shares of the working distance, so that scenes of unknown scale work alike.

    Args:
        backend: `grabcut` (no weights) or `sam2`.
        sam2_weights: Folder with a `Sam2VideoModel` saved by transformers; for the `sam2` backend only.
        crop_px: Longest side of the image part on which GrabCut runs, px.
        iterations: GrabCut iterations of each pass.
        passes: Passes after the first: each cuts again within a band round the hull of the masks before.
        hull_vote: Share of the views that must agree on a point of the first hull.
        strict_vote: The same for the hulls of later passes.
        subtractions: Times the masks are compared with the bare table that the other photos show.
        hull_voxels: Samples along the longest side of the hull's grid.
        height_share: Least height of an object point above the table.
        min_points: Fewest object points for a prompt.
        min_consistency: Mean IoU of masks and reprojected hull below which the result is degraded.
    """

    backend: str = "grabcut"
    sam2_weights: str | None = None
    crop_px: int = 360
    iterations: int = 3
    passes: int = 3
    hull_vote: float = 0.84
    strict_vote: float = 0.94
    subtractions: int = 2
    hull_voxels: int = 96
    height_share: float = 0.008
    min_points: int = 8
    min_consistency: float = 0.85
