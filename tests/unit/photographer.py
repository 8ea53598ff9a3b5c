"""Photos of splats rendered one by one, every moment of an exposure anew: the reference for the pictures the gap expects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.effects.images.camera_pipeline import CameraFrame, Shooting
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.scene.photograph import EXPOSURES, STRIPS, bent, develop, drawn_through
from gsbridge.scene.track import Track
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.rasterize import cpu

OPAQUE = 0.95
"""Share of the light from splats from which on there is no hole."""

_KEPT = 64
"""Pictures that are kept for the next photo that needs them."""


class Photographer:
    """Takes photos of one scene with one camera.

    Args:
        cloud: The scene, colours sRGB.
        camera: Pinhole.
        background: sRGB where there are no splats. [3].
        threads: Threads of the rasteriser.
    """

    def __init__(self, cloud: Cloud, camera: Camera, background: Sequence[float] = (0.0, 0.0, 0.0), threads: int = 1) -> None:
        if not camera.is_pinhole:
            raise ValueError("splats are drawn by a camera without distortion")
        self.cloud, self.camera, self.threads = cloud, camera, threads
        self.background = np.asarray(background, np.float32)
        self.pictures = 0
        self._kept: OrderedDict[tuple[object, ...], tuple[Array, Array, Array]] = OrderedDict()

    def draw(self, camera: Camera, cam_from_world: Array) -> tuple[Array, Array]:
        """Linear light and depth (m) of one picture. [H, W, 3], [H, W]."""
        cloud = self.cloud
        colours, alphas, depths = cpu.render(
            cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.colours, camera=camera,
            cam_from_table=cam_from_world, background=self.background, threads=self.threads, harmonics=cloud.harmonics,
        )  # fmt: skip
        return linear_from_srgb(np.clip(colours, 0.0, 1.0)), depths / np.maximum(alphas, np.float32(1e-6))

    def covered(self, track: Track, times: Array) -> Array:
        """One where splats hide the background, three pixels away from any hole; zero elsewhere. [N, H, W] float32."""
        cloud, out = self.cloud, []
        for pose in track.at(times):
            alphas = cpu.render(
                cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.colours, camera=self.camera,
                cam_from_table=pose, background=self.background, threads=self.threads,
            )[1]  # fmt: skip
            out.append(cv2.erode((alphas > OPAQUE).astype(np.uint8), np.ones((7, 7), np.uint8)).astype(np.float32))
        return np.stack(out)

    def photos(self, track: Track, times: Array, shooting: Shooting | None = None) -> Array:
        """Expected photos, without noise, sRGB-encoded, clamped.

        Args:
            track: Where the camera was.
            times: Time stamps of the photos, s. [N].
            shooting: How they are taken; plainly when None.

        Returns:
            [N, H, W, 3] float32.
        """
        shooting = shooting or Shooting()
        return np.stack([self._photo(track, float(time), shooting) for time in times])

    def _photo(self, track: Track, time: float, shooting: Shooting) -> Array:
        light, depths, pose = self._exposed(track, time, shooting)
        frame = CameraFrame(self.camera, time, depths, pose)
        return develop(light, frame, shooting)

    def _exposed(self, track: Track, time: float, shooting: Shooting) -> tuple[Array, Array, Array]:
        """Linear light gathered by one photo, depth in the middle of the exposure, and the pose there."""
        geometry = (shooting.delay, shooting.row_time, shooting.exposure_time, shooting.focal)
        key = (track, time, *geometry, shooting.mount.tobytes(), shooting.distortion.tobytes())
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        camera, pad = drawn_through(self.camera, shooting)
        middle = time - shooting.delay
        # Middles of equal parts of the exposure.
        span = (np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5 if shooting.exposure_time else np.zeros(1)
        light: Array = np.zeros(1, np.float32)
        depths: Array = np.zeros(0)
        for k, offset in enumerate(span):
            seen, depth = self._shutter(track, middle + float(offset) * shooting.exposure_time, shooting, camera)
            light = light + seen / np.float32(len(span))
            depths = depth if k == len(span) // 2 else depths
        if shooting.distortion.any():
            light, depths = bent(light, depths, camera, pad, shooting.distortion)
        out = (light, depths, shooting.mount @ track.at(np.array([middle]))[0])
        self._kept[key] = out
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return out

    def _shutter(self, track: Track, time: float, shooting: Shooting, camera: Camera) -> tuple[Array, Array]:
        """Render one moment: all rows at once, or strips of rows one after the other."""
        if not shooting.row_time:
            self.pictures += 1
            return self.draw(camera, shooting.mount @ track.at(np.array([time]))[0])
        edges = np.unique(np.linspace(0, camera.height, STRIPS + 1).round().astype(int))
        rows = 0.5 * (edges[:-1] + edges[1:]) - 0.5 * camera.height
        poses = track.at(time + rows * shooting.row_time)
        parts = [
            self.draw(camera.cropped(0, int(top), camera.width, int(end - top)), shooting.mount @ pose)
            for top, end, pose in zip(edges[:-1], edges[1:], poses, strict=True)
        ]
        self.pictures += 1
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
