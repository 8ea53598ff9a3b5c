"""Photos of the benchmark's own world, with hidden effects in formulations of their own: nothing here imports image effects.

A pixel is the mean of several rays. Every ray has its own time, so that a rolling shutter needs no composition of images.
Lenses bend rays, defocus is a disc, vignetting depends on the angle of the ray, mains light is a squared sine wave, and
response curves are tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.gap.benchmark.image_world import ImageWorld
from gsbridge.geometry import Array
from gsbridge.scene.track import Track

FINE = 3
"""Number of rays along each edge of a pixel."""

_MOMENTS = 7
"""Number of moments within an exposure."""

READ, SHOT = 0.006, 6e-5
"""Noise of the sensor: standard deviation in the dark, and increase of the variance from black to white."""


@dataclass
class TruthCamera:
    """A camera in the world, with hidden effects.

    Args:
        world: The world.
        camera: Nominal pinhole camera.
        hidden: Sizes of the hidden effects, by name.
        spin: Directions, places and colours of the hidden effects.
    """

    world: ImageWorld
    camera: Camera
    hidden: Mapping[str, float] = field(default_factory=dict)
    spin: Mapping[str, float] = field(default_factory=dict)

    def photos(self, track: Track, times: Array) -> Array:
        """Return encoded photos without noise, clipped to 0..1. [N, H, W, 3]."""
        return np.stack([self._photo(track, float(time)) for time in times])

    def _size(self, name: str) -> float:
        return float(self.hidden.get(name, 0.0))

    def rays(self, focal: float, bend: float, fringe: float) -> Array:
        """Return the directions of all rays in the camera frame, z = 1, row by row. [FINE * H * FINE * W, 3].

        Args:
            focal: Factor on the focal length.
            bend: Radial distortion k1.
            fringe: Share by which a colour channel is magnified.
        """
        camera = self.camera
        u = (np.arange(FINE * camera.width) + 0.5) / FINE
        v = (np.arange(FINE * camera.height) + 0.5) / FINE
        u, v = np.meshgrid(u, v)
        matrix = np.array([[camera.fx * focal, 0, camera.cx], [0, camera.fy * focal, camera.cy], [0, 0, 1.0]])
        points = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        if bend:
            stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
            flat = cv2.undistortPoints(points, matrix, np.array([bend, 0.0, 0.0, 0.0]), criteria=stop)[:, 0]
        else:
            flat = (points[:, 0] - matrix[:2, 2]) / np.diag(matrix)[:2]
        return np.column_stack([flat / (1.0 + fringe), np.ones(len(flat))])

    def _photo(self, track: Track, time: float) -> Array:
        focal, bend, fringe = 1.0 + self._size("focal"), self._size("distortion"), self._size("fringe")
        if not fringe:
            return self._finished(self._light(track, time, self.rays(focal, bend, 0.0)), time)
        # Lateral chromatic aberration: red is magnified and blue is shrunk.
        parts = [self._light(track, time, self.rays(focal, bend, sign * fringe))[..., k] for k, sign in enumerate((1, 0, -1))]
        return self._finished(np.stack(parts, axis=-1), time)

    def _light(self, track: Track, time: float, rays: Array) -> Array:
        """Return the linear light on the fine grid, before defocus. [FINE * H, FINE * W, 3]."""
        camera, open_for = self.camera, self._size("motion_blur")
        tall, wide = FINE * camera.height, FINE * camera.width
        rows = np.repeat((np.arange(tall) + 0.5) / FINE - 0.5 * camera.height, wide)
        moments = (np.arange(_MOMENTS) + 0.5) / _MOMENTS - 0.5 if open_for else np.zeros(1)
        total = np.zeros((len(rays), 3), np.float32)
        for moment in moments:
            when = time - self._size("latency") + moment * open_for + rows * self._size("rolling_shutter")
            total += self._seen(track, when, rays) / len(moments)
        return total.reshape(tall, wide, 3)

    def _seen(self, track: Track, when: Array, rays: Array) -> Array:
        """Return the light along rays, each at its own time, s. [R], [R, 3] -> [R, 3]."""
        moments, which = np.unique(when, return_inverse=True)
        poses = track.at(moments)
        mount = self.mount()
        turns = np.einsum("nij,jk->nik", poses[:, :3, :3].transpose(0, 2, 1), mount[:3, :3])
        centres = np.einsum("nij,nj->ni", poses[:, :3, :3].transpose(0, 2, 1), mount[:3, 3] - poses[:, :3, 3])
        if len(moments) == 1:
            directions = rays @ turns[0].T
            origins = np.broadcast_to(centres[0], directions.shape)
        else:
            directions = np.einsum("nij,nj->ni", turns[which], rays)
            origins = centres[which]
        colours, places = self.world.look(origins, directions)
        return colours if not self._size("shadow") else colours * self.lamp(places)[:, None].astype(np.float32)

    def mount(self) -> Array:
        """Return the pose of the true camera in the frame of the nominal one. [4, 4]."""
        out = np.eye(4)
        size = self._size("extrinsics")
        if size:
            way = np.array([self.spin.get(k, 0.0) for k in ("x", "y", "z")]) * size
            turn = np.array([self.spin.get(k, 0.0) for k in ("a", "b", "c")]) * size * 2.0
            out[:3, :3] = cv2.Rodrigues(turn)[0]
            out[:3, 3] = way
        return out

    def lamp(self, places: Array) -> Array:
        """Return the share of the lamp's light that reaches points, in the world frame, m. [R, 3] -> [R]."""
        size = self._size("shadow")
        # A round object under a round lamp: the share of the lamp's disc that is visible past the object's edge.
        centre, radius = np.array([self.spin["px"], self.spin["py"]]), self.spin["radius"]
        past = (np.hypot(*(places[:, :2] - centre).T) - radius) / (0.25 * radius)
        edge = np.clip(past, -1.0, 1.0)
        covered = (np.arccos(edge) - edge * np.sqrt(1.0 - edge**2)) / np.pi
        return 1.0 - size * covered

    def _finished(self, light: Array, time: float) -> Array:
        """Return the encoded photo for light on the fine grid at a time, s."""
        return self.developed(_encoded(np.clip(self.gathered(light, time), 0.0, 1.0)))

    def gathered(self, light: Array, time: float = 0.0) -> Array:
        """Return the linear light at each pixel, after lens and gains. [FINE * H, FINE * W, 3] -> [H, W, 3].

        Args:
            light: Light on the fine grid, before defocus. [FINE * H, FINE * W, 3].
            time: Time of the photo, s.
        """
        camera = self.camera
        spot = self._size("defocus")
        if spot:
            light = _disc(light, 2.0 * spot * FINE)
        image = cv2.resize(light, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        u = (np.arange(camera.width) + 0.5 - camera.cx) / (0.5 * np.hypot(camera.width, camera.height))
        v = ((np.arange(camera.height) + 0.5 - camera.cy) / (0.5 * np.hypot(camera.width, camera.height)))[:, None]
        if self._size("hue_cast"):
            colour = np.array([self.spin[k] for k in ("r", "g", "bl")]) * self._size("hue_cast")
            far = ((u - self.spin["hx"]) ** 2 + (v - self.spin["hy"]) ** 2) / (2.0 * self.spin["hr"] ** 2)
            image = image + image * np.multiply.outer(np.power(np.e, -far), colour)
        if self._size("vignetting"):
            angle = np.arctan(np.sqrt(self._size("vignetting") * (u**2 + v**2)))
            image = image * (np.cos(angle) ** 4)[..., None]
        if self._size("flicker"):
            rows = time + (np.arange(camera.height) + 0.5 - 0.5 * camera.height) * self.spin["readout"]
            # The power of a mains lamp is the square of a sine wave of half its frequency.
            wave = 2.0 * np.sin(np.pi * self.spin["hertz"] * rows + self.spin["phase"]) ** 2 - 1.0
            image = image * (1.0 + self._size("flicker") * wave)[:, None, None]
        image = image * np.exp2(self._size("exposure"))
        if self._size("white_balance"):
            image = image * 10.0 ** (self._size("white_balance") * np.array([self.spin["wr"], 0.0, self.spin["wb"]]))
        if self._size("saturation"):
            image = _colourful(image, 1.0 + self._size("saturation"))
        return np.asarray(image)

    def developed(self, code: Array) -> Array:
        """Apply the effects of the camera's electronics to encoded values. [H, W, 3] float32."""
        camera = self.camera
        v = ((np.arange(camera.height) + 0.5 - camera.cy) / (0.5 * np.hypot(camera.width, camera.height)))[:, None]
        if self._size("response"):
            knots = np.linspace(0.0, 1.0, 1025)
            code = np.interp(code, knots, knots ** np.exp(self._size("response")))
        if self._size("ghost"):
            # A second reflection in a window pane in front of the lens, which is outside the catalogue.
            shift = round(5 * self.camera.width / 64)
            code = code + self._size("ghost") * np.roll(code, (shift, -2 * shift), axis=(0, 1))
        if self._size("haze_depth"):
            code = code + self._size("haze_depth") * (1.0 - code) * np.clip(0.5 - v, 0.0, 1.0)[..., None]
        if self._size("stripes"):
            code = code + self._size("stripes") * np.sin(2.0 * np.pi * np.arange(camera.width) / 7.0)[None, :, None]
        return np.clip(code + self._size("black_level"), 0.0, 1.0).astype(np.float32)


def grainy(photos: Array, hidden: Mapping[str, float], rng: np.random.Generator) -> Array:
    """Add the sensor's noise to photos, by counting electrons, and round them to 8 bits.

    Args:
        photos: Photos without noise, 0..1. [...].
        hidden: Sizes of the hidden effects; `noise` is the standard deviation of noise added to the sensor's own.
        rng: Random numbers.

    Returns:
        Values of k / 255 in the shape of `photos`, float32.
    """
    extra = float(hidden.get("noise", 0.0))
    well = 1.0 / SHOT
    counted = rng.poisson(np.maximum(photos, 0.0) * well) / well
    noisy = counted + rng.normal(0.0, READ, photos.shape) + rng.normal(0.0, 1.0, photos.shape) * extra
    return (np.floor(np.clip(noisy, 0.0, 1.0) * 255.0 + 0.5) / 255.0).astype(np.float32)


def _disc(light: Array, diameter: float) -> Array:
    """Blur light by a disc, as a defocused round aperture does.

    The edge of the disc is antialiased. Its `diameter`, in fine pixels, is four standard deviations of the disc along an axis.
    """
    reach = int(np.ceil(0.5 * diameter)) + 1
    fine = (np.arange(-8 * reach - 4, 8 * reach + 4) + 0.5) / 8.0
    inside = (np.hypot(fine[:, None], fine) <= 0.5 * diameter).astype(np.float64)
    kernel = inside.reshape(2 * reach + 1, 8, 2 * reach + 1, 8).mean(axis=(1, 3))
    return cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)


def _colourful(image: Array, factor: float) -> Array:
    """Multiply the colour differences (Rec. 709) of linear light by a factor."""
    red, green, blue = np.moveaxis(image, -1, 0)
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    c_b, c_r = factor * (blue - luma) / 1.8556, factor * (red - luma) / 1.5748
    red, blue = luma + 1.5748 * c_r, luma + 1.8556 * c_b
    return np.maximum(np.stack([red, (luma - 0.2126 * red - 0.0722 * blue) / 0.7152, blue], axis=-1), 0.0)


def _encoded(light: Array) -> Array:
    """Encode linear light as sRGB, by the two pieces of its definition."""
    return np.piecewise(light, [light <= 0.0031308], [lambda x: 12.92 * x, lambda x: 1.055 * x ** (1 / 2.4) - 0.055])
