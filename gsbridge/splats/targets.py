"""Targets of the training: photos, and the weights of their pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gsbridge.cameras import Camera, View, Views, camera_centre
from gsbridge.errors import InputError, StageError
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8, read_mask, to_u8
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.matting import unmix


@dataclass(frozen=True)
class Target:
    """A photo, or the part of it that training uses.

    Args:
        name: Image name of the view.
        split: `train` or `held_out`.
        camera: Pinhole of this part of the photo.
        cam_from_table: Pose of the camera. [4, 4].
        photo: This part of the photo; for objects, outline pixels show the object's own colour without the background's share.
            [H, W, 3] uint8.
        weight: Objects: the mask, used as alpha. Backgrounds: 255 where the pixel's ray meets the table mesh. [H, W] uint8.
        unedited: This part of the photo as it was taken, which metrics compare with. [H, W, 3] uint8.
        left, top: Position of this part in the whole photo, px.
        whole: Camera of the whole photo.
    """

    name: str
    split: str
    camera: Camera
    cam_from_table: Array
    photo: Array
    weight: Array
    unedited: Array
    left: int
    top: int
    whole: Camera

    def reduced(self, factor: float, *, kind: str) -> Target:
        """Return this part of the photo at a smaller size (area means).

        Args:
            factor: New width over old width; from 1 on, nothing changes.
            kind: `object` keeps partly covered pixels, with the mean colour of their covered part; `background` drops them.
        """
        if factor >= 1:
            return self
        camera = self.camera.scaled(factor)
        size = (camera.width, camera.height)
        weight = self.weight.astype(np.float32) / 255
        colour = self.photo * weight[..., None] if kind == "object" else self.photo
        colour = cv2.resize(colour, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if kind == "object":
            colour /= np.maximum(weight, 1e-3)[..., None]
        else:
            weight = (weight > 0.999).astype(np.float32)
        photo = np.rint(np.clip(colour, 0, 255)).astype(np.uint8)
        unedited = cv2.resize(self.unedited, size, interpolation=cv2.INTER_AREA)
        return Target(self.name, self.split, camera, self.cam_from_table, photo, to_u8(weight), unedited, 0, 0, camera)

    def affordable(self, max_pixels: int, *, kind: str) -> Target:
        """Reduce this part to at most about `max_pixels` pixels, the limit of a training step; `kind` as in `reduced`."""
        return self.reduced(min(1.0, (max_pixels / (self.camera.width * self.camera.height)) ** 0.5), kind=kind)


def object_targets(views: Views, masks: str | Path, margin_px: int) -> list[Target]:
    """Return photos cropped to their masks; views with an empty mask are left out.

    Args:
        views: Registered views.
        masks: Folder of the masks, `{image stem}.png`.
        margin_px: Margin around the mask's bounding box, px, in which splats are penalised.

    Raises:
        InputError: A mask is missing or has another size than its photo.
        StageError: No training view has a mask.
    """
    targets = []
    for view in views:
        path = Path(masks) / f"{Path(view.name).stem}.png"
        mask = to_u8(read_mask(path))
        photo = read_image_u8(views.path(view))
        _check_size(path, mask, view)
        _check_size(views.path(view), photo, view)
        if not (mask > 127).any():
            continue
        clean = unmix(photo, mask.astype(np.float32) / 255)
        rows, columns = np.flatnonzero(mask.max(1)), np.flatnonzero(mask.max(0))
        top, bottom = max(0, rows[0] - margin_px), min(view.camera.height, rows[-1] + 1 + margin_px)
        left, right = max(0, columns[0] - margin_px), min(view.camera.width, columns[-1] + 1 + margin_px)
        part = np.s_[top:bottom, left:right]
        camera = view.camera.cropped(int(left), int(top), int(right - left), int(bottom - top))
        targets.append(
            Target(
                view.name,
                view.split,
                camera,
                view.cam_from_table,
                np.ascontiguousarray(clean[part]),
                np.ascontiguousarray(mask[part]),
                np.ascontiguousarray(photo[part]),
                int(left),
                int(top),
                view.camera,
            )
        )
    if not any(target.split == "train" for target in targets):
        raise StageError("splats", "every training view has an empty mask", "Look at the masks stage and its images")
    return targets


def background_targets(views: Views, mesh: Mesh) -> list[Target]:
    """Return whole photos in which only those pixels count whose ray meets the mesh.

    Raises:
        InputError: A photo has another size than its camera.
        StageError: No training view sees the mesh.
    """
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    targets = []
    for view in views:
        photo = read_image_u8(views.path(view))
        _check_size(views.path(view), photo, view)
        directions = view.camera.pixel_rays() @ view.cam_from_table[:3, :3]
        origins = np.broadcast_to(camera_centre(view.cam_from_table), directions.shape)
        rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
        hit = np.isfinite(scene.cast_rays(open3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy())
        if hit.any():
            weight = np.where(hit, 255, 0).astype(np.uint8)
            targets.append(
                Target(view.name, view.split, view.camera, view.cam_from_table, photo, weight, photo, 0, 0, view.camera)
            )
    if not any(target.split == "train" for target in targets):
        raise StageError("splats", "no training view sees the mesh", "Look at the mesh stage and at the alignment")
    return targets


def seen_faces(mesh: Mesh, targets: Sequence[Target]) -> Array:
    """Return which faces any training photo shows: centroid in the frame, facing the camera, not occluded. [F] bool."""
    seen = np.zeros(len(mesh.faces), bool)
    view = _Surface(mesh)
    for target in targets:
        if target.split == "train":
            seen[view.shown(target, ~seen)[0]] = True
    return seen


def shown_faces(mesh: Mesh, targets: Sequence[Target]) -> Iterator[tuple[Target, Array, Array]]:
    """Yield the faces of a surface that each training photo shows.

    Args:
        mesh: Surface, table frame, m.
        targets: Photos; held-out photos are left out.

    Yields:
        A photo, the faces whose centroids it shows [K] int, and the centroids' positions in the whole photo, px [K, 2].
    """
    view, every = _Surface(mesh), np.ones(len(mesh.faces), bool)
    for target in targets:
        if target.split == "train":
            yield target, *view.shown(target, every)


class _Surface:
    """A mesh with a ray-casting scene, to find the faces that a photo shows."""

    def __init__(self, mesh: Mesh) -> None:
        self._open3d = import_open3d()
        self._scene = self._open3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
        self._centroids, self._normals = mesh.corners().mean(1), mesh.normals()

    def shown(self, target: Target, asked: Array) -> tuple[Array, Array]:
        """Return those of the faces `asked`, [F] bool, that a photo shows, and their centroids, px. [K] int, [K, 2]."""
        pose, whole = target.cam_from_table, target.whole
        eye = camera_centre(pose)
        pixels = whole.project(self._centroids @ pose[:3, :3].T + pose[:3, 3])
        inside = (pixels >= 0).all(1) & (pixels[:, 0] < whole.width) & (pixels[:, 1] < whole.height)
        chosen = np.flatnonzero(asked & inside & (((eye - self._centroids) * self._normals).sum(1) > 0))
        directions = self._centroids[chosen] - eye
        rays = np.concatenate([np.broadcast_to(eye, directions.shape), directions], axis=1).astype(np.float32)
        reach = self._scene.cast_rays(self._open3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy()
        # The ray meets the face itself at 1; a hit nearer to the camera means that the face is occluded.
        chosen = chosen[reach > 0.995]
        return chosen, pixels[chosen]


def _check_size(path: Path, image: Array, view: View) -> None:
    """Raise an `InputError` if an image's size differs from its camera's."""
    height, width = image.shape[:2]
    if (width, height) != (view.camera.width, view.camera.height):
        size = f"{view.camera.width}x{view.camera.height}"
        raise InputError(
            path, f"the image has {width}x{height} pixels, its camera {size}", "Run the sfm and masks stages again"
        )
