"""Photos of the same views before and after something changed.

A robot returns to a posture to a fraction of a millimetre. Photos from the same postures on two days therefore differ only by
what changed in between, and not by the errors that the splats, lights and colours of a simulation have anyway: each earlier
photo serves as the model of the later one. Repeated photos of the first day show the noise.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.scene.track import Track

FEWEST = 4
"""Smallest number of views of a role."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Views of one role.

    Args:
        camera: Pinhole camera of all photos.
        before: sRGB-encoded photos, 0..1, taken while all was well. [N, H, W, 3] float32.
        again: Repeated photos of the same views with nothing changed, or the means of several. [N, H, W, 3].
        after: Later photos of the same views. [N, H, W, 3].
        depths: Depth of the visible surfaces along the camera's z axis, m; 0 or NaN where it is unknown. [N, H, W].
        poses: `cam_from_world` of the views. [N, 4, 4].
        track: Camera poses over time, if the camera moved while photos were taken; None if it was at rest.
        times: Times of the photos, s; needed with a track. [N].
        repeats: Number of photos that were averaged for `again`.
        name: Name for messages.
        digest: SHA-256 of the files; empty if there are no files.
        drawn: Whether the earlier images are rendered and thus free of noise; `again` then holds the same images.
        edge: Reduction factor of the images: original pixels along each edge of one pixel here.

    Raises:
        InputError: The sizes of photos, depths and poses do not match, there are too few views, or the photos are distorted.
    """

    camera: Camera
    before: Array
    again: Array
    after: Array
    depths: Array
    poses: Array
    track: Track | None = None
    times: Array | None = None
    repeats: int = 1
    name: str = ""
    digest: str = ""
    drawn: bool = False
    edge: int = 1

    def __post_init__(self) -> None:
        shape = (len(self.poses), self.camera.height, self.camera.width)
        source = self.name or "photos"
        if len(self.poses) < FEWEST:
            raise InputError(source, f"there are {len(self.poses)} views", f"Give {FEWEST} or more; see docs/gap_images.md")
        for title in ("before", "again", "after", "depths"):
            wanted = shape if title == "depths" else (*shape, 3)
            if getattr(self, title).shape != wanted:
                seen = " x ".join(str(k) for k in getattr(self, title).shape)
                raise InputError(source, f"'{title}' is {seen}", f"Give {' x '.join(map(str, wanted))}, one per pose and pixel")
        if self.poses.shape[1:] != (4, 4) or not np.isfinite(self.poses).all():
            raise InputError(source, "the photos have no poses", "Give cam_from_world of every view, 4 x 4")
        if not self.camera.is_pinhole:
            raise InputError(source, "the photos are distorted", "Undistort them first; the diagnosis seeks what is left")
        if self.track is not None and self.times is None:
            raise InputError(
                source,
                "a camera that moves on a track needs the times of its photos",
                "Give the times, or leave the track out for a camera that stood still",
            )

    def __len__(self) -> int:
        return len(self.poses)

    def content_digest(self) -> str:
        """Return the SHA-256 of photos, depths and poses."""
        parts = (self.before, self.again, self.after, self.depths, self.poses)
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()

    def quiet(self) -> Pairs:
        """Return these views with nothing changed: the repeated earlier photos replace the later ones."""
        return replace(self, after=self.again)
