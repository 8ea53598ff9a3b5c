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
        ordered: Whether neighbours in `names` are neighbours on the camera's path.
        camera: Calibrated camera, kept fixed; None to estimate it.
        focal_prior_px: Focal length from EXIF data, px at size `size`; None if unknown.
        size: Width and height of most images, px.
        other_sizes: Width and height of images of another size, by name. Each size gets a camera of its own.
        other_lenses: For images taken with another lens, by name: the lens's number, and its focal length from EXIF data, px
            (None if unknown). Each lens gets a camera of its own, unless `camera` is given.
    """

    folder: Path
    names: list[str]
    ordered: bool
    camera: Camera | None
    focal_prior_px: float | None
    size: tuple[int, int]
    other_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    other_lenses: Mapping[str, tuple[int, float | None]] = field(default_factory=dict)

    def by_camera(self) -> list[tuple[tuple[int, int], float | None, list[str]]]:
        """Size, focal length from EXIF data (px) and names of the images that share a camera, for each camera in order."""
        out: dict[tuple[tuple[int, int], int], tuple[float | None, list[str]]] = {}
        for name in self.names:
            first = (0, self.focal_prior_px)
            lens, focal = first if self.camera is not None else self.other_lenses.get(name, first)
            out.setdefault((self.other_sizes.get(name, self.size), lens), (focal, []))[1].append(name)
        return [(size, focal, names) for (size, _), (focal, names) in out.items()]
