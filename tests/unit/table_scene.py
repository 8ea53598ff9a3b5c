"""A ball on a table, drawn from formulas: photos, masks, depth and sparse points with known truth."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera, View, Views, look_at, split_of
from gsbridge.geometry import Array
from gsbridge.images import write_image

RADIUS = 0.03
CENTRE = np.array([0.0, 0.0, 0.026])
"""The ball is sunk 4 mm into the table, so that it has a foot."""


@functools.cache
def _lattice() -> Array:
    return np.random.default_rng(3).random((32, 32, 32)).astype(np.float32)


def noise(points: Array, scale: float) -> Array:
    """Smooth random texture in space, 0..1. [N, 3] -> [N]."""
    lattice = _lattice()
    q = points / scale
    cell = np.floor(q).astype(int)
    f = q - cell
    f = f * f * (3 - 2 * f)
    out = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod([f[:, k] if c else 1 - f[:, k] for k, c in enumerate(corner)], axis=0)
        index = (cell + np.array(corner)) % 32
        out += weight * lattice[index[:, 0], index[:, 1], index[:, 2]]
    return out


def texture(points: Array) -> Array:
    """Texture with coarse and fine parts, 0..1. [N, 3] -> [N]."""
    return 0.5 * noise(points, 0.008) + 0.5 * noise(points + 5.0, 0.0035)


@dataclass(frozen=True)
class Scene:
    """Photos of the scene and what is true of them.

    Args:
        views: Exact cameras; `views.images` holds the photos.
        points_npz: Sparse points as the align stage writes them.
        masks: Folder of the true masks.
        inside: The true masks. [H, W] bool each.
        depths: True depth along camera z. [H, W] each.
    """

    views: Views
    points_npz: Path
    masks: Path
    inside: list[Array]
    depths: list[Array]


def cameras(count: int, camera: Camera, distance: float = 0.3) -> list[View]:
    """Views on a rising orbit that look at the ball."""
    out = []
    for index in range(count):
        angle = 2 * np.pi * index / count
        lift = np.deg2rad(25 + 30 * ((index * 5) % count) / count)
        eye = distance * np.array([np.cos(angle) * np.cos(lift), np.sin(angle) * np.cos(lift), np.sin(lift)])
        out.append(View(f"{index:04d}.png", camera, look_at(eye, CENTRE), split_of(index)))
    return out


def trace(view: View, *, ball: bool = True, block: bool = False) -> tuple[Array, Array, Array]:
    """Points, depth and "on the ball" of every pixel. [H, W, 3], [H, W], [H, W].

    `block` puts a box of 6 x 6 x 2 cm onto the table in place of the ball.
    """
    rays = view.camera.pixel_rays() @ view.cam_from_table[:3, :3]
    eye = view.centre
    table = -eye[2] / np.minimum(rays[..., 2], -1e-6)
    hit = np.full(table.shape, np.inf)
    if ball:
        a = (rays**2).sum(-1)
        b = rays @ (eye - CENTRE)
        c = ((eye - CENTRE) ** 2).sum() - RADIUS**2
        root = b**2 - a * c
        hit = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    if block:
        low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.02])
        with np.errstate(divide="ignore"):
            t = np.stack([(low - eye) / rays, (high - eye) / rays])
        enter, leave = t.min(0).max(-1), t.max(0).min(-1)
        hit = np.where(enter < leave, enter, np.inf)
    on = hit < table
    depth = np.where(on, hit, table)
    return eye + depth[..., None] * rays, depth, on


def photo(points: Array, on: Array, brightness: float = 1.0) -> Array:
    """Colours of traced points: a red ball, a grey table. [H, W, 3] -> [H, W, 3] float32."""
    shape = on.shape
    value = texture(points.reshape(-1, 3)).reshape(shape)[..., None]
    red = np.array([0.8, 0.25, 0.15]) * (0.4 + 0.9 * value)
    grey = np.array([0.5, 0.5, 0.45]) * (0.5 + 0.8 * texture(points.reshape(-1, 3) + 9.0).reshape(shape)[..., None])
    return np.clip(brightness * np.where(on[..., None], red, grey), 0, 1).astype(np.float32)


@functools.cache
def ball_scene(folder: Path, count: int = 14, width: int = 256, height: int = 192) -> Scene:
    """Render the ball scene into a folder (once per folder and process)."""
    camera = Camera(width, height, 1.15 * width, 1.15 * width, width / 2, height / 2)
    views = cameras(count, camera)
    rng = np.random.default_rng(1)
    inside, depths, traced = [], [], []
    for view in views:
        points, depth, on = trace(view)
        write_image(folder / "images" / view.name, photo(points, on))
        write_image(folder / "masks" / view.name, on.astype(np.float32))
        inside.append(on)
        depths.append(depth)
        traced.append(points)
    sparse = []
    for points, on in zip(traced, inside, strict=True):
        for wanted, number in ((on, 20), (~on & (np.abs(points[..., :2]).max(-1) < 0.15), 40)):
            index = np.argwhere(wanted)
            pick = index[rng.choice(len(index), number, replace=False)]
            sparse.append(points[pick[:, 0], pick[:, 1]])
    cloud = np.concatenate(sparse) + rng.normal(0, 2e-4, (len(sparse) * 30, 3))
    pairs = []
    for number, view in enumerate(views):
        local = cloud @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        pixel = np.nan_to_num(camera.project(local), nan=-1)
        inner = (pixel > 0).all(1) & (pixel < (width, height)).all(1)
        index = np.floor(pixel[inner]).astype(int)
        seen = np.flatnonzero(inner)[np.abs(depths[number][index[:, 1], index[:, 0]] - local[inner, 2]) < 2e-3]
        pairs.append(np.stack([np.full(len(seen), number), seen], 1))
    both = np.concatenate(pairs).astype(np.int32)
    np.savez(
        folder / "points.npz",
        points=cloud,
        colours=np.full((len(cloud), 3), 128, np.uint8),
        view_index=both[:, 0],
        point_index=both[:, 1],
        errors=np.full(len(cloud), 0.5),
    )
    return Scene(Views(folder / "images", tuple(views)), folder / "points.npz", folder / "masks", inside, depths)
