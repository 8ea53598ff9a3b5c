"""The camera pipeline by which photos of a scene are simulated: time and pose, geometry, light and sensor.

Image effects change a `Shooting`, and `gsbridge.scene.photograph` simulates photos with it. A `Shooting` with its default
values produces plain pinhole images without any effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array


@dataclass(frozen=True)
class CameraFrame:
    """Camera, time, depths and pose of a photo, for the steps that change its light.

    Args:
        camera: Nominal pinhole camera.
        time: Time of the photo, s.
        depths: Depth of the visible surface along the camera's z axis, m. [H, W].
        cam_from_world: Transform from world to camera in the middle of the exposure. [4, 4].
    """

    camera: Camera
    time: float
    depths: Array
    cam_from_world: Array

    @cached_property
    def plane(self) -> tuple[Array, Array]:
        """Position of every pixel centre relative to the image centre, right and down, in half diagonals. [W], [H, 1]."""
        width, height = self.camera.width, self.camera.height
        half = 0.5 * np.hypot(width, height)
        return (np.arange(width) + 0.5 - 0.5 * width) / half, ((np.arange(height) + 0.5 - 0.5 * height) / half)[:, None]

    @cached_property
    def points(self) -> Array:
        """World coordinates of the surface point at every pixel, m. [H, W, 3]."""
        rays = self.camera.pixel_rays() * self.depths[..., None]
        return (rays - self.cam_from_world[:3, 3]) @ self.cam_from_world[:3, :3]


Step = Callable[[Array, CameraFrame], Array]
"""Function that maps the linear light of a photo to changed linear light. [H, W, 3] float32."""

SURFACE, LENS, GAIN, COLOUR = range(4)
"""Order of steps on linear light: light on surfaces, losses in the lens, exposure and gains, mixing of colour channels."""

RESPONSE, OFFSET = range(2)
"""Order of steps on encoded values: response curve, then offset."""


@dataclass
class Shooting:
    """Parameters and steps of the camera pipeline, from pose to sensor; effects change them.

    Attributes:
        delay: Time by which images are older than their time stamps, s.
        row_time: Time from the readout of one row to the next, s; the time stamp is that of the middle row.
        exposure_time: Duration of the exposure, centred on the time stamp, s.
        mount: Transform from the assumed camera frame to the true one. [4, 4].
        focal: Factor on both focal lengths.
        distortion: k1, k2 of the OPENCV model. [2].
        blur: Variance of the lens's blur, px2.
        softness: Weights with which the image is sharpened against its blurred copies, one for each of
            `gsbridge.scene.photograph.BLURS`.
        light: Steps on linear light, each with its place in the order (`SURFACE` to `COLOUR`).
        sensor: Steps on encoded values, each with its place in the order (`RESPONSE` or `OFFSET`).
        read_variance: Noise variance of encoded values in the dark (read noise).
        shot_variance: Noise variance that is added to it in proportion to the encoded value, up to white (shot noise).
    """

    delay: float = 0.0
    row_time: float = 0.0
    exposure_time: float = 0.0
    mount: Array = field(default_factory=lambda: np.eye(4))
    focal: float = 1.0
    distortion: Array = field(default_factory=lambda: np.zeros(2))
    blur: float = 0.0
    softness: tuple[float, ...] = ()
    light: list[tuple[int, Step]] = field(default_factory=list)
    sensor: list[tuple[int, Callable[[Array], Array]]] = field(default_factory=list)
    read_variance: float = 0.0
    shot_variance: float = 0.0

    def on_light(self, place: int, step: Step) -> None:
        """Add a step on linear light at a place in the order."""
        self.light.append((place, step))

    def on_sensor(self, place: int, step: Callable[[Array], Array]) -> None:
        """Add a step on encoded values at a place in the order."""
        self.sensor.append((place, step))
