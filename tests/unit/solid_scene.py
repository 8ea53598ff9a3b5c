"""Solids on a table, given by signed distances and drawn from formulas: photos, masks, depth and sparse points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from table_scene import Scene, photo

from gsbridge.cameras import Camera, View, Views, look_at, split_of
from gsbridge.geometry import Array
from gsbridge.images import write_image

Distance = Callable[[Array], Array]

POT_HEIGHT, POT_FOOT, POT_RIM, POT_WALL, POT_FLOOR = 0.05, 0.022, 0.033, 0.004, 0.006


def pot(p: Array) -> Array:
    """Signed distance of a flared pot that is open at the top, m. [N, 3] -> [N]."""
    rho, z = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
    slope = (POT_RIM - POT_FOOT) / POT_HEIGHT
    side = (rho - POT_FOOT - slope * z) / np.hypot(1.0, slope)
    outside = np.maximum(np.maximum(side, z - POT_HEIGHT), -z)
    return np.maximum(outside, -np.maximum(side + POT_WALL, POT_FLOOR - z))


def filled_pot(p: Array) -> Array:
    """The same pot, full to the rim."""
    rho, z = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
    slope = (POT_RIM - POT_FOOT) / POT_HEIGHT
    return np.maximum(np.maximum((rho - POT_FOOT - slope * z) / np.hypot(1.0, slope), z - POT_HEIGHT), -z)


def statue(p: Array) -> Array:
    """Signed distance of a narrow body on a wide plinth, m. [N, 3] -> [N]."""
    return np.minimum(_box(p, (0.0, 0.0, 0.008), (0.04, 0.04, 0.008)), _box(p, (0.0, 0.0, 0.05), (0.012, 0.012, 0.05)))


def gate(p: Array) -> Array:
    """Signed distance of a block with a window right through it, m. [N, 3] -> [N]."""
    return np.maximum(_box(p, (0.0, 0.0, 0.03), (0.035, 0.012, 0.03)), -_box(p, (0.0, 0.0, 0.032), (0.018, 0.05, 0.014)))


def block(p: Array) -> Array:
    """Signed distance of a block without any detail, m. [N, 3] -> [N]."""
    return _box(p, (0.0, 0.0, 0.025), (0.03, 0.02, 0.025))


def _box(p: Array, centre: tuple[float, ...], half: tuple[float, ...]) -> Array:
    q = np.abs(p - np.array(centre)) - np.array(half)
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


def around(camera: Camera, count: int, lifts_deg: tuple[float, ...], target: Array, distance: float = 0.3) -> list[View]:
    """Views on one circle, at the given heights in turn."""
    out = []
    for index in range(count):
        angle, lift = 2 * np.pi * index / count, np.deg2rad(lifts_deg[index % len(lifts_deg)])
        eye = target + distance * np.array([np.cos(angle) * np.cos(lift), np.sin(angle) * np.cos(lift), np.sin(lift)])
        out.append(View(f"{index:04d}.png", camera, look_at(eye, target), split_of(index)))
    return out


def traced(view: View, distance: Distance) -> tuple[Array, Array, Array]:
    """Points, depth and "on the solid" of every pixel. [H, W, 3], [H, W], [H, W]."""
    rays = (view.camera.pixel_rays() @ view.cam_from_table[:3, :3]).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    eye = view.centre
    table = -eye[2] / np.minimum(rays[:, 2], -1e-6)
    # Before the box that holds every solid here there is nothing to find.
    reach = np.full(len(rays), max(np.linalg.norm(eye) - 0.13, 0.0)) / length
    active = np.arange(len(rays))
    for _ in range(160):
        gap = distance(eye + reach[active, None] * rays[active])
        reach[active] += 0.9 * gap / length[active]
        active = active[(gap > 5e-5) & (reach[active] < table[active])]
    on = reach < table - 1e-6
    depth = np.where(on, reach, table)
    shape = (view.camera.height, view.camera.width)
    return (eye + depth[:, None] * rays).reshape(*shape, 3), depth.reshape(shape), on.reshape(shape)


def solid_scene(
    folder: Path, distance: Distance, views: list[View], *, plain: Callable[[Array], Array] | None = None, points: int = 30
) -> Scene:
    """Photograph a solid.

    Args:
        folder: Where the files go.
        distance: Its signed distance, m.
        views: The cameras.
        plain: Says which points of the solid have no texture and give no sparse point; None: all have. [N, 3] -> [N] bool.
        points: Sparse points on the solid, per view.
    """
    rng = np.random.default_rng(1)
    inside, depths, cloud = [], [], []
    for view in views:
        at, depth, on = traced(view, distance)
        picture = photo(at, on)
        usable = on.copy()
        if plain is not None:
            bare = on & plain(at.reshape(-1, 3)).reshape(on.shape)
            picture[bare] = 0.7
            usable &= ~bare
        write_image(folder / "images" / view.name, picture)
        write_image(folder / "masks" / view.name, on.astype(np.float32))
        inside.append(on)
        depths.append(depth)
        for wanted, number in ((usable, points), (~on & (np.abs(at[..., :2]).max(-1) < 0.2), 2 * points)):
            index = np.argwhere(wanted)
            pick = index[rng.choice(len(index), min(number, len(index)), replace=False)]
            cloud.append(at[pick[:, 0], pick[:, 1]])
    sparse = np.concatenate(cloud)
    sparse = sparse + rng.normal(0, 2e-4, sparse.shape)
    both = []
    for number, view in enumerate(views):
        local = sparse @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        pixel = np.nan_to_num(view.camera.project(local), nan=-1)
        inner = (pixel > 0).all(1) & (pixel < (view.camera.width, view.camera.height)).all(1)
        index = np.floor(pixel[inner]).astype(int)
        seen = np.flatnonzero(inner)[np.abs(depths[number][index[:, 1], index[:, 0]] - local[inner, 2]) < 2e-3]
        both.append(np.stack([np.full(len(seen), number), seen], 1))
    pairs = np.concatenate(both).astype(np.int32)
    np.savez(
        folder / "points.npz",
        points=sparse,
        colours=np.full((len(sparse), 3), 128, np.uint8),
        view_index=pairs[:, 0],
        point_index=pairs[:, 1],
        errors=np.full(len(sparse), 0.5),
    )
    return Scene(Views(folder / "images", tuple(views)), folder / "points.npz", folder / "masks", inside, depths)
