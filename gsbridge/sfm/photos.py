"""Photos to reconstruct."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gsbridge.cameras import Camera


@dataclass(frozen=True)
class Photos:
    """Input of a reconstruction.

    Args:
        folder: Folder of the images.
        names: Images to use, in the order of the capture.
        ordered: Neighbours in `names` are neighbours on the camera's path.
        camera: Calibrated camera, kept fixed; None to find it.
        focal_prior_px: Focal length from EXIF data, px at this size.
        size: Width and height, px.
        other_sizes: Those of images that differ, by name: a camera of its own for each size.
        other_focals: Focal lengths from EXIF data of images that differ, by name, px; None where theirs is unknown. A camera of
            its own for each.
    """

    folder: Path
    names: list[str]
    ordered: bool
    camera: Camera | None
    focal_prior_px: float | None
    size: tuple[int, int]
    other_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    other_focals: Mapping[str, float | None] = field(default_factory=dict)

    def by_camera(self) -> dict[tuple[tuple[int, int], float | None], list[str]]:
        """Names of the images of each size and focal length from EXIF data, in order."""
        out: dict[tuple[tuple[int, int], float | None], list[str]] = {}
        for name in self.names:
            key = self.other_sizes.get(name, self.size), self.other_focals.get(name, self.focal_prior_px)
            out.setdefault(key, []).append(name)
        return out
