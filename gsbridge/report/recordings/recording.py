"""Opening and closing of rerun recordings, and logging that several stages share."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.cameras import Camera, View
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.meshes import Mesh
from gsbridge.splats.cloud import Cloud

IMAGE_SIDE_PX = 640
"""Longer side of logged images, px: recordings stay small enough to mail."""
JPEG_QUALITY = 80


@contextlib.contextmanager
def recording(out: str | Path, stage: str, scene: str, layout: rrb.Container) -> Iterator[rr.RecordingStream]:
    """Yield a stream that writes to `out`; the file appears only when the block ends without an error.

    Args:
        out: The `.rrd`.
        stage: Stage, the recording's application.
        scene: Scene, the recording's name.
        layout: Views of the viewer.
    """
    with atomic_file(out) as temporary:
        # A fixed id: two recordings of the same files differ in their log times only.
        stream = rr.RecordingStream(f"gsbridge_{stage}", recording_id=f"{stage}-{scene}")
        stream.save(str(temporary), default_blueprint=_blueprint(layout))
        stream.send_recording_name(scene)
        try:
            yield stream
            stream.flush()
        finally:
            stream.disconnect()


def _blueprint(layout: rrb.Container) -> rrb.Blueprint:
    """The layout with the panels of the viewer small, so that the data has the room."""
    panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"), rrb.TimePanel(state="collapsed")
    return rrb.Blueprint(layout, *panels)


def figures_text(record: Mapping[str, Any], names: Sequence[str]) -> str:
    """Status, reasons and the named figures of a record, as a Markdown table."""
    lines = [f"status **{record['status']}**", "", *(f"- {reason}" for reason in record["reasons"]), "", "| | |", "|---|---|"]
    for name in names:
        value = record.get(name)
        if value is not None:
            lines.append(f"| {name} | {f'{value:.4g}' if isinstance(value, float) else value} |")
    return "\n".join(lines)


def log_scene_axes(stream: rr.RecordingStream, length: float, entity: str = "table/axes") -> None:
    """Log a right-handed frame with z up and its axes (x red, y green, z blue).

    Args:
        stream: Recording.
        length: Length of the axes, m.
        entity: Where to put them in the recording.
    """
    stream.log("table", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log(
        entity,
        rr.Arrows3D(
            origins=np.zeros((3, 3)),
            vectors=np.eye(3) * length,
            colors=[[220, 50, 50], [50, 180, 50], [60, 90, 230]],
            labels=["x", "y", "z"],
        ),
        static=True,
    )


def log_camera(
    stream: rr.RecordingStream, entity: str, camera: Camera, cam_from_parent: Array, *, plane: float, static: bool
) -> None:
    """Log pose and intrinsics of a camera below its parent frame.

    Args:
        stream: Recording.
        entity: Path of the camera.
        camera: Pinhole.
        cam_from_parent: View matrix. [4, 4].
        plane: Distance at which the viewer draws the image, in units of the parent.
        static: True for a pose that holds at all times.
    """
    pose = np.asarray(cam_from_parent)
    stream.log(
        entity,
        rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3], relation=rr.TransformRelation.ChildFromParent),
        rr.Pinhole(
            image_from_camera=camera.intrinsics,
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=plane,
        ),
        static=static,
    )


def log_centres(stream: rr.RecordingStream, entity: str, cloud: Cloud) -> None:
    """Log the splats of a body as points, which every viewer draws.

    The radius of a point is the middle one of its splat's three scales, limited to 0.2 to 5 mm.

    Args:
        stream: Recording.
        entity: Where to put them in the recording.
        cloud: The splats.
    """
    colours = np.rint(np.clip(cloud.colours, 0, 1) * 255).astype(np.uint8)
    radii = np.clip(np.sort(cloud.scales, axis=1)[:, 1], 2e-4, 5e-3)
    stream.log(entity, rr.Points3D(cloud.means, colors=colours, radii=radii), static=True)


def small_image(path: str | Path, side_px: int = IMAGE_SIDE_PX) -> Array:
    """An image, scaled down until its longer side is at most `side_px`. [H, W, 3] uint8."""
    image = read_image_u8(path)
    factor = side_px / max(image.shape[:2])
    if factor >= 1:
        return image
    return cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


def log_photo(stream: rr.RecordingStream, entity: str, image: Array, *, static: bool = False) -> None:
    """Log an image as JPEG.

    Args:
        stream: Recording.
        entity: Where to put it in the recording.
        image: RGB. [H, W, 3] uint8.
        static: Whether it is shown at all times, instead of from the recording's current time on.
    """
    stream.log(entity, rr.Image(image).compress(jpeg_quality=JPEG_QUALITY), static=static)


def log_views(
    stream: rr.RecordingStream, views: Sequence[View], images: str | Path, *, parent: str, timeline: str, plane: float
) -> None:
    """Log all views: a small frustum each, and one camera with its photo that moves along the timeline.

    Args:
        stream: Recording.
        views: Poses and cameras.
        images: Folder of the photos.
        parent: Entity whose frame the poses belong to.
        timeline: Name of the sequence.
        plane: Distance from the camera at which images are drawn, m.
    """
    for index, view in enumerate(views):
        stem = rr.escape_entity_path_part(Path(view.name).stem)
        log_camera(stream, f"{parent}/cameras/{stem}", view.camera, view.cam_from_table, plane=0.2 * plane, static=True)
        stream.set_time(timeline, sequence=index)
        photo = small_image(Path(images) / view.name)
        camera = view.camera.scaled(photo.shape[1] / view.camera.width)
        log_camera(stream, f"{parent}/view", camera, view.cam_from_table, plane=plane, static=False)
        log_photo(stream, f"{parent}/view/photo", photo)
        stream.log("name", rr.TextLog(f"{view.name} ({view.split})"))


def log_mesh(stream: rr.RecordingStream, entity: str, mesh: Mesh, colour: Sequence[int]) -> None:
    """Log a mesh with its vertex colours, or in one colour where it has none.

    Args:
        stream: Recording.
        entity: Where to put it in the recording.
        mesh: The mesh.
        colour: RGB 0..255. [3].
    """
    normals = np.zeros_like(mesh.vertices)
    corners = mesh.corners()
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], weighted)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    colours = None if mesh.colours is None else np.rint(mesh.colours * 255).astype(np.uint8)
    stream.log(
        entity,
        rr.Mesh3D(
            vertex_positions=mesh.vertices,
            triangle_indices=mesh.faces,
            vertex_normals=normals,
            vertex_colors=colours,
            albedo_factor=None if colours is not None else [*colour, 255],
        ),
        static=True,
    )
