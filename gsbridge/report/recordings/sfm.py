"""Recording of the sfm stage: sparse model, cameras and images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.cameras import View
from gsbridge.files import read_json
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix, read_model
from gsbridge.report.recordings.recording import figures_text, log_views, recording
from gsbridge.report.tables.result_paths import scene_of

SHOWN = ("registered", "total", "points", "track_length", "reprojection_px", "mapper", "retries", "layout_error")


def record_sfm(model: str | Path, images: str | Path, sfm_json: str | Path, out: str | Path) -> None:
    """Record the sparse model of one scene, in the model's own frame and unit.

    Entities: `model/points`, `model/cameras/*`, `model/view` with `photo` on the timeline `view`, `summary`.

    Args:
        model: Folder of the undistorted COLMAP model.
        images: Folder of the undistorted images.
        sfm_json: Record of the stage.
        out: The `.rrd`.

    Raises:
        InputError: The model or an image cannot be read.
    """
    record = read_json(sfm_json)
    found = read_model(model)
    reconstructed = sorted((found.image(index) for index in found.reg_image_ids()), key=lambda image: image.name)
    views = [View(image.name, camera_from_colmap(image.camera, model), pose_matrix(image)) for image in reconstructed]
    points = [found.points3D[index] for index in sorted(found.points3D)]
    positions = np.array([point.xyz for point in points]).reshape(-1, 3)
    colours = np.array([point.color for point in points], dtype=np.uint8).reshape(-1, 3)
    centres = np.array([view.centre for view in views]).reshape(-1, 3)
    # The unit is arbitrary: sizes on screen follow the distance between cameras and points.
    size = float(np.median(np.linalg.norm(centres - np.median(positions, axis=0), axis=1))) if len(positions) else 1.0
    layout = rrb.Horizontal(
        rrb.Spatial3DView(origin="model", name="Sparse model"),
        rrb.Vertical(
            rrb.Spatial2DView(origin="model/view", name="Photo"), rrb.TextDocumentView(origin="summary", name="Summary")
        ),
    )
    with recording(out, "sfm", scene_of(sfm_json), layout) as stream:
        # The frame of a sparse model is arbitrary; COLMAP's usual first camera looks along z with y down.
        stream.log("model", rr.ViewCoordinates.RDF, static=True)
        stream.log("model/points", rr.Points3D(positions, colors=colours, radii=0.003 * size), static=True)
        stream.log("summary", rr.TextDocument(figures_text(record, SHOWN), media_type="text/markdown"), static=True)
        log_views(stream, views, images, parent="model", timeline="view", plane=0.25 * size)
