"""Settings of the reconstruction of the cameras."""

from __future__ import annotations

from pydantic import Field

from gsbridge.configuration.base import Positive, Settings, Share, Switch, Whole


class SfmSettings(Settings):
    """Limits and budgets of one reconstruction."""

    max_features: Whole = Field(default=4096, ge=100, le=100_000)
    """SIFT features per image."""
    peak_threshold: Positive = Field(default=0.002, le=1)
    """Smallest contrast of a SIFT feature. The default is below that of COLMAP, which finds too little on plain surfaces."""
    overlap: Whole = Field(default=10, ge=1, le=1000)
    """Number of neighbours that each frame of an ordered capture is matched with, besides the frames at distances of powers of
    two."""
    neighbours_from: Whole = Field(default=40, ge=3)
    """Fewest images of an unordered capture that are matched with their neighbours by name first, and exhaustively only where
    one stays unregistered."""
    exhaustive_up_to: Whole = Field(default=150, ge=0)
    """Most images of an ordered capture that are matched exhaustively, once matching neighbours has failed."""
    pass_share: Share = 0.95
    """Share of registered images from which the result passes."""
    degraded_share: Share = 0.6
    """Share of registered images below which the stage fails; between the two shares the result is degraded."""
    tag_refinement: Switch = True
    """Refine the model with the tag corners as points of known layout."""
