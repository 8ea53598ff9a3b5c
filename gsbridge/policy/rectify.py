"""Conversion of any camera's pictures to a policy's input: cropped to its angle of view, undistorted and shrunk.

Every pixel of the policy's picture is the mean of the light that falls on it, as in a camera with large pixels; the calibration
of the wrist camera's colours averages likewise. A picture that already has the policy's intrinsics stays as it is, bit by bit.
"""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear, to_u8

MISSING = 0.02
"""Largest share of the policy's picture that the camera may miss on each side; the edge of the camera's picture is repeated
there. Two cameras of the same kind differ by 1 % in focal length."""

_FINEST = 16
_LIGHT = linear_from_srgb(np.arange(256, dtype=np.float32) / 255.0)


class Rectifier:
    """Turns pictures of one camera into pictures of another at the same place.

    Args:
        source: The camera on the robot, with its distortion.
        target: Pinhole of the policy's picture, with the same place and axes.

    Raises:
        InputError: The source does not see what the target shows.
    """

    def __init__(self, source: Camera, target: Camera) -> None:
        self.source, self.target = source, target
        if source == target:
            self._map = None
            return
        # Per pixel of the target, take as many rays as it covers pixels of the source.
        wanted = max(source.fx / target.fx, source.fy / target.fy)
        self._fine = int(np.clip(np.ceil(wanted - 1e-9), 1, _FINEST))
        rays = target.scaled(self._fine).pixel_rays()
        pixels = source.project(rays)
        _check(pixels, source, target)
        # Only this part of the picture is converted to light.
        size = [source.width, source.height]
        low = np.clip(np.floor(pixels.min((0, 1))) - 1, 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max((0, 1))) + 1, 0, size).astype(int)
        self._part = slice(low[1], high[1]), slice(low[0], high[0])
        # In OpenCV, pixel centres have whole coordinates; here they have halves.
        self._map = tuple(np.ascontiguousarray(pixels[..., k] - low[k] - 0.5, np.float32) for k in (0, 1))

    def __call__(self, image: Array) -> Array:
        """Return the picture as the target sees it.

        Args:
            image: Picture of the source, RGB, sRGB. uint8 [H, W, 3].

        Returns:
            uint8 [target height, target width, 3].

        Raises:
            InputError: The picture has another size or type.
        """
        image = np.asarray(image)
        wanted = (self.source.height, self.source.width, 3)
        if image.dtype != np.uint8 or image.shape != wanted:
            raise InputError(
                "driver: image",
                f"it is {image.dtype} {image.shape}, its intrinsics say uint8 {wanted}",
                "Deliver RGB pictures of the size that belongs to the intrinsics",
            )
        if self._map is None:
            return image
        light = cv2.remap(
            _LIGHT[image[self._part]], self._map[0], self._map[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        height, width = self.target.height, self.target.width
        mean = light.reshape(height, self._fine, width, self._fine, 3).mean((1, 3))
        return to_u8(srgb_from_linear(mean))


def _check(pixels: Array, source: Camera, target: Camera) -> None:
    """Check that the rays of the target fall on the picture of the source, and in the same order. [H, W, 2]."""
    across, down = np.diff(pixels[..., 0], axis=1), np.diff(pixels[..., 1], axis=0)
    if not (np.isfinite(pixels).all() and (across > 0).all() and (down > 0).all()):
        raise InputError("driver: camera", "its distortion folds the picture", "Calibrate it again, with tags near the edges")
    low, high = pixels.min((0, 1)), pixels.max((0, 1))
    scale = np.array([source.fx * target.width / target.fx, source.fy * target.height / target.fy])
    missing = np.maximum(-low, high - [source.width, source.height]) / scale
    if missing.max() > MISSING:
        angle = np.degrees(2 * np.arctan(target.width / 2 / target.fx))
        raise InputError(
            "driver: camera",
            f"the policy looks {angle:.1f} degrees wide and high, the camera misses {100 * missing.max():.0f} % at one side",
            "Choose a mode of the camera that sees more, uncropped, and give its own intrinsics",
        )
