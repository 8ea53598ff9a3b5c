"""Settings of the alignment to the table."""

from __future__ import annotations

from pydantic import Field

from gsbridge.configuration.base import Number, Settings, Share, Switch


class AlignSection(Settings):
    """Limits of the alignment that are the same for all scenes."""

    plane_threshold: Share = 0.006
    """Distance within which a point lies on the table, as a share of the cameras' distance."""
    max_tilt_deg: Number = Field(default=1.0, ge=0, le=90)
    """Angle between the board and the points' plane above which the result is degraded, degrees."""
    max_scale_se: Share = 0.005
    """Standard error of the scale by the board, as a share of it, above which the result is degraded."""


class AlignSettings(AlignSection):
    """Limits of the alignment of one scene."""

    require_scale: Switch = False
    """Fail where neither the board nor a known length gives the scale."""
