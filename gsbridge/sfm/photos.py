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
        focal_prior_px: Focal length from EXIF data, px.
        size: Width and height, px.
        other_sizes: Those of images that differ, by name: a camera of its own for each size.
    """

    folder: Path
    names: list[str]
    ordered: bool
    camera: Camera | None
    focal_prior_px: float | None
    size: tuple[int, int]
    other_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def by_size(self) -> dict[tuple[int, int], list[str]]:
        """Names of the images of each size, in order."""
        out: dict[tuple[int, int], list[str]] = {}
        for name in self.names:
            out.setdefault(self.other_sizes.get(name, self.size), []).append(name)
        return out
