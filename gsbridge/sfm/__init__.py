"""Structure from motion: calibrated cameras, posed and undistorted photos, sparse points."""

from gsbridge.sfm.calibrate import calibrate_camera
from gsbridge.sfm.settings import SfmSettings
from gsbridge.sfm.stage import reconstruct

__all__ = ["SfmSettings", "calibrate_camera", "reconstruct"]
