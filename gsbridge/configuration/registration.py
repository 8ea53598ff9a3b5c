"""Settings of the registration."""

from __future__ import annotations

from pydantic import Field

from gsbridge.configuration.base import Number, Positive, Settings, Whole


class RegistrationSettings(Settings):
    """Limits of the registration."""

    min_poses: Whole = Field(default=8, ge=5, le=1000)
    """Poses of the arm below which the stage fails."""
    min_turn_deg: Number = Field(default=4.0, ge=0, le=90)
    """Spread of the hand's turns about a second axis below which the stage fails, standard deviation, degrees."""
    gate_px: Positive = 1.5
    """Reprojection error of a photo's own board pose above which tags and then the photo are left out, px."""
    max_residual_px: Positive = 1.0
    """Reprojection error of the whole fit above which the result is degraded, px."""
    max_residual_mm: Positive = 2.0
    """Leave-one-out residual above which the result is degraded, root mean square, mm."""
    max_se_mm: Positive = 1.0
    """Standard error of a position above which the result is degraded, mm."""
    max_se_deg: Positive = 0.1
    """Standard error of an orientation above which the result is degraded, degrees."""
