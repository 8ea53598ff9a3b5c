"""Photos of a ball, matt or glossy, shaded analytically, and how well splats show those that they were not trained on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from gsbridge.cameras import Camera, look_at, split_of
from gsbridge.configuration.splats import SplatSettings
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.meshes import Mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.binding import create_binding
from gsbridge.splats.evaluate import evaluate_cloud
from gsbridge.splats.exposure import Exposures
from gsbridge.splats.targets import Target

SIZE, RADIUS, VIEWS, SAMPLES = 40, 0.05, 48, 3
LAMP = np.array([0.5, -0.3, 0.81])
LAMP = LAMP / np.linalg.norm(LAMP)


def photo(eye: np.ndarray, camera: Camera, sheen: float, sharpness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A ball of Phong's shading, spotted and lit by one lamp: light, coverage and pose; each pixel is a mean."""
    pose = look_at(eye, np.zeros(3))
    fine = camera.scaled(SAMPLES)
    direction = fine.pixel_rays() @ pose[:3, :3]
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    along = -(direction @ eye)
    inside = along**2 - eye @ eye + RADIUS**2
    normal = (eye + direction * (along - np.sqrt(np.maximum(inside, 0)))[..., None]) / RADIUS
    spots = 0.5 + 0.35 * np.sin(8 * normal)
    light = spots * (0.25 + 0.5 * np.maximum(normal @ LAMP, 0))[..., None]
    mirrored = direction - 2 * (direction * normal).sum(-1, keepdims=True) * normal
    light = light + sheen * np.maximum(mirrored @ LAMP, 0)[..., None] ** sharpness
    cover = (inside > 0).astype(float)

    def mean(values: np.ndarray) -> np.ndarray:
        return values.reshape(SIZE, SAMPLES, SIZE, SAMPLES, -1).mean((1, 3))

    share = mean(cover)
    colour = mean(light * cover[..., None]) / np.maximum(share, 1e-6)
    return colour, share[..., 0], pose


def targets(sheen: float, sharpness: float = 6.0, gains: np.ndarray | None = None) -> list[Target]:
    """Photos from all round, at three heights; each in its own exposure where gains on linear light are given. [VIEWS, 3]."""
    camera = Camera(SIZE, SIZE, 75.0, 75.0, SIZE / 2, SIZE / 2)
    out = []
    for i in range(VIEWS):
        angle, rise = 2 * np.pi * i * 0.381966, (0.35, 0.7, 1.05)[i % 3]
        eye = 0.25 * np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
        light, share, pose = photo(eye, camera, sheen, sharpness)
        colour = srgb_from_linear(np.clip(light if gains is None else gains[i] * light, 0, 1))
        image, weight = np.rint(255 * colour).astype(np.uint8), np.rint(255 * share).astype(np.uint8)
        # Taken before black: the pixel holds the ball's part of the light.
        unedited = np.rint(255 * srgb_from_linear(np.clip(linear_from_srgb(colour) * share[..., None], 0, 1))).astype(np.uint8)
        out.append(Target(f"{i:04d}.png", split_of(i), camera, pose, image, weight, unedited, 0, 0, camera))
    return out


def held_out(
    photos: list[Target],
    folder: Path,
    *,
    degree: int = 0,
    steps: int = 400,
    kind: str = "soft",
    per_photo: bool = False,
    **options: Any,
) -> tuple[float, Exposures | None]:
    """Masked PSNR on the photos that the training did not see, dB, and the exposures that it found."""
    ball = trimesh.creation.icosphere(3, RADIUS)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    binding = create_binding(kind, mesh, 1, band=0.01, seed=0, sh_degree=degree)
    exposures = Exposures([target.name for target in photos if target.split == "train"]) if per_photo else None
    options |= {"exposures": exposures, "state": folder / f"{kind}{degree}{per_photo}"}
    trainer.train(binding, photos, SplatSettings(steps=steps), kind="object", seed=0, **options)
    found = None if exposures is None else exposures.found()
    metrics = evaluate_cloud(binding.evaluate(), photos, kind="object", exposures=found)
    return float(metrics["held_out"]["masked"]["psnr"]), exposures
