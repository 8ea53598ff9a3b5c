"""Differentiable rendering of 3D Gaussians: one interface, three backends.

`cpu` runs anywhere, `cuda` needs gsplat and an NVIDIA device, `reference` is plain torch for tests.

A splat's covariance is mapped to the screen by the Jacobian of the projection at its centre (EWA splatting), and 0.3 px^2 is
added there. Alpha is clipped at 0.99 and set to 0 below 1/255. A pixel is finished once its transmittance is below 1e-4. Splats
are blended front to back by the camera z of their centres; equal depths keep the order of the splats.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsbridge.cameras import Camera, camera_centre
from gsbridge.errors import InputError
from gsbridge.geometry import Array

BACKENDS = ("cpu", "cuda", "reference")


@dataclass(frozen=True)
class Rendering:
    """Images of one view.

    Args:
        colours: RGB over the background. [H, W, 3].
        alphas: Share of the pixel's light that comes from splats, 0..1. [H, W].
        depths: Alpha-weighted sum of camera z, m; divide by `alphas` for a mean depth. [H, W].
    """

    colours: torch.Tensor
    alphas: torch.Tensor
    depths: torch.Tensor


def rasterize(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    *,
    camera: Camera,
    cam_from_table: Array,
    background: torch.Tensor | None = None,
    backend: str = "cpu",
    near: float = 0.01,
    harmonics: torch.Tensor | None = None,
) -> Rendering:
    """Render splats; gradients flow to the splats' tensors, not to camera or background.

    Splats with a value that is not finite are left out.

    Args:
        means: Centres, table frame, m. [N, 3].
        quats: Orientations wxyz, of any length except zero. [N, 4].
        scales: Standard deviations along the splat's axes, m. [N, 3].
        opacities: Opacity at the centre, 0..1. [N].
        colours: RGB 0..1. [N, 3].
        camera: Pinhole camera.
        cam_from_table: Pose of the camera. [4, 4].
        background: Colour behind the splats; None for black. [3].
        backend: `cpu`, `cuda` or `reference`.
        near: Smallest camera z of a centre, m.
        harmonics: Coefficients of the colours' dependence on viewing direction (`gsbridge.splats.harmonics`); None for no
            dependence. [N, K, 3].

    Returns:
        Colour, alpha and depth images.

    Raises:
        InputError: The backend is unknown or not available on this machine.
        ValueError: The shapes do not fit together, or the camera has distortion.
    """
    count = len(means)
    for name, tensor, shape in (
        ("means", means, (count, 3)),
        ("quats", quats, (count, 4)),
        ("scales", scales, (count, 3)),
        ("opacities", opacities, (count,)),
        ("colours", colours, (count, 3)),
    ):
        if tuple(tensor.shape) != shape:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}, expected {shape}")
    if not camera.is_pinhole:
        raise ValueError("the rasteriser needs a camera without distortion")
    if harmonics is not None:
        if harmonics.shape[:1] + harmonics.shape[2:] != (count, 3):
            raise ValueError(f"harmonics has shape {tuple(harmonics.shape)}, expected {(count, 'K', 3)}")
        colours = seen_colours(means, colours, harmonics, cam_from_table, kernels=backend == "cpu")
    arguments = (means, quats, scales, opacities, colours, camera, cam_from_table, background, near)
    if backend == "cpu":
        from gsbridge.splats.rasterize import cpu

        return Rendering(*cpu.rasterize(*arguments))
    if backend == "cuda":
        from gsbridge.splats.rasterize import cuda

        return Rendering(*cuda.rasterize(*arguments))
    if backend == "reference":
        from gsbridge.splats.rasterize import reference

        return Rendering(*reference.rasterize(*arguments))
    raise InputError("splats.backend", f"unknown backend '{backend}'", f"Use one of {', '.join(BACKENDS)}")


def seen_colours(
    means: torch.Tensor, colours: torch.Tensor, harmonics: torch.Tensor, cam_from_table: Array, *, kernels: bool = True
) -> torch.Tensor:
    """Return the colours of splats as one camera sees them, differentiable; with harmonics, `rasterize` does this first.

    Args:
        means, colours, harmonics: As in `rasterize`. [N, 3], [N, 3], [N, K, 3].
        cam_from_table: Pose of the camera. [4, 4].
        kernels: True for the compiled kernels, on the CPU; False for plain torch, on any device.
    """
    from gsbridge.splats.rasterize.directional import view_colours

    return view_colours(means, colours, harmonics, camera_centre(cam_from_table), kernels=kernels)
