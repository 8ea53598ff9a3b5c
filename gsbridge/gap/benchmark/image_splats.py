"""Splats of the benchmark's world, fitted to effect-free photos as a scene is: what a simulation would show."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree

from gsbridge.cameras import Camera, camera_centre
from gsbridge.gap.benchmark.image_world import World
from gsbridge.geometry import Array
from gsbridge.images import srgb_from_linear
from gsbridge.scene.track import Track
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.rasterize import rasterize

_RATES = {"means": 3e-4, "logs": 0.02, "opacity": 0.05, "colours": 0.02}
"""Of the optimiser."""


def fit_splats(
    world: World, camera: Camera, views: list[tuple[Track, Array, Array]], seed: int, *, splats: int = 3000, steps: int = 500
) -> Cloud:
    """Splats that look like photos.

    Args:
        world: For where surfaces are, as a depth camera would tell.
        camera: Of the photos.
        views: Track, times and photos of every film.
        seed: Of places and order.
        splats: How many.
        steps: Photos looked at.
    """
    rng = np.random.default_rng(seed)
    poses = np.concatenate([track.at(times) for track, times, _ in views])
    photos = torch.from_numpy(np.concatenate([shot for _, _, shot in views]).astype(np.float32))
    means, seen = _surface(world, camera, poses, splats, rng)
    # As wide as the way to their neighbours, so that no hole is left.
    apart = cKDTree(means).query(means, 4)[0][:, 1:].mean(axis=1)
    leaves = {
        "means": torch.tensor(means, dtype=torch.float32),
        "logs": torch.tensor(np.log(0.6 * np.clip(apart, 2e-3, 0.05)), dtype=torch.float32)[:, None].repeat(1, 3),
        "opacity": torch.full((splats,), 2.0),
        "colours": torch.tensor(seen, dtype=torch.float32),
    }
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(splats, 1)
    for leaf in leaves.values():
        leaf.requires_grad_(True)
    optimiser = torch.optim.Adam([{"params": [leaf], "lr": _RATES[name]} for name, leaf in leaves.items()])
    order = rng.permutation(np.tile(np.arange(len(poses)), steps // len(poses) + 1))[:steps]
    for step, number in enumerate(order):
        share = 0.1 ** (step / steps)
        for group, rate in zip(optimiser.param_groups, _RATES.values(), strict=True):
            group["lr"] = rate * share
        optimiser.zero_grad()
        drawn = rasterize(
            leaves["means"], quats, leaves["logs"].exp(), torch.sigmoid(leaves["opacity"]), leaves["colours"],
            camera=camera, cam_from_table=poses[number],
        ).colours  # fmt: skip
        loss = ((drawn - photos[number]) ** 2).mean()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        parts = (leaves["means"], quats, leaves["logs"].exp(), torch.sigmoid(leaves["opacity"]), leaves["colours"].clamp(0, 1))
        return Cloud(*(part.numpy() for part in parts))


def _surface(world: World, camera: Camera, poses: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Places on surfaces that the photos show, and their encoded colours. [count, 3] each."""
    rays = camera.pixel_rays().reshape(-1, 3)
    per = -(-count // len(poses))
    places, colours = [], []
    for pose in poses:
        some = rays[rng.choice(len(rays), per)] + np.array([1.0, 1.0, 0.0]) * rng.normal(0, 0.5, (per, 3)) / camera.fx
        colour, place = world.look(np.broadcast_to(camera_centre(pose), some.shape), some @ pose[:3, :3])
        places.append(place)
        colours.append(srgb_from_linear(colour))
    keep = rng.permutation(per * len(poses))[:count]
    return np.concatenate(places)[keep], np.concatenate(colours)[keep]
