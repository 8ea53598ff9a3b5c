"""Settings of the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SfmSettings:
    """Limits and budgets of one reconstruction.

    Args:
        max_features: SIFT features per image.
        peak_threshold: SIFT contrast floor; below COLMAP's default, which starves on plain surfaces.
        overlap: Neighbours each frame of an ordered capture is matched with, beside those at powers of two.
        exhaustive_up_to: Unordered captures are matched exhaustively; ordered ones up to this many images in a retry.
        pass_share: Share of registered images from which the result passes.
        degraded_share: Share below which the stage fails.
        tag_refinement: Refine the model with the tag corners as points of known layout.
    """

    max_features: int = 4096
    peak_threshold: float = 0.002
    overlap: int = 10
    exhaustive_up_to: int = 150
    pass_share: float = 0.95
    degraded_share: float = 0.6
    tag_refinement: bool = True
