"""Compilation of the training kernels ahead of time, so that parallel jobs find them in the cache."""

from __future__ import annotations

import numpy as np
import torch

from gsbridge import logs
from gsbridge.cameras import Camera, look_at
from gsbridge.splats.losses import l1_ssim
from gsbridge.splats.rasterize import rasterize


def compile_kernels() -> None:
    """Compile and cache every kernel for one thread and, if the process may use more, for several threads."""
    for count in sorted({1, logs.threads()}):
        with logs.limited(count):
            _step()


def _step() -> None:
    """Take one training step on a few splats, so that numba compiles every kernel."""
    generator = torch.Generator().manual_seed(0)
    means = (0.1 * torch.rand(8, 3, generator=generator)).requires_grad_()
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(8, 1).requires_grad_()
    scales = torch.full((8, 3), 0.02, requires_grad=True)
    opacities = torch.full((8,), 0.5, requires_grad=True)
    colours = torch.rand(8, 3, generator=generator).requires_grad_()
    camera = Camera(32, 32, 40.0, 40.0, 16.0, 16.0)
    pose = look_at(np.array([0.3, 0.3, 0.3]), np.array([0.05, 0.05, 0.05]))
    harmonics = torch.zeros(8, 3, 3, requires_grad=True)
    rendering = rasterize(means, quats, scales, opacities, colours, camera=camera, cam_from_table=pose, harmonics=harmonics)
    loss = l1_ssim(rendering.colours, torch.zeros(32, 32, 3), weight=torch.ones(32, 32))
    (loss + rendering.alphas.mean() + rendering.depths.mean()).backward()
