"""Photos of the same views before and after something changed.

A robot comes back to a posture to a fraction of a millimetre. Photos from the same postures on two days differ by what changed
between them, and not by what splats, lights and colours of a simulation are off by anyway: each earlier photo is the model of
the later one. Second photos of the first day tell the noise.
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
"""Views of a role."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Views of one role.

    Args:
        camera: Pinhole of all photos.
        before: sRGB-encoded photos, 0..1, while all was well. [N, H, W, 3] float32.
        again: Further photos of the same views, with nothing changed, or the mean of some. [N, H, W, 3].
        after: Photos of the same views since. [N, H, W, 3].
        depths: Camera z of what the views show, m; 0 or not-a-number where it is unknown. [N, H, W].
        poses: `cam_from_world` of the views. [N, 4, 4].
        track: Where the camera was, if it moved while photos were taken; None where it stood.
        times: Times of the photos, s; needed with a track. [N].
        repeats: Number of photos that `again` is the mean of.
        name: Name for messages.
        digest: SHA-256 of the files; empty where there are none.
        drawn: Whether the earlier pictures are drawn, so that they have no noise; `again` is then the same pictures.
        edge: Pixels of the camera's photos along each edge of a pixel here: pictures may have been reduced.

    Raises:
        InputError: Photos, depths and poses are not of one size, or there are too few.
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
        """SHA-256 of photos, depths and poses."""
        parts = (self.before, self.again, self.after, self.depths, self.poses)
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()

    def quiet(self) -> Pairs:
        """These views with nothing changed: their repeated first photos stand for the later ones."""
        return replace(self, after=self.again)
