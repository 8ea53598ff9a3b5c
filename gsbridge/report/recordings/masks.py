"""Recording of the masks stage: each mask over its photo."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.cameras import read_views
from gsbridge.images import read_mask
from gsbridge.report.recordings.recording import log_photo, recording, small_image
from gsbridge.report.tables.result_paths import scene_of

OBJECT_CLASS = 1


def record_masks(views_json: str | Path, images: str | Path, masks: str | Path, out: str | Path) -> None:
    """Record the masks of one object over its photos.

    Entities: `photo`, `photo/mask` (class 1 = object), `photo/outline` and `plots/area_percent` on the timeline `view`.

    Args:
        views_json: Registered views.
        images: Folder of undistorted images.
        masks: Folder of masks, one PNG per view.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    views = read_views(views_json, images)
    layout = rrb.Horizontal(
        rrb.Spatial2DView(origin="photo", name="Mask over photo"),
        rrb.TimeSeriesView(origin="plots", name="Area (% of the photo)"),
        column_shares=[2, 1],
    )
    with recording(out, "masks", scene_of(views_json), layout) as stream:
        stream.log(
            "photo", rr.AnnotationContext([(0, "table", (0, 0, 0, 0)), (OBJECT_CLASS, "object", (255, 60, 60))]), static=True
        )
        for index, view in enumerate(views):
            stream.set_time("view", sequence=index)
            photo = small_image(views.path(view))
            mask = read_mask(Path(masks) / f"{Path(view.name).stem}.png") >= 0.5
            size = (photo.shape[1], photo.shape[0])
            small = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
            rings = cv2.findContours(small, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
            outlines = [np.vstack([ring[:, 0], ring[:1, 0]]) + 0.5 for ring in rings]
            log_photo(stream, "photo/image", photo)
            stream.log("photo/mask", rr.SegmentationImage((small * OBJECT_CLASS).astype(np.uint8), opacity=0.4))
            stream.log("photo/outline", rr.LineStrips2D(outlines, colors=[255, 230, 60], radii=0.8))
            stream.log("plots/area_percent", rr.Scalars(100 * float(mask.mean())))
