"""The sheet on which a person reads pixels of photos, to help the masks of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import read_views
from gsbridge.configuration.scenes import MaskPoint
from gsbridge.errors import InputError
from gsbridge.report.pages.html import write_page
from gsbridge.report.pages.photo_pictures import jpeg_uri, masked_photo, ruled

PHOTOS = 12
"""Number of photos on a sheet if none is named, spread evenly over the capture."""
_LONGEST = 1000


@dataclass(frozen=True)
class SheetPhoto:
    """A photo with rulers: its file name, and a data URI."""

    name: str
    data: str


def write_mask_sheet(
    scene: str, folder: str | Path, out: str | Path, names: Sequence[str] = (), points: Sequence[MaskPoint] = ()
) -> int:
    """Write the sheet of one scene: photos with rulers, their masks where there are some, and points already given.

    Args:
        scene: Name of the scene.
        folder: Its results, `results/scenes/{scene}`; the stages up to align have run.
        out: The page.
        names: Photos to show; if empty, `PHOTOS` of all.
        points: Points that were already given; see `SceneMasks`.

    Returns:
        Number of photos shown.

    Raises:
        InputError: The scene has no registered photos, or none of a given name.
    """
    base = Path(folder)
    if not (base / "align/views.json").is_file():
        # The folder of the run holds `results`.
        run = base.parents[1].parent
        where = "" if run.resolve() == Path.cwd() else f"--directory {run} "
        remedy = f"Run snakemake {where}-- results/scenes/{scene}/align/align.json"
        raise InputError(base / "align/views.json", "this scene has no registered photos yet", remedy)
    views = {view.name: view for view in read_views(base / "align/views.json", base / "sfm/images")}
    unknown = [name for name in names if name not in views]
    if unknown:
        raise InputError(
            base / "sfm/images" / unknown[0],
            "no registered photo has this name",
            f"Use one of {', '.join(list(views)[:5])}, ...",
        )
    every = list(views)
    wanted = list(names) or [every[i] for i in np.unique(np.linspace(0, len(every) - 1, PHOTOS).round().astype(int))]
    photos = []
    for name in wanted:
        mask = base / "masks/images" / f"{Path(name).stem}.png"
        picture = masked_photo(base / "sfm/images" / name, mask if mask.is_file() else None, _LONGEST, dim=0.7)
        given = [(u, v, kind) for photo, u, v, kind in points if photo == name]
        photos.append(SheetPhoto(name, jpeg_uri(ruled(picture, picture.shape[1] / views[name].camera.width, given))))
    example = f'["{wanted[0]}", {round(views[wanted[0]].camera.width / 2)}, {round(views[wanted[0]].camera.height / 2)}, keep]'
    write_page(out, "mask_sheet.html.j2", scene=scene, photos=photos, example=example, masked=(base / "masks/images").is_dir())
    return len(photos)
