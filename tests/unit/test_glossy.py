"""A glossy ball and a matt one, shaded analytically: harmonics gain on the one and do not lose on the other."""

from __future__ import annotations

import numpy as np
import trimesh

from gsbridge.cameras import Camera, look_at, split_of
from gsbridge.configuration.splats import SplatSettings
from gsbridge.images import srgb_from_linear
from gsbridge.meshes import Mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.binding import create_binding
from gsbridge.splats.evaluate import evaluate_cloud
from gsbridge.splats.targets import Target

SIZE, RADIUS, VIEWS, SAMPLES = 40, 0.05, 48, 3
LAMP = np.array([0.5, -0.3, 0.81])
LAMP = LAMP / np.linalg.norm(LAMP)


def photo(eye: np.ndarray, camera: Camera, sheen: float, sharpness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A ball of Phong's shading, spotted and lit by one lamp: encoded colour, coverage and pose; each pixel is a mean."""
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
    return srgb_from_linear(np.clip(colour, 0, 1)), share[..., 0], pose


def targets(sheen: float, sharpness: float = 6.0) -> list[Target]:
    """Photos from all round, at three heights."""
    camera = Camera(SIZE, SIZE, 75.0, 75.0, SIZE / 2, SIZE / 2)
    out = []
    for i in range(VIEWS):
        angle, rise = 2 * np.pi * i * 0.381966, (0.35, 0.7, 1.05)[i % 3]
        eye = 0.25 * np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
        colour, share, pose = photo(eye, camera, sheen, sharpness)
        image, weight = np.rint(255 * colour).astype(np.uint8), np.rint(255 * share).astype(np.uint8)
        # Taken before black: the pixel holds the ball's part of the light.
        unedited = np.rint(255 * srgb_from_linear(np.clip(_linear(colour) * share[..., None], 0, 1))).astype(np.uint8)
        out.append(Target(f"{i:04d}.png", split_of(i), camera, pose, image, weight, unedited, 0, 0, camera))
    return out


def _linear(colour: np.ndarray) -> np.ndarray:
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def held_out(photos: list[Target], degree: int, folder, steps: int = 400, kind: str = "soft", **options) -> float:  # type: ignore[no-untyped-def]
    """Masked PSNR on the photos that the training did not see, dB."""
    ball = trimesh.creation.icosphere(3, RADIUS)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    binding = create_binding(kind, mesh, 1, band=0.01, seed=0, sh_degree=degree)
    trainer.train(binding, photos, SplatSettings(steps=steps), kind="object", seed=0, state=folder / str(degree), **options)
    return float(evaluate_cloud(binding.evaluate(), photos, kind="object")["held_out"]["masked"]["psnr"])


def test_degree_1_gains_on_a_glossy_ball(tmp_path) -> None:  # type: ignore[no-untyped-def]
    photos = targets(sheen=0.35)
    assert held_out(photos, 1, tmp_path) > held_out(photos, 0, tmp_path) + 0.5


def test_degree_1_loses_nothing_on_a_matt_ball(tmp_path) -> None:  # type: ignore[no-untyped-def]
    photos = targets(sheen=0.0)
    assert held_out(photos, 1, tmp_path) > held_out(photos, 0, tmp_path) - 0.1
