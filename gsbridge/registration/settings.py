"""Settings of the registration."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RegistrationSettings:
    """Limits of the registration.

    Args:
        min_poses: Poses of the arm below which the stage fails.
        min_turn_deg: Spread of the hand's turns about a second axis below which the stage fails, standard deviation, degrees.
        gate_px: Reprojection error of a photo's own board pose above which tags and then the photo are left out, px.
        max_residual_px: Reprojection error of the whole fit above which the result is degraded, px.
        max_residual_mm: Leave-one-out residual above which the result is degraded, root mean square, mm.
        max_se_mm: Standard error of a position above which the result is degraded, mm.
        max_se_deg: Standard error of an orientation above which the result is degraded, degrees.
    """

    min_poses: int = 8
    min_turn_deg: float = 4.0
    gate_px: float = 1.5
    max_residual_px: float = 1.0
    max_residual_mm: float = 2.0
    max_se_mm: float = 1.0
    max_se_deg: float = 0.1
