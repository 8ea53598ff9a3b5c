"""Undistorted images and models: a pinhole of the same focal length, without black borders."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.photogrammetry.colmap import camera_from_colmap, pose_matrix


def undistort_pixels(pixels: Array, camera: Camera) -> Array:
    """Convert pixels of `camera` to pixels of the pinhole `camera.undistorted()`. [N, 2] -> [N, 2]."""
    points = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    if camera.is_pinhole or not len(points):
        return points.copy()
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-9)
    # OpenCV only solves u = K x here, so K and pixels may both have their centres at +0.5.
    distortion = np.array(camera.distortion)
    out = cv2.undistortPoints(points[:, None], camera.intrinsics, distortion, R=None, P=camera.intrinsics, criteria=criteria)
    return out.reshape(-1, 2)


def pinhole_of(camera: Camera) -> Camera:
    """Pinhole with the focal length of `camera`, cropped to the part that the photo fills.

    The crop starts from the photo's own outline; each edge moves inwards until it lies inside the undistorted photo.
    """
    if camera.is_pinhole:
        return camera
    w, h = camera.width, camera.height
    along_x, along_y = np.linspace(0, w, 65), np.linspace(0, h, 65)

    def edge(x: Array, y: Array) -> Array:
        x, y = np.broadcast_arrays(x, y)
        return undistort_pixels(np.stack([x, y], -1), camera)

    left = max(0, int(np.ceil(edge(np.array(0.0), along_y)[:, 0].max())))
    right = min(w, int(np.floor(edge(np.array(float(w)), along_y)[:, 0].min())))
    top = max(0, int(np.ceil(edge(along_x, np.array(0.0))[:, 1].max())))
    bottom = min(h, int(np.floor(edge(along_x, np.array(float(h)))[:, 1].min())))
    return camera.undistorted().cropped(left, top, max(1, right - left), max(1, bottom - top))


def undistort_image(image: Array, camera: Camera, pinhole: Camera, *, interpolation: int = cv2.INTER_CUBIC) -> Array:
    """Resample a photo of `camera` into `pinhole`. uint8 or float [H, W, ...] -> [H', W', ...].

    Args:
        image: Photo or mask in the pixels of `camera`. [H, W, ...].
        camera: Camera of the photo, with distortion.
        pinhole: Camera of the result; same pose.
        interpolation: OpenCV's constant; `INTER_NEAREST` or `INTER_LINEAR` for masks.
    """
    if camera == pinhole:
        return image
    rays = pinhole.pixel_rays()
    # OpenCV's maps have pixel centres at integers.
    source = (camera.project(rays) - 0.5).astype(np.float32)
    return cv2.remap(image, source[..., 0], source[..., 1], interpolation, borderMode=cv2.BORDER_REFLECT)


def undistorted_model(model: pycolmap.Reconstruction, pinholes: dict[int, Camera]) -> pycolmap.Reconstruction:
    """Copy of a model with pinhole cameras and undistorted observations; images without a pose are left out.

    Args:
        model: Model of the photos as taken.
        pinholes: Camera of the undistorted images by camera id.
    """
    out = pycolmap.Reconstruction()
    for camera_id, pinhole in pinholes.items():
        out.add_camera_with_trivial_rig(
            pycolmap.Camera(
                camera_id=camera_id,
                model="PINHOLE",
                width=pinhole.width,
                height=pinhole.height,
                params=[pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy],
            )
        )
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        camera = camera_from_colmap(image.camera, image.name)
        pinhole = pinholes[image.camera_id]
        pixels = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        shift = np.array([pinhole.cx - camera.cx, pinhole.cy - camera.cy])
        moved = undistort_pixels(pixels, camera) + shift
        copy = pycolmap.Image(image.name, moved, image.camera_id, image_id)
        pose = pycolmap.Rigid3d(pose_matrix(image)[:3])
        out.add_image_with_trivial_frame(copy, pose)
    for point_id, point in model.points3D.items():
        out.add_point3D_with_id(point_id, point)
    return out


def undistort_photos(frames: Path, names: dict[str, tuple[Camera, Camera]], out: Path, threads: int) -> None:
    """Write undistorted photos.

    Args:
        frames: Folder of the photos as taken.
        names: Camera and pinhole by file name.
        out: Existing folder.
        threads: Threads to use.
    """
    from gsbridge.images import read_image_u8, write_image
    from gsbridge.logs import track

    def undistort(name: str) -> None:
        write_image(out / name, undistort_image(read_image_u8(frames / name), *names[name]))

    with ThreadPoolExecutor(threads) as pool:
        for _ in track(pool.map(undistort, names), "undistort photos", len(names)):
            pass
