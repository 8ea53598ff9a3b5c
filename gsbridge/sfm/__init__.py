"""Structure from motion: calibrated cameras, posed and undistorted photos, sparse points."""

from gsbridge.configuration.sfm import SfmSettings
from gsbridge.sfm.calibrate import calibrate_camera
from gsbridge.sfm.stage import reconstruct

__all__ = ["SfmSettings", "calibrate_camera", "reconstruct"]
