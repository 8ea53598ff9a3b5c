"""Settings of the choice of keyframes."""

from __future__ import annotations

from pydantic import Field

from gsbridge.configuration.base import Number, Settings, Share, Whole


class KeyframeSettings(Settings):
    """Limits of the choice of keyframes."""

    count: Whole = Field(default=50, ge=3, le=2000)
    """Keyframes wanted from a video."""
    min_sharpness: Number = Field(default=10.0, ge=0)
    """Variance of the Laplacian below which a frame is dropped, grey levels squared, at 640 px width."""
    min_step: Share = 0.008
    """Least image motion between two keyframes of a video, as a share of the image's width."""
    min_motion: Number = Field(default=0.15, ge=0)
    """Least image motion over a whole video, as a share of the image's width."""
    min_brightness: Number = Field(default=8.0, ge=0, le=255)
    """Mean grey level below which a frame counts as black, 0..255."""
    max_side: Whole = Field(default=1600, ge=64, le=10_000)
    """Longer side of the stored frames, px; larger photos are scaled down."""
