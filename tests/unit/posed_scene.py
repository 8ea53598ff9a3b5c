"""Cameras round a board with known truth, as numbers and as drawn photos, for the tests of sfm and align."""

from __future__ import annotations

import functools
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import Array, Similarity
from gsbridge.images import write_image
from gsbridge.photogrammetry.board import standard_board, tag_pixels
from gsbridge.photogrammetry.colmap import colmap_params

BOARD = standard_board()
LENS = Camera(640, 480, 600.0, 601.0, 323.0, 236.0, (0.04, -0.03, 0.0005, -0.0004))


def orbit(count: int, arc: float = 2 * np.pi, distance: float = 0.45) -> list[Array]:
    """`cam_from_table` of cameras on a rising path that look near the board's centre. [4, 4] each."""
    out = []
    for i in range(count):
        angle, lift = arc * i / count, np.deg2rad(30 + 25 * i / count)
        eye = distance * np.array([np.cos(angle) * np.cos(lift), np.sin(angle) * np.cos(lift), np.sin(lift)])
        out.append(look_at(eye, np.array([0.01 * np.sin(3.0 * i), 0.01 * np.cos(2.0 * i), 0.01])))
    return out


def names(count: int) -> list[str]:
    return [f"{i:04d}.png" for i in range(count)]


def local(pose: Array, points: Array) -> Array:
    """Points in camera coordinates. [N, 3]."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def sightings(camera: Camera, poses: list[Array], noise: float = 0.0, seed: int = 0) -> dict[str, dict[int, Array]]:
    """Tag corners as seen, px, by image and tag."""
    rng = np.random.default_rng(seed)
    out: dict[str, dict[int, Array]] = {}
    for name, pose in zip(names(len(poses)), poses, strict=True):
        out[name] = {}
        for tag, corners in BOARD.corners().items():
            pixels = camera.project(local(pose, corners)) + rng.normal(0, noise, (4, 2))
            if ((pixels > 2) & (pixels < [camera.width - 2, camera.height - 2])).all():
                out[name][tag] = pixels
    return out


def cloud(seed: int = 0, on_table: int = 600, above: int = 200) -> Array:
    """Points on a table of 0.8 x 0.6 m and on a box of 6 x 4 x 5 cm at its centre. [N, 3]."""
    rng = np.random.default_rng(seed)
    table = np.c_[rng.uniform([-0.4, -0.3], [0.4, 0.3], (on_table, 2)), rng.normal(0, 2e-4, on_table)]
    box = rng.uniform([-0.03, -0.02, 0.01], [0.03, 0.02, 0.05], (above, 3))
    return np.r_[table, box]


def model_of(camera: Camera, poses: list[Array], points: Array, noise: float = 0.0, seed: int = 0) -> pycolmap.Reconstruction:
    """A COLMAP model of the given truth, with noise on the observations, px."""
    rng = np.random.default_rng(seed)
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1,
            model="PINHOLE" if camera.is_pinhole else "OPENCV",
            width=camera.width,
            height=camera.height,
            params=colmap_params(camera),
        )
    )
    tracks: dict[int, pycolmap.Track] = {}
    for i, (name, pose) in enumerate(zip(names(len(poses)), poses, strict=True)):
        pixels = camera.project(local(pose, points))
        # Far outside the image the lens polynomial folds back into it.
        straight = camera.undistorted().project(local(pose, points))
        pixels[~(np.abs(straight - [camera.cx, camera.cy]) < [camera.width, camera.height]).all(1)] = np.nan
        seen = np.flatnonzero((np.nan_to_num(pixels, nan=-1.0) > 0).all(1) & (pixels < [camera.width, camera.height]).all(1))
        noisy = pixels[seen] + rng.normal(0, noise, (len(seen), 2))
        model.add_image_with_trivial_frame(pycolmap.Image(name, noisy, 1, i + 1), pycolmap.Rigid3d(pose[:3]))
        for place, point in enumerate(seen):
            tracks.setdefault(int(point), pycolmap.Track()).add_element(i + 1, place)
    for point, track in sorted(tracks.items()):
        if track.length() >= 2:
            model.add_point3D(points[point], track)
    return model


def moved(model: pycolmap.Reconstruction, target_from_source: Similarity) -> pycolmap.Reconstruction:
    """Copy of a model in another frame."""
    out = pycolmap.Reconstruction(model)
    rotation = pycolmap.Rotation3d(target_from_source.rotation)
    out.transform(pycolmap.Sim3d(target_from_source.scale, rotation, target_from_source.translation))
    return out


@functools.cache
def _print() -> Array:
    """Texture of 1 x 1 m, 0..1, at 0.5 mm per pixel. [2000, 2000] float32."""
    rng = np.random.default_rng(5)
    out = np.zeros((2000, 2000), np.float32)
    for cell in (7, 17, 40):
        coarse = rng.random((2000 // cell + 2, 2000 // cell + 2)).astype(np.float32)
        out += cv2.resize(coarse, (2000, 2000), interpolation=cv2.INTER_CUBIC)
    return (out - out.min()) / (out.max() - out.min())


def _shade(points: Array) -> Array:
    """Brightness of the table and of the block on it, 0..1: the board's tags on white, texture elsewhere. [N, 3] -> [N]."""
    # The block's sides show the texture too, sheared; a lookup is far cheaper than the formula.
    flat = ((points[:, :2] + 0.7 * points[:, 2:]) / 0.0005 + 1000.0).astype(np.float32)
    flat = flat.reshape(-1, 100, 2)
    value = 0.25 + 0.6 * cv2.remap(_print(), flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP).ravel()
    half = BOARD.tag_size / 2
    for tag, centre in zip(BOARD.ids, BOARD.centres, strict=True):
        offset = points[:, :2] - centre
        paper = (np.abs(offset) < 1.3 * half).all(1) & (points[:, 2] < 1e-6)
        value[paper] = 0.9
        inside = paper & (np.abs(offset) < half).all(1)
        column, row = np.floor((offset[inside] * [1, -1] + half) / BOARD.tag_size * 8).astype(int).clip(0, 7).T
        value[inside] = 0.05 + 0.85 * tag_pixels(tag)[row, column]
    return value


def draw(camera: Camera, pose: Array) -> Array:
    """Photo of the table with the board and a block of 6 x 6 x 4 cm, linear light box-filtered. uint8 [H, W, 3]."""
    fine = 2
    u, v = np.meshgrid((np.arange(camera.width * fine) + 0.5) / fine, (np.arange(camera.height * fine) + 0.5) / fine)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-8)
    xy = cv2.undistortPoints(
        np.stack([u, v], -1).reshape(-1, 1, 2), camera.intrinsics, np.array(camera.distortion), criteria=criteria
    ).reshape(-1, 2)
    rays = np.c_[xy, np.ones(len(xy))] @ pose[:3, :3]
    eye = -pose[:3, :3].T @ pose[:3, 3]
    table = -eye[2] / np.minimum(rays[:, 2], -1e-2)
    low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.04])
    t = np.stack([(low - eye) / rays, (high - eye) / rays])
    enter, leave = t.min(0).max(-1), t.max(0).min(-1)
    depth = np.where(enter < leave, np.minimum(enter, table), table)
    light = _shade(eye + depth[:, None] * rays).reshape(v.shape)
    light = light.reshape(camera.height, fine, camera.width, fine).mean((1, 3))
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.repeat(np.rint(255 * encoded.clip(0, 1)).astype(np.uint8)[..., None], 3, axis=2)


@functools.cache
def photos(folder: Path, count: int = 9, width: int = 400, height: int = 300) -> tuple[Camera, list[Array]]:
    """Draw photos into a folder (once per folder and process); their camera and poses."""
    camera = Camera(width, height, 0.95 * width, 0.95 * width, 0.505 * width, 0.49 * height, (0.04, -0.03, 0.0, 0.0))
    poses = orbit(count, arc=np.deg2rad(8.0 * count))
    for name, pose in zip(names(count), poses, strict=True):
        write_image(folder / name, draw(camera, pose))
    return camera, poses
