"""Photos with time stamps, and where the camera was."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.geometry import Array
from gsbridge.scene.track import Track

ROLES = ("fit", "select", "verify")

REFERENCE = "reference"
"""Photos of the same camera and light that the splats were not made from: by them the floor is learnt."""


@dataclass(frozen=True, eq=False)
class Shots:
    """Photos of one role.

    Args:
        times: Time stamps, s. [N].
        photos: sRGB-encoded, 0..1. [N, H, W, 3] float32.
        track: Where the camera was.
        name: For messages.
        digest: SHA-256 of the files; empty where there are none.
    """

    times: Array
    photos: Array
    track: Track
    name: str = ""
    digest: str = ""

    def __len__(self) -> int:
        return len(self.times)

    def content_digest(self) -> str:
        """SHA-256 of photos, times and poses."""
        parts = (self.times, self.photos, self.track.times, self.track.poses)
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()

    def part(self, keep: Array) -> Shots:
        """Some of the photos."""
        return replace(self, times=self.times[keep], photos=self.photos[keep])
