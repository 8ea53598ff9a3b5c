"""Expected photos: earlier photos as they would look after a change of the camera's pose, lens or response.

The change is computed on an almost noise-free copy of the photo, made with further photos of the view. The light of each pixel
is moved according to its depth, so that detail and shading stay as they are. The difference is then added to the photo. If
the photo itself were blurred or moved, its noise would decrease, and any effect that blurs would explain every pair of photos
better than no effect.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import cv2
import numpy as np

from gsbridge.effects.images.camera_pipeline import CameraFrame, Shooting
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.visibility import off_steps, seen_from
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, to_u8
from gsbridge.scene.photograph import EXPOSURES, STRIPS, develop, straightening

_STRENGTH = 3.0
"""Differences, of 255, that count as noise in a single photo."""

_ROUND = 5
"""Half width of the window, px, over which the share of texture that both photos show is averaged."""

_TURNS = 5
"""Iterations of the search for the depth along a ray."""

_HIDING = 0.5
"""Occlusion is computed only where near and far things shift against each other by at least this much, px."""

_SAME = 0.02
"""Largest relative difference between an interpolated and a moved depth that count as the same place."""

_KEPT = 4
"""Number of camera geometries whose light is kept: a search changes colours more often than geometry."""


def _clean(photo: Array, other: Array, strength: float) -> Array:
    """Denoise a photo but keep its detail. [H, W, 3].

    Smoothing also removes fine texture. That share of the removed signal which another photo of the view shows as well is
    added back.

    Source: Buades, Coll and Morel, Non-local means denoising, Image Processing On Line 1, 2011.
    """
    smooth = cv2.fastNlMeansDenoisingColored(to_u8(photo), None, strength, strength, 5, 15).astype(np.float32) / 255.0
    taken, others = photo - smooth, other - smooth
    size = (2 * _ROUND + 1,) * 2
    alike, whole = cv2.blur(taken * others, size).mean(axis=2), cv2.blur(taken * taken, size).mean(axis=2)
    share = np.clip(alike / np.maximum(whole, 1e-12), 0.0, 1.0)[..., None]
    return (smooth + share * taken).astype(np.float32)


class Expectation:
    """Photos of some views as effects would change them.

    Args:
        pairs: The views.
    """

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs
        self.depths = np.nan_to_num(pairs.depths, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
        known = self.depths > 0
        # Pixels of unknown depth are not compared, but the warp needs some depth everywhere.
        self.depths = np.where(known, self.depths, np.median(self.depths[known]) if known.any() else 1.0).astype(np.float32)
        self._known = None if known.all() else known.astype(np.float32)
        self.clean = pairs.before if pairs.drawn else np.stack(
            [_clean(*both, _STRENGTH / np.sqrt(pairs.repeats)) for both in zip(pairs.again, pairs.before, strict=True)]
        )  # fmt: skip
        self.light = linear_from_srgb(self.clean)
        self.pictures = 0
        self._kept: OrderedDict[tuple[object, ...], tuple[Array, Array]] = OrderedDict()

    def photos(self, how: Shooting) -> Array:
        """Return the expected encoded photos; their only noise is that of the earlier photos. [N, H, W, 3] float32."""
        light, pairs = self._seen(how)[0], self.pairs
        self.pictures += 1
        changed = np.stack([develop(light[n], self._frame(n, how), how) for n in range(len(pairs))])
        return pairs.before + (changed - self.clean)

    def shown(self, how: Shooting) -> Array:
        """Mask the pixels whose content is visible in the earlier photo, too. [N, H, W] bool."""
        return self._seen(how)[1]

    def flat(self, how: Shooting) -> Array:
        """Return the expected photos without motion or defocus, in which noise can be measured. [N, H, W, 3] float32."""
        still = replace(how, mount=np.eye(4), focal=1.0, distortion=np.zeros(2), delay=0.0, row_time=0.0, exposure_time=0.0)
        still = replace(still, blur=0.0)
        return np.stack([develop(self._before[n], self._frame(n, still), still) for n in range(len(self.pairs))])

    @cached_property
    def _before(self) -> Array:
        """Linear light of the earlier photos with their noise. [N, H, W, 3]."""
        return linear_from_srgb(self.pairs.before.astype(np.float32))

    def _frame(self, n: int, how: Shooting) -> CameraFrame:
        pairs = self.pairs
        time = 0.0 if pairs.times is None else float(pairs.times[n])
        return CameraFrame(pairs.camera, time, self.depths[n], how.mount @ pairs.poses[n])

    def _seen(self, how: Shooting) -> tuple[Array, Array]:
        """Return the linear light at the sensor, and where the earlier photo shows it. [N, H, W, 3], [N, H, W] bool."""
        moving = (how.delay, how.row_time, how.exposure_time) if self.pairs.track is not None else (0.0, 0.0, 0.0)
        key = (*moving, how.focal, how.mount.tobytes(), how.distortion.tobytes())
        if key == (0.0, 0.0, 0.0, 1.0, np.eye(4).tobytes(), np.zeros(2).tobytes()):
            return self.light, np.ones(self.light.shape[:3], bool)
        if key not in self._kept:
            rays = self._rays(how)
            span = (np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5 if moving[2] else np.zeros(1)
            whole = [
                sum(self._shutter(n, float(offset) * how.exposure_time - how.delay, how, rays) for offset in span) / len(span)
                for n in range(len(self.pairs))
            ]
            table = np.stack(whole).astype(np.float32)
            # The mean of the masks is 1 only where all moments of the exposure are visible.
            self._kept[key] = table[..., :3], table[..., 3] > 0.999
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return self._kept[key]

    def _rays(self, how: Shooting) -> Array:
        """Return the viewing rays of the pixels through the changed lens, z = 1. [H, W, 3]."""
        camera = self.pairs.camera
        camera = replace(camera, fx=camera.fx * how.focal, fy=camera.fy * how.focal)
        rays = camera.pixel_rays()
        if how.distortion.any():
            rays[..., :2] *= straightening(np.hypot(rays[..., 0], rays[..., 1]), how.distortion)[..., None]
        return rays

    def _shutter(self, n: int, later: float, how: Shooting, rays: Array) -> Array:
        """Return the light of one moment and a mask of where it is known. [H, W, 4].

        All rows are taken at once, or in strips one after the other if the shutter rolls. `later` is the time of the moment
        after the time stamp, s.
        """
        pairs, height = self.pairs, self.pairs.camera.height
        if pairs.track is None or pairs.times is None:
            return self._settled([self._warped(n, how.mount @ pairs.poses[n], rays)])
        time = float(pairs.times[n]) + later
        if not how.row_time:
            return self._settled([self._warped(n, how.mount @ pairs.track.at(np.array([time]))[0], rays)])
        edges = np.unique(np.linspace(0, height, STRIPS + 1).round().astype(int))
        rows = 0.5 * (edges[:-1] + edges[1:]) - 0.5 * height
        poses = pairs.track.at(time + rows * how.row_time)
        strips = zip(edges[:-1], edges[1:], poses, strict=True)
        return self._settled([self._warped(n, how.mount @ pose, rays[top:end], int(top)) for top, end, pose in strips])

    @staticmethod
    def _settled(strips: Sequence[tuple[Array, Array, bool]]) -> Array:
        """Join strips of rows; if occlusion matters, mask pixels near steps of depth. [H, W, 4]."""
        table = np.concatenate([strip[0] for strip in strips])
        if any(strip[2] for strip in strips):
            table[..., 3] *= off_steps(np.concatenate([strip[1] for strip in strips]))
        return table

    def _warped(self, n: int, pose: Array, rays: Array, top: int = 0) -> tuple[Array, Array, bool]:
        """Warp the light of a photo to a camera at another pose.

        Args:
            n: Number of the photo.
            pose: `cam_from_world` of the other camera. [4, 4].
            rays: Its viewing rays, z = 1. [h, W, 3].
            top: Row of the image in which `rays` begin.

        Returns:
            Light, and 1 where the photo shows it, else 0, [h, W, 4]; depth, m, 0 where unknown, [h, W]; and whether occlusion
            matters.
        """
        camera, depth = self.pairs.camera, self.depths[n]
        old_from_new = self.pairs.poses[n] @ np.linalg.inv(pose)
        turned = rays @ old_from_new[:3, :3].T
        known = np.ones(rays.shape[:2], bool)
        far = depth[top : top + len(rays)].astype(np.float64)
        hiding = camera.fx * np.linalg.norm(old_from_new[:3, 3]) * (1.0 / depth.min() - 1.0 / depth.max()) > _HIDING
        if hiding:
            # Start at the nearest surface on every ray; otherwise the search can end at a surface that this one hides.
            nearest = self._nearest(n, np.linalg.inv(old_from_new), rays)
            known = nearest > 0
            far = np.where(known, nearest, far)
        # Find, along every ray, the point whose depth in the old view equals the depth map there.
        across = down = there = deep = np.zeros(0, np.float32)
        for _ in range(_TURNS):
            places = turned * far[..., None] + old_from_new[:3, 3]
            deep = np.maximum(places[..., 2], 1e-6)
            # OpenCV puts the centre of the first pixel at zero.
            across = (camera.fx * places[..., 0] / deep + camera.cx - 0.5).astype(np.float32)
            down = (camera.fy * places[..., 1] / deep + camera.cy - 0.5).astype(np.float32)
            there = cv2.remap(depth, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            far = far * np.clip(there / deep, 0.5, 2.0)
        seen = cv2.remap(self.light[n], across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        inside = (across >= 0) & (across <= camera.width - 1) & (down >= 0) & (down <= camera.height - 1)
        if hiding:
            known &= np.abs(there - deep) <= _SAME * deep
        if self._known is not None:
            # Things of unknown depth may be as near as half the median depth, and hide more in the new view than in the old.
            reach = int(np.ceil(camera.fx * np.linalg.norm(old_from_new[:3, 3]) / np.median(depth))) + 1
            sure = cv2.erode(self._known[n], np.ones((2 * reach + 1,) * 2, np.uint8))
            known &= cv2.remap(sure, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > 0.999
        inside &= known
        table = np.concatenate([np.maximum(seen, 0.0), inside[..., None].astype(np.float32)], axis=2)
        return table, np.where(known, far, 0.0), bool(hiding)

    def _nearest(self, n: int, new_from_old: Array, rays: Array) -> Array:
        """Return the depth of the nearest surface along rays of the new view, m; 0 where the old view shows none. [h, W]."""
        camera = self.pairs.camera
        seen = seen_from(self.depths[n], camera, new_from_old)
        across = (camera.fx * rays[..., 0] + camera.cx - 0.5).astype(np.float32)
        down = (camera.fy * rays[..., 1] + camera.cy - 0.5).astype(np.float32)
        return cv2.remap(seen, across, down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
