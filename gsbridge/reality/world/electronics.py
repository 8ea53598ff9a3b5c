"""The camera's electronics and lens errors.

The electronics are automatic exposure and white balance, which follow the light with a lag, compression, and dropped or late
pictures. The lens errors are those that remain after calibration.
"""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.reality.world.hidden import Hidden

GREY, LAG = 0.18, 0.3
"""Mean linear light that automatic exposure aims at, and time constant of exposure and white balance, s."""

_GAINS = 0.25, 4.0


class Electronics:
    """The electronics of one camera during an episode.

    Args:
        hidden: Hidden parameters of the world.
        period: Time from picture to picture, s.
    """

    def __init__(self, hidden: Hidden, period: float) -> None:
        self.hidden, self._follow = hidden, 1.0 - np.exp(-period / LAG)
        self.begin(0)

    def begin(self, seed: int) -> None:
        """Begin an episode. At its first picture, exposure and white balance are already settled."""
        self._rng = np.random.default_rng([seed, 5])
        self._gains: Array | None = None
        self._taken: Array | None = None
        self._given: Array | None = None

    def gains(self, light: Array) -> Array:
        """Return each channel's gain for a picture of this light, [H, W, 3], and move the next gains towards it. [3]."""
        hidden = self.hidden
        if hidden.auto_exposure == 0.0 and hidden.auto_balance == 0.0:
            return np.ones(3)
        means = np.maximum(np.clip(light * hidden.exposure, 0.0, 1.0).mean((0, 1)), 1e-4)
        exposure = (GREY / (means @ [0.2126, 0.7152, 0.0722])) ** hidden.auto_exposure
        wanted = np.clip(exposure * (means[1] / means) ** hidden.auto_balance, *_GAINS)
        now = wanted if self._gains is None else self._gains
        self._gains = now + self._follow * (wanted - now)
        return now

    def delivered(self, picture: Array) -> Array:
        """Return the picture that the camera delivers: compressed, and at random late or the one before. uint8 [H, W, 3]."""
        hidden = self.hidden
        if hidden.compression > 0.0:
            picture = _compressed(picture, 100 - round(hidden.compression))
        if hidden.dropped_frames == 0.0 and hidden.late_frames == 0.0:
            return picture
        late, dropped = self._rng.uniform(size=2) < (hidden.late_frames, hidden.dropped_frames)
        before, self._taken = self._taken, picture
        out = before if late and before is not None else picture
        given = self._given if dropped and self._given is not None else out
        self._given = given
        return given


def _compressed(picture: Array, quality: int) -> Array:
    """Return the picture after JPEG compression. uint8 [H, W, 3]."""
    done, content = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError("the picture cannot be encoded")
    return np.ascontiguousarray(np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))[..., ::-1])


class LensError:
    """A lens that differs from its calibration.

    Args:
        camera: The camera as calibrated: a pinhole with the principal point in the middle.
        hidden: Hidden parameters, of which `distortion` and `focal_error` are used.

    Attributes:
        wide: Pinhole camera whose picture contains everything that the lens sees.
    """

    def __init__(self, camera: Camera, hidden: Hidden) -> None:
        x, y = (np.mgrid[: camera.height, : camera.width][::-1].reshape(2, -1) + 0.5) - [[camera.cx], [camera.cy]]
        bent = np.stack([x, y]) / (camera.fx * (1.0 + hidden.focal_error))
        straight = bent
        # Invert x (1 + k r2) by fixed-point iteration; the error is far below a pixel after a few iterations.
        for _ in range(20):
            straight = bent / (1.0 + hidden.distortion * (straight**2).sum(0))
        pixels = camera.fx * straight
        edge = max(1, int(np.ceil(np.abs(pixels).max(1) - [camera.width / 2, camera.height / 2]).max()) + 1)
        wide = camera.width + 2 * edge, camera.height + 2 * edge
        self.wide = Camera(*wide, camera.fx, camera.fy, wide[0] / 2, wide[1] / 2)
        # OpenCV has pixel centres at integers.
        columns, rows = pixels + 0.5 * np.array([[wide[0]], [wide[1]]]) - 0.5
        self._map_x = columns.reshape(camera.height, camera.width).astype(np.float32)
        self._map_y = rows.reshape(camera.height, camera.width).astype(np.float32)

    def __call__(self, light: Array) -> Array:
        """Map light of the `wide` pinhole to the picture that the lens forms. [H, W, 3]."""
        light = np.ascontiguousarray(light, np.float32)
        return cv2.remap(light, self._map_x, self._map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
