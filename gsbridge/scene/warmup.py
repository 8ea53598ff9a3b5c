"""Compiling the kernels of shadows and of groups of splats once, so that environments side by side find them in the cache."""

from __future__ import annotations

import numpy as np

from gsbridge.cameras import Camera, look_at
from gsbridge.scene.groups import GroupedComposition
from gsbridge.scene.light import WIDTH, SkyLight, directions
from gsbridge.scene.occlusion import transmittances
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.view import draw_seen, pooled
from gsbridge.splats.cloud import Cloud


def compile_kernels() -> None:
    """Look at one splat, and dim one small picture; numba compiles and caches every kernel on the way."""
    count, ball = len(directions()), np.array([[0.0, 0.0, 0.2, 0.05]])
    camera, pose = Camera(16, 16, 16.0, 16.0, 8.0, 8.0), look_at(np.array([0.0, -0.1, 0.5]), np.zeros(3))
    picture, flat = np.ones((16, 16, 3), np.float32), np.ones((16, 16), np.float32)
    splat = Cloud(np.zeros((1, 3)), np.eye(4)[:1], np.full((1, 3), 0.01), np.ones(1), np.ones((1, 3)), np.zeros((1, 3, 3)))
    grouped = GroupedComposition({"object": splat})
    seen = grouped.see({"object": np.eye(4)}, camera, pose)
    pooled(*draw_seen(grouped.splats, seen, camera, (0.0, 0.0, 0.0), 1, antialiased=True), 2)
    shadows = Shadows(SkyLight(0.0, np.full(count, 1.0 / count)), {"link": ball}, ("object", ball))
    shadows.dim(picture, 0.5 * flat, flat, camera, pose, {"link": np.eye(4), "object": np.eye(4)})
    transmittances(np.zeros((1, 3)), ball, directions(), WIDTH)
