"""How photos of a scene are taken: when and from where, through what geometry, and what becomes of the light.

Image effects change a `Shooting`; `gsbridge.scene.photograph` takes photos by it. A fresh one takes plain pictures.
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
    """A photo's camera, time, depths and pose, which steps on its light may use.

    Args:
        camera: Nominal pinhole.
        time: Time of the photo, s.
        depths: Camera z of what is seen, m. [H, W].
        cam_from_world: Pose in the middle of the exposure. [4, 4].
    """

    camera: Camera
    time: float
    depths: Array
    cam_from_world: Array

    @cached_property
    def plane(self) -> tuple[Array, Array]:
        """Place of every pixel from the middle of the image, right and down, in half diagonals. [W], [H, 1]."""
        width, height = self.camera.width, self.camera.height
        half = 0.5 * np.hypot(width, height)
        return (np.arange(width) + 0.5 - 0.5 * width) / half, ((np.arange(height) + 0.5 - 0.5 * height) / half)[:, None]

    @cached_property
    def points(self) -> Array:
        """Point of the world that every pixel sees, m. [H, W, 3]."""
        rays = self.camera.pixel_rays() * self.depths[..., None]
        return (rays - self.cam_from_world[:3, 3]) @ self.cam_from_world[:3, :3]


Step = Callable[[Array, CameraFrame], Array]
"""Takes linear light of a photo and gives it back changed. [H, W, 3] float32."""

SURFACE, LENS, GAIN, COLOUR = range(4)
"""Order of steps on linear light: on surfaces, in the lens, exposure and gains, and the mixing of the sensor's colours."""

RESPONSE, OFFSET = range(2)
"""Order of steps on encoded values."""


@dataclass
class Shooting:
    """The way photos are taken, from pose to sensor; effects change it.

    Attributes:
        delay: Time by which pictures are older than their time stamps, s.
        row_time: From one row to the next, s; the time stamp is that of the middle row.
        exposure_time: How long light is gathered, around the time stamp, s.
        mount: Pose of the camera in the frame of where it is thought to be. [4, 4].
        focal: Factor on both focal lengths.
        distortion: k1, k2 of the OPENCV model.
        blur: Variance of the lens's blur, px2.
        softness: How much light is sharpened against its blurred copies, for each of `gsbridge.scene.photograph.BLURS`.
        light: Steps on linear light, with their place in the order.
        sensor: Steps on encoded values, likewise.
        read_variance: Variance of encoded values where it is dark.
        shot_variance: Growth of this variance up to white.
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
        """Add a step on linear light."""
        self.light.append((place, step))

    def on_sensor(self, place: int, step: Callable[[Array], Array]) -> None:
        """Add a step on encoded values."""
        self.sensor.append((place, step))
