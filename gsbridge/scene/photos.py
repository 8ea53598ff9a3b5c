"""The mean colour of an object, from the photos of a capture."""

from __future__ import annotations

from pathlib import Path

from gsbridge.cameras import Views
from gsbridge.images import read_image, read_mask
from gsbridge.scene.meshes import mean_colour


def photo_colour(views: Views, masks: str | Path) -> tuple[float, float, float]:
    """Mean colour of an object inside its masks in the training photos, for the control with a mesh of one colour.

    Args:
        views: Posed photos.
        masks: Folder of masks.

    Returns:
        sRGB 0..1.

    Raises:
        InputError: A photo or mask cannot be read.
    """
    used = [view for view in views if view.split == "train"]
    colour = mean_colour(
        [read_image(views.path(view)) for view in used],
        [read_mask(Path(masks) / f"{Path(view.name).stem}.png") for view in used],
    )
    return float(colour[0]), float(colour[1]), float(colour[2])
