"""Recording of the align stage: table plane, board, tags, axes, points and cameras in the table frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.cameras import Camera, View, read_views
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array
from gsbridge.photogrammetry.board import Board
from gsbridge.report.recordings.recording import IMAGE_SIDE_PX, figures_text, log_scene_axes, log_views, recording
from gsbridge.report.tables.result_paths import scene_of

TAG_COLOUR = [250, 150, 30]
SEEN_COLOUR = [40, 200, 230]
SHOWN = ("scale_source", "scale", "scale_se", "residual_mm", "tilt_deg", "plane_inliers", "points", "tags")


def record_align(
    align_json: str | Path,
    views_json: str | Path,
    images: str | Path,
    points: str | Path,
    tags_json: str | Path | None,
    board: Board | None,
    out: str | Path,
) -> None:
    """Record a scene in its table frame.

    Entities: `table/axes`, `table/plane`, `table/points`, `table/board`, `table/tags` (layout), `table/tags_seen` (corners
    triangulated from the photos: how well they cover the layout shows the quality of the alignment), `table/cameras/*`,
    `table/view` with `photo` and `tags` on the timeline `view`, `summary`.

    Args:
        align_json: Record of the stage.
        views_json: Cameras and poses, table frame.
        images: Folder of undistorted images.
        points: `points.npz` of the stage.
        tags_json: Tag corners in undistorted pixels, or None.
        board: Layout of the board, or None.
        out: The `.rrd`.

    Raises:
        InputError: A file is damaged.
    """
    record, views = read_json(align_json), read_views(views_json, images)
    tags = read_json(tags_json) if tags_json is not None else {}
    try:
        with np.load(points) as file:
            positions, colours = file["points"], file["colours"]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(points, f"the points cannot be read ({error})", "Run the align stage again") from error
    reach = float(np.percentile(np.abs(positions[:, :2]), 95)) if len(positions) else 0.5
    layout = rrb.Horizontal(
        rrb.Spatial3DView(origin="table", name="Table frame"),
        rrb.Vertical(
            rrb.Spatial2DView(origin="table/view", name="Photo"), rrb.TextDocumentView(origin="summary", name="Summary")
        ),
    )
    with recording(out, "align", scene_of(align_json), layout) as stream:
        log_scene_axes(stream, 0.1)
        stream.log("summary", rr.TextDocument(figures_text(record, SHOWN), media_type="text/markdown"), static=True)
        stream.log("table/points", rr.Points3D(positions, colors=colours, radii=0.0012), static=True)
        _log_plane(stream, reach)
        if board is not None:
            _log_board(stream, board)
        log_views(stream, list(views), images, parent="table", timeline="view", plane=0.15)
        _log_tags(stream, list(views), tags)


def _log_plane(stream: rr.RecordingStream, reach: float) -> None:
    """Log a see-through square at z = 0 of half edge `reach`, m, and a grid of 10 cm on it."""
    corners = np.array([[-reach, -reach, 0], [reach, -reach, 0], [reach, reach, 0], [-reach, reach, 0]])
    stream.log(
        "table/plane",
        rr.Mesh3D(vertex_positions=corners, triangle_indices=[[0, 1, 2], [0, 2, 3]], albedo_factor=[120, 160, 220, 60]),
        static=True,
    )
    ticks = np.arange(-np.floor(reach * 10), np.floor(reach * 10) + 1) / 10
    lines = [[[x, -reach, 0], [x, reach, 0]] for x in ticks] + [[[-reach, y, 0], [reach, y, 0]] for y in ticks]
    stream.log("table/plane/grid", rr.LineStrips3D(lines, colors=[120, 120, 120, 90], radii=0.0004), static=True)


def _log_board(stream: rr.RecordingStream, board: Board) -> None:
    """Log the rim of the sheet and the squares of its tags."""
    width, height = board.size
    rim = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [width / 2, height / 2]
    stream.log("table/board", rr.LineStrips3D([np.c_[rim, np.zeros(5)]], colors=[240, 240, 240], radii=0.0006), static=True)
    squares = {tag: np.vstack([corners, corners[:1]]) for tag, corners in board.corners().items()}
    stream.log(
        "table/tags",
        rr.LineStrips3D(list(squares.values()), colors=TAG_COLOUR, radii=0.0006, labels=[str(tag) for tag in squares]),
        static=True,
    )


def _log_tags(stream: rr.RecordingStream, views: list[View], tags: dict) -> None:
    """Log the tag corners over the photos, and as points triangulated from all photos."""
    sights: dict[tuple[str, int], list[tuple[Camera, Array, Array]]] = {}
    for index, view in enumerate(views):
        found = {tag: np.array(corners, dtype=np.float64) for tag, corners in tags.get(view.name, {}).items()}
        stream.set_time("view", sequence=index)
        closed = [np.vstack([corners, corners[:1]]) for corners in found.values()]
        # Photos are logged at a reduced size, so the corners are scaled with them.
        factor = min(1.0, IMAGE_SIDE_PX / max(view.camera.width, view.camera.height))
        stream.log("table/view/tags", rr.LineStrips2D([line * factor for line in closed], colors=TAG_COLOUR, radii=1.0))
        for tag, corners in found.items():
            for corner in range(4):
                sights.setdefault((tag, corner), []).append((view.camera, view.cam_from_table, corners[corner]))
    seen = [triangulate(rays) for rays in sights.values() if len(rays) >= 2]
    if seen:
        stream.log("table/tags_seen", rr.Points3D(np.array(seen), colors=SEEN_COLOUR, radii=0.0015), static=True)


def triangulate(sights: list[tuple[Camera, Array, Array]]) -> Array:
    """Point nearest to the lines of sight of one feature, in the least-squares sense. [3].

    Args:
        sights: Camera, `cam_from_table` [4, 4] and pixel [2] of each photo, at least two.
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for camera, pose, pixel in sights:
        ray = np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])
        direction = pose[:3, :3].T @ (ray / np.linalg.norm(ray))
        across = np.eye(3) - np.outer(direction, direction)
        normal += across
        right += across @ (-pose[:3, :3].T @ pose[:3, 3])
    return np.linalg.solve(normal, right)
